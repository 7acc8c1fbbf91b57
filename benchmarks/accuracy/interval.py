"""Whether 95 % intervals hold the truth in 95 %.

`python -m benchmarks.accuracy.interval [--records 2000] [--kinds ...]`. Each record is three days of a slab in weather
of its own, made by `benchmarks.reference.analytic_slab` (sine series, no part of wallid) after ten days that set its
initial profile, with errors of one kind. The true faces vary between the hourly rows too. The width is held against the
best possible: the Cramer-Rao bound with the covariance that the errors were drawn from, at the true diffusivity, with
the same unknowns.
"""

import argparse
import os
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from benchmarks.reference.analytic_slab import temperatures, weather

LENGTH, DIFFUSIVITY = 0.4, 7e-7  # m, m2/s
PLACES = (0.08, 0.2, 0.31)  # m
STEP, ROWS, BEFORE = 3600.0, 72, 240
PARTS = 12  # of each hour, between which the true faces are straight lines
NORMAL_95 = 1.959963984540054
MODES = 8


@dataclass(frozen=True)
class Errors:
    """What is wrong with a record's readings, as drawn; the case states the same sizes.

    Args:
        sensor, face: K, noise of each reading. memory: of the sensors' noise from row to row.
        position: m. offset: K. face_position: of the faces' sensors, m.
    """

    sensor: float
    face: float
    memory: float = 0.0
    position: float = 0.0
    offset: float = 0.0
    face_position: float = 0.0


KINDS = {
    "white": Errors(0.05, 0.002),
    "propagated": Errors(0.02, 0.1),
    "correlated": Errors(0.05, 0.002, memory=0.9),
    "positions": Errors(0.03, 0.01, position=0.005),
    "faces": Errors(0.03, 0.01, face_position=0.005),
    "all": Errors(0.05, 0.05, memory=0.7, position=0.005, offset=0.1),
}


def truth(
    faces: np.ndarray, places: np.ndarray, diffusivity: float = DIFFUSIVITY, ends: tuple[float, float] = (0.0, 0.0)
) -> np.ndarray:
    """Temperatures in the window, from faces that begin earlier and are so far to the right of where they should be.

    Args:
        faces: `PARTS` an hour.
    """
    length = LENGTH + ends[1] - ends[0]
    inside = temperatures(faces, STEP / PARTS, (places - ends[0]) / length, diffusivity / length**2)
    return at_rows(inside)[-ROWS:]


def at_rows(fine: np.ndarray) -> np.ndarray:
    """What is given `PARTS` times an hour, once an hour."""
    return fine[::PARTS]


