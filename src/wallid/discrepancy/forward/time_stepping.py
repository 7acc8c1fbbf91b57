"""The integration by diffrax of a wall whose coefficients depend on temperature or time."""

from __future__ import annotations

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...models.integration import StepToRows
from ..effects.equation_terms import ForcingData, Terms
from .cells import Cells
from .implicit_solver import DiagonallyImplicit
from .nonlinear_wall import build_nonlinear_wall

MAX_SUBSTEP = 1200.0
"""Longest step of the implicit solver, s."""


def simulate_nonlinear_wall(
    wall: Cells,
    terms: Terms,
    forcing: ForcingData,
    diffusivity: Array,
    initial: Float[Array, " node"],
    *,
    substeps: int,
    solver: diffrax.AbstractSolver | None = None,
    controller: diffrax.AbstractAdaptiveStepSizeController | None = None,
) -> tuple[Float[Array, "time instrument"], Float[Array, "time instrument"]]:
    """Temperature (degC) and its rate (K/s) at the sensors of a nonlinear wall, then of the fluxes at plates (K/m).

    Args:
        wall: the cells.
        terms: the terms that depend on temperature or time.
        forcing: with the step and T0.
        diffusivity: m2/s.
        initial: state at the first row, degC.
        substeps: equal steps of the implicit solver between two rows.
        solver: another solver of diffrax, for comparison.
        controller: its step size controller; None steps from row to row.

    Returns:
        Temperatures and rates; NaN where the solver fails.
    """
    field = build_nonlinear_wall(wall, terms, forcing, diffusivity)
    times = jnp.arange(forcing.intervals + 1) * forcing.step
    if controller is None:
        steps: diffrax.AbstractStepSizeController = StepToRows(ts=times)
        save, max_steps = diffrax.SaveAt(t0=True, steps=True), forcing.intervals
    else:
        steps, save, max_steps = controller, diffrax.SaveAt(ts=times), 256 * len(times)
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(field),
        solver or DiagonallyImplicit(substeps),
        t0=0.0,
        t1=forcing.intervals * forcing.step,
        dt0=None,
        y0=initial,
        saveat=save,
        stepsize_controller=steps,
        adjoint=diffrax.ForwardMode(),
        max_steps=max_steps,
        throw=False,
    )
    assert solution.ys is not None
    return jax.vmap(field.observed)(times, solution.ys)
