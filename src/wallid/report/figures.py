"""Every figure of a run, put together from the Axes of `plot`."""

from __future__ import annotations

from collections.abc import Iterator
from io import BytesIO
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure

from .. import plot
from ..case.time_window import Window, diagnosed, whole
from ..discrepancy.effect_fit import Fit
from ..discrepancy.findings import Diagnosis
from ..discrepancy.residual_tests import ResidualTests
from ..estimation.diffusivity import theta_kelvin
from ..models.flux_plates import plate_outputs
from ..models.window_inputs import full_order_model
from ..plot.legends import shared_legend

if TYPE_CHECKING:
    from ..estimation.many_windows import CampaignEstimate
    from ..workflow import Run

STEMS = (
    "wall",
    "record",
    "design",
    "places",
    "orders",
    "campaign",
    "estimate",
    "reliability",
    "uncertainty",
    "loads",
    "flux",
    "missing",
    "residuals",
    "remainder",
    "fit",
    "confusable",
    "windows",
    "periodogram",
)
"""The stems of all of them."""
_MOST_POINTS = 20_000  # of a line: past it a drawing holds it as pixels
_MOST_MARKERS = 400  # of a line: each is a stroke of its own
_MOST_SENSORS = 6  # of the worst week's figure
_NARROW = 4.0  # inches


def encode(made: Figure, kind: str, *, salt: str, facecolor: str = "auto", most_points: int = _MOST_POINTS) -> bytes:
    """A figure as a file, the same bytes each time; of a drawing, what would be too many strokes is held as pixels.

    Args:
        kind: "png", "svg" or "pdf".
        salt: of the names within an SVG.
        facecolor: of the ground.
        most_points: of a line that is not held as pixels.
    """
    for ax in made.axes:
        for mesh in ax.collections:
            mesh.set_rasterized(isinstance(mesh, QuadMesh))
        for line in ax.lines:
            marked = line.get_marker() not in ("None", "none", "", " ", None)
            most = min(_MOST_MARKERS, most_points) if marked else most_points
            line.set_rasterized(np.size(line.get_xdata()) > most)
    undated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind, {})
    own = {"svg.hashsalt": salt, "svg.fonttype": "path", "figure.constrained_layout.use": False}
    stream = BytesIO()
    with plot.style(), mpl.rc_context(own):  # pyright: ignore[reportArgumentType]
        _lay_out(made)
        made.savefig(stream, format=kind, facecolor=facecolor, metadata=undated)
    return stream.getvalue()


def _lay_out(made: Figure) -> None:
    """Put the Axes in their places, once: each file would do so twice more."""
    engine = made.get_layout_engine()
    if engine is not None:
        engine.execute(made)
        made.set_layout_engine(None)  # to what the style in force says, which is none


def of_stages(run: Run) -> Iterator[tuple[str, Figure]]:
    """Every figure that a run has the numbers for but those of its diagnosis, with its file's stem."""
    with plot.style():
        made, ax = plot.figure(height=2.2 + 0.16 * len(run.case.wall.layers))
        plot.wall(ax, run.case)
        yield "wall", made
        yield "record", _record_figure(run)
        if run.design is not None:
            yield "design", _design_figure(run)
        if run.places is not None and run.sampling is not None:
            made, axes = plot.figure(1, 2, width=9.0, height=3.8)
            plot.sensor_places(axes[0], run.places)
            plot.sampling(axes[1], run.sampling)
            yield "places", made
        if run.orders:
            made, ax = plot.figure(height=3.2)
            plot.orders(ax, run.orders)
            yield "orders", made
        if run.campaign is not None:
            yield "campaign", _campaign_figure(run.campaign)
        if run.fit is not None:
            yield "estimate", _estimate_figure(run) if run.case.sensors else _convergence_figure(run)
        if run.fit is not None and run.fit.thermal is not None:
            yield "flux", _flux_figure(run)
        if run.prediction is not None:
            yield "reliability", _reliability_figure(run)
            yield "uncertainty", _uncertainty_figure(run)
        if run.prediction is not None and run.prediction.loads is not None:
            made, axes = plot.figure(1, 2, height=2.8)
            plot.flux(axes[0], run.prediction.days, run.prediction.loads)
            plot.loads(axes[1], run.prediction.loads)
            yield "loads", made


