"""Whether 95 % intervals hold the truth where the wall is of stones and mortar, and in which one a sensor is.

`python -m benchmarks.accuracy.section_heights`

Each wall is another coursed rubble, simulated by finite elements (`section_by_finite_elements`) between smooth faces:
all its conductivities are a common factor times the stated ones. Three sensors are at known distances from the left
face and at random heights. Each record is estimated through the section with the heights as known and as unknown, and
as a homogeneous wall in one dimension. `--diagnose` adds the diagnosis in one dimension with the stated section and
unknown heights, with its effect `heterogeneity`.

Each record's outcome is appended to a log of JSON lines, so that a long run goes on where it ended.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.accuracy.discrepancy.score import interval
from benchmarks.accuracy.resumed_log import count_options, resumed
from benchmarks.reference.analytic_slab import weather
from benchmarks.reference.section_by_finite_elements import ElementSection, Rectangle

LENGTH, HEIGHT = 0.4, 0.5
MATERIALS = {"stone": (1.7, 2.1e6), "mortar": (0.6, 1.5e6)}  # W/m/K, J/m3/K
PLACES = (0.1, 0.2, 0.3)  # m
DAYS, BEFORE = 7, 4
STEP, FINE = 1800.0, 300.0  # s
SENSOR_STD, FACE_STD, POSITION_STD = 0.05, 0.02, 0.002  # K, K, m
ELEMENT = 0.02  # m
METHODS = ("known", "unknown", "one dimension")
DIAGNOSIS = "diagnosis"
DECIDED = 9.0  # of -2 log L between the materials
KEYS = ("number",)
SEED = 2903  # fixed before the first record was estimated


def rubble(rng: np.random.Generator) -> tuple:
    """The regions of one wall."""
    from wallid.case.section import coursed_rubble

    return coursed_rubble(
        LENGTH, HEIGHT, courses=int(rng.integers(2, 5)), stone_length=float(rng.uniform(0.12, 0.3)),
        joint=0.02, seed=int(rng.integers(1 << 30)),
    )  # fmt: skip


def simulated(
    regions: tuple, materials: dict[str, tuple[float, float]], heights: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, float]:
    """The readings of the faces and sensors at the rows, degC, `(time, 5)`, and the equivalent wall's diffusivity.

    Args:
        materials: true conductivity, W/m/K, and heat capacity, J/m3/K, of each.
    """
    rectangles = [Rectangle(one.x, one.y, *materials[one.material]) for one in regions]
    faces = weather(round((DAYS + BEFORE) * 86400.0 / FINE), FINE, rng, hours=(8.0, 2.0))
    points = np.stack([np.array(PLACES) + POSITION_STD * rng.standard_normal(3), heights], axis=1)
    stride = round(STEP / FINE)
    wall = ElementSection(LENGTH, HEIGHT, rectangles, ELEMENT)
    inside = wall.temperatures(faces, FINE, points, stride)
    rows = slice(round(BEFORE * 86400.0 / STEP), None)
    readings = np.concatenate([faces[::stride][: len(inside)], inside], axis=1)[rows]
    noise = np.array([FACE_STD] * 2 + [SENSOR_STD] * 3) * rng.standard_normal(readings.shape)
    return readings + noise, wall.diffusivity


def record(number: int) -> tuple[Any, pd.DataFrame, np.ndarray, float, float]:
    """A wall's section, its record, its sensors' heights, its diffusivity, and the factor of its conductivities."""
    from wallid.case.section import SectionMaterial, section_of_regions

    rng = np.random.default_rng([SEED, number])
    regions, factor, heights = rubble(rng), float(np.exp(0.3 * rng.standard_normal())), rng.uniform(0.0, HEIGHT, 3)
    true = {name: (factor * k, c) for name, (k, c) in MATERIALS.items()}
    readings, truth = simulated(regions, true, heights, rng)
    section = section_of_regions(LENGTH, HEIGHT, [SectionMaterial(k, *v) for k, v in MATERIALS.items()], regions)
    return section, frame_of(readings), heights, truth, factor


def frame_of(readings: np.ndarray) -> pd.DataFrame:
    """The readings of the faces and sensors with their times."""
    frame = pd.DataFrame(readings, columns=["left", "right", "T1", "T2", "T3"])
    frame.insert(0, "time", STEP * np.arange(len(frame)))
    return frame


def case_of(
    section: Any, frame: pd.DataFrame, heights: Sequence[float | None], *, in_section: bool = True, **options: Any
) -> Any:
    """The case of a record, with its sensors' heights as they are stated, and further options."""
    import wallid

    sensors = [
        wallid.Sensor(f"T{k + 1}", x, noise_std=SENSOR_STD, position_std=POSITION_STD, height=height)
        for k, (x, height) in enumerate(zip(PLACES, heights, strict=True))
    ]
    return wallid.Case.from_dataframe(
        frame, time="time", left="left", right="right", wall=wallid.Wall(LENGTH, section.diffusivity_prior),
        sensors=sensors, section=section if in_section else None, model="lom", boundary_noise_std=FACE_STD,
        window_days=DAYS, **options,
    )  # fmt: skip


