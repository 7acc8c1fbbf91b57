"""The large model with effects in: from `Terms` to the readings that a campaign would give.

A wall whose terms are linear and constant in time is solved exactly in its modes, one step a row, for
faces that are monotone cubics between rows::

    m' = lambda m + b u(t),     m_1 = e^z m_0 + h sum_j j! phi_{j+1}(z) b c_j,     z = h lambda

(`phi` of `exponential.py`, `u = sum_j c_j s^j`). Any other goes through diffrax, by a linearly implicit
solver with sub-steps between the rows. Both share the wall's cells, faces and readings.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, ClassVar

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .effects import Campaign, Step, Terms, Wetting, latent_capacity
from .effects.source import SOURCE_WIDTH
from .exponential import phi_functions

_DAY = 86400.0
_LEAST_FACTOR = 0.05  # of a coefficient that depends on temperature or time, lest the equation lose its sense
_STENCIL = 4  # nodes of a reading
_ONSET = 1800.0  # s, in which a wetting sets in
LONGEST_SUBSTEP = 1200.0
"""Of the linearly implicit solver, s."""


class Cells(eqx.Module):
    """The wall's cells with the terms that do not change in time.

    The state are the inner nodes. `q` are the inputs: the two face readings, outdoor and indoor air, then
    the sources.

    Arguments:
        places: of all nodes, m.
        resistance: between nodes, films included, m of the wall's effective material.
        capacity: of the inner nodes, m of it.
        advection: velocity over the distance of a node's neighbours, 1/s.
        loss: 1/s.
        other: the inputs after the faces, at the nodes, per second.
        state: readings from the state. face: readings from the two face readings.
        course: coefficients of all inputs between rows.
    """

    places: Float[Array, " all"]
    resistance: Float[Array, " cell"]
    capacity: Float[Array, " node"]
    advection: Float[Array, " node"]
    loss: Float[Array, ""]
    other: Float[Array, "node channel"]
    state: Float[Array, "sensor node"]
    face: Float[Array, "sensor face"]
    course: Float[Array, "interval power input"]


def cells(terms: Terms, campaign: Campaign) -> Cells:
    """The wall's cells: resistances and capacities integrated over each, faces, readings and inputs.

    Resistances and capacities are scaled so that the wall's effective diffusivity `L^2 / (R C)` stays the
    one parameter whatever the layers and joints.
    """
    length = campaign.length - jnp.sum(terms.depth)
    shrink = length / campaign.length
    places = terms.depth[0] + shrink * campaign.places
    middles = 0.5 * (places[1:] + places[:-1])
    resistance = shrink * campaign.resistance
    for layer in terms.conductivity_steps:
        resistance = resistance * _stepped(places, Step(-layer.size, layer.place))
    for joint in terms.joints:
        resistance = resistance + joint.size * _hats(middles, joint.place)
    capacity = shrink * campaign.capacity
    bounds = jnp.concatenate([places[:1], middles, places[-1:]])
    for layer in terms.capacity_steps:
        capacity = capacity * _stepped(bounds, layer)
    whole = length / jnp.sum(resistance)
    resistance, film = whole * resistance, whole * terms.film  # a film's length is of the material itself, as a joint's
    capacity = capacity * (length / jnp.sum(capacity))

    # T_face = (1 - w) T_read + w T_first behind a film; the face's own half cell goes to the node next to it
    behind = film / (film + resistance[jnp.array([0, -1])])
    ends = jnp.array([0, -1])
    inner = capacity[1:-1].at[ends].add(behind * capacity[ends])
    readings = _readings(places, resistance, campaign.position + terms.position)
    state = readings[:, 1:-1].at[:, ends].add(behind * readings[:, ends])
    face = (1.0 - behind) * readings[:, ends]

    sources = [_profile(source.place, places, campaign.length) * source.rate for source in terms.sources]
    other = jnp.stack([jnp.broadcast_to(s, inner.shape) for s in (terms.loss[0], terms.loss[1], *sources)], axis=1)
    air = jnp.stack([campaign.outdoor, campaign.indoor], axis=-1)
    courses = [terms.faces, air, *(source.course[..., None] for source in terms.sources)]
    return Cells(
        places=places,
        resistance=resistance.at[ends].add(film),
        capacity=inner,
        advection=terms.velocity / (places[2:] - places[:-2]),
        loss=jnp.sum(terms.loss),
        other=other,
        state=state,
        face=face,
        course=jnp.concatenate(courses, axis=-1),
    )


def _stepped(edges: Array, step: Step) -> Array:
    """The mean over each cell of a factor `e^(-size/2)` left of a place and `e^(size/2)` right of it."""
    right = jnp.clip((edges[1:] - step.place) / jnp.diff(edges), 0.0, 1.0)
    return (1.0 - right) * jnp.exp(-0.5 * step.size) + right * jnp.exp(0.5 * step.size)


def _hats(points: Array, place: Array) -> Array:
    """Weights of points, with sum 1, whose centre is the place."""
    gaps = jnp.diff(points)
    rising = jnp.concatenate([jnp.ones(1), 1.0 - (points[1:] - place) / gaps])
    falling = jnp.concatenate([1.0 - (place - points[:-1]) / gaps, jnp.ones(1)])
    return jnp.clip(jnp.minimum(rising, falling), 0.0, 1.0)


def _profile(place: Array | None, places: Array, length: Array) -> Array:
    if place is None:
        return jnp.ones(places.shape[0] - 2)
    return jnp.exp(-0.5 * ((places[1:-1] - place) / (SOURCE_WIDTH * length)) ** 2)


def _readings(places: Array, resistance: Array, position: Array) -> Float[Array, "sensor all"]:
    """Weights of all nodes for each reading: cubic in the resistance passed, in which no joint makes a kink."""
    passed = jnp.concatenate([jnp.zeros(1), jnp.cumsum(resistance)])
    first = jnp.clip(jnp.searchsorted(places, position) - _STENCIL // 2, 0, places.shape[0] - _STENCIL)
    stencil = first[:, None] + jnp.arange(_STENCIL)
    nodes = passed[stencil]
    here = jnp.interp(position, places, passed)[:, None]
    weights = [
        math.prod((here[:, 0] - nodes[:, j]) / (nodes[:, i] - nodes[:, j]) for j in range(_STENCIL) if j != i)
        for i in range(_STENCIL)
    ]
    rows = jnp.zeros((position.shape[0], places.shape[0]))
    return rows.at[jnp.arange(position.shape[0])[:, None], stencil].set(jnp.stack(weights, axis=1))


def start(wall: Cells, campaign: Campaign, profile: Float[Array, " mode"]) -> Float[Array, " node"]:
    """The state at the first row: a straight line between the faces and sine modes, degC."""
    ends = wall.places[jnp.array([0, -1])]
    xi = (wall.places[1:-1] - ends[0]) / (ends[1] - ends[0])
    modes = jnp.sin(jnp.pi * xi[:, None] * jnp.arange(1, profile.shape[0] + 1))
    line = campaign.start_profile
    return line[0] + (line[1] - line[0]) * xi + modes @ profile


def _coefficients(wall: Cells, diffusivity: Array) -> tuple[Array, Array, Array]:
    """`lower, diagonal, upper` of the linear wall's rate, over all inner nodes; the ends belong to the faces."""
    conductance = diffusivity / wall.resistance
    lower = conductance[:-1] / wall.capacity + wall.advection
    upper = conductance[1:] / wall.capacity - wall.advection
    return lower, -(conductance[:-1] + conductance[1:]) / wall.capacity - wall.loss, upper


