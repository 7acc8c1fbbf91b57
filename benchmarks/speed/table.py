"""The benchmark's results as people read them: Markdown, and the scaling as a figure."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

from benchmarks.speed.measure import Measured

_UNITS = ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"))


def seconds(value: float) -> str:
    """Three digits with a fitting unit."""
    for size, unit in _UNITS:
        if value >= size:
            return f"{value / size:.3g} {unit}"
    return f"{value / 1e-6:.2g} µs"


def as_markdown(
    found: dict[str, dict[str, Measured]], absent: dict[str, dict[str, str]], ground: dict[str, Any]
) -> str:
    """A section a work: its contenders, then what is asked of it."""
    versions = ", ".join(f"{name} {version}" for name, version in ground["versions"].items())
    lines = [
        f"{ground['processor']}, {ground['cores']} cores, load {ground['load_at_start']:.2f} at the start; "
        f"Python {ground['python']}, {versions}.",
        "",
    ]
    for work, results in found.items():
        module = importlib.import_module(f"benchmarks.speed.works.{work}")
        lines += [f"### {work}", "", f"{module.TITLE[0].upper()}{module.TITLE[1:]}.", ""]
        lines += ["| contender | median | quartiles | first call | peak memory | error |", "|---|---|---|---|---|---|"]
        lines += [_row(one) for one in results.values()]
        lines += [f"| {name} | - | - | - | - | {_brief(why)} |" for name, why in absent.get(work, {}).items()]
        asked = module.asked(results)
        if asked:
            lines += ["", "| asked | target | reached | |", "|---|---|---|---|"]
            lines += [f"| {' | '.join(row.texts())} |" for row in asked]
        lines.append("")
    return "\n".join(lines)


def _row(one: Measured) -> str:
    low, high = (seconds(value / one.units) for value in one.quartiles)
    error = ", ".join(f"{name} {value:.1e}" for name, value in one.error.items()) or "-"
    spread = f"{low} to {high}" if one.runs > 1 else "one run"
    memory = "-" if one.memory is None else f"{max(one.memory, 0):.0f} MiB"
    cells = (one.contender, seconds(one.each), spread, seconds(one.first), memory, error)
    return f"| {' | '.join(cells)} |"


def _brief(why: str) -> str:
    return why.strip().splitlines()[-1][:120] if why.strip() else "failed"


def scaling_figure(results: dict[str, Measured], path: Path) -> None:
    """Time over size in log-log, a panel a size, with the exponent of each."""
    import matplotlib.pyplot as plt

    from benchmarks.speed.works.scaling import SIZES, exponents

    slopes = exponents(results)
    figure, panels = plt.subplots(1, len(SIZES), figsize=(11, 3), layout="constrained", sharey=True)
    units = {"nodes": "nodes", "steps": "rows", "order": "modes", "sensors": "sensors"}
    for axes, (name, sizes) in zip(panels, SIZES.items(), strict=True):
        there = [(size, results[f"{name} {size}"]) for size in sizes if f"{name} {size}" in results]
        axes.loglog([size for size, _ in there], [1e3 * one.seconds for _, one in there], "o-", color="#0072B2")
        # the sizes themselves; a span of little more than a decade would have labels over each other
        axes.set_xticks([size for size, _ in there], [_short(size) for size, _ in there])
        axes.minorticks_off()
        axes.set_xlabel(f"{name} (number of {units[name]})" if name != units[name] else f"{name} (number)")
        axes.set_title(f"exponent {slopes[name]:.2f}" if name in slopes else "not measured", fontsize=10)
        axes.grid(True, which="major", linewidth=0.4)
    panels[0].set_ylabel("field and sensitivity (ms)")
    figure.savefig(path, dpi=150)
    plt.close(figure)


def _short(size: int) -> str:
    """A size in few characters: 20, 1e6."""
    return str(size) if size < 10_000 else f"{size:.0e}".replace("e+0", "e")
