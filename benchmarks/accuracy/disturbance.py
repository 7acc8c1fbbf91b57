"""Whether 95 % intervals hold the truth when heat enters the wall that no column explains.

`python -m benchmarks.accuracy.disturbance`

Each record is a slab between smooth faces that its simulator knows every minute, by sine series: no part of wallid.
Heat enters as a random process with a memory of 3 hours or 2 days: 3 K a day, the same everywhere in the wall, or
5 W/m2 behind its right face. There its density falls on a straight line over 8 cm (the model has exponentials), or as
an exponential over a depth of its own, from 1.25 to 10 cm. The record has two sensors inside, or a flux plate on each
face. Each is estimated with `disturbance = "none"` and `"auto"`.

Each record's outcome is appended to a log of JSON lines, so that a long run goes on where it ended.
"""

from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.accuracy.resumed_log import count_options, resumed
from benchmarks.reference.analytic_slab import fluxes, heated, random_process, temperatures, weather

LENGTH, CONDUCTIVITY, CAPACITY = 0.3, 0.75, 1.5e6
DIFFUSIVITY = CONDUCTIVITY / CAPACITY
PLACES = np.array([0.3, 0.7])  # over the length
FINE = 60.0  # s, between the times at which the simulator knows faces and heat
BEFORE = 10.0  # days
SENSOR_STD, FACE_STD, FLUX_STD, GAIN_STD = 0.05, 0.02, 0.3, 0.02
DAYS = {"sensors": 5.0, "plates": 3.0}
STEP = {"sensors": 1800.0, "plates": 900.0}  # s
HEATS, MEMORIES, OPTIONS = ("wall", "face", "nothing", "decaying"), (3.0, 48.0), ("none", "auto")
DEPTH = 0.08  # m, of the heat behind a face
DECAYS = 0.0125, 0.1  # m, of the heat that decays from a face
POINTS = np.linspace(0.0, 1.0, 3001)  # over the length, of a profile
KEYS = ("logged", "heat", "memory", "number")
"""Where an outcome says which record it is of."""
SEED = 2801  # fixed before the first record was estimated


@dataclass(frozen=True)
class Kind:
    """Records of one kind: what is logged, where heat enters, its memory in hours; their seed, the faces' noise."""

    logged: str
    heat: str
    memory: float
    seed: int = SEED
    face_std: float = FACE_STD

    @property
    def rows(self) -> int:
        return round(DAYS[self.logged] * 86400.0 / STEP[self.logged])


def key_of(kind: Kind, number: int) -> tuple:
    """The values of `KEYS` of a record."""
    return kind.logged, kind.heat, kind.memory, number


def profile_of(heat: str) -> np.ndarray:
    """Where heat enters, at equal distances over the wall: everywhere, or behind the right face; of mean 1."""
    depth = DEPTH / LENGTH
    return np.ones_like(POINTS) if heat == "wall" else 2.0 / depth * np.maximum(1.0 - (1.0 - POINTS) / depth, 0.0)


def decaying(depth: float) -> np.ndarray:
    """Heat that decays from the right face over a depth in m, at equal distances over the wall; of mean 1."""
    share = depth / LENGTH
    return np.exp(-(1.0 - POINTS) / share) / (share * -np.expm1(-1.0 / share))


