"""How the packaged twin's seed compares: the demo's estimate for it and for ten other weathers.

`python -m benchmarks.accuracy.twin_seeds` prints a Markdown table. The seed of the packaged record was chosen
before any estimate was made.
"""

import jax
import numpy as np

import wallid
from benchmarks.reference.example_cases import saint_julien_case
from benchmarks.reference.make_examples import TWIN_SEED

TRUTH = 1.06e-6
OTHERS = range(2010, 2020)


def row(case: wallid.Case, seed: int) -> tuple[str, list[float]]:
    """A line of the table, and the relative errors with and without sun."""
    errors, cells = [], []
    for sun in (0.003, 0.0):
        twin = saint_julien_case(case, seed, sun=sun)
        window = wallid.design(twin)
        fit = wallid.estimate(twin, window, wallid.learn(twin, window))
        errors.append(fit.value / TRUTH - 1.0)
        cells += [f"{1e6 * fit.value:.3f} ± {1e6 * fit.std:.3f}", f"{errors[-1]:+.1%}"]
    name = f"{seed} (packaged)" if seed == TWIN_SEED else str(seed)
    return " | ".join([f"| {name}", *cells]) + " |", errors


def main() -> None:
    """Print the table and the spread over the ten other seeds."""
    jax.config.update("jax_enable_x64", True)
    case = wallid.load("saint_julien")
    print("| seed | diffusivity, sun unmodelled (mm²/s) | error | without sun (mm²/s) | error |")
    print("|---|---|---|---|---|")
    found = []
    for seed in (TWIN_SEED, *OTHERS):
        line, errors = row(case, seed)
        print(line, flush=True)
        if seed != TWIN_SEED:
            found.append(errors)
    mean, largest = np.mean(found, axis=0), np.abs(found).max(axis=0)
    cells = [f"mean {m:+.1%}, largest {most:.1%}" for m, most in zip(mean, largest, strict=True)]
    print(f"| ten others | | {cells[0]} | | {cells[1]} |")


if __name__ == "__main__":
    main()