def _rows(course: Float[Array, "interval power input"], step: Array) -> tuple[Array, Array]:
    """Value and rate (per s) of the inputs at each row."""
    powers = jnp.arange(course.shape[1])[:, None]
    value = jnp.concatenate([course[:, 0], jnp.sum(course[-1:], axis=1)])
    rate = jnp.concatenate([course[:, 1], jnp.sum(powers * course[-1:], axis=1)]) / step
    return value, rate


class Modes(eqx.Module):
    """A linear wall in its modes: `m' = poles m + into f` for rates f at the nodes, `T = out m`."""

    poles: Float[Array, " mode"]
    into: Float[Array, "mode node"]
    out: Float[Array, "node mode"]
    inputs: Float[Array, "mode input"]

    def run(
        self, initial: Float[Array, " mode"], drive: Float[Array, "interval power mode"], step: Array
    ) -> Float[Array, "time mode"]:
        """The modes at each row, driven by polynomials between rows; exact."""
        E, *phis = phi_functions(step * self.poles, most=drive.shape[1])
        driven = sum((drive[:, j] * (step * math.factorial(j) * phi) for j, phi in enumerate(phis)), jnp.zeros(()))

        def advance(m: Array, driven: Array) -> tuple[Array, Array]:
            m = E * m + driven
            return m, m

        _, later = jax.lax.scan(advance, initial, driven)
        return jnp.concatenate([initial[None], later])


