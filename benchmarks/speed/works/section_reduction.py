"""The reduction of a section over the priors of its materials, to the order that the error asks for."""

from __future__ import annotations

from functools import partial

from benchmarks.reference.stone_section import POINTS, stone_section
from benchmarks.speed.measure import Prepared
from benchmarks.speed.works.ratio import Asked, Results, seconds_of
from wallid.models.section import MaterialRange, ReducedSection, full_order_section, reduce_section

TITLE = "reduced model of a section over the priors of two materials, 3 sensors, error below 1e-4"
SMALL, LARGE = "10,848 cells", "100,861 cells"
STEPS = {SMALL: 0.002, LARGE: 0.00044}  # m, of the mesh beside a joint


def _reduction(step: float) -> Prepared:
    section = stone_section(step)

    def run() -> ReducedSection:
        return reduce_section(full_order_section(section, POINTS).model, MaterialRange.of(section))

    def error(found: ReducedSection) -> dict[str, float]:
        return {"order": found.order, "u": found.error, "theta": found.theta_error}

    return Prepared(run, error, once=True)


CONTENDERS = {name: partial(_reduction, step) for name, step in STEPS.items()}


def asked(results: Results) -> list[Asked]:
    """What the issue asks."""
    memory = results[LARGE].memory if LARGE in results else None
    return [
        Asked(SMALL, seconds_of(results, SMALL), 20, at_least=False, unit="s"),
        Asked(LARGE, seconds_of(results, LARGE), 180, at_least=False, unit="s"),
        Asked(f"{LARGE}, memory", memory, 4096, at_least=False, unit="MiB"),
    ]
