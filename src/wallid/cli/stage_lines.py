"""The line that is printed when a stage is done: its name, its key result, and its seconds."""

from __future__ import annotations

from collections.abc import Callable

from .._internal.number_formats import p_value_text, value_and_std
from ..estimation.many_windows import CampaignEstimate
from ..estimation.result_objects import Estimate
from ..workflow import Run


def stage_line(stage: str, result: str, seconds: float) -> str:
    """The line of a stage that is done."""
    return f"{stage:<12} {result} ({seconds:.1f} s)"


def key_result(run: Run, stage: str) -> str:
    """The key result of a stage of a run, in a few words."""
    return _RESULTS[stage](run)


def _check(run: Run) -> str:
    assert run.check is not None
    count = len(run.check.stops)
    return f"{count} reason(s) that stop a run" if count else "nothing would stop a run"


def _design(run: Run) -> str:
    found = run.design
    assert found is not None
    if not found.informative:
        return "no window has information on the diffusivity"
    start, end = found.labels
    return f"{start} to {end}, the best of {len(found.starts)} window(s); expected +-{found.expected_relative_std:.2%}"


def _learn(run: Run) -> str:
    assert run.learned is not None
    return f"reduced-order model of order {run.learned.system.order}, eps_inf {run.learned.eps_inf[0]:.1e}"


def _orders(run: Run) -> str:
    return f"orders {', '.join(str(model.system.order) for model in run.orders)}" if run.orders else "no other order"


def _diffusivity(estimate: Estimate | CampaignEstimate) -> str:
    low, high = estimate.interval_95
    text = f"{estimate.value:.4g} m2/s, 95 %: {low:.4g} to {high:.4g}"
    return text if estimate.reliable else f"not to be relied on; the search ended at {text}"


def _estimate(run: Run) -> str:
    assert run.fit is not None
    thermal = run.fit.thermal
    if thermal is None or not run.fit.reliable:
        return _diffusivity(run.fit)
    resistance = thermal.resistance
    return f"R = {value_and_std(resistance.value, resistance.std, 'm2 K/W')}"


def _campaign(run: Run) -> str:
    assert run.campaign is not None
    used = f"{len(run.campaign.used)} of {len(run.campaign.windows)} windows"
    return f"{used}; {_diffusivity(run.campaign)}"


def _reliability(run: Run) -> str:
    assert run.prediction is not None
    rms = {name: run.prediction.rms_of_sensor(s)[1] for s, name in enumerate(run.prediction.sensor_names)}
    worst = max(rms, key=rms.__getitem__)
    return f"rms residual over the entire record up to {rms[worst]:.2g} K, at {worst}"


def _screening(run: Run) -> str:
    found = run.screening
    assert found is not None
    tests = f"{p_value_text(found.score_p_value, 1e-3)} and {p_value_text(found.residual_p_value)}"
    return f"{'an effect is missing' if found.missing else 'no missing effect'} ({tests})"


def _lengths(run: Run) -> str:
    assert run.lengths is not None
    days, criterion = run.lengths.days, run.lengths.criterion
    return f"{days[0]:g} to {days[-1]:g} days; criterion {criterion[0]:.3f} to {criterion[-1]:.3f}"


def _places(run: Run) -> str:
    assert run.sensor_placement is not None
    positions = ", ".join(f"{position:.3g}" for position in run.sensor_placement.chosen)
    return f"further sensors at {positions} m" if positions else "no further sensor"


def _diagnose(run: Run) -> str:
    found = run.diagnosis
    assert found is not None
    effects = [found.problem.label(named.effect_parameters.effect) for named in found.effects]
    shown = ["heterogeneity"] if found.shows_heterogeneity and found.verdict in ("named", "confusable") else []
    names = "; ".join([*shown, *effects])
    return f"{found.verdict}{names and f': {names}'}"


_RESULTS: dict[str, Callable[[Run], str]] = {
    "check": _check,
    "campaign": _campaign,
    "design": _design,
    "learn": _learn,
    "orders": _orders,
    "estimate": _estimate,
    "reliability": _reliability,
    "lengths": _lengths,
    "places": _places,
    "screening": _screening,
    "diagnose": _diagnose,
}