def modes(wall: Cells, diffusivity: Array) -> Modes:
    """The modes of a linear wall.

    `D^-1 A D` is symmetric for `d_{i+1}/d_i = sqrt(lower_{i+1}/upper_i)`: air flow leaves the modes real.
    """
    lower, diagonal, upper = _coefficients(wall, diffusivity)
    log_ratio = 0.5 * (jnp.log(lower[1:]) - jnp.log(upper[:-1]))
    scale = jnp.exp(jnp.concatenate([jnp.zeros(1), jnp.cumsum(log_ratio)]))
    beside = jnp.sqrt(lower[1:] * upper[:-1])
    poles, Q = jnp.linalg.eigh(jnp.diag(diagonal) + jnp.diag(beside, 1) + jnp.diag(beside, -1))
    into = Q.T / scale
    faces = jnp.zeros((lower.shape[0], 2)).at[0, 0].set(lower[0]).at[-1, 1].set(upper[-1])
    return Modes(poles, into, scale[:, None] * Q, into @ jnp.concatenate([faces, wall.other], axis=1))


def linear_course(
    wall: Cells, campaign: Campaign, diffusivity: Array, initial: Float[Array, " node"]
) -> tuple[Float[Array, "time sensor"], Float[Array, "time sensor"]]:
    """Temperature (degC) and its rate (K/s) at the sensors, at each row, of a linear wall."""
    system = modes(wall, diffusivity)
    m = system.run(system.into @ initial, wall.course @ system.inputs.T, campaign.step)
    q, q_rate = _rows(wall.course, campaign.step)
    c = wall.state @ system.out
    value = m @ c.T + q[:, :2] @ wall.face.T
    rate = (m * system.poles + q @ system.inputs.T) @ c.T + q_rate[:, :2] @ wall.face.T
    return value, rate


class _Nonlinear(eqx.Module):
    """The rate of a wall whose coefficients depend on temperature or time, as a diffrax vector field."""

    wall: Cells
    diffusivity: Array
    step: Array
    reference: Array
    conductivity_slope: Array
    capacity_slope: Array
    latent: tuple[Step, ...]
    drift: Array
    wettings: tuple[Wetting, ...]

    def inputs(self, t: Array) -> tuple[Array, Array]:
        """Inputs and their rates (per s) at a time."""
        course = self.wall.course
        interval = jnp.clip((t / self.step).astype(int), 0, course.shape[0] - 1)
        s = t / self.step - interval
        powers = jnp.arange(course.shape[1])
        here = course[interval]
        value = s**powers @ here
        slope = (powers[1:] * s ** powers[:-1]) @ here[1:]
        return value, slope / self.step

    def factor(self, t: Array) -> Array:
        """`s(t)`, by which the diffusivity differs from that of the first row."""
        factor = 1.0 + self.drift * t / _DAY
        for event in self.wettings:
            since = t - event.time
            onset = jnp.clip(0.5 + since / _ONSET, 0.0, 1.0)  # not at once, so that its time can be searched for
            decay = jnp.exp(-jnp.maximum(since, 0.0) / event.time_constant)
            factor = factor * (1.0 + event.jump * onset * decay)
        return jnp.maximum(factor, _LEAST_FACTOR)

    def coefficients(self, t: Array, T: Array, q: Array) -> tuple[Array, Array, Array]:
        """`lower, diagonal, upper` of the rate with the coefficients of this moment."""
        everywhere = jnp.concatenate([q[:1], T, q[1:2]])
        middle = 0.5 * (everywhere[1:] + everywhere[:-1]) - self.reference
        conductivity = jnp.maximum(1.0 + self.conductivity_slope * middle, _LEAST_FACTOR)
        more = 1.0 + self.capacity_slope * (T - self.reference) + latent_capacity(self.latent, T)
        capacity = self.wall.capacity * jnp.maximum(more, _LEAST_FACTOR)
        conductance = self.diffusivity * self.factor(t) * conductivity / self.wall.resistance
        lower = conductance[:-1] / capacity + self.wall.advection
        upper = conductance[1:] / capacity - self.wall.advection
        return lower, -(conductance[:-1] + conductance[1:]) / capacity - self.wall.loss, upper

    def rate(self, matrix: tuple[Array, Array, Array], T: Array, q: Array) -> Array:
        """`dT/dt` with these coefficients."""
        lower, diagonal, upper = matrix
        everywhere = jnp.concatenate([q[:1], T, q[1:2]])
        return lower * everywhere[:-2] + diagonal * T + upper * everywhere[2:] + self.wall.other @ q[2:]

    def __call__(self, t: Any, T: Array, args: Any) -> Array:
        """`dT/dt`."""
        q, _ = self.inputs(jnp.asarray(t))
        return self.rate(self.coefficients(jnp.asarray(t), T, q), T, q)

    def reading(self, t: Any, T: Array, args: Any) -> tuple[Array, Array]:
        """Temperature and its rate at the sensors."""
        q, q_rate = self.inputs(jnp.asarray(t))
        rate = self.rate(self.coefficients(jnp.asarray(t), T, q), T, q)
        return self.wall.state @ T + self.wall.face @ q[:2], self.wall.state @ rate + self.wall.face @ q_rate[:2]


