"""What an issue asks of a work, from what was measured: a ratio, its target, whether it is met."""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.speed.measure import Measured

Results = dict[str, Measured]


@dataclass(frozen=True)
class Asked:
    """One target: `value` as reached (None where a contender is absent), `target` as asked."""

    what: str
    value: float | None
    target: float
    at_least: bool
    unit: str = "x"

    @property
    def met(self) -> bool | None:
        """Whether the target is met; None where it could not be measured."""
        if self.value is None:
            return None
        return self.value >= self.target if self.at_least else self.value <= self.target

    def texts(self) -> tuple[str, str, str, str]:
        """What, target, reached, verdict."""
        sign = ">=" if self.at_least else "<="
        reached = "not measured" if self.value is None else f"{self.value:.3g} {self.unit}"
        verdict = {True: "met", False: "**missed**", None: "-"}[self.met]
        return self.what, f"{sign} {self.target:.3g} {self.unit}", reached, verdict


def seconds_of(results: Results, name: str) -> float | None:
    """Seconds of one unit of a contender, None where it is absent."""
    return results[name].each if name in results else None


def faster(results: Results, quick: str, slow: str, target: float) -> Asked:
    """How many times faster one contender is than another; at least `target` is asked."""
    one, other = seconds_of(results, quick), seconds_of(results, slow)
    value = None if one is None or other is None else other / one
    return Asked(f"{quick}, times faster than {slow}", value, target, at_least=True)


def within(results: Results, ours: str, limit: str, target: float) -> Asked:
    """How many times the time of a limit a contender takes; at most `target` is asked."""
    one, other = seconds_of(results, ours), seconds_of(results, limit)
    value = None if one is None or other is None else one / other
    return Asked(f"{ours}, time over {limit}", value, target, at_least=False)


def error_ratio(results: Results, ours: str, other: str, names: tuple[str, ...], target: float) -> Asked:
    """The largest of some errors over another contender's; at most `target` is asked."""
    value = None
    if ours in results and other in results:
        value = max(results[ours].error[name] / results[other].error[name] for name in names)
    return Asked(f"{ours}, error ({', '.join(names)}) over {other}", value, target, at_least=False)