def estimated(number: int) -> dict[str, Any]:
    """The errors and standard errors of one record by each method, and where its sensors were found."""
    import jax

    jax.config.update("jax_enable_x64", True)
    import wallid

    section, frame, heights, truth, factor = record(number)
    outcome: dict[str, Any] = {"number": number, "factor": factor, "sensors": []}
    for method in METHODS:
        stated = heights.tolist() if method == "known" else (None,) * len(PLACES)
        fit = wallid.estimate(case_of(section, frame, stated, in_section=method != "one dimension"))
        low, high = fit.interval_95
        outcome[method] = {
            "error": float(np.log(fit.value / truth)),
            "std": fit.std / fit.value,
            "inside": bool(low <= truth <= high),
            "reliable": fit.reliable,
        }
        for k, place in enumerate(fit.sensor_places.values() if method == "unknown" else ()):
            true = section.material_at(PLACES[k], float(heights[k])).name
            outcome["sensors"].append(
                {"true": true, "found": place.material, "deviance": place.deviance, "share": place.materials[true]}
            )
    return outcome


def diagnosed(number: int) -> dict[str, Any]:
    """What a diagnosis in one dimension finds of the same record, with the stated section and unknown heights."""
    import jax

    jax.config.update("jax_enable_x64", True)
    import wallid

    section, frame, _, truth, _ = record(number)
    found = wallid.diagnose(case_of(section, frame, (None,) * len(PLACES)))
    low, high = found.interval_95
    heterogeneity = found.heterogeneity
    return {
        "number": number,
        DIAGNOSIS: {
            "error": float(np.log(found.final.diffusivity / truth)),
            "std": found.final.log_std,
            "inside": bool(low <= truth <= high),
            "reliable": found.verdict in ("adequate", "named", "confusable"),
        },
        "verdict": found.verdict,
        "names": [one.effect_parameters.effect.name for one in found.effects],
        "shown": bool(heterogeneity is not None and heterogeneity.is_clear),
        "size": None if heterogeneity is None else [heterogeneity.size, heterogeneity.std],
        "evidence": None if heterogeneity is None else heterogeneity.evidence,
    }


def summary_of_diagnoses(outcomes: list[dict]) -> str:
    """Coverage and verdicts of the diagnoses."""
    verdicts = {name: sum(one["verdict"] == name for one in outcomes) for name in {one["verdict"] for one in outcomes}}
    named = sum(bool(one["names"]) for one in outcomes)
    shown, evidence = sum(one["shown"] for one in outcomes), [one["evidence"] for one in outcomes]
    sizes = np.array([one["size"] for one in outcomes])
    known = np.isfinite(sizes[:, 1]) & (sizes[:, 1] > 0)
    z = (sizes[known, 0] - 1.0) / sizes[known, 1]
    return "\n".join(
        [
            _line(DIAGNOSIS, outcomes),
            f"heterogeneity shown in {shown} of {len(outcomes)}; median evidence {np.median(evidence):.0f}; size "
            f"{np.median(sizes[:, 0]):.2f} in the median, z of size - 1: {z.mean():+.2f} +- {z.std():.2f}",
            f"verdicts {verdicts}; another effect named in {named}",
        ]
    )


def _line(method: str, outcomes: list[dict]) -> str:
    """Coverage and z of a method."""
    own = [one[method] for one in outcomes]
    z = np.array([one["error"] / one["std"] for one in own])
    hits = sum(one["inside"] for one in own)
    low, high = interval(hits, len(own))
    return (
        f"{method:<14} {hits} of {len(own)} ({hits / len(own):.1%}, {low:.1%} to {high:.1%}); z {z.mean():+.2f} +- "
        f"{z.std():.2f}; median standard error {np.median([one['std'] for one in own]):.2%}; "
        f"called reliable {sum(one['reliable'] for one in own)}"
    )


def summary(outcomes: list[dict]) -> str:
    """Coverage and z of each method, and how often a sensor's material was right."""
    lines = [_line(method, outcomes) for method in METHODS]
    sensors = [sensor for one in outcomes for sensor in one["sensors"]]
    decided = [sensor for sensor in sensors if sensor["deviance"] is not None and sensor["deviance"] >= DECIDED]
    right = sum(sensor["true"] == sensor["found"] for sensor in decided)
    lines.append(f"stone or mortar: decided {len(decided)} of {len(sensors)} sensors, right {right}")
    everywhere = sum(sensor["true"] == sensor["found"] for sensor in sensors)
    lines.append(
        f"the likelier one right for {everywhere} of {len(sensors)}, "
        f"stated on average {np.mean([max(s['share'], 1 - s['share']) for s in sensors]):.1%}"
    )
    return "\n".join(lines)


def main() -> None:
    """Run what the log does not have yet, and print the summary."""
    parser = count_options(__doc__, "section_heights.jsonl", 400, "walls")
    parser.add_argument("--diagnose", action="store_true", help="diagnose the records; needs a log of its own")
    arguments = parser.parse_args()
    tasks = [(number,) for number in range(arguments.first, arguments.first + arguments.records)]
    work, show = (diagnosed, summary_of_diagnoses) if arguments.diagnose else (estimated, summary)
    print(show(resumed(arguments.log, tasks, work, lambda number: (number,), KEYS, arguments.workers)))


if __name__ == "__main__":
    main()