def _flow(wall: Cells, terms: Terms, campaign: Campaign, diffusivity: Array) -> _Nonlinear:
    return _Nonlinear(
        wall,
        diffusivity,
        campaign.step,
        campaign.reference,
        terms.conductivity_slope,
        terms.capacity_slope,
        terms.latent,
        terms.drift,
        terms.wettings,
    )


class LinearlyImplicit(diffrax.AbstractSolver):
    """Two linear solves a step, second order for any matrix `W` near the Jacobian, damping at infinity::

        (1 - g h W) k_1 = f(t, y) + g h f_t
        (1 - g h W) k_2 = f(t + h, y + h k_1) - 2 k_1 - g h f_t,      y_1 = y + h (3 k_1 + k_2) / 2

    with `g = 1 - 1/sqrt(2)`, `W` the tridiagonal rate with the coefficients of the step's beginning, and
    `f_t` what the faces' and sources' change makes.

    Source: ROS2 of Verwer, Spee, Blom and Hundsdorfer, SIAM J. Sci. Comput. 20 (1999), 1456.
    """

    term_structure: ClassVar = diffrax.ODETerm
    interpolation_cls: ClassVar[Callable[..., diffrax.LocalLinearInterpolation]] = diffrax.LocalLinearInterpolation

    def order(self, terms):
        """Two."""
        return 2

    def init(self, terms, t0, t1, y0, args):
        """Nothing is kept from step to step."""
        return

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        """One step from t0 to t1."""
        flow: _Nonlinear = getattr(terms, "term", terms).vector_field
        start, end = jnp.asarray(t0), jnp.asarray(t1)
        h, gamma = end - start, 1.0 - 1.0 / math.sqrt(2.0)
        # just inside the step: at a row itself the courses may jump
        q0, q0_rate = flow.inputs(start + 1e-6 * h)
        q1, _ = flow.inputs(end - 1e-6 * h)
        lower, diagonal, upper = matrix = flow.coefficients(start, y0, q0)

        def solve(right: Array) -> Array:
            below, beside, above = (jnp.asarray(-gamma * h * part) for part in (lower, diagonal, upper))
            # the first and last of these belong to the faces
            return jax.lax.linalg.tridiagonal_solve(
                below.at[0].set(0.0), 1.0 + beside, above.at[-1].set(0.0), right[:, None]
            )[:, 0]

        inward = jnp.zeros_like(y0).at[0].add(lower[0] * q0_rate[0]).at[-1].add(upper[-1] * q0_rate[1])
        drive = gamma * h * (inward + flow.wall.other @ q0_rate[2:])
        k1 = solve(flow.rate(matrix, y0, q0) + drive)
        ahead = y0 + h * k1
        k2 = solve(flow.rate(flow.coefficients(end, ahead, q1), ahead, q1) - 2.0 * k1 - drive)
        y1 = y0 + 0.5 * h * (3.0 * k1 + k2)
        return y1, None, {"y0": y0, "y1": y1}, None, diffrax.RESULTS.successful

    def func(self, terms, t0, y0, args):
        """The rate, for diffrax's own use."""
        return terms.vf(t0, y0, args)