def _record_figure(run: Run) -> Figure:
    if run.check is not None:
        made, axes = plot.figure(2, 1, height=3.2)
        plot.record(axes[0], run.case)
        plot.coverage(axes[1], run.case)
        return made
    made, ax = plot.figure(height=3.2)
    plot.record(ax, run.case, shaded(run))
    return made


def shaded(run: Run) -> Window | None:
    """The window that the record's figure marks; None where all of the record is used, or none of it."""
    if run.fit is not None:
        return run.fit.window
    if run.design is not None:
        return run.design.best
    if run.diagnosis is not None and run.case.choices.diagnose_days is not None:
        return diagnosed(run.case)
    return None


def narrow(run: Run) -> Iterator[tuple[str, Figure]]:
    """What a small screen shows instead of the figure of the same stem: as legible, and not as wide."""
    with plot.style():
        made, ax = plot.figure(width=_NARROW, height=1.8)
        plot.wall(ax, run.case)
        yield "wall", made


def _design_figure(run: Run) -> Figure:
    """How far each reading would move, then the criterion, then what longer windows would give."""
    assert run.design is not None
    sensors, plates = len(run.case.sensors), plate_outputs(run.case)
    shown = (sensors > 0) + (len(plates) > 0)
    made, axes = plot.figure(shown + (1 if run.lengths is None else 2), height=2.4)
    window = whole(run.case)
    moved = theta_kelvin(full_order_model(run.case, plates), run.case, window, run.design.diffusivities[0])
    days = run.case.record.days[window.part]
    if sensors:
        plot.theta(axes[0], run.case, days, moved[:, :sensors])
    if plates:
        plot.flux_theta(axes[shown - 1], run.case, days, moved[:, sensors:])
    plot.criterion(axes[shown], run.design)
    if run.lengths is not None:
        plot.compromise(axes[shown + 1], run.lengths)
    return made


def _estimate_figure(run: Run) -> Figure:
    assert run.fit is not None
    made, axes = plot.figure(2, 2, width=9.0, height=2.8)
    plot.convergence(axes[0, 0], axes[0, 1], run.fit)
    theta = theta_kelvin(full_order_model(run.case), run.case, run.fit.window, run.fit.value)
    plot.measured_against_simulated(axes[1, 0], run.case, run.fit, theta, legend=False)
    plot.residual(axes[1, 1], run.case, run.fit, theta, legend=False)
    shared_legend(made, axes[1, 0])
    return made


def _campaign_figure(found: CampaignEstimate) -> Figure:
    """Every window's diffusivity, and its resistance beside it where fluxes told any."""
    height = 1.6 + 0.22 * min(len(found.windows), 40)
    if found.thermal is None:
        made, ax = plot.figure(height=height)
        plot.forest(ax, found)
        return made
    made, axes = plot.figure(1, 2, width=9.0, height=height)
    plot.forest(axes[0], found, legend=False)
    plot.resistance_forest(axes[1], found, legend=False)
    axes[1].set(ylabel="", yticklabels=[])
    shared_legend(made, axes[0])
    return made


def _convergence_figure(run: Run) -> Figure:
    """Of an estimate from fluxes alone: there are no temperatures to show beside it."""
    assert run.fit is not None
    made, axes = plot.figure(1, 2, width=9.0, height=2.8)
    plot.convergence(axes[0], axes[1], run.fit)
    return made


def _flux_figure(run: Run) -> Figure:
    """A row for each plate: measured and simulated, what is left, and its density."""
    assert run.fit is not None and run.fit.thermal is not None
    plates = len(run.fit.thermal.gains)
    made, axes = plot.figure(plates, 3, width=11.0, height=2.8)
    for p, (course, residual, density) in enumerate(np.atleast_2d(axes)):
        plot.measured_flux(course, run.case, run.fit, p)
        plot.flux_residual(residual, run.case, run.fit, p)
        plot.flux_density(density, run.case, run.fit, p)
    return made


def _reliability_figure(run: Run) -> Figure:
    found = run.prediction
    assert found is not None
    made, axes = plot.figure(len(found.names), 2, width=9.0, height=2.4)
    for s, row in enumerate(np.atleast_2d(axes)):
        plot.last_week(row[0], found, s)
        plot.density(row[1], found, s)
    return made


