"""The README's picture: the demo in four panels. `python -m benchmarks.accuracy.readme_picture` draws it anew."""

from pathlib import Path

import jax

import wallid

OUT = Path(__file__).parents[2] / "notebooks" / "figures" / "demo.png"


def main() -> None:
    """Run the demo's steps and draw."""
    jax.config.update("jax_enable_x64", True)
    from wallid import plot

    case = wallid.load("saint_julien")
    found = wallid.design(case)
    rom = wallid.learn(case, found)
    fit = wallid.estimate(case, found, rom)
    whole = wallid.predict(case, fit, rom.system)
    with plot.style():
        made, axes = plot.figure(2, 2, width=10.0, height=2.9)
        plot.record(case, found.best, ax=axes[0, 0])
        plot.criterion(found, ax=axes[0, 1])
        plot.last_week(whole, 1, ax=axes[1, 0])
        plot.residual_density(whole, 1, ax=axes[1, 1])
        made.savefig(OUT, dpi=110)
    print(f"wrote {OUT}")


if __name__ == "__main__":
    main()
