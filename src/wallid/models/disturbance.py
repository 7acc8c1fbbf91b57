"""A disturbance: heat that the model does not know, as a stationary Gaussian process.

The heat has a profile over the wall (`HeatProfile`), and its course adds states to a model in its modes:

    x' = Fo (A x + B q) + b d,      d = H z,      z' = F z + L w,      w white noise

`b` is the model's input of heat at that place, a column of `B0`. `d` is a Matern process:

    Matern 1/2:   F = -1/tau,                  H = 1,        k(t) = s^2 exp(-|t|/tau)
    Matern 3/2:   F = [[0, 1], [-l^2, -2 l]],  H = [1, 0],   k(t) = s^2 (1 + l |t|) exp(-l |t|),      l = sqrt(3)/tau

These states do not scale with Fo. The step from row to row is exact, and so is the covariance of what it adds.

Source: C. E. Rasmussen, C. K. I. Williams, Gaussian Processes for Machine Learning (2006), 4.2; S. Sarkka, A. Solin,
Applied Stochastic Differential Equations (2019), 6 and 12.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, ScalarLike

from .._internal.arrays import on_device
from .exponential_solver import step_map
from .state_space import StateSpace

Smoothness = Literal["matern-1/2", "matern-3/2"]
_FACES = 2  # the boundary temperatures, the first inputs
_FASTEST = 40.0  # decay of a mode within a row, beyond which it is taken as steady
_NODES, _WEIGHTS = (0.5 * part for part in np.polynomial.legendre.leggauss(10))
_NODES = _NODES + 0.5  # on [0, 1]


class MaternProcess(eqx.Module):
    """A stationary Gaussian process in time with a Matern covariance.

    Args:
        std: standard deviation.
        time_constant: tau, in the unit of the model's time.
        smoothness: "matern-1/2" (an Ornstein-Uhlenbeck process) or "matern-3/2" (once differentiable).
    """

    std: Float[Array, ""] = eqx.field(converter=on_device)
    time_constant: Float[Array, ""] = eqx.field(converter=on_device)
    smoothness: Smoothness = eqx.field(static=True, default="matern-1/2")

    @property
    def order(self) -> int:
        """The number of states."""
        return 1 if self.smoothness == "matern-1/2" else 2

    @property
    def rate(self) -> Float[Array, ""]:
        """`1/tau`, or `sqrt(3)/tau`: the rate at which the states decay."""
        return (1.0 if self.order == 1 else math.sqrt(3.0)) / self.time_constant

    @property
    def rate_matrix(self) -> Float[Array, "state state"]:
        """F."""
        rate = self.rate
        if self.order == 1:
            return -rate[None, None]
        return jnp.stack([jnp.stack([jnp.zeros_like(rate), jnp.ones_like(rate)]), jnp.stack([-(rate**2), -2 * rate])])

    @property
    def stationary_covariance(self) -> Float[Array, "state state"]:
        """The covariance of the states at any time."""
        variance = self.std**2
        return variance[None, None] if self.order == 1 else jnp.diag(jnp.stack([variance, variance * self.rate**2]))

    def spectral_density(self, frequency: Float[ArrayLike, " frequency"]) -> Float[Array, " frequency"]:
        """The variance for each unit of frequency, over positive frequencies alone: its integral is `std^2`.

            4 s^2 l / (l^2 + w^2),      8 s^2 l^3 / (l^2 + w^2)^2,      w = 2 pi f, l the rate

        Args:
            frequency: over the unit of the model's time.
        """
        omega, rate = 2.0 * jnp.pi * jnp.asarray(frequency), self.rate
        of_half = 4.0 * self.std**2 * rate / (rate**2 + omega**2)
        return of_half if self.order == 1 else of_half * 2.0 * rate**2 / (rate**2 + omega**2)

    def transition(self, time: ScalarLike) -> Float[Array, "state state"]:
        """`exp(F t)`."""
        decay = jnp.exp(-self.rate * time)
        if self.order == 1:
            return decay[None, None]
        return decay * (jnp.eye(2) + time * (self.rate_matrix + self.rate * jnp.eye(2)))

    def covariance(self, lag: Float[Array, "*lags"]) -> Float[Array, "*lags"]:
        """`k(t)`, for lags `t`."""
        decay = self.rate * jnp.abs(lag)
        return self.std**2 * jnp.exp(-decay) * (1.0 if self.order == 1 else 1.0 + decay)


class GaussianStep(eqx.Module):
    """The exact step from row to row of a linear model with Gaussian noise: `s_1 = Phi s_0 + W0 q_0 + W1 q_1 + e`.

    Args:
        transition: Phi, `(state, state)`.
        W0, W1: of the inputs at the start and at the end of the step, `(state, column)`.
        noise: Q, the covariance of e, `(state, state)`.
        initial: covariance of the states at the first row, `(state, state)`.
        stationary: the same long after it.
        C, D: outputs `y = C s + D q`, `(output, state)` and `(output, input)`.
    """

    transition: Float[Array, "state state"]
    W0: Float[Array, "state column"]
    W1: Float[Array, "state column"]
    noise: Float[Array, "state state"]
    initial: Float[Array, "state state"]
    stationary: Float[Array, "state state"]
    C: Float[Array, "output state"]
    D: Float[Array, "output input"]


def with_disturbance(system: StateSpace, process: MaternProcess, place: int) -> StateSpace:
    """The model with the states of a disturbance after its own.

    Args:
        system: in its modes (a diagonal A), with inputs of heat after the two boundary temperatures.
        process: of the heat, its time in t_ref.
        place: the input at which the heat enters; the inputs of heat are dropped.

    Returns:
        a state space with a full A, whose input are the boundary temperatures.
    """
    _check_heat_inputs(system)
    assert system.B0 is not None
    heat = system.B0[:, place]
    order, states = system.order, process.order
    size = order + states
    A = jnp.zeros((size, size)).at[jnp.arange(order), jnp.arange(order)].set(system.A)
    A0 = jnp.zeros((size, size)).at[:order, order].set(heat)
    A0 = A0.at[order:, order:].set(process.rate_matrix)
    if system.A0 is not None:
        A0 = A0.at[jnp.arange(order), jnp.arange(order)].add(system.A0)
    padding = ((0, states), (0, 0))
    return StateSpace(
        A=A,
        B=jnp.pad(system.B[:, :_FACES], padding),
        C=_outputs_with_process(system, place, states),
        D=system.D[:, :_FACES],
        P=jnp.pad(system.P, padding),
        A0=A0,
        C_theta=None if system.C_theta is None else jnp.pad(system.C_theta, ((0, 0), (0, states))),
        output_names=system.output_names,
        driven=system.driven[:_FACES],
    )


def without_heat(system: StateSpace) -> StateSpace:
    """The model with its two boundary temperatures as the only inputs."""
    B0 = None if system.B0 is None else system.B0[:, :_FACES]
    faces = system.driven[:_FACES]
    return dataclasses.replace(system, B=system.B[:, :_FACES], B0=B0, D=system.D[:, :_FACES], driven=faces)


def gaussian_step(
    system: StateSpace, fourier: ScalarLike, step: ScalarLike, process: MaternProcess, place: int, cubic: bool = True
) -> GaussianStep:
    """The exact step of a model with a disturbance, whose heat begins with the first row.

    The wall's states at the first row are those of the initial profile, so their covariance there is zero. With `f` the
    modes' rates, `P` the covariance of the states in a stationary state, by mode i and process state:

        P_iz = b_i H P_z (-f_i - F')^-1,      P_ij = -(b_i H P_jz' + P_iz H' b_j) / (f_i + f_j),      Q = P - Phi P Phi'

    Args:
        system: in its modes, with inputs of heat after the two boundary temperatures.
        fourier: Fo, 1.
        step: time between rows, in t_ref.
        process: of the heat, its time in t_ref.
        place: the input at which the heat enters.
        cubic: whether the boundary temperatures are cubics between rows; else straight lines.
    """
    # arrays, because JAX would compile again for each new Python number
    _check_heat_inputs(system)
    return _gaussian_step(system, on_device(fourier), on_device(step), process, jnp.asarray(place), cubic)


@eqx.filter_jit
def _gaussian_step(
    system: StateSpace, fourier: Array, step: Array, process: MaternProcess, place: Array, cubic: bool
) -> GaussianStep:
    assert system.B0 is not None
    rates = fourier * system.A + (0.0 if system.A0 is None else system.A0)
    heat, states = system.B0[:, place], process.order
    exact = step_map(without_heat(system), fourier, step, sensitivity=False, cubic=cubic)
    F, P_z, E = process.rate_matrix, process.stationary_covariance, process.transition(step)
    coupling = heat[:, None] * jax.vmap(lambda f: _integral(f, process, step)[0])(rates)
    to_process = jax.vmap(lambda f, b: jnp.linalg.solve((-f * jnp.eye(states) - F), P_z[:, 0]) * b)(rates, heat)
    both = heat[:, None] * to_process[None, :, 0]
    own = -(both + both.T) / (rates[:, None] + rates)
    stationary = jnp.block([[own, to_process], [to_process.T, P_z]])
    transition = jnp.block([[jnp.diag(exact.E), coupling], [jnp.zeros((states, len(rates))), E]])
    noise = stationary - transition @ stationary @ transition.T
    padding = ((0, states), (0, 0))
    return GaussianStep(
        transition=transition,
        W0=jnp.pad(exact.W0, padding),
        W1=jnp.pad(exact.W1, padding),
        noise=0.5 * (noise + noise.T),
        initial=jnp.zeros_like(stationary).at[len(rates) :, len(rates) :].set(P_z),
        stationary=stationary,
        C=_outputs_with_process(system, place, states),
        D=system.D[:, :_FACES],
    )


def _outputs_with_process(system: StateSpace, place: ScalarLike, states: int) -> Float[Array, "output state"]:
    """C, then the direct effect of the heat on the outputs through the process's first state."""
    return jnp.concatenate([system.C, system.D[:, place, None], jnp.zeros((len(system.C), states - 1))], axis=1)


def _integral(f: Array, process: MaternProcess, step: ScalarLike) -> Float[Array, "state state"]:
    """`int_0^h exp(f (h - s)) exp(F s) ds = (F - f)^-1 (exp(F h) - exp(f h))`; by quadrature where f is near -l."""
    identity = jnp.eye(process.order)
    near = jnp.abs(f + process.rate) * step < 1.0
    shifted = process.rate_matrix - jnp.where(near, 1.0, f) * identity  # F + l has no eigenvalue 1
    closed = jnp.linalg.solve(shifted, process.transition(step) - jnp.exp(f * step) * identity)
    values = [
        w * jnp.exp(f * step * (1.0 - s)) * process.transition(s * step) for s, w in zip(_NODES, _WEIGHTS, strict=True)
    ]
    return jnp.where(near, step * sum(values[1:], values[0]), closed)


def _check_heat_inputs(system: StateSpace) -> None:
    """Refuse a model without modes or without inputs of heat."""
    if not system.is_diagonal or system.B0 is None or system.B.shape[1] <= _FACES:
        raise ValueError("disturbance: the model must be in its modes, with inputs of heat (argument `heat`)")


def with_slow_modes(system: StateSpace, fourier: float, step: float) -> StateSpace:
    """The model without the modes that decay within a row; their steady part is added to D.

    A mode of rate f and input b is `-b q / f` where q changes slowly, with an error of 1 / (f times q's time constant).

    Args:
        system: in its modes.
        fourier: Fo, 1. step: time between rows, in t_ref.

    Returns:
        the model with a multiple of 8 modes, so that few programs are compiled; the whole model where all are slow.
    """
    rates = -np.asarray(system.A) * fourier * step
    slow = int(8 * np.ceil((np.count_nonzero(rates < _FASTEST) + 1) / 8))
    if slow >= system.order:
        return system
    order = np.argsort(rates)
    kept, left = np.sort(order[:slow]), order[slow:]
    A, B, C = (np.asarray(part) for part in (system.A, system.B, system.C))
    B0 = np.zeros_like(B) if system.B0 is None else np.asarray(system.B0)
    steady = C[:, left] @ ((B[left] + B0[left] / fourier) / -A[left, None])
    return dataclasses.replace(
        system,
        A=A[kept],
        B=B[kept],
        B0=None if system.B0 is None else on_device(B0[kept]),
        C=C[:, kept],
        D=np.asarray(system.D) + steady,
        P=np.asarray(system.P)[kept],
    )
