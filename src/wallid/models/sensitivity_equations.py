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

from .._internal.validation import one_of
from .integration import Integrator, Outputs, run_rows
from .state_space import StateSpace
from .window_inputs import WindowData


def run(
    system: StateSpace,
    fourier: ScalarLike,
    experiment: WindowData,
    *,
    sensitivity: bool = False,
    integrator: Integrator = "propagator",
) -> tuple[Outputs, Outputs | None]:
    """u and theta at the rows of an experiment."""
    given = system, fourier, experiment.step, experiment.inputs, experiment.initial
    return run_rows(*given, sensitivity=sensitivity, integrator=integrator)


def profile_response(
    system: StateSpace,
    fourier: ScalarLike,
    experiment: WindowData,
    initial: Float[Array, " param"],
    *,
    integrator: Integrator = "propagator",
) -> Outputs:
    """What an addition to the initial profile alone makes of u: the faces add nothing."""
    still = eqx.tree_at(lambda data: data.inputs, experiment, jnp.zeros_like(experiment.inputs))
    return run(system, fourier, still.starting_from(initial), integrator=integrator)[0]


def explicit(
    system: StateSpace, fourier: ScalarLike, experiment: WindowData, *, integrator: Integrator = "propagator"
) -> tuple[Outputs, Outputs]:
    """u and theta by the explicit theta system."""
    u, theta = run(system, fourier, experiment, sensitivity=True, integrator=integrator)
    assert theta is not None
    return u, theta


def autodiff(
    system: StateSpace, fourier: ScalarLike, experiment: WindowData, *, integrator: Integrator = "propagator"
) -> tuple[Outputs, Outputs]:
    """u and theta by forward-mode differentiation of u."""
    fourier = jnp.asarray(fourier, dtype=float)
    return jax.jvp(
        lambda fo: run(system, fo, experiment, integrator=integrator)[0], (fourier,), (jnp.ones_like(fourier),)
    )


def sensitivity(
    system: StateSpace,
    fourier: ScalarLike,
    data: WindowData,
    *,
    method: Literal["explicit", "autodiff"] = "explicit",
    integrator: Integrator = "propagator",
) -> tuple[Outputs, Outputs]:
    """The outputs `u` of a model and their sensitivity `theta = du/dFo` over a window.

    Args:
        system: a full-order or reduced-order model.
        fourier: Fo = t_ref alpha / L^2, 1.
        data: the window's inputs and initial profile, from `wallid.models.window_data`.
        method: "explicit" integrates the theta system beside the field; "autodiff" differentiates the integration of
            the field in forward mode. They agree to round-off.
        integrator: "propagator", the exact step from row to row, or "diffrax".

    Returns:
        `u` and `theta`, both `(time, output)`, 1.

    Raises:
        ValueError: another method.
    """
    one_of("method", method, ("explicit", "autodiff"))
    return (explicit if method == "explicit" else autodiff)(system, fourier, data, integrator=integrator)


@eqx.filter_custom_jvp
def field_with_theta(
    fourier: Float[Array, ""],
    initial: Float[Array, " param"],
    system: StateSpace,
    experiment: WindowData,
    integrator: Integrator,
) -> Outputs:
    """u from an initial profile; its derivative by Fo is the explicit theta.

    For solvers that ask autodiff for a Jacobian. In the initial profile u is linear.
    """
    return run(system, fourier, experiment.starting_from(initial), integrator=integrator)[0]


@field_with_theta.def_jvp
def _field_jvp(primals, tangents):
    fourier, initial, system, experiment, integrator = primals
    u, theta = explicit(system, fourier, experiment.starting_from(initial), integrator=integrator)
    change = jnp.zeros_like(u)
    if tangents[0] is not None:
        change = change + theta * tangents[0]
    if tangents[1] is not None:
        change = change + profile_response(system, fourier, experiment, tangents[1], integrator=integrator)
    return u, change