def draw(errors: Errors, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """True faces with their past, `PARTS` an hour; measured faces and measured sensors of the window."""
    rng = np.random.default_rng([seed, 7])
    faces = weather((BEFORE + ROWS - 1) * PARTS + 1, STEP / PARTS, rng, hours=(8.0, 2.0))
    shift, offset = (size * rng.standard_normal(len(PLACES)) for size in (errors.position, errors.offset))
    noise = rng.standard_normal((ROWS + 200, len(PLACES)))
    if errors.memory:
        noise = lfilter([np.sqrt(1 - errors.memory**2)], [1.0, -errors.memory], noise, axis=0)
    face_noise = errors.face * rng.standard_normal((ROWS, 2))
    ends = errors.face_position * rng.standard_normal(2)
    inside = truth(faces, np.array(PLACES) + shift, ends=(ends[0], ends[1]))
    return faces, at_rows(faces)[-ROWS:] + face_noise, inside + offset + errors.sensor * noise[200:]


def best_std(errors: Errors, faces: np.ndarray) -> float:
    """The Cramer-Rao bound of ln(diffusivity): true covariance, true sensitivity, the unknowns' priors."""
    places, rate = np.array(PLACES), DIFFUSIVITY / LENGTH**2
    step = 1e-4
    slope = (truth(faces, places, DIFFUSIVITY * (1 + step)) - truth(faces, places, DIFFUSIVITY * (1 - step))) / (
        2 * step
    )
    C = np.kron(np.eye(len(places)), toeplitz(errors.memory ** np.arange(ROWS)))
    R = errors.sensor**2 * C
    pulse = np.zeros((ROWS + 1, 2))
    for side in (0, 1):
        pulse[:] = 0.0
        pulse[1, side] = 1.0
        answer = temperatures(pulse, STEP, places / LENGTH, rate)[1:]
        G = np.concatenate([np.tril(toeplitz(answer[:, s])) for s in range(len(places))])
        R += errors.face**2 * G @ G.T
    n, t = np.arange(1, MODES + 1), STEP * np.arange(ROWS)
    span = max(1.0, np.ptp(at_rows(faces)[-ROWS:]))
    modes = (
        np.sqrt(2)
        * np.sin(np.pi * np.outer(places / LENGTH, n))[:, None]
        * np.exp(-np.outer(t, rate * (n * np.pi) ** 2))
    )
    nuisance = [modes.reshape(-1, MODES) * (span / n)]
    each = np.kron(np.eye(len(places)), np.ones((ROWS, 1)))
    if errors.offset:
        nuisance.append(errors.offset * each)
    if errors.position:
        h = 1e-5
        gradient = (truth(faces, places + h) - truth(faces, places - h)) / (2 * h)
        nuisance.append(errors.position * each * gradient.T.reshape(-1, 1))
    if errors.face_position:
        for end in np.eye(2):
            h = 1e-5
            along = (truth(faces, places, ends=tuple(h * end)) - truth(faces, places, ends=tuple(-h * end))) / (2 * h)
            nuisance.append(errors.face_position * along.T.reshape(-1, 1))
    Z = np.concatenate(nuisance, axis=1)
    R += Z @ Z.T
    h = slope.T.reshape(-1)
    return float(1.0 / np.sqrt(h @ np.linalg.solve(R, h)))


def case_of(errors: Errors, faces: np.ndarray, readings: np.ndarray):
    """The record as a case of wallid."""
    import wallid
    from wallid.case.options import Choices

    time = STEP * np.arange(ROWS)
    names = tuple(f"T{s}" for s in range(len(PLACES)))
    record = wallid.Record(
        time, time, None, faces, readings, names,
        boundary_noise_std=errors.face, face_position_std=errors.face_position, file="benchmark",
    )  # fmt: skip
    sensors = tuple(
        wallid.Sensor(name, place, noise_std=errors.sensor, position_std=errors.position, offset_std=errors.offset)
        for name, place in zip(names, PLACES, strict=True)
    )
    wall = wallid.Wall(length=LENGTH, diffusivity_prior=4e-7)
    choices = Choices(model="lom", nodes=61)
    return wallid.Case("benchmark", Path("benchmark.toml"), wall, sensors, record, choices)


@dataclass(frozen=True)
class Row:
    """One record's end: ln(estimate/truth), its interval, the bound, and whether it is to be relied on."""

    error: float
    low: float
    high: float
    std: float
    best: float
    reliable: bool


def one(kind: str, seed: int, **choices) -> Row:
    """Draw a record, estimate, compare."""
    import wallid

    errors = KINDS[kind]
    faces, measured, readings = draw(errors, seed)
    case = case_of(errors, measured, readings)
    case = replace(case, choices=replace(case.choices, **choices))
    fit = wallid.estimate(case, None, wallid.full_order_model(case))
    low, high = np.log(np.array(fit.interval_95) / DIFFUSIVITY)
    return Row(
        float(np.log(fit.value / DIFFUSIVITY)), low, high, fit.std / fit.value, best_std(errors, faces), fit.reliable
    )


def many(kind: str, seeds: range, **choices) -> list[Row]:
    """Several records, in this process."""
    import jax

    jax.config.update("jax_enable_x64", True)
    return [one(kind, seed, **choices) for seed in seeds]


def summary(rows: list[Row]) -> dict[str, float]:
    """Coverage of the reliable intervals, their width over the best possible, and how the errors lie."""
    used = [row for row in rows if row.reliable]
    error, low, high, std, best = np.array([[r.error, r.low, r.high, r.std, r.best] for r in used]).T
    return {
        "coverage": float(np.mean((low <= 0) & (high >= 0))),
        "width": float(np.mean((high - low) / (2 * NORMAL_95 * best))),
        "scatter": float(np.sqrt(np.mean((error / best) ** 2))),
        "pull": float(np.std(error / std)),
        "bias": float(np.mean(error / std)),
        "uninformative": 1.0 - len(used) / len(rows),
    }


def table(records: int, kinds: list[str], processes: int, **choices) -> Iterator[str]:
    """The table's lines, as they are ready."""
    yield (
        "| errors | records | 95 % intervals that hold the truth | mean width over the best possible | "
        "scatter over the best | mean error in standard errors | uninformative | seconds |"
    )
    yield "|---|---|---|---|---|---|---|---|"
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        for kind in kinds:
            began = time.perf_counter()
            share = -(-records // processes)
            parts = [range(k * share, min(records, (k + 1) * share)) for k in range(processes)]
            rows = [row for done in pool.map(many, [kind] * processes, parts) for row in done]
            found = summary(rows)
            yield (
                f"| {kind} | {records} | {found['coverage']:.1%} | {found['width']:.2f} | {found['scatter']:.2f} | "
                f"{found['bias']:+.2f} | {found['uninformative']:.1%} | {time.perf_counter() - began:.0f} |"
            )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--records", type=int, default=2000)
    parser.add_argument("--kinds", nargs="+", choices=list(KINDS), default=list(KINDS))
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    given = parser.parse_args()
    for line in table(given.records, given.kinds, given.processes):
        print(line, flush=True)