def nonlinear_course(
    wall: Cells,
    terms: Terms,
    campaign: Campaign,
    diffusivity: Array,
    initial: Float[Array, " node"],
    *,
    substeps: int,
    solver: diffrax.AbstractSolver = LinearlyImplicit(),  # noqa: B008 (immutable)
    controller: diffrax.AbstractAdaptiveStepSizeController | None = None,
) -> tuple[Float[Array, "time sensor"], Float[Array, "time sensor"]]:
    """Temperature (degC) and its rate (K/s) at the sensors, at each row, through diffrax.

    Arguments:
        substeps: equal steps between two rows.
        solver, controller: another of diffrax's, for comparison; an adaptive controller takes no `substeps`.
    """
    flow = _flow(wall, terms, campaign, diffusivity)
    rows = campaign.intervals + 1
    if controller is None:
        fine = jnp.arange(campaign.intervals * substeps + 1) * (campaign.step / substeps)
        steps: diffrax.AbstractStepSizeController = diffrax.StepTo(ts=fine)
        save, most, stride = diffrax.SaveAt(t0=True, steps=True, fn=flow.reading), fine.shape[0] - 1, substeps
    else:
        steps = controller
        save = diffrax.SaveAt(ts=jnp.arange(rows) * campaign.step, fn=flow.reading)
        most, stride = 256 * rows, 1
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(flow),
        solver,
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
    value, rate = solution.ys
    return value[::stride], rate[::stride]


def first_order(
    terms: Terms,
    change: Terms,
    campaign: Campaign,
    diffusivity: Array,
    profile: Float[Array, " mode"],
    *,
    substeps: int,
) -> Float[Array, "time sensor"]:
    """The derivative of the readings along a change that makes the wall nonlinear, at a linear wall.

    What the change adds to the rate at the linear wall's temperatures is a source of heat; its response is
    linear: the paper's sensitivity system once more, `theta' = A theta + df/dphi`.

    Arguments:
        terms: with the change at its neutral value.
        change: the terms' derivative along it.
        substeps: on whose straight lines the source lies between two rows.
    """
    wall = cells(terms, campaign)
    fine = eqx.tree_at(lambda w: w.course, wall, _finer(wall.course, substeps))
    step = campaign.step / substeps
    system = modes(wall, diffusivity)
    initial = system.into @ start(wall, campaign, profile)
    T = system.run(initial, fine.course @ system.inputs.T, step) @ system.out.T
    q, _ = _rows(fine.course, step)
    t = jnp.arange(T.shape[0]) * step

    def rate(some: Terms, t: Array, T: Array, q: Array) -> Array:
        flow = _flow(wall, some, campaign, diffusivity)
        return flow.rate(flow.coefficients(t, T, q), T, q)

    def source(t: Array, T: Array, q: Array) -> Array:
        return jax.jvp(lambda some: rate(some, t, T, q), (terms,), (change,))[1]

    f = jax.vmap(source)(t, T, q) @ system.into.T
    lines = jnp.stack([f[:-1], jnp.diff(f, axis=0)], axis=1)
    m = system.run(jnp.zeros_like(initial), lines, step)
    c = wall.state @ system.out
    value, slope = (m @ c.T)[::substeps], ((m * system.poles + f) @ c.T)[::substeps]
    still = jnp.zeros_like(value)
    return jax.jvp(lambda *course: readings(terms, campaign, *course), (still, still), (value, slope))[1]


def face_response(
    terms: Terms, faces: Float[Array, "interval power face"], campaign: Campaign, diffusivity: Array
) -> Float[Array, "time sensor"]:
    """What the readings of a linear wall make of a change of its faces, K."""
    wall = cells(terms, campaign)
    course = jnp.zeros_like(wall.course).at[:, :, :2].set(faces)
    still = jnp.zeros(wall.capacity.shape)
    driven = linear_course(eqx.tree_at(lambda w: w.course, wall, course), campaign, diffusivity, still)
    rest = tuple(jnp.zeros_like(part) for part in driven)
    return jax.jvp(lambda *course: readings(terms, campaign, *course), rest, driven)[1]


def _finer(course: Float[Array, "interval power input"], parts: int) -> Float[Array, "part power input"]:
    """The same polynomials on equal parts of each interval: `s = (i + r)/parts`."""
    powers = course.shape[1]
    shift = np.zeros((parts, powers, powers))
    for i in range(parts):
        for j in range(powers):
            for k in range(j + 1):
                shift[i, k, j] = math.comb(j, k) * (i / parts) ** (j - k) / parts**k
    return jnp.einsum("ikj,njq->nikq", jnp.asarray(shift), course).reshape(-1, powers, course.shape[2])


