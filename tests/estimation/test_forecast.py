"""Forecasts of walls with heat that no column explains; the truth is sine series, no part of wallid."""

import io
import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from benchmarks.accuracy.disturbance import FACE_STD, LENGTH, PLACES, SENSOR_STD, Kind
from heated_walls import DAY_ROWS, case_of
from numpy.testing import assert_allclose
from pages import check
from typer.testing import CliRunner

import wallid
from wallid import plot
from wallid.case.time_window import entire_record, row_at
from wallid.cli.commands import app
from wallid.estimation.forecasting import step_errors
from wallid.estimation.persistence import error_of_persistence, with_persistent_faces
from wallid.inference.filter_model import filter_model
from wallid.inference.generalised_least_squares import fit_generalised_least_squares
from wallid.models.flux_plates import full_order_model_with_plates
from wallid.models.window_inputs import window_data
from wallid.records.cleaning_log import RecordBreak
from wallid.report.page import page_environment


@pytest.fixture(scope="module")
def found():
    return wallid.forecast(case_of(), "2026-03-05T00:00", 24.0)


def test_the_band_holds_the_readings(found):
    assert found.mean.shape == found.std.shape == (DAY_ROWS, 2)
    assert min(found.inside) > 0.8, "of 48 dependent readings"
    assert found.disturbance is not None and found.disturbance.place == "wall"
    assert 1.0 < found.disturbance.std < 6.0 and found.disturbance.unit == "K/day"
    first, last = found.std[0], found.std[-1]
    assert np.all(first > SENSOR_STD) and np.all(last > 2 * first), "it grows as the readings age"
    residual = found.measured[found.first :] - found.mean
    assert np.sqrt(np.nanmean(residual**2)) < 0.6
    for one in found.step_errors:
        assert min(one.coverage) > 0.85 and one.hours in (1.0, 6.0, 24.0)
    assert found.step_errors[0].rms < found.step_errors[-1].rms


def test_the_first_step_is_the_filters_innovation():
    """One row ahead, the errors over their standard deviations are the innovations of the filter."""
    case = case_of()
    window = entire_record(case)
    fit = fit_generalised_least_squares(
        case, window, window_data(case, window), full_order_model_with_plates(case), 5e-7, eta=1e-8
    )
    states = filter_model(case, window, fit)
    rows = case.record.rows
    filtered = states.filtered()
    one = step_errors([(1.0, states, filtered)], case.record.step, (case.record.step / 3600.0,))[0]
    begin = rows // 5 + 1
    H = np.asarray(states.model.outputs)[begin:]
    predicted = np.einsum("tos,ts->to", H, np.asarray(filtered.predicted_mean)[begin:])
    assert_allclose(one.rms, np.sqrt(np.mean((states.readings[begin:] - predicted) ** 2, axis=0)), rtol=1e-9)


def test_persistence_goes_on_from_the_last_reading(found):
    """After the record's end the faces are those of a day before, moved; the error grows from nothing."""
    case = case_of()
    stamp = str(case.record.stamp(case.record.rows))
    after = wallid.forecast(case, stamp, 36.0)
    assert after.faces == "persistence" and not np.isfinite(after.measured[after.first :]).any()
    faces, rows = np.asarray(after.case.record.faces), case.record.rows
    moved = faces[rows - 1] - faces[rows - 1 - DAY_ROWS]
    assert_allclose(faces[rows : rows + DAY_ROWS], faces[rows - DAY_ROWS : rows] + moved)
    assert_allclose(faces[rows + DAY_ROWS], faces[rows - DAY_ROWS + 0] + moved)
    persistent = wallid.forecast(case_of(), "2026-03-05T00:00", 24.0, faces="persistence")
    assert np.all(persistent.std[-1] > found.std[-1]) and np.all(np.isnan(after.inside))
    assert_allclose(persistent.std[0], found.std[0], rtol=0.2)


def test_a_forecast_does_not_depend_on_its_length(found):
    longer = wallid.forecast(case_of(), "2026-03-05T00:00", 60.0)
    assert longer.faces == "persistence" and longer.logged == DAY_ROWS
    assert "until 2026-03-05T23:30:00, then as on the day before" in str(longer)
    assert longer.disturbance.evidence == pytest.approx(found.disturbance.evidence, rel=0.02)
    assert_allclose(longer.mean[:DAY_ROWS], found.mean, atol=0.02)
    assert_allclose(longer.std[:DAY_ROWS], found.std, rtol=0.02)


def test_interpolated_faces_widen_a_forecast(found):
    case, fill_std = case_of(), np.zeros((240, 2))
    fill_std[193:207] = 3.0
    wide = wallid.forecast(replace(case, record=replace(case.record, fill_std=fill_std)), "2026-03-05T00:00", 12.0)
    assert np.all(wide.std[14] > 1.5 * found.std[14])


