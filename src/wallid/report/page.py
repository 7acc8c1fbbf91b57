"""`report.html`: one page with the result of a run, its figures, numbers and settings, and the command that made it.

The page loads no other file: its figures are SVG in the page. Their lines and text follow the light or dark setting of
the reader.
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

from .._internal.number_formats import format_interval, format_quantity, format_text
from .._internal.units import DAY
from .._internal.visible_text import visible_text
from ..discrepancy.effects.catalogue import untestable
from ..discrepancy.result.wall_properties import DIFFUSIVITY
from ..estimation.heat_flux import SURFACES_TEXT
from ..experiment_design.window_selection import ExpectedErrors
from .captions import alternative_text, figure_caption
from .figures import narrow_figures
from .next_steps import implications, next_steps, relation_of_diffusivities
from .result_json import diffusivity_entry
from .settings import settings_tables
from .svg import DrawnFigure, data_uris, draw_figure
from .tables import number_tables

if TYPE_CHECKING:
    from markupsafe import Markup

    from ..estimation.result_objects import Estimate
    from ..experiment_design.window_selection import Design
    from ..workflow import Run

_PACKAGES = ("wallid", "jax", "equinox", "diffrax", "optimistix", "numpy", "scipy", "matplotlib", "pandas")
_RANKED_ROWS = 10
_LARGEST_RATIO = 1.25  # of the residual to the stated noise, above which the model does not fit the readings

_BADGES = {
    "adequate": "diagnosis: nothing is missing that this record could show",
    "named": "diagnosis: a missing effect is found",
    "confusable": "diagnosis: a missing effect is found, but others would explain the record as well",
    "unnamed": "diagnosis: something unknown is missing",
    "uninformative": "no reliable value",
    None: "estimate",
}


@dataclass(frozen=True)
class PageFigure:
    """A figure of the page.

    Args:
        stem: name of its file without extension.
        data_uri: the figure as SVG.
        alternative_text: description of what it shows, for readers who cannot see it.
        caption: how to read it.
        width: inches, at which its text is as large as that of the page.
        narrow_data_uri: the figure for a narrow screen; empty where it is the same.
    """

    stem: str
    data_uri: str
    alternative_text: str
    caption: str
    width: float
    narrow_data_uri: str


def render_page(run: Run, result: dict[str, Any], figures: Sequence[DrawnFigure], command: str = "") -> str:
    """The page of a run as HTML.

    Args:
        result: contents of result.json.
        figures: in the order of the page.
        command: command line that made the page; empty where there was none.
    """
    values = diffusivities(run, result) if run.case.sensors else []
    ranked = () if run.diagnosis is None else run.diagnosis.table
    shown = 0 if result["verdict"] == "adequate" else _RANKED_ROWS  # all is chance in an adequate record
    steps = [f"{step[:1].upper()}{step[1:]}".rstrip(".") + "." for step in next_steps(run)]
    text = (
        page_environment()
        .get_template("report.html")
        .render(
            run=run,
            case=run.case,
            diagnosis=run.diagnosis,
            ranked=ranked[:shown],
            other_ranked=ranked[shown:],
            result=result,
            verdict=result["verdict"],
            badge=_badge(run, result),
            headlines=values[:1] if run.case.sensors else _resistance_and_transmittance(result),
            values=values,
            other_values=values[1:],
            relation=format_text(relation_of_diffusivities(run)),
            sides=_sides(run),
            implications=[format_text(line) for line in implications(run, _reliable(run, values))],
            steps=[_with_code(format_text(step)) for step in steps],
            prescriptions=[]
            if run.diagnosis is None
            else [format_text(one.sentence) for one in run.diagnosis.prescriptions],
            unknown_heat=_unknown_heat(run),
            first_figure=_first_figure(run),
            answer=answer(run, result),
            figures=_page_figures(run, figures),
            tables=number_tables(result, values[0][0] if values else ""),
            settings=settings_tables(run.case),
            versions=[("Python", platform.python_version()), *((name, version(name)) for name in _PACKAGES)],
            command=command,
            date=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
            untestable=_untestable(run),
        )
    )
    return visible_text(text)


def with_links(text: str, links: dict[str, str]) -> str:
    """A page with links at its top to the other pages in its folder.

    Args:
        text: of the page.
        links: description of each linked file, by its name.
    """
    shown = "; ".join(f'{escape(description)}: <a href="{name}">{name}</a>' for name, description in links.items())
    return re.sub(r'(?<=<p id="beside">).*?(?=</p>)', lambda _: shown, text, count=1)


def _reliable(run: Run, values: list[tuple[str, dict[str, Any]]]) -> dict[str, Any] | None:
    """The entry of the final diffusivity; None where it is not reliable."""
    return values[0][1] if values and not run.unreliable_reason else None


def _first_figure(run: Run) -> str:
    """The figure that shows the answer."""
    if run.diagnosis is not None:
        return "fit" if run.diagnosis.verdict == "adequate" else "missing"
    if run.fit is not None:
        return "estimate" if run.case.sensors else "flux"
    return "campaign" if run.campaign is not None else "record" if run.check is not None else "design"


def _badge(run: Run, result: dict[str, Any]) -> str:
    if run.check is not None:
        return "check: a run would stop" if run.check.stops else "check: a run can go ahead"
    if run.fit is None and run.campaign is None and run.diagnosis is None and not run.unreliable_reason:
        return "design"
    if run.screening is not None and run.screening.missing:
        return "estimate: the model does not explain the record"
    return _BADGES[result["verdict"]]


def diffusivities(run: Run, result: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    """Name and entry of each diffusivity of a run, the final one first; the name states the data and the model."""
    values = []
    if run.diagnosis is not None:
        data = "entire record" if run.case.choices.diagnose_days is None else "diagnosed days"
        if run.diagnosis.after.active:
            effects = "the effect in the model" if len(run.diagnosis.effects) == 1 else "the effects in the model"
            model = "with the nearest effect, refused" if run.diagnosis.incomplete else f"with {effects}"
            values.append((f"Diffusivity, {data}, {model}", result["diffusivity"]))
        plain = "diffusivity_before" if run.diagnosis.after.active else "diffusivity"
        if run.diagnosis.shows_heterogeneity:
            values.append((f"Diffusivity, {data}, with the section", DIFFUSIVITY.of(run.diagnosis.plain).result()))
            values.append((f"Diffusivity, {data}, homogeneous wall", result["diffusivity_before"]))
        else:
            values.append((f"Diffusivity, {data}, plain model", result[plain]))
    if run.campaign is not None:
        values.append(("Diffusivity, all windows, plain model", diffusivity_entry(run.campaign)))
    if run.fit is not None:
        data = "best window" if run.design is not None and run.fit.window == run.design.best else "one window"
        values.append((f"Diffusivity, {data}, plain model", diffusivity_entry(run.fit)))
    return [(name, entry) for name, entry in values if entry["value"] is not None]


def _sides(run: Run) -> str:
    """Which face is outside."""
    wall = run.case.wall
    return f"The {wall.inside} face is inside, the {wall.outside} face is outside. Positions count from the left face."


def _resistance_and_transmittance(result: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    """Name and entry of the thermal resistance and of the U-value, which flux plates alone determine."""
    names = {
        "resistance": "Thermal resistance R, from face to face",
        "transmittance": f"U-value, {SURFACES_TEXT}",
    }
    entries = [(format_text(name), result.get(key)) for key, name in names.items()]
    return [(name, entry) for name, entry in entries if entry is not None and entry["value"] is not None]


def _with_code(text: str) -> Markup:
    """A text with what stands between backticks as code."""
    from markupsafe import Markup

    return Markup(re.sub(r"`([^`]*)`", r"<code>\1</code>", escape(text, quote=False)))


def answer(run: Run, result: dict[str, Any]) -> str:
    """The result of a run in one or two sentences."""
    return format_text(_answer(run, result))


def _unknown_heat(run: Run) -> str:
    """What the course of the unknown heat says; empty without a diagnosis that leaves something."""
    heat = None if run.diagnosis is None else run.diagnosis.unknown_heat
    if heat is None:
        return ""
    text = format_text(heat.sentence)
    return f"If what no known effect explains is heat, {text}. Look for what does that, or log it."


def _answer(run: Run, result: dict[str, Any]) -> str:
    if run.check is not None:
        sentences = [*(f"A run would stop: {stop}" for stop in run.check.stops), *run.check.notes]
        return ". ".join(sentences or ["Nothing would stop a run"]) + "."
    if run.diagnosis is not None:
        return run.diagnosis.sentence
    if run.unreliable_reason:
        return f"{run.unreliable_reason[:1].upper()}{run.unreliable_reason[1:]}."
    if run.campaign is not None:
        (low, high), thermal = run.campaign.interval_95, run.campaign.thermal
        resistance = "" if thermal is None else f", and a resistance from face to face of {thermal.resistance}"
        return (
            f"{len(run.campaign.used)} of {len(run.campaign.windows)} windows are informative. Together they give a "
            f"diffusivity of {low:.4g} to {high:.4g} m2/s (95 %){resistance}: {run.campaign.agreement}."
        )
    if run.fit is not None and run.fit.thermal is not None:
        thermal = run.fit.thermal
        values = (
            ""
            if not run.case.sensors
            else (
                f"The resistance of the wall from face to face is {thermal.resistance}. Its U-value is "
                f"{thermal.transmittance}, {SURFACES_TEXT}. "
            )
        )
        return f"{values}{_flux_misfit(run.fit, result)}"
    if run.fit is not None:
        misfit = _misfit(result)
        return f"The window determines the diffusivity, provided that the model is valid. {misfit}"
    return "" if run.design is None else _design_sentence(run.design)


def _design_sentence(design: Design) -> str:
    if not design.informative:
        return str(design)
    days, (begin, end) = design.rows * design.step / DAY, (label[:16].replace("T", " ") for label in design.labels)
    errors = design.errors or ExpectedErrors(design.expected_relative_std)
    return (
        f"The most informative {days:.3g} days of this record are from {begin} to {end}. From them a standard error of "
        f"{errors} is expected."
    )


def _misfit(result: dict[str, Any]) -> str:
    """Whether the residual exceeds the stated noise: over the entire record where it was predicted.

    Args:
        result: entries of result.json.
    """
    if "reliability" in result:
        data, rms, noise = "the entire record", result["reliability"]["rms_K"], result["reliability"]["noise_K"]
    else:
        data, rms, noise = "the window used", result["gap"]["after_K"], result["gap"]["floor_K"]
    residual = f"Over {data}, the root mean square of the residual is {rms:.2g} K."
    if rms <= _LARGEST_RATIO * noise:
        return (
            f"{residual} The stated sensor noise of {noise:.2g} K explains it. wallid diagnose tests for effects that "
            "are missing nevertheless."
        )
    return (
        f"{residual} The stated sensor noise explains only {noise:.2g} K: the model lacks an effect, which may bias "
        "the diffusivity. wallid diagnose searches for it."
    )


def _flux_misfit(fit: Estimate, result: dict[str, Any]) -> str:
    """Whether the residual of the fluxes exceeds the stated noise of plates and faces."""
    rms, noise = (result["flux_gap"][key] for key in ("after_W_per_m2", "floor_W_per_m2"))
    residual = f"Simulated and measured fluxes differ by {rms:.2g} W/m2 (root mean square)."
    expected = f"the stated noise of plates and faces accounts for {noise:.2g} W/m2"
    lasting = "noise changes from reading to reading, this difference lasts for hours"
    widened = (
        "What causes it is not modelled, but it is counted: the intervals are as wide as this difference makes them."
    )
    if rms > _LARGEST_RATIO * noise:
        return f"{residual} That is more than noise: {expected}. {widened}"
    if fit.reduced_chi_square > _LARGEST_RATIO**2:
        return f"{residual} That is no more than noise ({expected}), but {lasting}. {widened}"
    return f"{residual} That is within the noise: {expected}."


def _untestable(run: Run) -> dict[str, str]:
    """Each effect that this record cannot test, and the data that it would need."""
    if run.diagnosis is None:
        return {}
    problem = run.diagnosis.problem
    return {
        name: ", ".join(needs) for name, needs in untestable(problem.sensor_count, problem.record.regressors).items()
    }


def _page_figures(run: Run, figures: Sequence[DrawnFigure]) -> list[PageFigure]:
    """The figures with captions and alternative texts."""
    stems = {drawn.stem for drawn in figures}
    narrow = {stem: draw_figure(stem, figure).data_uri for stem, figure in narrow_figures(run) if stem in stems}
    return [
        PageFigure(
            stem=drawn.stem,
            data_uri=data_uri,
            alternative_text=alternative_text(drawn.stem, run),
            caption=figure_caption(drawn.stem, run),
            width=drawn.figure.get_figwidth(),
            narrow_data_uri=narrow.get(drawn.stem, ""),
        )
        for drawn, data_uri in zip(figures, data_uris(figures), strict=True)
    ]


@cache
def page_environment() -> Any:
    """The templates of the pages, with the filters of their numbers."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("wallid.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"prose": format_text, "interval": format_interval}
    environment.filters["value"] = lambda entry: format_quantity(entry | {"interval_95": None})
    environment.filters["percent"] = lambda share: f"{100 * share:+.1f} %".replace("-", "−")
    return environment
