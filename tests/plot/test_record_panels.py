"""The panels of a record: its further columns with their units, flux plates, and removed spikes."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from axes import check_complete
from matplotlib.dates import date2num
from matplotlib.patches import Rectangle

import wallid
from wallid import plot
from wallid.case.record_check import check as check_record
from wallid.report.captions import alternative_text, figure_caption
from wallid.report.figures import stage_figures
from wallid.workflow import Run

ROWS = 480
SPIKES = {"T1": (100, 31.0), "left": (200, 70.0), "right": (300, -90.0)}


@pytest.fixture(scope="module")
def case():
    """Five days of a wall with every further column, three spikes, and a gap in the irradiance."""
    import pandas as pd

    wave = np.sin(2 * np.pi * np.arange(ROWS) / 96)
    columns = {
        "left": 20 + 0.5 * wave, "right": 5 + 6 * wave, "T1": 12 + 2 * wave, "sun": np.clip(400 * wave, 0, None),
        "q1": 30 + 10 * wave, "q2": 20 - 10 * wave, "out": 4 + 6 * wave, "in": 21 + wave, "wind": 3 + wave,
        "rain": np.where(wave > 0.99, 2.0, 0.0), "heat": np.where(wave > 0, 1.0, 0.0),
    }  # fmt: skip
    columns["sun"][250:270] = np.nan
    for name, (row, value) in SPIKES.items():
        columns[name][row] = value
    table = pd.DataFrame(columns, index=pd.date_range("2024-03-01", periods=ROWS, freq="15min"))
    return wallid.Case.from_dataframe(
        table, left="left", right="right", length=0.4, diffusivity_prior=5e-7, sensors={"T1": 0.2}, noise_std=0.1,
        regressors={
            "irradiance": "sun", "flux_left": "q1", "flux_right": "q2", "air_outdoor": "out", "air_indoor": "in",
            "wind": "wind", "rain": "rain", "heating": "heat",
        },
    )  # fmt: skip


@pytest.fixture
def ax():
    yield plt.subplots()[1]
    plt.close("all")


LABELS = {
    "flux": "heat flux\n(W/m²)", "irradiance": "irradiance\n(W/m²)", "air": "air (°C)", "wind": "wind (m/s)",
    "rain": "rain (mm/h)", "heating": "heating (0 to 1)",
}  # fmt: skip


def test_fluxes_without_a_neighbour_are_drawn_as_points(case, ax):
    """A line between rows shows nothing where three of four rows have no reading."""
    flux = np.where(np.arange(ROWS) % 4 == 0, case.record.regressors["flux_left"], np.nan)
    record = replace(case.record, regressors={**case.record.regressors, "flux_left": flux})
    points, line = plot.regressors(replace(case, record=record), "flux", ax=ax).lines
    assert (points.get_linestyle(), line.get_linestyle()) == ("None", "-")
    np.testing.assert_array_equal(points.get_ydata(), flux[::4])


def test_each_further_column_has_a_panel_with_its_unit(case):
    assert plot.regressor_quantities(case) == list(LABELS)
    columns = {"flux": ["flux_left", "flux_right"], "air": ["air_outdoor", "air_indoor"]}
    for quantity, label in LABELS.items():
        ax = plot.regressors(case, quantity)
        assert ax.get_ylabel() == label
        for line, column in zip(ax.lines, columns.get(quantity, [quantity]), strict=True):
            np.testing.assert_array_equal(line.get_ydata(), case.record.regressors[column])
            np.testing.assert_allclose(line.get_xdata(), date2num(case.record.stamps))
        check_complete(ax)
        plt.close("all")


def test_a_quantity_that_is_not_there_is_refused():
    with pytest.raises(ValueError, match="quantity 'flux': the record has irradiance"):
        plot.regressors(wallid.load("saint_julien"), "flux")
    with pytest.raises(ValueError, match="no further columns"):
        plot.regressors(wallid.load("validation"), "rain")


def test_the_figure_of_the_record_holds_them_all(case):
    made = dict(stage_figures(Run(case)))["record"]
    assert [ax.get_ylabel() for ax in made.axes] == ["temperature (°C)", *LABELS.values()]
    made.draw_without_rendering()
    limits = {ax.get_xlim() for ax in made.axes}
    assert len(limits) == 1, "one time axis for all"
    assert [bool(ax.get_xlabel()) for ax in made.axes] == [False] * 6 + [True]
    assert "below, heat fluxes, irradiance, air temperatures, wind, rain, heating" in figure_caption(
        "record", Run(case)
    )
    told = alternative_text("record", Run(case))
    assert "flux left 20 to 40 W/m²" in told and "rain 0 to 2 mm/h" in told and "heating 0 to 1." in told
    assert "from 2024-03-01T00:00:00" in told and "spike" not in told


def test_a_check_shows_removed_spikes_and_every_column(case):
    run = Run(case, check=check_record(case))
    made = dict(stage_figures(run))["record"]
    temperatures, availability = made.axes[0], made.axes[-1]
    marks = {line.get_label(): line for line in temperatures.lines if line.get_label().startswith("spike removed")}
    assert set(marks) == {
        "spike removed", "spike removed, higher than shown", "spike removed, lower than shown"
    }  # fmt: skip
    for label, (row, value) in zip(sorted(marks), SPIKES.values(), strict=True):
        (x,), (y,) = marks[label].get_data()
        assert x == pytest.approx(date2num(case.record.stamps[row]))
        assert y == pytest.approx(value) if label == "spike removed" else abs(y) < abs(value)
    low, high = temperatures.get_ylim()
    assert low > -60 and high < 80, "no spike sets the scale"
    names = [label.get_text() for label in availability.get_yticklabels()]
    assert names == ["left face", "right face", "T1", "irradiance", "flux left", "flux right", "air outdoor",
                     "air indoor", "wind", "rain", "heating"]  # fmt: skip
    irradiance = [
        bars for bars in availability.collections if bars.get_paths() and 2.6 < bars.get_paths()[0].vertices[0, 1] < 3
    ]
    (runs,) = irradiance
    assert len(runs.get_paths()) == 2, "before and after its gap"
    assert "Crosses and triangles" in figure_caption("record", run)
    assert "; 3 removed spikes;" in alternative_text("record", run)


def test_a_record_without_spikes_says_nothing_of_them():
    case = wallid.load("saint_julien")
    run = Run(case, check=check_record(case))
    assert "spike" not in figure_caption("record", run) + alternative_text("record", run)
    ax = plot.record(case, spikes=True)
    assert not [line for line in ax.lines if line.get_label().startswith("spike")]
    plt.close("all")


def test_flux_plates_lie_on_the_outer_side_of_their_faces(ax, case):
    plot.wall(case, ax=ax)
    plates = {
        patch.get_label(): patch
        for patch in ax.patches
        if isinstance(patch, Rectangle) and "plate" in patch.get_label()
    }
    left, right = plates["plate left"], plates["plate right"]
    assert left.get_x() + left.get_width() == pytest.approx(0.0) and left.get_x() >= ax.get_xlim()[0]
    assert right.get_x() == pytest.approx(40.0) and right.get_x() + right.get_width() <= ax.get_xlim()[1]
    assert "heat flux plates" in [text.get_text() for text in ax.get_legend().get_texts()]
    assert "heat flux plates on the left and right" in alternative_text("wall", Run(case))
    check_complete(ax)


def test_a_wall_without_plates_has_none(ax):
    case = wallid.load("saint_julien")
    plot.wall(case, ax=ax)
    assert not [patch for patch in ax.patches if "plate" in str(patch.get_label())]
    assert "plate" not in figure_caption("wall", Run(case)) + alternative_text("wall", Run(case))
