"""The page of a forecast and its figures."""

from __future__ import annotations

from matplotlib.figure import Figure

from .. import plot
from .._internal.number_formats import format_text
from ..estimation.forecast_result import Forecast
from .single_page import SinglePage

_CAPTIONS = {
    "forecast": "The readings before and after the start of the forecast, the forecast, and the band that holds "
    "95 % of the readings.",
    "ahead": "How many of the readings before lay in the 95 % band of their prediction, 1, 6 and 24 hours ahead. "
    "Shares near 95 % say that the bands can be believed.",
}


def forecast_page(forecast: Forecast) -> SinglePage:
    """What `wallid forecast` writes."""
    disturbance = forecast.disturbance
    return SinglePage(
        case=forecast.case.name,
        template="forecast.html",
        context={
            "forecast": forecast,
            "start": str(forecast.start).replace("T", " "),
            "last": [(name, format_text(forecast.last(k))) for k, name in enumerate(forecast.names)],
            "disturbance": "" if disturbance is None else format_text(str(disturbance)),
            "faces": format_text(forecast.faces_text),
            "doubt": format_text(forecast.unreliable_reason),
            "errors": [
                (f"{one.hours:g} h", [f"{r:.2g} ({c:.0%})" for r, c in zip(one.rms, one.coverage, strict=True)])
                for one in forecast.step_errors
            ],
            "summary": format_text(str(forecast)),
        },
        entries={
            "forecast": forecast.to_dict(),
            "disturbance": None if disturbance is None else disturbance.to_dict(),
        },
        draw=lambda: _figures(forecast),
        captions=_CAPTIONS,
        files={"forecast.csv": forecast.to_csv().encode()},
    )


def _figures(forecast: Forecast) -> list[tuple[str, Figure]]:
    with plot.style():
        count = len(forecast.names)
        bands, axes = plot.figure(count, 1, height=2.4 * count)
        for k, ax in enumerate([axes] if count == 1 else axes):
            plot.forecast_band(forecast, k, ax=ax)
        figures = [("forecast", bands)]
        if forecast.step_errors:
            ahead, ax = plot.figure(height=2.6)
            plot.errors_ahead(forecast, ax=ax)
            figures.append(("ahead", ahead))
    return figures