def test_the_error_of_persistence_is_that_of_a_random_walk():
    """Of faces that are random walks its variance is 2 j a day ahead, 2 j - N on the next, in steps of the walk."""
    rng, day, rows = np.random.default_rng(0), 24, 72
    response = np.zeros((2, rows, 1))
    response[0, 0] = 1.0  # a reading that is the left face
    errors = []
    for _ in range(200):
        faces = np.cumsum(rng.standard_normal((7 * day, 2)), axis=0)
        time = 3600.0 * np.arange(len(faces))
        record = wallid.Record(time, time, None, faces, np.empty((len(faces), 0)), (), boundary_noise_std=0.01)
        errors.append(error_of_persistence(record, response, len(faces), rows, 0)[:, 0] ** 2)
    j = np.arange(1, rows + 1)
    expected = 2 * j - day * (np.ceil(j / day) - 1)
    assert_allclose(np.mean(errors, axis=0), expected, rtol=0.2)


def test_persistence_needs_days_to_go_on_from():
    with pytest.raises(wallid.InputError, match="less than 3 days"):
        wallid.forecast(case_of(), "2026-03-03T00:00", 24.0, faces="persistence")


def test_persistence_crosses_no_break():
    """The rows of a break stay what they are where the record is lengthened."""
    case = case_of()
    fill_std = np.zeros((240, 2))
    fill_std[100:120] = np.inf
    case = replace(case, record=replace(case.record, fill_std=fill_std))
    later, logged = with_persistent_faces(replace(case, record=without_break(case.record)), 230, 20, "record")
    assert logged == 10 and later.record.rows == 250 and not later.record.broken.any()
    with pytest.raises(wallid.InputError, match="without a break"):
        with_persistent_faces(case, 230, 20, "record")


def without_break(record):
    return replace(record, fill_std=np.zeros((240, 2)))


def test_plates_are_forecast_too():
    found = wallid.forecast(case_of(Kind("plates", "wall", 48.0)), "2026-03-03T00:00", 12.0)
    assert found.names == ("flux_left", "flux_right") and found.units == ("W/m2", "W/m2")
    assert min(found.inside) > 0.7
    assert found.disturbance.unit == "W/m2"


def test_the_tables_have_a_mean_and_a_std_for_each_output(found):
    frame = found.to_frame()
    assert list(frame.columns) == ["T1", "T1_std", "T2", "T2_std"] and frame.index.name == "time"
    read = pd.read_csv(io.StringIO(found.to_csv()))
    assert list(read.columns) == ["time", *frame.columns]
    assert read["time"][0] == "2026-03-05T00:00:00" and len(read) == DAY_ROWS
    assert_allclose(read["T2_std"], found.std[:, 1], rtol=1e-4)
    assert "in the 95 % band" in str(found) and "<table" in found._repr_html_()
    entries = found.to_dict()
    assert set(entries) == {"start", "hours", "faces", "reliable", "reason", "training_days", "outputs", "step_errors"}
    assert entries["reliable"] and entries["reason"] == ""
    poor = replace(found, step_errors=(replace(found.step_errors[0], coverage=(0.95, 0.6)),))
    assert "only 60% of T2" in poor.unreliable_reason and "unreliable" in str(poor)


@pytest.mark.parametrize(
    ("start", "message"),
    [
        ("2027-01-01", "must lie between"),
        ("tomorrow", "such as 2026-03-01"),
        ("2026-03-01T05:00", "needs at least 24"),
        ("2026-03-05T00:00+01:00", "have no zone"),
    ],
)
def test_a_time_that_cannot_be_is_refused(start, message):
    with pytest.raises(wallid.InputError, match=message):
        wallid.forecast(case_of(), start)


def test_other_arguments_that_cannot_be_are_refused():
    with pytest.raises(wallid.InputError, match="hours"):
        wallid.forecast(case_of(), "2026-03-05", -1.0)
    for wrong in ({"hours": np.inf}, {"days": np.nan}, {"days": -3.0}):
        with pytest.raises(wallid.InputError, match=next(iter(wrong))):
            wallid.forecast(case_of(), "2026-03-05", **wrong)
    with pytest.raises(wallid.InputError, match=r"in days = 0\.25"):
        wallid.forecast(case_of(), "2026-03-05", days=0.25)
    unread = np.array(case_of().record.sensors)
    unread[:190] = np.nan
    with pytest.raises(wallid.InputError, match="there are 4 readings"):
        wallid.forecast(replace(case_of(), record=replace(case_of().record, sensors=unread)), "2026-03-05")
    seconds = replace(case_of().record, stamps=case_of().record.time)
    with pytest.raises(wallid.InputError, match="has seconds"):
        wallid.forecast(replace(case_of(), record=seconds), "2026-03-05")


