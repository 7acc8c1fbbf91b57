"""A record that is made in Python: arrays that do not fit are refused where it is made."""

from dataclasses import fields, replace

import numpy as np
import pandas as pd
import pytest
from refusals import refuses

import wallid
from wallid.records.array_checks import checked_times

ROWS, STEP = 24, 600.0


def arrays(**changes):
    time = STEP * np.arange(ROWS)
    given = {"time": time, "stamps": time, "zone": None, "faces": np.zeros((ROWS, 2)), "sensors": np.zeros((ROWS, 3))}
    return given | {"names": ("T1", "T2", "T3"), "regressors": {"rain": np.zeros(ROWS)}} | changes


def made(**changes):
    return wallid.Record(**arrays(**changes))


def with_value(row, value, of=None):
    values = STEP * np.arange(ROWS) if of is None else of.copy()
    values[row] = value
    return values


@pytest.mark.parametrize(
    ("changes", "parts"),
    [
        ({"time": np.zeros((ROWS, 1))}, ("time has shape (24, 1)", "it must be (time,)")),
        ({"time": np.zeros(1)}, ("time has shape (1,)", "at least 2 rows")),
        ({"time": ["noon"] * ROWS}, ("time = ", "array of numbers")),
        ({"time": with_value(5, np.nan)}, ("time[5] = nan", "finite")),
        ({"time": with_value(5, 0.0)}, ("time[5] = 0 s follows 2400 s", "increase", "sort the rows")),
        ({"time": with_value(5, 2400.0)}, ("time[5] = 2400 s follows 2400 s", "remove repeated")),
        ({"time": with_value(5, 3100.0)}, ("time[5] is 700 s after", "typical step is 600 s", "resample it")),
        ({"time": 7200.0 + STEP * np.arange(ROWS)}, ("time[0] = 7200 s", "from the first row", "time - time[0]")),
        ({"stamps": np.arange(3.0)}, ("stamps has shape (3,)", "with 24 times it must be (24,)")),
        ({"stamps": ["noon"] * ROWS}, ("stamps has values of type", "datetime64 or s")),
        ({"stamps": with_value(5, 0.0)}, ("stamps[5] = 0.0 follows 2400.0", "increase")),
        ({"faces": np.zeros((2, ROWS))}, ("faces has shape (2, 24)", "it must be (24, 2)", "give `faces.T`")),
        ({"faces": np.zeros(ROWS)}, ("faces has shape (24,)", "it must be (24, 2)", "left, right")),
        ({"faces": np.full((ROWS, 2), np.nan)}, ("faces[0, 0] = nan", "48 are not", "Case.from_dataframe")),
        ({"sensors": np.zeros((ROWS, 2))}, ("sensors has shape (24, 2)", "it must be (24, 3)", "names")),
        ({"sensors": np.zeros((ROWS - 1, 3))}, ("sensors has shape (23, 3)", "it must be (24, 3)")),
        ({"names": "T1"}, ("names = ", "('T1',)")),
        ({"names": ("T1", "T2", "T1")}, ('names: "T1" occurs twice',)),
        ({"names": ("T1", "T2", "")}, ("names[2]", "must be a text")),
        ({"regressors": {"rain": np.zeros(3)}}, ('regressors["rain"] has shape (3,)', "it must be (24,)")),
        ({"regressors": {"rains": np.zeros(ROWS)}}, ('regressors: unknown key "rains"', 'did you mean "rain"')),
        ({"fill_std": np.zeros(ROWS)}, ("fill_std has shape (24,)", "it must be (24, 2)")),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused_where_the_record_is_made(changes, parts):
    refuses(lambda: made(**changes), *parts)
    refuses(lambda: replace(made(), **changes), *parts)


def test_lists_and_tables_are_made_arrays():
    """Everything behind a record takes NumPy's arrays of floats."""
    table = pd.DataFrame({"a": range(ROWS), "b": range(ROWS)})
    times = pd.date_range("2020-01-01", periods=ROWS, freq="10min")
    record = made(
        time=list(range(ROWS)), stamps=times, faces=table, sensors=np.zeros((ROWS, 3), int), names=list("abc")
    )
    assert record.time.dtype == record.faces.dtype == record.sensors.dtype == float
    assert record.stamps.dtype == "datetime64[ns]" and record.stamp(1) == "2020-01-01T00:10:00"
    assert record.names == ("a", "b", "c") and record.step == 1.0


def test_arrays_of_floats_are_not_copied():
    given = arrays()
    record = wallid.Record(**given)
    assert all(getattr(record, name) is given[name] for name in ("time", "stamps", "faces", "sensors"))


def test_a_loggers_rounding_of_its_times_is_no_uneven_step():
    time = np.round(np.arange(ROWS) / 7.0, 4)  # as in a file with four decimals
    assert made(time=time).step == pytest.approx(1 / 7, abs=1e-4)


def test_a_window_is_what_a_record_of_its_rows_would_be(monkeypatch):
    """It is not checked again: a design makes thousands of windows."""
    record = made(faces=np.arange(2.0 * ROWS).reshape(ROWS, 2), fill_std=np.ones((ROWS, 2)), face_position_std=0.001)
    assert record.step == STEP  # kept by the record, and not handed to its window
    checks = []
    monkeypatch.setattr(
        "wallid.records.uniform_record.checked_times", lambda time: checks.append(0) or checked_times(time)
    )
    part = record.window(3, 10)
    assert not checks
    again = replace(part)
    assert checks
    for field in fields(wallid.Record):
        np.testing.assert_equal(getattr(part, field.name), getattr(again, field.name))
    assert part.faces[0, 0] == 6.0 and part.time[0] == 0.0 and part.rows == 10 and part.face_slopes.shape == (10, 2)
