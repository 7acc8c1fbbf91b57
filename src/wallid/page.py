"""`report.html`: one page that holds a run's answer, figures, numbers, settings and the command that makes it again.

Nothing on it is fetched: figures are SVG within the page, whose ink follows the reader's light or dark setting.
"""

from __future__ import annotations

import base64
import io
import platform
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields, replace
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from ._style import GREY
from .captions import CAPTIONS
from .effects import untestable
from .figures import save

if TYPE_CHECKING:
    from .workflow import Run

_PACKAGES = ("wallid", "jax", "equinox", "diffrax", "optimistix", "numpy", "scipy", "matplotlib", "pandas")
_DECIMALS = re.compile(r"(\.\d\d)\d+")  # past a hundredth of a point nothing is seen
_MOST_BYTES = 2_500_000  # of all pictures: a page stays under 3 MB
_FEW_POINTS = 50  # of a line in a picture that is too large
_INK = "#010203"  # stands for the text's colour until the page says which that is

_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

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

    Arguments:
        stem: of its file. source: a data URI. alt: what it shows, in words. caption: how to read it.
        width: in inches, at which its letters are as large as the page's.
    """

    stem: str
    source: str
    alt: str
    caption: str
    width: float


def page(run: Run, result: dict[str, Any], figures: Iterable[tuple[str, Figure]], command: str = "") -> str:
    """The page of a run.

    Arguments:
        result: the contents of result.json.
        figures: with their stems.
        command: that makes the page again; empty where there was none.
    """
    pictures = _pictures(run, list(figures))
    return _template().render(
        run=run,
        case=run.case,
        explanation=run.explanation,
        result=result,
        verdict=result["verdict"],
        badge=_badge(run, result),
        answer=answer(run, result),
        pictures=pictures,
        tables=list(tables(result)),
        settings=[(field.name, getattr(run.case.choices, field.name)) for field in fields(run.case.choices)],
        versions=[("Python", platform.python_version()), *((name, version(name)) for name in _PACKAGES)],
        command=command,
        made=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        untestable=_untestable(run),
    )


def _badge(run: Run, result: dict[str, Any]) -> str:
    if run.check is not None:
        return "check: a run would stop" if run.check.stops else "check: a run can go ahead"
    if run.fit is None and run.campaign is None and run.explanation is None and not run.unreliable:
        return "design"
    verdict = result["verdict"]
    return _BADGES[None] if verdict is None else f"{verdict}: {_BADGES[verdict]}"


def answer(run: Run, result: dict[str, Any]) -> str:
    """The verdict in a sentence or two."""
    if run.check is not None:
        told = [*(f"A run would stop: {stop}" for stop in run.check.stops), *run.check.notes]
        return ". ".join(told or ["Nothing would stop a run"]) + "."
    if run.explanation is not None:
        return unit(run.explanation.sentence.replace("+-", "±"))
    if run.unreliable:
        return f"This record gives no number to rely on: {run.unreliable}."
    if run.campaign is not None:
        low, high = run.campaign.interval_95
        return (
            f"{len(run.campaign.used)} of {len(run.campaign.windows)} windows are informative, and together they give "
            f"{number(low)} to {number(high)} m²/s (95 %): {run.campaign.agreement}."
        )
    if run.fit is not None and run.fit.thermal is not None:
        told = run.fit.thermal
        resistance, transmittance = (
            unit(str(quantity)).replace("+-", "±") for quantity in (told.resistance, told.transmittance)
        )
        return (
            f"From face to face the wall has a resistance of {resistance}, and with the standard surface resistances a "
            f"U-value of {transmittance}."
        )
    if run.fit is not None:
        gap = result["gap"]
        return (
            f"The model leaves {gap['after_K']:.2g} K in the window used, where the sensors' noise alone would leave "
            f"{gap['floor_K']:.2g} K. Whether an effect is missing from it was not asked: see wallid diagnose."
        )
    return "" if run.design is None else str(run.design).splitlines()[0]


def number(value: Any, digits: int = 4) -> str:
    """A value of result.json as a person reads it."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        mantissa, _, power = f"{value:.{digits}g}".partition("e")
        ten = f" × 10{str(int(power)).translate(_RAISED)}" if power else ""
        return mantissa.replace("-", "−") + ten
    if isinstance(value, list):
        return ", ".join(number(item, digits) for item in value) or "none"
    return str(value)


def tables(result: dict[str, Any]) -> Iterator[tuple[str, list[tuple[str, str]]]]:
    """Every number of result.json: a table for each of its parts, and one of all that has no parts."""
    plain, parts = [], []
    for key, value in result.items():
        if key in ("ranked", "untestable"):  # have tables of their own
            continue
        rows = list(_rows(value, ""))
        if isinstance(value, dict | list) and rows:
            parts.append((_words(key), rows))
        elif not isinstance(value, dict | list):
            plain.append((_words(key), number(value)))
    yield "overview", plain
    yield from parts


