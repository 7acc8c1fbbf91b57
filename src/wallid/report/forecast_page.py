"""The page of a forecast and its figures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from importlib.metadata import version

from matplotlib.figure import Figure

from .. import plot
from .._internal.number_formats import format_text
from .._internal.visible_text import visible_text
from ..estimation.forecast_result import Forecast
from .page import page_environment
from .svg import DrawnFigure, data_uris


def forecast_figures(forecast: Forecast) -> Iterator[tuple[str, Figure]]:
    """Each figure of a forecast with the name of its file."""
    with plot.style():
        count = len(forecast.names)
        figure, axes = plot.figure(count, 1, height=2.4 * count)
        for k, ax in enumerate([axes] if count == 1 else axes):
            plot.forecast_band(forecast, k, ax=ax)
        yield "forecast", figure
        if forecast.step_errors:
            figure, ax = plot.figure(height=2.6)
            plot.errors_ahead(forecast, ax=ax)
            yield "ahead", figure


def render_forecast_page(forecast: Forecast, figures: Sequence[DrawnFigure], command: str = "") -> str:
    """The page of a forecast as HTML.

    Args:
        forecast: the forecast.
        figures: in the order of the page.
        command: command line that made the page; empty where there was none.
    """
    captions = {
        "forecast": "The readings before and after the start of the forecast, the forecast, and the band that holds "
        "95 % of the readings.",
        "ahead": "How many of the readings before lay in the 95 % band of their prediction, 1, 6 and 24 hours ahead. "
        "Shares near 95 % say that the bands can be believed.",
    }
    shown = [
        {"stem": one.stem, "uri": uri, "caption": captions[one.stem], "width": round(96 * one.figure.get_figwidth())}
        for one, uri in zip(figures, data_uris(figures), strict=True)
    ]
    last = [(name, format_text(forecast.last(k))) for k, name in enumerate(forecast.names)]
    text = (
        page_environment()
        .get_template("forecast.html")
        .render(
            forecast=forecast,
            start=str(forecast.start).replace("T", " "),
            last=last,
            disturbance="" if forecast.disturbance is None else format_text(str(forecast.disturbance)),
            faces="as in the record" if forecast.faces == "record" else "as on the day before",
            errors=[
                (f"{one.hours:g} h", [f"{r:.2g} ({c:.0%})" for r, c in zip(one.rms, one.coverage, strict=True)])
                for one in forecast.step_errors
            ],
            summary=format_text(str(forecast)),
            figures=shown,
            command=command,
            date=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
            wallid=version("wallid"),
        )
    )
    return visible_text(text)
