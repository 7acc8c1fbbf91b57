"""What a diagnosis says of heat that no effect of the library is, and how like the hidden heat its course is.

`python -m benchmarks.accuracy.unnamed`

Each record is a slab between smooth faces that its simulator knows every minute, by sine series: no part of wallid. Two
sensors are logged for 10 days at half an hour. Heat enters everywhere in the wall, or behind its right face on a
straight line over 8 cm (the model has exponentials). Its course is random with a memory of 3 hours or 2 days, or it
comes in bursts of 2 to 6 hours on half of the days, each at its own hour and of its own size. The largest response is
5 to 25 standard deviations of a reading's noise.

What is counted: the verdict, and the correlation of the course that the diagnosis shows with the hidden one.

Each record's outcome is appended to a log of JSON lines, so that a long run goes on where it ended.
"""

import time
from itertools import product

import numpy as np

from benchmarks.accuracy.discrepancy.score import interval
from benchmarks.accuracy.disturbance import (
    BEFORE,
    DIFFUSIVITY,
    FACE_STD,
    FINE,
    LENGTH,
    PLACES,
    SENSOR_STD,
    profile_of,
    slab_case,
)
from benchmarks.accuracy.resumed_log import count_options, resumed
from benchmarks.reference.analytic_slab import heated, random_process, temperatures, weather

SEED = 2806  # fixed before the first record was diagnosed; six of 2805 were taken for noise with a memory
DAYS, STEP = 10.0, 1800.0
COURSES, PROFILES = ("3 h", "2 days", "bursts"), ("wall", "face")
SMALLEST, LARGEST = 5.0, 25.0  # of the largest response over the noise
KEYS = ("course", "profile", "number")
"""Where an outcome says which record it is of."""


def course_of(course: str, count: int, rng: np.random.Generator) -> np.ndarray:
    """The heat's rate at all times of the simulator, of any size."""
    if course != "bursts":
        return random_process(count, FINE, 3.0 if course == "3 h" else 48.0, rng)
    seconds, heat = FINE * np.arange(count), np.zeros(count)
    sure = round(BEFORE) + 1  # a day of the record that has a burst
    for day in range(int(seconds[-1] // 86400.0) + 1):
        start, length, size = rng.uniform(0.0, 20.0), rng.uniform(2.0, 6.0), rng.uniform(0.5, 1.5)
        if rng.uniform() < 0.5 or day == sure:
            hour = (seconds - 86400.0 * day) / 3600.0 - start
            heat += np.where((hour > 0.0) & (hour < length), size, 0.0)
    return heat


def simulated(course: str, profile: str, number: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The readings of faces and sensors of one record, degC, and the hidden heat at its rows, K/s."""
    rng = np.random.default_rng([SEED, COURSES.index(course), PROFILES.index(profile), number])
    stride, before, rows = round(STEP / FINE), round(BEFORE * 86400.0 / FINE), round(DAYS * 86400.0 / STEP)
    count = before + (rows - 1) * stride + 1
    rate = DIFFUSIVITY / LENGTH**2
    faces, heat = weather(count, FINE, rng, hours=(8.0, 2.0)), course_of(course, count, rng)
    kept = slice(before, None, stride)
    warmer = heated(heat, FINE, profile_of(profile), rate, PLACES)[0][kept]
    largest = np.exp(rng.uniform(np.log(SMALLEST), np.log(LARGEST))) * SENSOR_STD
    size = largest / np.abs(warmer - warmer.mean(axis=0)).max()
    inside = temperatures(faces, FINE, PLACES, rate)[kept] + size * warmer
    return (
        faces[kept] + FACE_STD * rng.standard_normal((rows, 2)),
        inside + SENSOR_STD * rng.standard_normal(inside.shape),
        size * heat[kept],
    )


def diagnosed(course: str, profile: str, number: int) -> dict:
    """The outcome of one record."""
    import jax

    jax.config.update("jax_enable_x64", True)
    import wallid

    faces, inside, heat = simulated(course, profile, number)
    case = slab_case(STEP, faces, inside, None, initial_profile=2)
    began = time.perf_counter()
    found = wallid.diagnose(case)
    entries, left = found.to_dict(), found.unknown_heat
    low, high = entries["diffusivity"]["interval_95"]
    return {
        "course": course,
        "profile": profile,
        "number": number,
        "seconds": time.perf_counter() - began,
        "verdict": entries["verdict"],
        "effects": [[one["name"], one["target"]] for one in entries["effects"]],
        "holds": bool(low <= DIFFUSIVITY <= high),
        "correlation": None if left is None else float(np.corrcoef(left.course, heat)[0, 1]),
    }


def summary(outcomes: list[dict]) -> str:
    """The verdicts and correlations of each kind."""
    lines = []
    for kind in (*product(COURSES, PROFILES), None):
        own = [one for one in outcomes if kind is None or (one["course"], one["profile"]) == kind]
        if not own:
            continue
        unnamed = sum(one["verdict"] == "unnamed" for one in own)
        low, high = interval(unnamed, len(own))
        found = [one["correlation"] for one in own if one["correlation"] is not None]
        median = f"{np.median(found):.2f}" if found else "-"
        lines.append(
            f"{'all' if kind is None else ', '.join(kind):<14} unnamed {unnamed:4d} of {len(own):4d} "
            f"({low:4.0%} to {high:4.0%}); correlation {median} in the median of {len(found)}; "
            f"diffusivity in its interval {sum(one['holds'] for one in own)}"
        )
    return "\n".join(lines)


def main() -> None:
    """Run what the log does not have yet, and print the summary."""
    arguments = count_options(__doc__, "unnamed.jsonl", 400, "of all kinds together").parse_args()
    kinds = list(product(COURSES, PROFILES))
    numbers = range(arguments.first, arguments.first + -(-arguments.records // len(kinds)))
    tasks = [(*kind, number) for number in numbers for kind in kinds]
    print(summary(resumed(arguments.log, tasks, diagnosed, lambda *key: key, KEYS, arguments.workers)))


if __name__ == "__main__":
    main()
