"""Whether 95 % intervals hold the values of a section's materials where their ratios are not known.

`python -m benchmarks.accuracy.section_materials`

Each wall is another coursed rubble as in `section_heights`, simulated by finite elements. The conductivity and the heat
capacity of stone and of mortar differ from the stated ones by independent factors, 0.3 in ln. Each record is estimated
with the materials as stated and with them free, with the sensors' heights known and unknown.

Each record's outcome is appended to a log of JSON lines, so that a long run goes on where it ended.
"""

from typing import Any

import numpy as np

from benchmarks.accuracy.discrepancy.score import interval
from benchmarks.accuracy.resumed_log import count_options, resumed
from benchmarks.accuracy.section_heights import HEIGHT, LENGTH, MATERIALS, case_of, frame_of, rubble, simulated

SPREAD = 0.3  # of the logarithm of each value about the stated one
METHODS = {"stated, heights known": ((), True), "free, heights known": (("materials",), True),
           "free, heights unknown": (("materials",), False)}  # fmt: skip
KEYS = ("number",)
SEED = 2911  # fixed before the first record was estimated


def estimated(number: int) -> dict[str, Any]:
    """The errors and standard errors of one record by each method: of the diffusivity, and of the materials' values."""
    import jax

    jax.config.update("jax_enable_x64", True)
    import wallid
    from wallid.case.section import SectionMaterial, section_of_regions

    rng = np.random.default_rng([SEED, number])
    regions, heights = rubble(rng), rng.uniform(0.0, HEIGHT, 3)
    true = {
        name: tuple(np.array(values) * np.exp(SPREAD * rng.standard_normal(2))) for name, values in MATERIALS.items()
    }
    readings, truth = simulated(regions, true, heights, rng)
    section = section_of_regions(
        LENGTH, HEIGHT, [SectionMaterial(k, *v, uncertainty=SPREAD) for k, v in MATERIALS.items()], regions
    )
    outcome: dict[str, Any] = {"number": number}
    for method, (free, known) in METHODS.items():
        stated = heights.tolist() if known else (None,) * len(heights)
        fit = wallid.estimate(case_of(section, frame_of(readings), stated, free=free))
        low, high = fit.interval_95
        outcome[method] = {
            "error": float(np.log(fit.value / truth)),
            "std": fit.std / fit.value,
            "inside": bool(low <= truth <= high),
            "reliable": fit.reliable,
        }
        if fit.materials is not None:
            outcome[method]["learned"] = fit.materials.learned
            outcome[method]["values"] = {
                name: {
                    "inside": bool(one.interval_95[0] <= _true_value(true, name) <= one.interval_95[1]),
                    "std": one.std / one.value,
                }
                for name, one in (fit.materials.quantities | fit.materials.combinations).items()
            }
    return outcome


def _true_value(true: dict[str, tuple[float, float]], name: str) -> float:
    """The true value of a quantity such as "heat_capacity of mortar over stone"."""
    kind, _, which = name.partition(" of ")
    numerator, _, denominator = which.partition(" over ")

    def of(material: str) -> float:
        k, c = true[material]
        return {"conductivity": k, "heat_capacity": c, "diffusivity": k / c}[kind]

    return of(numerator) / (of(denominator) if denominator else 1.0)


def summary(outcomes: list[dict]) -> str:
    """Coverage of each method's diffusivity, and of each value of the materials."""
    lines = []
    for method in METHODS:
        own = [one[method] for one in outcomes]
        z = np.array([one["error"] / one["std"] for one in own])
        lines.append(
            f"{method:<22} {_coverage([one['inside'] for one in own])}; z {z.mean():+.2f} +- {z.std():.2f}; "
            f"median standard error {np.median([one['std'] for one in own]):.2%}; "
            f"called reliable {sum(one['reliable'] for one in own)}"
        )
        if "values" not in own[0]:
            continue
        lines.append(f"  independent combinations learned: {np.bincount([one['learned'] for one in own]).tolist()}")
        for name in own[0]["values"]:
            values = [one["values"][name] for one in own]
            lines.append(
                f"  {name:<36} {_coverage([one['inside'] for one in values])}; "
                f"median standard error {np.median([one['std'] for one in values]):.1%}"
            )
    return "\n".join(lines)


def _coverage(inside: list[bool]) -> str:
    low, high = interval(sum(inside), len(inside))
    return f"{sum(inside)} of {len(inside)} ({np.mean(inside):.1%}, {low:.1%} to {high:.1%})"


def main() -> None:
    """Run what the log does not have yet, and print the summary."""
    arguments = count_options(__doc__, "section_materials.jsonl", 100, "walls").parse_args()
    tasks = [(number,) for number in range(arguments.first, arguments.first + arguments.records)]
    done = resumed(arguments.log, tasks, estimated, lambda number: (number,), KEYS, arguments.workers)
    print(summary(done))


if __name__ == "__main__":
    main()
