"""The figure of the average method: R over time, the three rules of ISO 9869-1, and in words which is not met."""

from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import matplotlib.pyplot as plt
import numpy as np
import pytest
from axes import check_complete
from legend_overlap import lines_in_legend

import wallid
from wallid import plot
from wallid.case.options import Choices
from wallid.case.time_window import Window
from wallid.estimation.heat_flux import ThermalProperties
from wallid.estimation.iso_9869 import average_method
from wallid.inference.quantity import Quantity
from wallid.report.captions import alternative_text
from wallid.report.figures import stage_figures
from wallid.workflow import Run

STEP = 900.0
ROWS = int(6.5 * 96)
DAYS = np.arange(ROWS) / 96
STEADY = np.full(ROWS, 30.0)
DRIFT = 30.0 * (1 + 0.03 * (DAYS - 3))


def case_of(flux, rows=ROWS):
    time = STEP * np.arange(rows)
    faces = np.tile([20.0, 5.0], (rows, 1))
    record = wallid.Record(time, time, None, faces, np.empty((rows, 0)), (), regressors={"flux_left": flux[:rows]})
    wall = wallid.Wall(length=0.4, diffusivity_prior=5e-7, outside="right")
    return wallid.Case("plate", Path("plate.toml"), wall, (), record, Choices(initial_profile=1, window_days=2.0))


def fit_of(case):
    """An estimate with the average method of the case and a resistance of its own."""
    record = case.record
    average = average_method(record.faces, record.regressors["flux_left"], STEP, "left")
    resistance = Quantity(0.52, 0.01, (0.50, 0.54), "m2 K/W")
    thermal = Mock(spec=ThermalProperties, average_methods=(average,), resistance=resistance)
    return Mock(spec=wallid.Estimate, thermal=thermal, window=Window(0, record.rows))


@pytest.fixture
def ax():
    yield plt.subplots()[1]
    plt.close("all")


def labelled(ax):
    return {line.get_label(): line for line in ax.lines}


def test_the_curve_ends_in_whole_days_at_the_result(ax):
    """A drifting flux over six and a half days: sums by hand."""
    case = case_of(DRIFT)
    plot.average_resistance(case, fit_of(case), 0, ax=ax)
    lines = labelled(ax)
    x, y = lines["average method, R"].get_data()
    np.testing.assert_allclose(y, 15.0 * np.arange(1, ROWS + 1) / np.cumsum(DRIFT))
    assert (x[0], x[-1]) == pytest.approx((1 / 96, 6.5))
    (end,), (result,) = lines["result"].get_data()
    assert end == 6.0 and result == pytest.approx(y[6 * 96 - 1])
    (before,), (value,) = lines["R a day before"].get_data()
    assert before == 5.0 and value == pytest.approx(y[5 * 96 - 1])
    first, last = (lines[f"R of the {name} two thirds"] for name in ("first", "last"))
    assert list(first.get_xdata()) == [0.0, 4.0] and list(last.get_xdata()) == [2.0, 6.0]
    np.testing.assert_allclose(first.get_ydata(), 15.0 / DRIFT[: 4 * 96].mean())
    np.testing.assert_allclose(last.get_ydata(), 15.0 / DRIFT[2 * 96 : 6 * 96].mean())


def test_the_band_is_five_percent_about_the_result(ax):
    case = case_of(STEADY)
    plot.average_resistance(case, fit_of(case), 0, ax=ax)
    (band,) = [artist for artist in ax.collections if artist.get_label() == "result ± 5 %"]
    box = band.get_paths()[0].get_extents()
    assert (box.x0, box.x1, box.y0, box.y1) == pytest.approx((0.0, 6.0, 0.475, 0.525))
    shortest = labelled(ax)["3 days, the least that is required"]
    assert set(shortest.get_xdata()) == {3.0}


@pytest.mark.parametrize(
    ("flux", "rows", "told"),
    [
        (STEADY, ROWS, ["All three stopping rules of ISO 9869-1 are met"]),
        (
            DRIFT,
            ROWS,
            [
                "Stopping rules of ISO 9869-1 that are not met:",
                "R of the first and of the last 4 days differ by 6.19 % (limit: 5 %)",
            ],
        ),
        (
            STEADY,
            240,
            [
                "Stopping rules of ISO 9869-1 that are not met:",
                "2.5 days were measured (at least 3 are required)",
            ],
        ),
    ],
)
def test_the_title_says_which_rule_is_not_met(ax, flux, rows, told):
    case = case_of(flux, rows)
    plot.average_resistance(case, fit_of(case), 0, ax=ax)
    assert ax.get_title(loc="left") == "" and ax.get_title().split("\n")[1:] == told
    check_complete(ax)
    assert not lines_in_legend(ax)


def test_a_plate_without_a_mean_flux_has_no_result(ax):
    case = case_of(np.zeros(ROWS))
    plot.average_resistance(case, fit_of(case), 0, ax=ax)
    assert ax.get_title() == "Left plate: the mean flux is zero, there is no resistance"
    assert "result" not in labelled(ax)
    ax.get_figure().draw_without_rendering()


def test_an_estimate_without_plates_is_refused():
    case = case_of(STEADY)
    with pytest.raises(ValueError, match="state flux_left or flux_right"):
        plot.average_resistance(case, Mock(spec=wallid.Estimate, thermal=None), 0)


@pytest.mark.slow
def test_the_report_has_the_figure_and_its_words():
    case = case_of(DRIFT)
    fit = wallid.estimate(replace(case, record=replace(case.record, faces=case.record.faces + DAYS[:, None] ** 2)))
    run = Run(case, fit=fit)
    made = dict(stage_figures(run))["average"]
    assert len(made.axes) == 1 and len(made.legends) == 1 and made.axes[0].get_legend() is None
    (average,) = fit.thermal.average_methods
    assert average.unmet_rules and all(rule in alternative_text("average", run) for rule in average.unmet_rules)
