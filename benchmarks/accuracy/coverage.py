"""Whether 95 % intervals hold the truth however the faces move between rows: `python -m benchmarks.accuracy.coverage`.

Each record is a slab between faces that are known to its simulator every minute: sine series, exact in time between
these minutes, no part of wallid. The record has a row every 10, 30 or 60 minutes. Between the rows the true faces are
smooth (weather with time constants of 8 and 2 hours), straight lines, or gusty (the smooth ones, and gusts of 15
minutes). `estimate` has three days of each. `diagnose`, and the test of the entire record that `run` makes, have two
weeks. The width is held against the best possible: the Cramer-Rao bound with the covariance of the readings, in which
the faces between rows are a Gaussian process of the true kind, known at its noisy rows.

Each record's outcome is appended to a log of JSON lines, so that a long run goes on where it ended.
"""

import argparse
import json
import os
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from functools import lru_cache
from itertools import product
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from scipy.linalg import cho_factor, cho_solve, toeplitz
from scipy.signal import lfilter

from benchmarks.reference.analytic_slab import temperatures, weather

LENGTH, DIFFUSIVITY = 0.4, 7e-7  # m, m2/s
PLACES = np.array([0.08, 0.2, 0.31])  # m
SENSOR_STD, FACE_STD = 0.05, 0.02  # K
FINE = 60.0  # s, between the times at which the simulator knows the faces
HOURS = (8.0, 2.0)  # time constants of smooth weather
SIZES = np.array([0.4, 1.0])  # K, of the weather at both faces, as in `weather`
GUST, GUST_HOURS = np.array([0.1, 0.3]), 0.25  # K at both faces; memory
BEFORE = 10.0  # days that set the initial profile
DAYS = {"estimate": 3.0, "diagnose": 14.0}
COURSES = ("smooth", "straight", "gusty")
STEPS = (600.0, 1800.0, 3600.0)  # s
NOISES = {"white": 0.0, "ar": 0.8}  # correlation from row to row
SEED = 2026  # fixed before the first record was estimated
MODES = 8
NORMAL_95 = 1.959963984540054


@dataclass(frozen=True)
class Kind:
    """Records of one kind: the command, the faces between rows, the step from row to row (s), the noise."""

    command: str
    course: str
    step: float
    noise: str

    @property
    def rows(self) -> int:
        return round(DAYS[self.command] * 86400.0 / self.step)

    @property
    def stride(self) -> int:
        """Fine times from row to row."""
        return round(self.step / FINE)


def faces(kind: Kind, rng: np.random.Generator) -> np.ndarray:
    """The true faces every minute, with their past, degC."""
    before = round(BEFORE * 86400.0 / FINE)
    count = before + (kind.rows - 1) * kind.stride + 1
    fine = weather(count, FINE, rng, hours=HOURS)
    if kind.course == "gusty":
        memory = np.exp(-FINE / 3600.0 / GUST_HOURS)
        draws = rng.standard_normal((count + 500, 2))
        fine += GUST * lfilter([np.sqrt(1 - memory**2)], [1.0, -memory], draws, axis=0)[500:]
    if kind.course == "straight":
        rows = np.arange(0, count, kind.stride)
        fine = np.stack([np.interp(np.arange(count), rows, column[rows]) for column in fine.T], axis=1)
    return fine


def truth(kind: Kind, fine: np.ndarray, diffusivity: float = DIFFUSIVITY) -> np.ndarray:
    """The true temperatures of the sensors at the rows, degC, `(time, sensor)`."""
    inside = temperatures(fine, FINE, PLACES / LENGTH, diffusivity / LENGTH**2)
    return inside[-1 - (kind.rows - 1) * kind.stride :: kind.stride]


def noise(kind: Kind, columns: int, rng: np.random.Generator) -> np.ndarray:
    """Stationary noise of variance 1 at the rows."""
    memory = NOISES[kind.noise]
    draws = rng.standard_normal((kind.rows + 200, columns))
    return lfilter([np.sqrt(1 - memory**2)], [1.0, -memory], draws, axis=0)[200:]