def test_a_time_with_an_offset_is_that_of_the_records_zone():
    """The stamps that messages print can be stated again."""
    record = replace(case_of().record, zone="+01:00")
    for time in (record.stamp(100), "2026-03-03T01:00:00Z", "2026-03-03T02:00", "2026-03-02T20:00-05:00"):
        assert row_at(record, "--from", time) == 100
    assert row_at(replace(record, zone="Z"), "--from", "2026-03-03T02:00:00Z") == 100


def test_a_time_without_an_offset_is_on_the_clock_of_the_file():
    """The record keeps the offset of its first row; the clock of the file is changed on 29 March 2026."""
    record = case_of().record
    stamps = np.datetime64("2026-03-27T00:00", "ns") + (1e9 * record.time).astype("timedelta64[ns]")
    record = replace(record, stamps=stamps, zone="+01:00", timezone="Europe/Berlin")
    assert record.step == 1800.0 and record.stamp(170) == "2026-03-30T13:00:00+01:00"
    for time in ("2026-03-30T14:00", "2026-03-30T12:00:00Z", record.stamp(170)):
        assert row_at(record, "--from", time) == 170
    assert row_at(record, "--from", "2026-03-28T12:00") == 72


def test_a_record_of_seconds_keeps_its_times(found):
    stamps = 1_700_000_000.0 + found.case.record.time
    in_seconds = replace(found, case=replace(found.case, record=replace(found.case.record, stamps=stamps)))
    rows = in_seconds.to_csv().splitlines()[1:]
    first = found.window.row + found.first
    assert [float(row.split(",")[0]) for row in rows] == stamps[first : first + len(rows)].tolist()
    for time in ("nan", np.inf):
        with pytest.raises(wallid.InputError, match="has seconds"):
            row_at(in_seconds.case.record, "--from", time)


def test_a_break_after_the_time_says_what_to_do():
    record = case_of().record
    fill_std = np.zeros((record.rows, 2))
    fill_std[120:150] = np.inf
    gap = RecordBreak(120, 30, "2026-03-03T11:30", "2026-03-04T03:00", 15.5, ("left", "right"))
    broken = replace(record, fill_std=fill_std, cleaning=replace(record.cleaning, breaks=(gap,)))
    case = replace(case_of(), record=broken)
    with pytest.raises(wallid.InputError, match="--faces persistence"):
        wallid.forecast(case, "2026-03-03T00:00")


def test_figures(found):
    ax = plot.forecast_band(found, 0)
    assert ax.get_ylabel() == "temperature (°C)" and ax.lines[0].get_ydata()[-1] == found.mean[-1, 0]
    bars = plot.errors_ahead(found).containers
    assert len(bars) == 2 and bars[0][0].get_height() == pytest.approx(100 * found.step_errors[0].coverage[0])
    with pytest.raises(ValueError, match="no predictions"):
        plot.errors_ahead(replace(found, step_errors=()))


def test_on_the_command_line(tmp_path):
    case = case_of()
    frame = case.record.to_frame()
    frame.columns = ["left", "right", "T1", "T2"][: frame.shape[1]]
    frame.to_csv(tmp_path / "record.csv", index_label="time")
    (tmp_path / "case.toml").write_text(
        f"""
        [wall]
        length = {LENGTH}
        diffusivity_prior = 7e-7
        [record]
        file = "record.csv"
        time = "time"
        left = "left"
        right = "right"
        boundary_noise_std = {FACE_STD}
        [[sensor]]
        name = "T1"
        position = {LENGTH * PLACES[0]}
        noise_std = {SENSOR_STD}
        [[sensor]]
        name = "T2"
        position = {LENGTH * PLACES[1]}
        noise_std = {SENSOR_STD}
        """
    )
    out = tmp_path / "out"
    arguments = ["forecast", str(tmp_path), "--from", "2026-03-05T00:00", "--hours", "6", "--out", str(out), "--json"]
    run = CliRunner().invoke(app, arguments)
    assert run.exit_code == 0, run.output
    result = json.loads(run.stdout)
    assert result["disturbance"]["place"] == "wall" and result["forecast"]["hours"] == 6.0
    assert {path.name for path in out.iterdir()} == {
        "result.json", "report.html", "forecast.csv", "forecast.png", "ahead.png"
    }  # fmt: skip
    page = check((out / "report.html").read_text("utf-8"))
    assert "Can the bands be believed?" in page.text
    assert page_environment().get_template("forecast.html")
    shorter = CliRunner().invoke(app, [*arguments, "--days", "3.5", "--faces", "persistence"])
    assert shorter.exit_code == 0, shorter.output
    again = json.loads(shorter.stdout)
    assert again["forecast"]["faces"] == "persistence" and result["forecast"]["faces"] == "record"
    assert again["disturbance"] != result["disturbance"]  # estimated from three and a half days instead of four
    wrong = CliRunner().invoke(app, ["forecast", str(tmp_path), "--from", "never", "--out", str(out)])
    assert wrong.exit_code == 2 and "--from never" in wrong.stderr
