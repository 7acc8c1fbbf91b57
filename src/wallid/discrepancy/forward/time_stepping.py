"""The course of a wall whose coefficients depend on temperature or time, stepped through diffrax."""

from __future__ import annotations

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...models.integration import ToRows
from ..effects.equation_terms import ForcingData, Terms
from .cells import Cells
from .implicit_solver import DiagonallyImplicit
from .nonlinear_wall import flow

LONGEST_SUBSTEP = 1200.0
"""Of the implicit solver, s."""


def stepped_course(
    wall: Cells,
    terms: Terms,
    campaign: ForcingData,
    diffusivity: Array,
    initial: Float[Array, " node"],
    *,
    substeps: int,
    solver: diffrax.AbstractSolver | None = None,
    controller: diffrax.AbstractAdaptiveStepSizeController | None = None,
) -> tuple[Float[Array, "time sensor"], Float[Array, "time sensor"]]:
    """Temperature (degC) and its rate (K/s) at the sensors, at each row, through diffrax.

    Args:
        substeps: of the implicit solver, equal steps between two rows.
        solver, controller: another of diffrax's and its steps, for comparison.
    """
    field = flow(wall, terms, campaign, diffusivity)
    times = jnp.arange(campaign.intervals + 1) * campaign.step
    if controller is None:
        steps: diffrax.AbstractStepSizeController = ToRows(ts=times)
        save, most = diffrax.SaveAt(t0=True, steps=True), campaign.intervals
    else:
        steps, save, most = controller, diffrax.SaveAt(ts=times), 256 * len(times)
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(field),
        solver or DiagonallyImplicit(substeps),
        t0=0.0,
        t1=campaign.intervals * campaign.step,
        dt0=None,
        y0=initial,
        saveat=save,
        stepsize_controller=steps,
        adjoint=diffrax.ForwardMode(),
        max_steps=most,
        throw=False,
    )
    assert solution.ys is not None
    return jax.vmap(field.reading)(times, solution.ys)