def _rows(value: Any, name: str) -> Iterator[tuple[str, str]]:
    if isinstance(value, dict):
        if "value" in value and "unit" in value:
            yield name, _quantity(value)
            return
        for key, item in value.items():
            yield from _rows(item, f"{name} {_words(key)}".strip())
    elif isinstance(value, list) and any(isinstance(item, dict) for item in value):
        for count, item in enumerate(value, start=1):
            label = item.get("label") or item.get("name") or count
            yield from _rows({k: v for k, v in item.items() if k not in ("label", "name")}, f"{name} {label}".strip())
    else:
        yield name, number(value)


def _quantity(found: dict[str, Any]) -> str:
    text = number(found["value"])
    if found.get("std") is not None:
        text += f" ± {number(found['std'], 2)}"
    if found.get("interval_95"):
        low, high = found["interval_95"]
        text += f" (95 %: {number(low)} to {number(high)})"
    return f"{text} {unit(found['unit'])}".strip()


def unit(text: str) -> str:
    """A unit as a person writes it."""
    return text.replace("m2", "m²").replace("m3", "m³")


def _words(key: str) -> str:
    """A key of result.json in words, its unit at the end in parentheses."""
    match = re.fullmatch(r"(.*)_(K|J_per_m2|W_per_m2|degC)", key)
    stem, unit = ("step", "s") if key == "step_s" else match.groups() if match else (key, "")
    shown = {"J_per_m2": "J/m²", "W_per_m2": "W/m²", "degC": "°C"}.get(unit, unit)
    return stem.replace("_", " ") + (f" ({shown})" if shown else "")


def _untestable(run: Run) -> dict[str, str]:
    """What each effect that could not be tried would need."""
    if run.explanation is None:
        return {}
    study = run.explanation.study
    return {name: ", ".join(needs) for name, needs in untestable(study.sensors, study.record.regressors).items()}


def _pictures(run: Run, figures: list[tuple[str, Figure]]) -> list[Picture]:
    """The figures as the page holds them; where they are too large together, the largest with its lines as pixels."""
    pictures = [_picture(run, stem, made) for stem, made in figures]
    by_size = sorted(range(len(figures)), key=lambda k: -len(pictures[k].source))
    for k in by_size:
        if sum(len(picture.source) for picture in pictures) <= _MOST_BYTES:
            break
        stem, made = figures[k]
        pictures[k] = replace(pictures[k], source=_svg(made, stem, most_points=_FEW_POINTS))
    return pictures


def _picture(run: Run, stem: str, made: Figure) -> Picture:
    caption, alt = CAPTIONS[stem]
    return Picture(stem, _svg(made, stem), alt(run), caption, made.get_figwidth())


def _svg(made: Figure, stem: str, **options: int) -> str:
    """A figure as the data URI of an SVG without a background, in the colour of the reader's text."""
    stream = io.StringIO()
    _in_ink(made)
    save(made, stream, "svg", salt=stem, transparent=True, **options)
    text = stream.getvalue()
    text = re.sub(r'(?<= d=")[^"]*|(?<= [xy]=")[^"]*', lambda found: _DECIMALS.sub(r"\1", found[0]), text)
    text = text[text.index("<svg") :].replace(_INK, "var(--ink)").replace(GREY.lower(), "var(--grey)")
    dark = "@media(prefers-color-scheme:dark){:root{--ink:#e3e6e8;--grey:#a9b0b6}}"
    ink = f"<style>:root{{--ink:#1d2329;--grey:{GREY}}}{dark}@media print{{:root{{--ink:#000;--grey:{GREY}}}}}</style>"
    text = re.sub(r"(<svg[^>]*>)", rf"\1{ink}", text, count=1)
    return f"data:image/svg+xml;base64,{base64.b64encode(text.encode()).decode()}"


def _in_ink(made: Figure) -> None:
    """What is black in a figure in the colour that stands for the text's."""
    for artist in made.findobj():
        for kind in ("color", "edgecolor", "markeredgecolor", "markerfacecolor"):
            get, put = getattr(artist, f"get_{kind}", None), getattr(artist, f"set_{kind}", None)
            if get is None or put is None:
                continue
            try:
                black = to_hex(get(), keep_alpha=True) == "#000000ff"
            except (TypeError, ValueError):  # several colours
                continue
            if black:
                put(_INK)


@cache
def _template() -> Any:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("wallid"), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {"number": number, "unit": unit}
    environment.filters["percent"] = lambda share: f"{100 * share:+.1f} %".replace("-", "−")
    return environment.get_template("report.html")