def _uncertainty_figure(run: Run) -> Figure:
    assert run.prediction is not None and run.fit is not None
    made, axes = plot.figure(1, 2, height=2.8)
    plot.uncertainty(axes[0], run.prediction)
    plot.initial_profile(axes[1], run.case, run.fit.window)
    return made


def diagnosis(explanation: Diagnosis) -> Iterator[tuple[str, Figure]]:
    """The figures of a diagnosis, with their files' stems; one panel where nothing was added to the plain model."""
    with plot.style():
        yield "missing", _missing_figure(explanation)
        yield "residuals", _residuals_figure(explanation)
        if explanation.incomplete:
            made, ax = plot.figure(height=3.0)
            plot.smooth_remainder(ax, explanation.after, explanation.left_after)
            yield "remainder", made
        yield "fit", _week_figure(explanation)
        if len(explanation.screen.candidates):
            yield "confusable", _confusable_figure(explanation)
        if explanation.effects:
            yield "windows", _windows_figure(explanation)
        yield "periodogram", _periodogram_figure(explanation)


def _shown(explanation: Diagnosis) -> list[tuple[str, Fit, ResidualTests]]:
    """The models that have panels: the plain one, and the one with effects where there are any."""
    before = ("Plain model", explanation.before, explanation.left_before)
    if not explanation.after.active:
        return [before]
    effects = "effect" if len(explanation.effects) == 1 else "effects"
    words = f"Nearest {effects}, refused" if explanation.incomplete else f"With the {effects}"
    return [before, (words, explanation.after, explanation.left_after)]


def _missing_figure(explanation: Diagnosis) -> Figure:
    made, axes = plot.figure(2, 1, width=8.0, height=3.2)
    plot.waterfall(axes[0], explanation)
    plot.ranked_gains(axes[1], explanation)
    return made


def _residuals_figure(explanation: Diagnosis) -> Figure:
    shown = _shown(explanation)
    made, axes = plot.figure(2, len(shown), width=4.0 + 3.5 * len(shown), height=2.8)
    axes = np.reshape(axes, (2, len(shown)))
    limit = plot.colour_limit(explanation)
    for column, (title, fit, left) in zip(axes.T, shown, strict=True):
        plot.residual_map(column[0], fit, limit, title, colour_bar=False)
        if column[1] is not axes[1, 0]:
            column[1].sharey(axes[1, 0])
        plot.hourly_residual(column[1], fit, left.by_hour, f"{title}: by hour of the day", legend=False)
    plot.shared_colour_bar(axes[0, 0].collections[0], list(axes[0]))
    shared_legend(made, axes[1, 0])
    return made


def _week_figure(explanation: Diagnosis) -> Figure:
    sensors = min(explanation.study.sensors, _MOST_SENSORS)
    made, axes = plot.figure(sensors, 2, width=10.0, height=2.2)
    for s, row in enumerate(np.reshape(axes, (sensors, 2))):
        plot.week_temperatures(row[0], explanation, s, legend=False)
        if s > 0:
            row[1].sharey(np.ravel(axes)[1])  # to see which sensor misses most
        plot.week_residuals(row[1], explanation, s, legend=False)
    shared_legend(made, np.ravel(axes)[0])
    return made


def _confusable_figure(explanation: Diagnosis) -> Figure:
    made, ax = plot.figure(width=7.6, height=6.2)
    plot.confusability(ax, explanation)
    return made


def _windows_figure(explanation: Diagnosis) -> Figure:
    count = len(explanation.effects)
    made, axes = plot.figure(count, 1, height=2.6)
    for ax, named in zip(np.ravel(axes), explanation.effects, strict=True):
        plot.size_by_window(ax, explanation, named)
    return made


def _periodogram_figure(explanation: Diagnosis) -> Figure:
    shown = _shown(explanation)
    made, axes = plot.figure(1, len(shown), width=2.0 + 3.2 * len(shown), height=3.0)
    for ax, (title, fit, _) in zip(np.ravel(axes), shown, strict=True):
        plot.cumulative_periodogram(ax, fit, f"{title}: cumulative periodogram", legend=False)
    shared_legend(made, np.ravel(axes)[0])
    return made
