"""The estimate of the validation case: Gauss-Newton from the prior to a relative change of 1e-8."""

from __future__ import annotations

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import least_squares

import wallid
from benchmarks.reference.integrators import by_lsim
from benchmarks.speed.measure import Prepared
from benchmarks.speed.works.direct import Direct
from benchmarks.speed.works.ratio import Asked, Results, faster
from benchmarks.speed.works.simulate import _direct
from wallid.inference.weighted_least_squares import WeightedFit, fit_weighted_least_squares

TITLE = "estimate, validation case: from 2.1e-7 m2/s, 2881 rows of 5 sensors"
START, ETA = 2.1e-7, 1e-8


def _ours(direct: Direct, system: wallid.StateSpace) -> Prepared:
    per_alpha = jnp.asarray(wallid.case.scales(direct.case).fourier_number(1.0))
    start, eta = jnp.asarray(START), jnp.asarray(ETA)

    def run() -> WeightedFit:
        return jax.block_until_ready(fit_weighted_least_squares(system, direct.data, per_alpha, start, eta))

    return Prepared(run, lambda fit: _error(START * np.exp(fit.parameters[0])))


def _error(alpha: float) -> dict[str, float]:
    """Against the minimum that SciPy finds with the exact solver, and against the truth."""
    return {"alpha over SciPy's": abs(float(alpha) / _reference() - 1), "truth": abs(float(alpha) / 5.21e-7 - 1)}


@cache
def _reference() -> float:
    return _by_scipy(1e-12)()


def _by_scipy(tolerance: float):
    direct = _direct()
    simulate = by_lsim(direct.nodal, *direct.arrays)
    scale, data = wallid.case.scales(direct.case), direct.data
    observed, weight = np.asarray(data.observed), np.asarray(data.weight)

    def residual(log_alpha: np.ndarray) -> np.ndarray:
        u, _ = simulate(scale.fourier_number(float(np.exp(log_alpha[0]))))
        return (weight * (scale.temperature_min + scale.temperature * u - observed)).ravel()

    def jacobian(log_alpha: np.ndarray) -> np.ndarray:
        fourier = scale.fourier_number(float(np.exp(log_alpha[0])))
        return (weight * scale.temperature * fourier * simulate(fourier)[1]).reshape(-1, 1)

    def run() -> float:
        found = least_squares(residual, [np.log(START)], jacobian, xtol=tolerance, ftol=tolerance, gtol=None)
        return float(np.exp(found.x[0]))

    return run


def _large() -> Prepared:
    direct = _direct()
    return _ours(direct, direct.nodal.modal())


def _reduced() -> Prepared:
    direct = _direct()
    return _ours(direct, direct.reduced)


CONTENDERS = {
    "LOM": _large,
    "MIM 5": _reduced,
    "least_squares on lsim": lambda: Prepared(_by_scipy(ETA), _error),
}
IN_TURNS = ("LOM", "MIM 5")


def asked(results: Results) -> list[Asked]:
    """What the issue asks."""
    return [faster(results, "MIM 5", "LOM", 3), faster(results, "MIM 5", "least_squares on lsim", 200)]
