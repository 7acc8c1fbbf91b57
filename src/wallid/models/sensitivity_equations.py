"""The sensitivity theta = du/dFo of a model: by its explicit system, and by forward-mode automatic differentiation.

`explicit` integrates `x_theta' = Fo A x_theta + A x + B q` together with the field; `autodiff` differentiates the
integration of the field. They agree to round-off, except for a reduced-order model with an H_theta of its own, whose
learned sensitivity is the explicit one.
"""

from __future__ import annotations

from typing import Literal

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, ScalarLike

from .._internal.validation import one_of
from .integration import FORWARD, Integrator, Outputs, run_rows
from .state_space import StateSpace
from .window_inputs import WindowData


def simulate_window(
    system: StateSpace,
    fourier: ScalarLike,
    data: WindowData,
    *,
    sensitivity: bool = False,
    integrator: Integrator = "propagator",
    adjoint: diffrax.AbstractAdjoint = FORWARD,
) -> tuple[Outputs, Outputs | None]:
    """u and theta at the rows of a window; theta is None without `sensitivity`."""
    inputs = data.step, data.inputs, data.initial
    return run_rows(system, fourier, *inputs, sensitivity=sensitivity, integrator=integrator, adjoint=adjoint)


def profile_response(
    system: StateSpace,
    fourier: ScalarLike,
    data: WindowData,
    initial: Float[Array, " param"],
    *,
    integrator: Integrator = "propagator",
) -> Outputs:
    """The response of u to a change of the initial profile alone, with constant zero inputs."""
    no_inputs = eqx.tree_at(lambda data: data.inputs, data, jnp.zeros_like(data.inputs))
    return simulate_window(system, fourier, no_inputs.starting_from(initial), integrator=integrator)[0]


def explicit(
    system: StateSpace,
    fourier: ScalarLike,
    data: WindowData,
    *,
    integrator: Integrator = "propagator",
    adjoint: diffrax.AbstractAdjoint = FORWARD,
) -> tuple[Outputs, Outputs]:
    """u and theta by the explicit theta system."""
    u, theta = simulate_window(system, fourier, data, sensitivity=True, integrator=integrator, adjoint=adjoint)
    assert theta is not None
    return u, theta


def autodiff(
    system: StateSpace,
    fourier: ScalarLike,
    data: WindowData,
    *,
    integrator: Integrator = "propagator",
    adjoint: diffrax.AbstractAdjoint = FORWARD,
) -> tuple[Outputs, Outputs]:
    """u and theta by forward-mode differentiation of u."""
    fourier = jnp.asarray(fourier, dtype=float)
    return jax.jvp(
        lambda fo: simulate_window(system, fo, data, integrator=integrator, adjoint=adjoint)[0],
        (fourier,),
        (jnp.ones_like(fourier),),
    )


def sensitivity(
    system: StateSpace,
    fourier: ScalarLike,
    data: WindowData,
    *,
    method: Literal["explicit", "autodiff"] = "explicit",
    integrator: Integrator = "propagator",
    adjoint: diffrax.AbstractAdjoint = FORWARD,
) -> tuple[Outputs, Outputs]:
    """The outputs `u` of a model and their sensitivity `theta = du/dFo` over a window.

    Args:
        system: a full-order or reduced-order model.
        fourier: Fo = t_ref alpha / L^2, 1.
        data: the window's inputs and initial profile, from `wallid.models.window_data`.
        method: "explicit" integrates the theta system beside the field; "autodiff" differentiates the integration of
            the field in forward mode. They agree to round-off.
        integrator: "propagator", the exact step from row to row, or "diffrax".
        adjoint: of diffrax, as in `wallid.simulate`: how the results are differentiated again. "autodiff" needs one for
            forward mode: `ForwardMode()` or, for reverse mode too, `DirectAdjoint()`.

    Returns:
        `u` and `theta`, both `(time, output)`, 1.

    Raises:
        ValueError: another method, or an adjoint for the propagator, which needs none.
    """
    one_of("method", method, ("explicit", "autodiff"))
    if integrator == "propagator" and adjoint is not FORWARD:
        raise ValueError('sensitivity: adjoint is for integrator = "diffrax"; the propagator needs none: omit it')
    by_method = explicit if method == "explicit" else autodiff
    return by_method(system, fourier, data, integrator=integrator, adjoint=adjoint)


@eqx.filter_custom_jvp
def field_with_theta(
    fourier: Float[Array, ""],
    initial: Float[Array, " param"],
    system: StateSpace,
    data: WindowData,
    integrator: Integrator,
) -> Outputs:
    """u from an initial profile; its derivative by Fo is the explicit theta.

    For solvers that take a Jacobian by autodiff. u is linear in the initial profile.
    """
    return simulate_window(system, fourier, data.starting_from(initial), integrator=integrator)[0]


@field_with_theta.def_jvp
def _field_jvp(primals, tangents):
    fourier, initial, system, data, integrator = primals
    u, theta = explicit(system, fourier, data.starting_from(initial), integrator=integrator)
    change = jnp.zeros_like(u)
    if tangents[0] is not None:
        change = change + theta * tangents[0]
    if tangents[1] is not None:
        change = change + profile_response(system, fourier, data, tangents[1], integrator=integrator)
    return u, change