def readings(
    terms: Terms, campaign: Campaign, value: Float[Array, "time sensor"], rate: Float[Array, "time sensor"]
) -> Float[Array, "time sensor"]:
    """What the sensors and their logger make of the temperatures at their places, degC."""
    value, rate = _delayed(value, rate, terms.delay, campaign.step)
    value = _lagged(value, rate, terms.lag, campaign.step)
    days = jnp.arange(value.shape[0])[:, None] * (campaign.step / _DAY)
    return value + terms.gain * (value - campaign.reference) + terms.offset + terms.rate * days


def _hermite(value: Array, rate: Array, step: Array) -> Float[Array, "interval power sensor"]:
    """Cubics through values and rates at the rows, in powers of s."""
    low, high = value[:-1], value[1:]
    out, into = step * rate[:-1], step * rate[1:]
    return jnp.stack([low, out, 3 * (high - low) - 2 * out - into, 2 * (low - high) + out + into], axis=1)


def _delayed(value: Array, rate: Array, delay: Array, step: Array) -> tuple[Array, Array]:
    """`T(t - delay)` and its rate, from the cubics; beyond the record on straight lines."""
    cubics = _hermite(value, rate, step)
    place = jnp.arange(value.shape[0]) - delay / step
    interval = jnp.clip(jnp.floor(place).astype(int), 0, cubics.shape[0] - 1)
    s = place - interval
    inside = jnp.where(s < 0.0, 0.0, jnp.where(s > 1.0, 1.0, s))  # not `clip`, whose slope is halved at its ends
    c0, c1, c2, c3 = (cubics[interval, j] for j in range(4))
    x = inside[:, None]
    slope = c1 + x * (2 * c2 + x * 3 * c3)
    return c0 + x * (c1 + x * (c2 + x * c3)) + slope * (s - inside)[:, None], slope / step


def _lagged(value: Array, rate: Array, lag: Array, step: Array) -> Array:
    """`lag y' + y = T` with T the cubics, exactly: with `s = lag/h`, `psi_j = int_0^1 e^(-(1-x)/s) x^j dx / s`::

    y_1 = e^(-1/s) y_0 + sum_j psi_j c_j,      psi_0 = 1 - e^(-1/s),      psi_j = 1 - j s psi_{j-1}

    and at lag 0 exactly T. For lags longer than a step from the phi-functions, which lose no digits there.
    """
    cubics = _hermite(value, rate, step)
    s = lag / step
    quick = s < 1.0
    safe = jnp.where(s > 1e-3, s, 1.0)
    keep = jnp.where(s > 1e-3, jnp.exp(-1.0 / safe), 0.0)
    short = [1.0 - keep]
    for j in range(1, 4):
        short.append(1.0 - j * jnp.where(quick, s, 0.0) * short[-1])
    pace = 1.0 / jnp.where(quick, 1.0, s)
    _, *phis = phi_functions(-pace, most=4)
    weights = [
        jnp.where(quick, near, pace * math.factorial(j) * phi)
        for j, (near, phi) in enumerate(zip(short, phis, strict=True))
    ]
    drive = sum((cubics[:, j] * weight for j, weight in enumerate(weights)), jnp.zeros(()))

    def follow(y: Array, driven: Array) -> tuple[Array, Array]:
        y = keep * y + driven
        return y, y

    _, later = jax.lax.scan(follow, value[0], drive)
    return jnp.concatenate([value[:1], later])


def respond(
    terms: Terms,
    campaign: Campaign,
    diffusivity: Array,
    profile: Float[Array, " mode"],
    *,
    linear: bool,
    substeps: int = 1,
) -> Float[Array, "time sensor"]:
    """The inner sensors' readings with everything in `terms`, degC.

    Arguments:
        diffusivity: m2/s; with layers or joints the wall's effective one.
        profile: amplitudes of the sine modes of the initial profile, K.
        linear: solve exactly in modes; False goes through diffrax.
        substeps: of the latter, between two rows.
    """
    wall = cells(terms, campaign)
    initial = start(wall, campaign, profile)
    if linear:
        value, rate = linear_course(wall, campaign, diffusivity, initial)
    else:
        value, rate = nonlinear_course(wall, terms, campaign, diffusivity, initial, substeps=substeps)
    return readings(terms, campaign, value, rate)
