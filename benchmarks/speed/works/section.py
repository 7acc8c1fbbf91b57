"""The estimate through a section of stones and mortar with its reduced model, beside the full-order model."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd

import wallid
from benchmarks.reference.analytic_slab import weather
from benchmarks.reference.section_full_order import FullOrderModel
from benchmarks.reference.stone_section import LENGTH, POINTS, in_elements, stone_section
from benchmarks.speed.measure import Prepared
from benchmarks.speed.works.ratio import Asked, Results, faster
from wallid.estimation.diffusivity import estimate_by_gls
from wallid.inference.gls_fit import GLSFit
from wallid.inference.likelihood import LikelihoodProblem, Minimum, minimise

TITLE = "estimate through a section of 9,951 cells, 30 days of hours, 3 sensors of known heights"
STEP = 0.0022  # m, of the mesh beside a joint: 9,951 cells
DAYS, BEFORE, FINE, ROW = 30, 4, 300.0, 3600.0  # days, days, s, s
FACTOR = 1.25  # of the true conductivities over the stated ones
SENSOR_STD, FACE_STD, POSITION_STD = 0.05, 0.02, 0.002  # K, K, m
ETA, MOST = 1e-6, 100  # stopping criterion, evaluations
FROM_REDUCED = "ln(alpha) from the reduced model's, standard errors"


@cache
def case() -> wallid.Case:
    """A record by finite elements between smooth faces."""
    rng, stride = np.random.default_rng(2907), round(ROW / FINE)
    faces = weather(round((DAYS + BEFORE) * 86400.0 / FINE) + 1, FINE, rng, hours=(8.0, 2.0))
    places = np.array([(point.x + POSITION_STD * rng.standard_normal(), point.y) for point in POINTS])
    inside = in_elements(0.02, FACTOR).temperatures(faces, FINE, places, stride)
    readings = np.concatenate([faces[::stride], inside], axis=1)[round(BEFORE * 86400.0 / ROW) :]
    readings += np.array([FACE_STD] * 2 + [SENSOR_STD] * 3) * rng.standard_normal(readings.shape)
    frame = pd.DataFrame(readings, columns=["left", "right", *(point.name for point in POINTS)])
    frame.insert(0, "time", ROW * np.arange(len(frame)))
    section = stone_section(STEP)
    sensors = [
        wallid.Sensor(point.name, point.x, noise_std=SENSOR_STD, position_std=POSITION_STD, height=point.y)
        for point in POINTS
    ]
    return wallid.Case.from_dataframe(
        frame, time="time", left="left", right="right", wall=wallid.Wall(LENGTH, section.diffusivity_prior),
        sensors=sensors, section=section, model="lom", boundary_noise_std=FACE_STD,
    )  # fmt: skip


@cache
def fit() -> GLSFit:
    """The whole estimate's last round, with the noise covariance that all fits below keep."""
    own = case()
    window, model = wallid.Window(0, own.record.rows), wallid.full_order_model(own)
    return estimate_by_gls(own, window, model, own.wall.diffusivity_prior, own.choices.eta)[1]


class SteppedProblem(LikelihoodProblem):
    """The same cost with the temperatures and sensitivities of another model, by their function of alpha in m2/s."""

    response: Callable[[float], tuple[np.ndarray, np.ndarray]] = eqx.field(static=True, kw_only=True)

    def predicted(self, y: jax.Array) -> jax.Array:
        """The predicted readings at the rows, degC: the other model's temperatures take the reduced one's place."""
        data = self.data
        reduced, _ = wallid.models.propagate(self.system, self.fourier(y), data.step, data.inputs, data.initial)
        other = _differentiable(self.response, data.observed.shape)(self.start * jnp.exp(y[0]))
        return super().predicted(y) + data.temperature * (other - reduced)


def _differentiable(response: Callable, shape: tuple[int, ...]) -> Callable[[jax.Array], jax.Array]:
    """Temperatures as a function of alpha that JAX can differentiate, by the derivatives by ln(alpha) beside them."""
    like = jax.ShapeDtypeStruct(shape, float)

    def both(diffusivity: jax.Array) -> tuple[jax.Array, jax.Array]:
        return jax.pure_callback(response, (like, like), diffusivity, vmap_method="sequential")

    @jax.custom_jvp
    def temperatures(diffusivity: jax.Array) -> jax.Array:
        return both(diffusivity)[0]

    @temperatures.defjvp
    def _(primals: tuple, tangents: tuple) -> tuple[jax.Array, jax.Array]:
        u, by_log = both(primals[0])
        return u, by_log * (tangents[0] / primals[0])

    return temperatures


def _gauss_newton(problem: LikelihoodProblem) -> Prepared:
    """Gauss-Newton from the prior, the covariance and all else as in the last round of the estimate."""
    first = jnp.zeros(len(problem.parameters))  # the prior
    eta = jnp.asarray(ETA)

    def run() -> Minimum:
        return jax.block_until_ready(minimise(problem, first, eta, MOST))

    def error(found: Minimum) -> dict[str, float]:
        reduced = minimise(fit().problem, first, eta, MOST)
        away = abs(float(found.vector[0] - reduced.vector[0])) / fit().log_std
        return {FROM_REDUCED: away, "iterations": float(found.trace.count) - 1.0}

    return Prepared(run, error)


def _stepped_problem() -> LikelihoodProblem:
    own, model = fit().problem, FullOrderModel(case())
    model.response(float(own.start), own.data)  # what is computed once
    return SteppedProblem(**vars(own), response=lambda diffusivity: model.response(float(diffusivity), own.data))


def _estimate(model: Callable[[], wallid.StateSpace] | None = None) -> Prepared:
    """The whole estimate; a model other than the reduced one is made anew in each run."""
    own = case()

    def run() -> wallid.Estimate:
        return wallid.estimate(own, model=None if model is None else model())

    def error(found: wallid.Estimate) -> dict[str, float]:
        reduced = wallid.estimate(own)
        return {FROM_REDUCED: abs(np.log(found.value / reduced.value)) * reduced.value / reduced.std}

    return Prepared(run, error, once=model is not None)


CONTENDERS = {
    "Gauss-Newton, reduced": lambda: _gauss_newton(fit().problem),
    "Gauss-Newton, full order in steps": lambda: _gauss_newton(_stepped_problem()),
    "whole estimate, reduced": _estimate,
    "whole estimate, full order in all its modes": lambda: _estimate(FullOrderModel(case()).in_modes),
}


def asked(results: Results) -> list[Asked]:
    """What the issue asks."""
    return [
        faster(results, "Gauss-Newton, reduced", "Gauss-Newton, full order in steps", 1000),
        faster(results, "whole estimate, reduced", "whole estimate, full order in all its modes", 50),
    ]
