"""Time axes: dates where the record has them, in its own zone, days where its times are seconds."""

import warnings
from dataclasses import replace
from itertools import pairwise

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.dates import date2num

import wallid
from wallid import plot
from wallid.case.time_window import Window
from wallid.estimation.prediction import HeatLoads, Prediction
from wallid.experiment_design.window_selection import Design
from wallid.plot.time_axis import TimeAxis
from wallid.records.row_times import RecordStart

FEBRUARY = date2num(np.datetime64("2009-02-01T00:00"))


@pytest.fixture(scope="module")
def case():
    return wallid.load("saint_julien")


@pytest.fixture(scope="module")
def plain():
    """A record whose times are seconds."""
    return wallid.load("validation")


def ticks(ax):
    """Position and text of each tick label of the abscissa, once the figure is laid out."""
    ax.get_figure().draw_without_rendering()
    low, high = ax.get_xlim()
    return {
        label.get_text(): at
        for label, at in zip(ax.get_xticklabels(), ax.get_xticks(), strict=True)
        if low <= at <= high
    }


def prediction(case):
    record = case.record
    loads = HeatLoads(np.zeros(record.rows), np.ones(5), np.ones(5), 1.0)
    readings = np.asarray(record.sensors)
    return Prediction(
        record.days, record.names, readings, readings, readings, np.ones_like(readings), None, loads, record.start
    )


def design(case):
    return Design(
        rows=72, starts=24 * np.arange(100), diffusivities=(1e-6,), information=np.ones((1, 100)), best=Window(24, 72),
        restart=True, step=case.record.step, labels=("2009-01-02T00:00:00", ""), record_start=case.record.start,
    )  # fmt: skip


DRAWN = {
    "record": lambda case: plot.record(case),
    "data_availability": lambda case: plot.data_availability(case),
    "regressors": lambda case: plot.regressors(case, "irradiance"),
    "sensitivity": lambda case: plot.sensitivity(case, case.record.days, case.record.sensors),
    "criterion": lambda case: plot.criterion(design(case)),
    "inner_face_flux": lambda case: plot.inner_face_flux(prediction(case)),
}


@pytest.fixture(autouse=True)
def closed():
    yield
    mpl.pyplot.close("all")


@pytest.mark.parametrize("name", DRAWN)
def test_the_ticks_of_a_record_with_dates_are_dates(case, name):
    found = ticks(DRAWN[name](case))
    assert found["Feb"] == FEBRUARY and {"Mar", "Apr"} <= set(found)
    assert not any(text.isdigit() and int(text) < 200 for text in found), "no days since the start"


def test_the_last_week_is_that_of_the_record(case):
    """It ends on 22 April at 05:00."""
    ax = plot.last_week(prediction(case), 0)
    assert set(ticks(ax)) <= {f"{day:02d}" for day in range(15, 23)} and "20" in ticks(ax)
    ax.get_figure().draw_without_rendering()
    assert ax.xaxis.get_offset_text().get_text() == "2009-Apr"
    assert ax.lines[0].get_xdata()[-1] == pytest.approx(date2num(case.record.stamps[-1]))


def test_a_record_with_seconds_keeps_days(plain):
    for ax in (plot.record(plain), plot.data_availability(plain)):
        assert ax.get_xlabel() == "days since the start of the record"
        assert {"0.0", "1.0"} <= set(ticks(ax))
        assert ax.get_xlim()[1] < 2.0


def test_the_zone_of_the_record_is_named(case):
    for zone, label in ((None, "time"), ("+01:00", "time (UTC+01:00)"), ("Z", "time (UTC)")):
        ax = plot.record(replace(case, record=replace(case.record, zone=zone)))
        assert ax.get_xlabel() == label
        assert ticks(ax)["Feb"] == FEBRUARY, "local time of the record, as in the file"


def test_the_readers_own_time_zone_moves_no_date(case):
    with mpl.rc_context({"timezone": "America/New_York"}):
        assert ticks(plot.record(case))["Feb"] == FEBRUARY


def test_a_window_is_shaded_at_its_dates(case):
    ax = plot.record(case, Window(168, 72))
    (band,) = [patch for patch in ax.patches if patch.get_label() == "window used"]
    box = band.get_extents().transformed(ax.transData.inverted())
    assert (box.x0, box.x1) == pytest.approx(tuple(date2num(case.record.stamps[[168, 239]])))


def test_a_best_window_is_named_by_its_date(case):
    ax = plot.criterion(design(case))
    assert "best window, from 2009-01-02 00:00" in [text.get_text() for text in ax.get_legend().get_texts()]
    assert ax.get_xlabel() == "start of the window (date)"


@pytest.mark.parametrize("days", [1e-3, 0.02, 0.08, 0.3, 1.0, 1.9, 2.9, 8.0, 40.0, 61.0, 100.0, 400.0, 720.0, 3000.0])
def test_every_length_has_ticks_that_do_not_overlap(days):
    """From a minute and a half to eight years, in panels of every width."""
    start = RecordStart(np.datetime64("2023-11-28T22:40:00"))
    for width in (2.8, 4.5, 9.0):
        _, ax = plot.figure(width=width)
        ax.plot(TimeAxis(start).at(np.array([0.0, days])), [0.0, 1.0])
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            TimeAxis(start).apply(ax)
            shown = ticks(ax)
        assert 2 <= len(shown) <= 10
        boxes = [label.get_window_extent() for label in ax.get_xticklabels() if label.get_text() in shown]
        assert all(one.x1 < two.x0 for one, two in pairwise(boxes))
