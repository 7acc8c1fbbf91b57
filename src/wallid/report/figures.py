"""Every figure of a run, composed of panels of `wallid.plot`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from io import BytesIO
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure

from .. import plot
from ..case.case_definition import Case
from ..case.time_window import Window, diagnosis_window, entire_record
from ..discrepancy.effect_fit import EffectFit
from ..discrepancy.next_measurement.actions import Prescription
from ..discrepancy.residual_tests import ResidualTests
from ..discrepancy.result.diagnosis_result import Diagnosis
from ..estimation.diffusivity import sensitivity_in_kelvin
from ..estimation.unknown_heat import UnknownHeat
from ..models.flux_plates import plate_outputs
from ..models.window_inputs import full_order_model
from ..plot.legends import legend_below, shared_legend

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
    "average",
    "missing",
    "residuals",
    "remainder",
    "fit",
    "confusable",
    "windows",
    "next",
    "heat",
    "periodogram",
)
"""Names of all figure files, without extension."""
_MOST_POINTS = 20_000  # of a line; in a vector file, longer lines are drawn as pixels
_MOST_MARKERS = 400  # of a line; more are drawn as pixels
_MOST_SENSORS = 6  # in the figure of the worst week
_NARROW = 4.0  # inches
_SECTION_WIDTH = 5.0  # inches, of the figure of a section
_COMPARABLE = 3.0  # times the smaller range: panels of the average method with larger differences have their own scales
_RECORD_HEIGHT, _REGRESSOR_HEIGHT = 3.2, 1.4  # inches
_AVAILABILITY_HEIGHT, _AVAILABILITY_ROW = 1.2, 0.25  # inches, and of each column


def encode_figure(
    figure: Figure, kind: str, *, salt: str, facecolor: str = "auto", most_points: int = _MOST_POINTS
) -> bytes:
    """Contents of a figure file, the same bytes each time; in vector files, long lines are drawn as pixels.

    Args:
        figure: the matplotlib figure.
        kind: "png", "svg" or "pdf".
        salt: of the ids in an SVG.
        facecolor: colour of the background.
        most_points: of a line that is not drawn as pixels.
    """
    for ax in figure.axes:
        for mesh in ax.collections:
            mesh.set_rasterized(isinstance(mesh, QuadMesh))
        for line in ax.lines:
            marked = line.get_marker() not in ("None", "none", "", " ", None)
            most = min(_MOST_MARKERS, most_points) if marked else most_points
            line.set_rasterized(np.size(line.get_xdata()) > most)
    undated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind, {})
    settings = {"svg.hashsalt": salt, "svg.fonttype": "path", "figure.constrained_layout.use": False}
    stream = BytesIO()
    with plot.style(), mpl.rc_context(settings):  # pyright: ignore[reportArgumentType]
        _lay_out(figure)
        figure.savefig(stream, format=kind, facecolor=facecolor, metadata=undated)
    return stream.getvalue()


def _lay_out(figure: Figure) -> None:
    """Compute the layout once; otherwise each file would compute it twice."""
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
        figure.set_layout_engine(None)  # takes the default of the active style: no layout engine


def stage_figures(run: Run) -> Iterator[tuple[str, Figure]]:
    """Each figure of the stages of a run except those of its diagnosis, with the name of its file."""
    with plot.style():
        yield "wall", _wall_figure(run.case)
        yield "record", _record_figure(run)
        if run.design is not None:
            yield "design", _design_figure(run)
        if run.sensor_placement is not None and run.sampling is not None:
            figure, axes = plot.figure(1, 2, width=9.0, height=3.8)
            plot.sensor_placement(run.sensor_placement, ax=axes[0])
            plot.sampling_steps(run.sampling, ax=axes[1])
            yield "places", figure
        if run.orders:
            figure, ax = plot.figure(height=3.2)
            plot.error_by_order(run.orders, ax=ax)
            yield "orders", figure
        if run.campaign is not None:
            yield "campaign", _campaign_figure(run.campaign)
        if run.fit is not None:
            yield "estimate", _estimate_figure(run) if run.case.sensors else _convergence_figure(run)
        if run.fit is not None and run.fit.thermal is not None:
            yield "flux", _flux_figure(run)
            yield "average", _average_figure(run)
        if run.prediction is not None:
            yield "reliability", _prediction_figure(run)
            yield "uncertainty", _uncertainty_figure(run)
        if run.prediction is not None and run.prediction.loads is not None:
            figure, axes = plot.figure(1, 2, height=2.8)
            plot.inner_face_flux(run.prediction, ax=axes[0])
            plot.heat_load(run.prediction.loads, ax=axes[1])
            yield "loads", figure


def _record_figure(run: Run) -> Figure:
    """Panels with one time axis: the temperatures, each further quantity, and for a check the available readings."""
    quantities = plot.regressor_quantities(run.case)
    heights = [_RECORD_HEIGHT, *(_REGRESSOR_HEIGHT for _ in quantities)]
    if run.check is not None:
        columns = 2 + len(run.case.sensors) + len(run.case.record.regressors)
        heights.append(_AVAILABILITY_HEIGHT + _AVAILABILITY_ROW * columns)
    figure, axes = plot.figure(len(heights), 1, height=heights)
    axes = np.atleast_1d(axes)
    plot.record(run.case, shaded_window(run), spikes=run.check is not None, ax=axes[0])
    for quantity, ax in zip(quantities, axes[1:], strict=False):
        plot.regressors(run.case, quantity, ax=ax)
    if run.check is not None:
        plot.data_availability(run.case, ax=axes[-1])
    for ax in axes[1:]:
        ax.sharex(axes[0])
    for ax in axes[:-1]:
        ax.label_outer()
    return figure


def shaded_window(run: Run) -> Window | None:
    """The window shaded in the figure of the record; None where the entire record is used, or nothing of it."""
    if run.fit is not None:
        return run.fit.window
    if run.design is not None:
        return run.design.best
    if run.diagnosis is not None and run.case.choices.diagnose_days is not None:
        return diagnosis_window(run.case)
    return None


def _wall_figure(case: Case, narrow: bool = False) -> Figure:
    """The wall with its sensors: its layers along x, or its section."""
    section = case.section
    if section is not None:
        width = _NARROW if narrow else _SECTION_WIDTH
        figure, ax = plot.figure(width=width, height=min(width * section.height / section.length, 1.5 * width) + 0.8)
        plot.materials(section, case.sensors, ax=ax)
        return figure
    if narrow:
        figure, ax = plot.figure(width=_NARROW, height=1.8)
    else:
        figure, ax = plot.figure(height=2.2 + 0.16 * len(case.wall.layers))
    plot.wall(case, ax=ax)
    return figure


def narrow_figures(run: Run) -> Iterator[tuple[str, Figure]]:
    """Narrow versions of figures for small screens, with the names of the files that they replace."""
    with plot.style():
        yield "wall", _wall_figure(run.case, narrow=True)


def _design_figure(run: Run) -> Figure:
    """Panels: sensitivity of the readings, criterion by start day, criterion by window length."""
    assert run.design is not None
    sensors, plates = len(run.case.sensors), plate_outputs(run.case)
    panels = (sensors > 0) + (len(plates) > 0)
    figure, axes = plot.figure(panels + (1 if run.lengths is None else 2), height=2.4)
    window = entire_record(run.case)
    sensitivity = sensitivity_in_kelvin(
        full_order_model(run.case, plates), run.case, window, run.design.diffusivities[0]
    )
    days = run.case.record.days[window.as_slice]
    if sensors:
        plot.sensitivity(run.case, days, sensitivity[:, :sensors], ax=axes[0])
    if plates:
        plot.flux_sensitivity(run.case, days, sensitivity[:, sensors:], ax=axes[panels - 1])
    plot.criterion(run.design, ax=axes[panels])
    if run.lengths is not None:
        plot.window_lengths(run.lengths, ax=axes[panels + 1])
    return figure


def _estimate_figure(run: Run) -> Figure:
    assert run.fit is not None
    figure, axes = plot.figure(2, 2, width=9.0, height=3.0)
    plot.convergence(run.fit, axes=axes[1])
    sensitivity = sensitivity_in_kelvin(full_order_model(run.case), run.case, run.fit.window, run.fit.value)
    plot.measured_against_simulated(run.case, run.fit, sensitivity, legend=False, ax=axes[0, 0])
    plot.residual(run.case, run.fit, sensitivity, legend=False, ax=axes[0, 1])
    legend_below(axes[0, 0])
    return figure


def _campaign_figure(campaign: CampaignEstimate) -> Figure:
    """The diffusivity from each window, and the resistance beside it where there are flux plates."""
    height = 1.6 + 0.22 * min(len(campaign.windows), 40)
    if campaign.thermal is None:
        figure, ax = plot.figure(height=height)
        plot.forest(campaign, ax=ax)
        return figure
    figure, axes = plot.figure(1, 2, width=9.0, height=height)
    plot.forest(campaign, legend=False, ax=axes[0])
    plot.resistance_forest(campaign, legend=False, ax=axes[1])
    axes[1].set(ylabel="", yticklabels=[])
    shared_legend(figure, axes[0])
    return figure


def _convergence_figure(run: Run) -> Figure:
    """Convergence alone, for an estimate from fluxes: there are no sensor temperatures to show."""
    assert run.fit is not None
    figure, axes = plot.figure(1, 2, width=9.0, height=2.8)
    plot.convergence(run.fit, axes=axes)
    return figure


def _flux_figure(run: Run) -> Figure:
    """A row for each plate: measured and simulated flux, residual, and density of the residual."""
    assert run.fit is not None and run.fit.thermal is not None
    plates = len(run.fit.thermal.plate_gains)
    figure, axes = plot.figure(plates, 3, width=11.0, height=2.8)
    for p, (series, residual, density) in enumerate(np.atleast_2d(axes)):
        plot.measured_flux(run.case, run.fit, p, ax=series)
        plot.flux_residual(run.case, run.fit, p, ax=residual)
        plot.flux_density(run.case, run.fit, p, ax=density)
    return figure


def _average_figure(run: Run) -> Figure:
    """The average method of ISO 9869-1 for each plate, one below another."""
    assert run.fit is not None and run.fit.thermal is not None
    plates = len(run.fit.thermal.average_methods)
    figure, axes = plot.figure(plates, 1, height=3.6)
    for p, ax in enumerate(np.atleast_1d(axes)):
        plot.average_resistance(run.case, run.fit, p, legend=False, ax=ax)
    lows, highs = np.array([ax.get_ylim() for ax in np.atleast_1d(axes)]).T
    if highs.max() - lows.min() < _COMPARABLE * (highs - lows).min():  # one scale, to compare the plates
        for ax in np.atleast_1d(axes):
            ax.set_ylim(float(lows.min()), float(highs.max()))
    shared_legend(figure, np.ravel(axes)[0])
    return figure


def _prediction_figure(run: Run) -> Figure:
    prediction = run.prediction
    assert prediction is not None
    figure, axes = plot.figure(len(prediction.sensor_names), 2, width=9.0, height=2.4)
    for s, row in enumerate(np.atleast_2d(axes)):
        plot.last_week(prediction, s, ax=row[0])
        plot.residual_density(prediction, s, ax=row[1])
    return figure


def _uncertainty_figure(run: Run) -> Figure:
    assert run.prediction is not None and run.fit is not None
    figure, axes = plot.figure(1, 2, height=2.8)
    plot.measurement_uncertainty(run.prediction, ax=axes[0])
    plot.initial_profile(run.case, run.fit.window, ax=axes[1])
    return figure


def diagnosis_figures(diagnosis: Diagnosis) -> Iterator[tuple[str, Figure]]:
    """Each figure of a diagnosis with the name of its file; without effects, each has one panel, of the plain model.

    The gains and the similarity of the effects are left out where the verdict is adequate: all effects are chance then.
    """
    with plot.style():
        yield "missing", _missing_figure(diagnosis)
        if questions := _drawn_questions(diagnosis):
            yield "next", _next_figure(questions)
        if diagnosis.unknown_heat is not None:
            yield "heat", _heat_figure(diagnosis.unknown_heat)
        yield "residuals", _residuals_figure(diagnosis)
        if diagnosis.incomplete:
            figure, ax = plot.figure(height=3.0)
            plot.smooth_residual(diagnosis.after, diagnosis.residual_tests_after, ax=ax)
            yield "remainder", figure
        yield "fit", _week_figure(diagnosis)
        if len(diagnosis.scores.candidates) and diagnosis.verdict != "adequate":
            yield "confusable", _similarity_figure(diagnosis)
        if diagnosis.effects:
            yield "windows", _windows_figure(diagnosis)
        yield "periodogram", _periodogram_figure(diagnosis)


def _models(diagnosis: Diagnosis) -> list[tuple[str, EffectFit, ResidualTests]]:
    """The models with panels, with their titles."""
    return [(label[:1].upper() + label[1:], fit, tests) for label, fit, tests in diagnosis.shown_models]


def _missing_figure(diagnosis: Diagnosis) -> Figure:
    if diagnosis.verdict == "adequate":  # every gain is chance then
        figure, ax = plot.figure(width=8.0, height=3.2)
        plot.waterfall(diagnosis, ax=ax)
        return figure
    figure, axes = plot.figure(2, 1, width=8.0, height=3.2)
    plot.waterfall(diagnosis, ax=axes[0])
    plot.ranked_gains(diagnosis, ax=axes[1])
    return figure


def _residuals_figure(diagnosis: Diagnosis) -> Figure:
    models = _models(diagnosis)
    figure, axes = plot.figure(2, len(models), width=4.0 + 3.5 * len(models), height=2.8)
    axes = np.reshape(axes, (2, len(models)))
    limit = plot.colour_limit(diagnosis)
    for column, (title, fit, tests) in zip(axes.T, models, strict=True):
        plot.residual_map(fit, limit, title, colour_bar=False, ax=column[0])
        if column[1] is not axes[1, 0]:
            column[1].sharey(axes[1, 0])
        plot.hourly_residual(fit, tests.by_hour, f"{title}: by hour of the day", legend=False, ax=column[1])
    plot.shared_colour_bar(list(axes[0]), plot.residual_scale(diagnosis.problem)[1])
    shared_legend(figure, axes[1, 0])
    return figure


def _drawn_questions(diagnosis: Diagnosis) -> list[Prescription]:
    """The questions with something to draw; those of columns that were not logged as one."""
    shown = [one for one in diagnosis.prescriptions if one.curve or one.actions]
    questions, columns = ([one for one in shown if bool(one.column) is is_column] for is_column in (False, True))
    together = tuple(action for one in columns for action in one.actions)
    return [*questions, *(replace(one, actions=together) for one in columns[:1])]


def _next_figure(shown: list[Prescription]) -> Figure:
    """A row for each question: the sensor by its place, and the actions."""
    places = any(one.curve for one in shown)
    heights = [1.7 + 0.25 * max(3, len(one.actions)) for one in shown]
    figure, axes = plot.figure(len(shown), 2 if places else 1, width=9.6 if places else 6.4, height=heights)
    for one, row in zip(shown, np.reshape(axes, (len(shown), -1)), strict=True):
        if one.curve:
            plot.sensor_probability(one, legend=False, ax=row[0])
        elif places:
            row[0].set_axis_off()
        plot.action_probabilities(one, legend=False, ax=row[-1])
        if not one.actions:
            row[-1].set_axis_off()
            row[-1].set_title("No action is probable enough")
    shared_legend(figure, next(ax for ax in np.ravel(axes) if ax.axison))
    return figure


def _heat_figure(heat: UnknownHeat) -> Figure:
    """The course of the unknown heat, its spectrum, and its mean day where there is one."""
    has_day = len(heat.mean_day[0]) > 0
    figure, axes = plot.figure(2 + has_day, 1, height=2.6)
    plot.heat_course(heat, ax=axes[0])
    plot.heat_spectrum(heat, ax=axes[1])
    if has_day:
        plot.heat_of_day(heat, ax=axes[2])
    return figure


def _week_figure(diagnosis: Diagnosis) -> Figure:
    problem = diagnosis.problem
    sensors = min(problem.sensor_count, _MOST_SENSORS)
    shown = [*range(sensors), *range(problem.sensor_count, problem.instrument_count)]
    figure, axes = plot.figure(len(shown), 2, width=10.0, height=2.2)
    rows = np.reshape(axes, (len(shown), 2))
    for s, row in zip(shown, rows, strict=True):
        first = rows[0, 1] if s < sensors else rows[sensors, 1]
        plot.week_readings(diagnosis, s, legend=False, ax=row[0])
        if row[1] is not first:
            row[1].sharey(first)  # to compare the residuals of the sensors, and those of the plates
        plot.week_residuals(diagnosis, s, legend=False, ax=row[1])
    shared_legend(figure, np.ravel(axes)[0])
    return figure


def _similarity_figure(diagnosis: Diagnosis) -> Figure:
    figure, ax = plot.figure(width=7.6, height=6.2)
    plot.cosine_similarity(diagnosis, ax=ax)
    return figure


def _windows_figure(diagnosis: Diagnosis) -> Figure:
    count = len(diagnosis.effects)
    figure, axes = plot.figure(count, 1, height=2.6)
    for ax, named in zip(np.ravel(axes), diagnosis.effects, strict=True):
        plot.size_by_window(diagnosis, named, ax=ax)
    return figure


def _periodogram_figure(diagnosis: Diagnosis) -> Figure:
    models = _models(diagnosis)
    figure, axes = plot.figure(1, len(models), width=2.0 + 3.2 * len(models), height=3.0)
    for ax, (title, fit, _) in zip(np.ravel(axes), models, strict=True):
        plot.cumulative_periodogram(fit, f"{title}: cumulative periodogram", legend=False, ax=ax)
    shared_legend(figure, np.ravel(axes)[0])
    return figure