def heat_of(kind: Kind, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """The heat's rate at all times, K/s, and its profile over the wall."""
    course = random_process(count, FINE, kind.memory, rng)
    if kind.heat == "wall":
        return 3.0 / 86400.0 * course, profile_of("wall")
    profile = decaying(np.exp(rng.uniform(*np.log(DECAYS)))) if kind.heat == "decaying" else profile_of(kind.heat)
    return (0.0 if kind.heat == "nothing" else 5.0) / (CAPACITY * LENGTH) * course, profile


def simulated(kind: Kind, number: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The readings of faces, sensors and plates of one record."""
    code = (list(DAYS).index(kind.logged), HEATS.index(kind.heat), round(kind.memory))
    rng = np.random.default_rng([kind.seed, *code, number])
    stride, before = round(STEP[kind.logged] / FINE), round(BEFORE * 86400.0 / FINE)
    count = before + (kind.rows - 1) * stride + 1
    rate = DIFFUSIVITY / LENGTH**2
    faces = weather(count, FINE, rng, hours=(8.0, 2.0))
    heat, profile = heat_of(kind, count, rng)
    warmer, more = heated(heat, FINE, profile, rate, PLACES)
    rows = slice(before, None, stride)
    inside = (temperatures(faces, FINE, PLACES, rate) + warmer)[rows]
    through = (CONDUCTIVITY / LENGTH * (fluxes(faces, FINE, rate) + more))[rows]
    gains = 1.0 + GAIN_STD * rng.standard_normal(2)
    return (
        faces[rows] + kind.face_std * rng.standard_normal((kind.rows, 2)),
        inside + SENSOR_STD * rng.standard_normal(inside.shape),
        gains * through + FLUX_STD * rng.standard_normal(through.shape),
    )


def case_of(kind: Kind, number: int, **choices: Any) -> Any:
    """One record as a case, with some `[choices]`."""
    faces, inside, through = simulated(kind, number)
    step, face_std = STEP[kind.logged], kind.face_std
    if kind.logged == "plates":
        return slab_case(step, faces, None, through, face_std=face_std, initial_profile=1, model="lom", **choices)
    return slab_case(step, faces, inside, None, face_std=face_std, initial_profile=2, model="lom", **choices)


def slab_case(
    step: float,
    faces: np.ndarray,
    inside: np.ndarray | None,
    through: np.ndarray | None,
    gain_std: float = GAIN_STD,
    face_std: float = FACE_STD,
    **choices: Any,
) -> Any:
    """Readings of the slab as a case, with some `[choices]`.

    Args:
        step: from row to row, s. faces: degC, `(time, 2)`.
        inside: of the sensors, degC, `(time, 2)`; None without them.
        through: of the plates, W/m2, `(time, 2)`; None without them.
        gain_std: stated standard deviation of the plates' calibrations.
        face_std: the same of the faces' readings, K.
    """
    import wallid
    from wallid.case.options import Choices

    time = step * np.arange(len(faces))
    names = () if inside is None else ("T1", "T2")
    record = wallid.Record(
        time, time, None, faces, np.empty((len(faces), 0)) if inside is None else inside, names,
        regressors={} if through is None else {"flux_left": through[:, 0], "flux_right": through[:, 1]},
        boundary_noise_std=face_std, flux_noise_std=FLUX_STD, flux_gain_std=gain_std,
    )  # fmt: skip
    sensors = tuple(wallid.Sensor(n, LENGTH * x, noise_std=SENSOR_STD) for n, x in zip(names, PLACES, strict=False))
    wall = wallid.Wall(length=LENGTH, diffusivity_prior=7e-7, outside="right")
    return wallid.Case("slab", Path("case.toml"), wall, sensors, record, Choices(**choices))


def against_truth(found: dict[str, tuple]) -> dict[str, dict]:
    """Standardised error, half width of the interval, and whether it holds the truth.

    Args:
        found: for each quantity its value, standard error, 95 % interval and truth.
    """
    return {
        name: {
            "z": float(np.log(value / truth) / (std / value)),
            "width": float(np.log(high / low) / 2),
            "held": bool(low <= truth <= high),
        }
        for name, (value, std, (low, high), truth) in found.items()
    }


def estimated(kind: Kind, number: int, option: str) -> dict:
    """What `estimate` says of one record."""
    import jax

    jax.config.update("jax_enable_x64", True)
    import wallid

    fit = wallid.estimate(case_of(kind, number, disturbance=option))
    found = {"diffusivity": (fit.value, fit.std, fit.interval_95, DIFFUSIVITY)}
    if fit.thermal is not None:
        R, C = fit.thermal.resistance, fit.thermal.areal_heat_capacity
        found["resistance"] = (R.value, R.std, R.interval_95, LENGTH / CONDUCTIVITY)
        found["capacity"] = (C.value, C.std, C.interval_95, LENGTH * CAPACITY)
    disturbance = (
        None
        if fit.disturbance is None
        else [
            fit.disturbance.place,
            fit.disturbance.std,
            fit.disturbance.time_constant / 3600.0,
            fit.disturbance.evidence,
        ]
    )
    return asdict(kind) | {
        "number": number,
        "option": option,
        "reliable": fit.reliable,
        "reason": fit.reason[:60],
        "quantities": against_truth(found),
        "disturbance": disturbance,
    }


def summary(outcomes: list[dict]) -> str:
    """Coverage, mean and spread of the standardised error, and median half width, by kind and option."""
    head = "logged | heat | memory, h | option | quantity | records | reliable | found | hold the truth"
    lines = [f"| {head} | z: mean, spread | half width |", "|---|---|---|---|---|---|---|---|---|---|---|"]
    keys = sorted({(o["logged"], o["heat"], o["memory"], o["option"]) for o in outcomes})
    for key in keys:
        some = [o for o in outcomes if (o["logged"], o["heat"], o["memory"], o["option"]) == key]
        found = sum(o["disturbance"] is not None for o in some)
        reliable = sum(o["reliable"] for o in some)
        for name in some[0]["quantities"]:
            each = [o["quantities"][name] for o in some]
            z = np.array([one["z"] for one in each])
            held = np.mean([one["held"] for one in each])
            width = np.median([one["width"] for one in each])
            lines.append(
                f"| {key[0]} | {key[1]} | {key[2]:g} | {key[3]} | {name} | {len(some)} | {reliable} | {found} "
                f"| {held:.1%} | {z.mean():+.2f}, {z.std():.2f} | {width:.1%} |"
            )
    return "\n".join(lines)


def main() -> None:
    """Run what the log does not have yet, and print the summary."""
    parser = count_options(__doc__, "disturbance.jsonl", 400)
    parser.add_argument("--logged", nargs="*", default=list(DAYS))
    parser.add_argument("--options", nargs="*", default=list(OPTIONS))
    parser.add_argument("--heats", nargs="*", default=list(HEATS))
    parser.add_argument("--seed", type=int, default=SEED, help="of a repeat, with a log of its own")
    parser.add_argument("--face-std", type=float, default=FACE_STD, help="noise of the faces, K, with a log of its own")
    arguments = parser.parse_args()
    kinds = [
        Kind(*one, arguments.seed, arguments.face_std)
        for one in product(arguments.logged, arguments.heats, MEMORIES)
        if one[1] != "nothing" or one[2] == MEMORIES[0]
    ]
    tasks = [
        (kind, number, option)
        for number in range(arguments.first, arguments.first + arguments.records)
        for kind in kinds
        for option in arguments.options
    ]
    done = resumed(
        arguments.log,
        tasks,
        estimated,
        lambda kind, number, option: (*key_of(kind, number), option),
        (*KEYS, "option"),
        arguments.workers,
    )
    print(summary(done))


if __name__ == "__main__":
    main()
