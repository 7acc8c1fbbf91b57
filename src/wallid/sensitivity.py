"""The sensitivity theta = du/dFo two ways: the explicit theta system, and forward-mode autodiff.

`explicit` integrates `theta' = Fo A theta + A u + B q` beside the field; `autodiff` differentiates
the field's own integration. They agree to round-off, for large and reduced models; a reduced model
with a free H_theta has only the explicit one as its learned sensitivity.
"""

from __future__ import annotations

from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, ScalarLike

from .experiment import Experiment
from .simulate import Outputs, propagate, simulate
from .statespace import StateSpace

Integrator = Literal["propagator", "diffrax"]
"""How rows are stepped through: the fast scan, or `diffrax.diffeqsolve`; the same exact step."""


def run(
    system: StateSpace,
    fourier: ScalarLike,
    experiment: Experiment,
    *,
    sensitivity: bool = False,
    integrator: Integrator = "propagator",
) -> tuple[Outputs, Outputs | None]:
    """u and theta at the rows of an experiment.

    Raises:
        ValueError: an integrator that there is not.
    """
    if integrator == "propagator":
        return propagate(
            system, fourier, experiment.step, experiment.inputs, experiment.initial, sensitivity=sensitivity
        )
    if integrator == "diffrax":
        return simulate(
            system, fourier, experiment.time, experiment.inputs, experiment.initial, sensitivity=sensitivity
        )
    raise ValueError(f'integrator: {integrator!r}; it is "propagator" or "diffrax"')


def explicit(
    system: StateSpace, fourier: ScalarLike, experiment: Experiment, *, integrator: Integrator = "propagator"
) -> tuple[Outputs, Outputs]:
    """u and theta by the explicit theta system."""
    u, theta = run(system, fourier, experiment, sensitivity=True, integrator=integrator)
    assert theta is not None
    return u, theta


def autodiff(
    system: StateSpace, fourier: ScalarLike, experiment: Experiment, *, integrator: Integrator = "propagator"
) -> tuple[Outputs, Outputs]:
    """u and theta by forward-mode differentiation of u."""
    fourier = jnp.asarray(fourier, dtype=float)
    return jax.jvp(
        lambda fo: run(system, fo, experiment, integrator=integrator)[0], (fourier,), (jnp.ones_like(fourier),)
    )


@eqx.filter_custom_jvp
def field_with_theta(
    fourier: Float[Array, ""], system: StateSpace, experiment: Experiment, integrator: Integrator
) -> Outputs:
    """u, whose derivative by Fo is the explicit theta: for solvers that ask autodiff for a Jacobian."""
    return run(system, fourier, experiment, integrator=integrator)[0]


@field_with_theta.def_jvp
def _field_jvp(primals, tangents):
    fourier, system, experiment, integrator = primals
    u, theta = explicit(system, fourier, experiment, integrator=integrator)
    change = tangents[0]
    return u, jnp.zeros_like(theta) if change is None else theta * change
