"""Whether 95 % intervals hold the truth beside flux plates, where the noise has a memory and where it has none.

`python -m benchmarks.accuracy.noise_beside_plates`

Records are those of the discrepancy benchmark with nothing hidden: sensors inside, one plate or two, and noise of
sensors, faces and plates that is white, autocorrelated (0.6 or 0.9 from row to row) or half of each. The simulator
knows the faces every two minutes. Each outcome goes to a log of JSON lines, so that a long run goes on where it ended.
"""

import tempfile
from dataclasses import replace

import numpy as np

from benchmarks.accuracy.discrepancy.scenarios import NOISES, nulls
from benchmarks.accuracy.discrepancy.score import interval
from benchmarks.accuracy.disturbance import against_truth
from benchmarks.accuracy.resumed_log import count_options, resumed
from benchmarks.reference.simulator_with_effects import write_case

SEED = 1046  # of the scoring seeds; fixed before the first record was estimated
KEYS = ("noise", "number")


def estimated(noise: str, number: int) -> dict:
    """What `estimate` says of one record."""
    import jax

    jax.config.update("jax_enable_x64", True)
    import wallid

    spec = nulls(noise, number + 1, SEED)[number]
    spec = replace(spec, plates=("left", "right") if number % 2 else ("left",))
    with tempfile.TemporaryDirectory() as folder:
        write_case(spec, folder)
        fit = wallid.estimate(wallid.load(folder))
    R = fit.thermal.resistance
    found = {
        "diffusivity": (fit.value, fit.std, fit.interval_95, spec.diffusivity),
        "resistance": (R.value, R.std, R.interval_95, spec.length / spec.conductivity),
    }
    return {
        "noise": noise,
        "number": number,
        "step": spec.step,
        "reliable": fit.reliable,
        "disturbance": None if fit.disturbance is None else str(fit.disturbance),
        "quantities": against_truth(found),
    }


def summary(outcomes: list[dict]) -> str:
    """Coverage with its 95 % band, and root mean square of the standardised error, by noise and step."""
    lines = []
    for noise, step in sorted({(o["noise"], o["step"]) for o in outcomes}):
        own = [o for o in outcomes if (o["noise"], o["step"]) == (noise, step)]
        texts = []
        for name in ("diffusivity", "resistance"):
            each = [o["quantities"][name] for o in own]
            held, z = sum(one["held"] for one in each), np.array([one["z"] for one in each])
            low, high = interval(held, len(own))
            texts.append(
                f"{name} held in {held} ({low:.0%} to {high:.0%}), z {np.sqrt(np.mean(z**2)):.2f} "
                f"(mean {z.mean():+.2f})"
            )
        unsure, heat = sum(not o["reliable"] for o in own), sum(o["disturbance"] is not None for o in own)
        texts.append(f"{heat} with heat, {unsure} not reliable")
        lines.append(f"{noise:<5} {step:4.0f} s {len(own):3d} records: {'; '.join(texts)}")
    return "\n".join(lines)


def main() -> None:
    """Run what the log does not have yet, and print the summary."""
    parser = count_options(__doc__, "noise_beside_plates.jsonl", 100, "of each noise")
    parser.add_argument("--noises", nargs="*", default=list(NOISES))
    arguments = parser.parse_args()
    numbers = range(arguments.first, arguments.first + arguments.records)
    tasks = [(noise, number) for number in numbers for noise in arguments.noises]
    done = resumed(arguments.log, tasks, estimated, lambda *task: task, KEYS, arguments.workers)
    print(summary(done))


if __name__ == "__main__":
    main()
