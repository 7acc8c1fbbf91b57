"""`report.html`: one page that holds a run's answer, figures, numbers, settings and the command that makes it again.

Nothing on it is fetched: figures are SVG within the page, whose ink follows the reader's light or dark setting.
"""

from __future__ import annotations

import platform
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache
from html import escape
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from .._internal.number_formats import number, prose, unit
from ..discrepancy.effects.catalogue import untestable
from .captions import alternative, caption
from .figures import narrow
from .settings import settings
from .svg import Drawn, draw, sources
from .tables import tables

if TYPE_CHECKING:
    from ..workflow import Run

_PACKAGES = ("wallid", "jax", "equinox", "diffrax", "optimistix", "numpy", "scipy", "matplotlib", "pandas")
_FITS = 1.25  # times what the stated noise leaves: more, and the model misses something

_BADGES = {
    "adequate": "nothing is missing",
    "named": "a missing effect is named",
    "confusable": "a missing effect, and rivals",
    "unnamed": "something unknown is missing",
    "uninformative": "not to be relied on",
    None: "estimate",
}


@dataclass(frozen=True)
class Picture:
    """A figure as the page holds it.

    Args:
        stem: of its file. source: a data URI. alt: what it shows, in words. caption: how to read it.
        width: in inches, at which its letters are as large as the page's.
        narrow: what a small screen shows instead; empty where that is the same.
    """

    stem: str
    source: str
    alt: str
    caption: str
    width: float
    narrow: str


def page(run: Run, result: dict[str, Any], figures: Sequence[Drawn], command: str = "") -> str:
    """The page of a run.

    Args:
        result: the contents of result.json.
        figures: drawn.
        command: that makes the page again; empty where there was none.
    """
    return _template().render(
        run=run,
        case=run.case,
        explanation=run.diagnosis,
        ranked=() if run.diagnosis is None else run.diagnosis.table,
        result=result,
        verdict=result["verdict"],
        badge=_badge(run, result),
        headline=headline(run, result),
        answer=answer(run, result),
        pictures=_pictures(run, figures),
        tables=tables(result),
        settings=settings(run.case),
        versions=[("Python", platform.python_version()), *((name, version(name)) for name in _PACKAGES)],
        command=command,
        made=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        untestable=_untestable(run),
    )


def linked(text: str, links: dict[str, str]) -> str:
    """A page with links at its top to the pages that lie beside it.

    Args:
        links: what each file shows, by its name.
    """
    shown = "; ".join(f'{escape(words)}: <a href="{name}">{name}</a>' for name, words in links.items())
    return re.sub(r'(?<=<p id="beside">).*?(?=</p>)', lambda _: shown, text, count=1)


def _badge(run: Run, result: dict[str, Any]) -> str:
    if run.check is not None:
        return "check: a run would stop" if run.check.stops else "check: a run can go ahead"
    if run.fit is None and run.campaign is None and run.diagnosis is None and not run.unreliable:
        return "design"
    verdict = result["verdict"]
    return _BADGES[None] if verdict is None else f"{verdict}: {_BADGES[verdict]}"


def headline(run: Run, result: dict[str, Any]) -> tuple[str, dict[str, Any]] | None:
    """What was asked for by its name, and its value: the diffusivity, or from fluxes alone the resistance."""
    name = "Diffusivity" if run.case.sensors else "Thermal resistance, face to face"
    found = result["diffusivity"] if run.case.sensors else result.get("resistance")
    return None if found is None or found["value"] is None else (name, found)


def answer(run: Run, result: dict[str, Any]) -> str:
    """The verdict in a sentence or two."""
    return prose(_answer(run, result))


def _answer(run: Run, result: dict[str, Any]) -> str:
    if run.check is not None:
        told = [*(f"A run would stop: {stop}" for stop in run.check.stops), *run.check.notes]
        return ". ".join(told or ["Nothing would stop a run"]) + "."
    if run.diagnosis is not None:
        return run.diagnosis.sentence
    if run.unreliable:
        return f"This record gives no number to rely on: {run.unreliable}."
    if run.campaign is not None:
        (low, high), told = run.campaign.interval_95, run.campaign.thermal
        through = "" if told is None else f", and a resistance from face to face of {told.resistance}"
        return (
            f"{len(run.campaign.used)} of {len(run.campaign.windows)} windows are informative, and together they give "
            f"{low:.4g} to {high:.4g} m2/s (95 %){through}: {run.campaign.agreement}."
        )
    if run.fit is not None and run.fit.thermal is not None:
        told = run.fit.thermal
        return (
            f"From face to face the wall has a resistance of {told.resistance}, and with the standard surface "
            f"resistances a U-value of {told.transmittance}. {_fits_fluxes(result)}"
        )
    if run.fit is not None:
        return f"A number to rely on, as far as the model is right. {_fits(result)}"
    return "" if run.design is None else str(run.design).splitlines()[0]


def _fits(result: dict[str, Any]) -> str:
    """Whether the model leaves no more than noise does: over the whole record where that was asked for."""
    if "reliability" in result:
        where, left, noise = "the whole record", result["reliability"]["rms_K"], result["reliability"]["noise_K"]
    else:
        where, left, noise = "the window used", result["gap"]["after_K"], result["gap"]["floor_K"]
    if left <= _FITS * noise:
        return (
            f"Over {where} the prediction is off by {left:.2g} K, no more than the sensors' noise of {noise:.2g} K "
            "explains. Whether an effect is missing all the same, wallid diagnose tells."
        )
    return (
        f"Over {where} the prediction is off by {left:.2g} K, where the sensors' noise explains {noise:.2g} K: "
        "something is missing from the model, which may move the number. wallid diagnose looks for it."
    )


def _fits_fluxes(result: dict[str, Any]) -> str:
    """Whether the model leaves no more of the fluxes than the plates' noise does."""
    left, noise = (result["flux_gap"][key] for key in ("after_W_per_m2", "floor_W_per_m2"))
    if left <= _FITS * noise:
        return f"The model misses the fluxes by {left:.2g} W/m2, no more than the noise of {noise:.2g} W/m2 explains."
    return (
        f"The model misses the fluxes by {left:.2g} W/m2, where their noise explains {noise:.2g} W/m2: the interval "
        "counts that misfit too."
    )


def _untestable(run: Run) -> dict[str, str]:
    """What each effect that could not be tried would need."""
    if run.diagnosis is None:
        return {}
    study = run.diagnosis.study
    return {name: ", ".join(needs) for name, needs in untestable(study.sensors, study.record.regressors).items()}


def _pictures(run: Run, figures: Sequence[Drawn]) -> list[Picture]:
    """The figures as the page holds them."""
    shown = {drawn.stem for drawn in figures}
    narrowed = {stem: draw(stem, made).source for stem, made in narrow(run) if stem in shown}
    return [
        Picture(
            stem=drawn.stem,
            source=source,
            alt=alternative(drawn.stem, run),
            caption=caption(drawn.stem, run),
            width=drawn.made.get_figwidth(),
            narrow=narrowed.get(drawn.stem, ""),
        )
        for drawn, source in zip(figures, sources(figures), strict=True)
    ]


@cache
def _template() -> Any:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("wallid.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"number": number, "unit": unit, "prose": prose}
    environment.filters["percent"] = lambda share: f"{100 * share:+.1f} %".replace("-", "−")
    return environment.get_template("report.html")