def draw(kind: Kind, number: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """True faces every minute; measured faces and sensors at the rows."""
    label = [
        list(DAYS).index(kind.command),
        COURSES.index(kind.course),
        round(kind.step),
        list(NOISES).index(kind.noise),
    ]
    rng = np.random.default_rng([SEED, *label, number])
    fine = faces(kind, rng)
    errors = noise(kind, 2 + len(PLACES), rng)
    measured = fine[-1 - (kind.rows - 1) * kind.stride :: kind.stride] + FACE_STD * errors[:, :2]
    return fine, measured, truth(kind, fine) + SENSOR_STD * errors[:, 2:]


# -------------------------------------------------------------------------------------------- the best possible


def _autocovariance(kind: Kind, size: float, gust: float, lags: np.ndarray) -> np.ndarray:
    """Of a face's random part at lags in hours, K2: white noise through one or two first-order filters."""
    one, other = HOURS
    smooth = (one * np.exp(-lags / one) - other * np.exp(-lags / other)) / (one - other)
    return size**2 * smooth + (gust**2 * np.exp(-lags / GUST_HOURS) if kind.course == "gusty" else 0.0)


def _between_rows(kind: Kind, size: float, gust: float) -> np.ndarray:
    """Covariance of a face every minute given its noisy rows, K2; of straight lines that of their ends' noise."""
    count = (kind.rows - 1) * kind.stride + 1
    rows = np.arange(0, count, kind.stride)
    at_rows = FACE_STD**2 * toeplitz(NOISES[kind.noise] ** np.arange(kind.rows, dtype=float))
    if kind.course == "straight":
        weights = np.maximum(1 - np.abs(np.arange(count)[:, None] - rows) / kind.stride, 0.0)
        return weights @ at_rows @ weights.T
    K = toeplitz(_autocovariance(kind, size, gust, np.arange(count) * FINE / 3600.0))
    given = cho_factor(K[np.ix_(rows, rows)] + at_rows)
    return K - K[:, rows] @ cho_solve(given, K[rows])


@lru_cache(maxsize=1)
def best_covariance(kind: Kind) -> np.ndarray:
    """Covariance of the readings, K2, sensor after sensor: noise, faces, and the initial profile."""
    count, rows, rate = (kind.rows - 1) * kind.stride + 1, kind.rows, DIFFUSIVITY / LENGTH**2
    R = SENSOR_STD**2 * np.kron(np.eye(len(PLACES)), toeplitz(NOISES[kind.noise] ** np.arange(rows, dtype=float)))
    for side in (0, 1):
        pulse = np.zeros((count + 1, 2))
        pulse[1, side] = 1.0
        answer = temperatures(pulse, FINE, PLACES / LENGTH, rate)[1:]
        P = _between_rows(kind, SIZES[side], GUST[side])
        G = np.zeros((len(PLACES), rows, count))
        for row in range(rows):
            last = row * kind.stride
            G[:, row, : last + 1] = answer[last::-1].T
        G = G.reshape(-1, count)
        R += G @ P @ G.T
    n, t = np.arange(1, MODES + 1), kind.step * np.arange(rows)
    decay = np.exp(-np.outer(t, rate * (n * np.pi) ** 2))
    modes = (np.sqrt(2) * np.sin(np.pi * np.outer(PLACES / LENGTH, n))[:, None] * decay).reshape(-1, MODES) * (15.0 / n)
    return R + modes @ modes.T


def best_std(kind: Kind, fine: np.ndarray) -> float:
    """The Cramer-Rao bound of ln(diffusivity)."""
    step = 1e-4
    slope = truth(kind, fine, DIFFUSIVITY * (1 + step)) - truth(kind, fine, DIFFUSIVITY * (1 - step))
    h = (slope / (2 * step)).T.reshape(-1)
    return float(1.0 / np.sqrt(h @ np.linalg.solve(best_covariance(kind), h)))


# -------------------------------------------------------------------------------------------------- one record


def case_of(kind: Kind, measured: np.ndarray, readings: np.ndarray):
    """The record as a case of wallid."""
    import wallid
    from wallid.case.options import Choices

    time = kind.step * np.arange(kind.rows)
    names = tuple(f"T{s}" for s in range(len(PLACES)))
    record = wallid.Record(time, time, None, measured, readings, names, boundary_noise_std=FACE_STD, file="benchmark")
    sensors = tuple(
        wallid.Sensor(name, place, noise_std=SENSOR_STD, position_std=0.0)
        for name, place in zip(names, PLACES, strict=True)
    )
    wall = wallid.Wall(length=LENGTH, diffusivity_prior=4e-7)
    choices = Choices(model="lom", window_days=DAYS["estimate"])
    return wallid.Case("benchmark", Path("benchmark.toml"), wall, sensors, record, choices)


def one(kind: Kind, number: int) -> dict:
    """Draw a record, estimate or diagnose, compare."""
    import wallid
    from wallid.discrepancy.screening import screen

    fine, measured, readings = draw(kind, number)
    case = case_of(kind, measured, readings)
    line = asdict(kind) | {"number": number}
    if kind.command == "estimate":
        fit = wallid.estimate(case, None, wallid.full_order_model(case))
        value, std, interval = fit.value, fit.std, fit.interval_95
        line |= {"said": fit.reason, "noise_ratio": fit.noise_ratio, "best": best_std(kind, fine)}
    else:
        found = wallid.diagnose(case)
        result = found.to_dict()
        value, std, interval = (result["diffusivity"][key] for key in ("value", "std", "interval_95"))
        line |= {"said": result["verdict"], "effects": [effect["name"] for effect in result["effects"]]}
        line |= {"mixups": [mixup.kind for mixup in found.mixups], "screened": screen(case).missing}
    return line | {"value": value, "std": std, "low": interval[0], "high": interval[1]}


def ready() -> None:
    """64-bit floats, and no threads of BLAS that wait for each other."""
    import jax
    from threadpoolctl import threadpool_limits

    jax.config.update("jax_enable_x64", True)
    threadpool_limits(limits=1, user_api="blas")


def several(kind: Kind, numbers: range) -> list[dict]:
    """Several records, in this process."""
    return [one(kind, number) for number in numbers]


# --------------------------------------------------------------------------------------------------- the table


def summary(lines: list[dict]) -> dict[str, float]:
    """Coverage, mean and spread of the standardised error, and mean width over the best possible."""
    value, std, low, high = np.array([[line[key] for key in ("value", "std", "low", "high")] for line in lines]).T
    z = np.log(value / DIFFUSIVITY) / (std / value)
    best = np.array([line.get("best", np.nan) for line in lines])
    return {
        "coverage": float(np.mean((low <= DIFFUSIVITY) & (high >= DIFFUSIVITY))),
        "mean": float(z.mean()),
        "spread": float(z.std()),
        "width": float(np.mean(np.log(high / low) / (2 * NORMAL_95 * best))),
        "words": float(np.mean([line["said"] not in ("", "adequate") for line in lines])),
    }


def table(lines: list[dict], kinds: list[Kind]) -> Iterator[str]:
    """The table's lines; words: records of which something was said, though nothing is missing."""
    yield "| command | faces | minutes | noise | records | inside | mean z | spread of z | width over best | words |"
    yield "|---|---|---|---|---|---|---|---|---|---|"
    for kind in kinds:
        own = [line for line in lines if all(line[key] == value for key, value in asdict(kind).items())]
        if own:
            found = summary(own)
            yield (
                f"| {kind.command} | {kind.course} | {kind.step / 60:.0f} | {kind.noise} | {len(own)} | "
                f"{found['coverage']:.1%} | {found['mean']:+.2f} | {found['spread']:.2f} | {found['width']:.2f} | "
                f"{found['words']:.1%} |"
            )


def main() -> None:
    """Run and print; see the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--command", nargs="+", choices=list(DAYS), default=list(DAYS))
    parser.add_argument("--course", nargs="+", choices=COURSES, default=list(COURSES))
    parser.add_argument("--step", nargs="+", type=float, default=list(STEPS), help="s")
    parser.add_argument("--noise", nargs="+", choices=list(NOISES), default=list(NOISES))
    parser.add_argument("--estimates", type=int, default=400)
    parser.add_argument("--diagnoses", type=int, default=200)
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    parser.add_argument("--log", type=Path, default=Path("wallid-out") / "coverage.jsonl")
    given = parser.parse_args()
    counts = {"estimate": given.estimates, "diagnose": given.diagnoses}
    kinds = [Kind(*one) for one in product(given.command, given.course, given.step, given.noise)]
    given.log.parent.mkdir(parents=True, exist_ok=True)
    lines = [json.loads(text) for text in given.log.read_text("utf-8").splitlines()] if given.log.exists() else []
    done = {(*(line[key] for key in ("command", "course", "step", "noise")), line["number"]) for line in lines}
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with (
        ProcessPoolExecutor(given.processes, mp_context=get_context("spawn"), initializer=ready) as pool,
        open(given.log, "a", encoding="utf-8") as file,
    ):
        jobs = []
        for kind in kinds:
            todo = [k for k in range(counts[kind.command]) if (*asdict(kind).values(), k) not in done]
            jobs += [pool.submit(several, kind, todo[k : k + 20]) for k in range(0, len(todo), 20)]
        for job in as_completed(jobs):
            for line in job.result():
                lines.append(line)
                file.write(json.dumps(line) + "\n")
            file.flush()
    for text in table(lines, kinds):
        print(text)


if __name__ == "__main__":
    main()
