import time
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from refusals import refuses

from wallid.records.uniform_record import REGRESSORS, FileFormat, read_record

ROWS = 48
COLUMNS = {"time": "time", "left": "T_left", "right": "T_right", "sensors": ["T1", "T2"]}


def sheet(rows=ROWS, **columns):
    """A valid record as a table of texts, hourly, to be spoilt."""
    count = np.arange(rows)
    table = {
        "time": pd.date_range("2009-01-01", periods=rows, freq="h").strftime("%Y-%m-%dT%H:%M:%S"),
        "T_left": 5 + np.sin(count),
        "T_right": 20 - 0.01 * count,
        "T1": 10 + 0.1 * count,
        "T2": 15.0 - 0.02 * count,
    }
    return pd.DataFrame(table | columns).astype(str)


@pytest.fixture
def reads(tmp_path):
    """Writes a table, or a text, as record.csv and gives a call that reads it."""

    def prepare(table, **options):
        path = tmp_path / "record.csv"
        if isinstance(table, bytes):
            path.write_bytes(table)
        elif isinstance(table, str):
            path.write_text(table, encoding="utf-8")
        else:
            table.to_csv(path, index=False)
        return lambda: read_record(path, **(COLUMNS | options))

    return prepare


@pytest.fixture
def record(reads):
    return reads(sheet(wind=1.0), regressors={"wind": "wind"})()


# ------------------------------------------------------------------------------------ what is read


def test_reads_a_record(record):
    assert (record.rows, record.step, record.duration, record.zone) == (48, 3600.0, 47 * 3600.0, None)
    assert (record.faces.shape, record.sensors.shape, record.names) == ((48, 2), (48, 2), ("T1", "T2"))
    assert record.faces.dtype == record.sensors.dtype == record.time.dtype == float
    assert record.stamps.dtype == np.dtype("datetime64[ns]")
    assert record.time[:3].tolist() == [0.0, 3600.0, 7200.0]
    np.testing.assert_array_equal(record.regressors["wind"], np.ones(48))


def test_empty_cells_of_inner_sensors_are_missing(reads):
    table = sheet()
    table.loc[3:4, "T1"] = ""
    record = reads(table)()
    assert np.flatnonzero(np.isnan(record.sensors[:, 0])).tolist() == [3, 4]
    assert "missing values: T1 2" in str(record)


def test_extra_columns_blank_lines_and_a_byte_order_mark_are_ignored(reads):
    plain = reads(sheet())()
    text = sheet(note="a, b").to_csv(index=False).replace("\n", "\r\n") + "\r\n\r\n"
    record = reads(text.encode("utf-8-sig"))()
    np.testing.assert_array_equal(record.sensors, plain.sensors)
    np.testing.assert_array_equal(record.stamps, plain.stamps)


def test_a_face_may_stand_still(reads):
    assert np.ptp(reads(sheet(T_right="20"))().faces[:, 1]) == 0.0


def test_a_record_without_inner_sensors(reads):
    record = reads(sheet(q=3.0), sensors=[], regressors={"flux_left": "q"})()
    assert (record.sensors.shape, record.names) == ((48, 0), ())
    assert "inner sensors: none" in str(record)


def test_summary_gives_span_step_rows_and_ranges(record):
    lines = record.summary()
    for part in ("48 rows", "every 3600 s", "1.958 d", "2009-01-01T00:00:00", "2009-01-02T23:00:00"):
        assert part in lines
    assert "left 4.0 to 6.0 degC, right 19.5 to 20.0 degC" in lines


@settings(max_examples=50)
@given(
    step=st.sampled_from([1.0, 30.0, 300.0, 600.0, 3600.0, 86400.0]),
    zone=st.sampled_from(["", "Z", "+00:00", "+01:00", "-09:30", "+0530", "+02"]),
    start=st.datetimes(pd.Timestamp("1970-01-01"), pd.Timestamp("2100-01-01")).map(lambda t: t.replace(microsecond=0)),
    data=st.data(),
)
def test_a_valid_record_is_read_back_equal(tmp_path_factory, step, zone, start, data):
    rows = data.draw(st.integers(8, 30))
    celsius = st.floats(-60, 60)
    faces = data.draw(st.lists(st.tuples(celsius, celsius), min_size=rows, max_size=rows))
    inner = [1.0, *data.draw(st.lists(st.none() | celsius, min_size=rows - 1, max_size=rows - 1))]
    stamps = np.datetime64(start, "ns") + np.arange(rows) * np.timedelta64(int(step), "s")
    path = tmp_path_factory.mktemp("random") / "record.csv"
    with open(path, "w", encoding="utf-8") as file:
        file.write("time,T_left,T_right,T1\n")
        for stamp, (left, right), cell in zip(stamps, faces, inner, strict=True):
            shown = np.datetime_as_string(stamp, unit="s")
            file.write(f"{shown}{zone},{left!r},{right!r},{'' if cell is None else repr(cell)}\n")
    columns = {"time": "time", "left": "T_left", "right": "T_right", "sensors": ["T1"]}
    record = read_record(path, **columns)
    if not record.cleaning.unchanged:  # a value far from all others is screened as a spike
        record = read_record(path, **columns, file_format=FileFormat(clean=False))
    np.testing.assert_array_equal(record.stamps, stamps)
    # pandas 2 reads the last digit of some numbers wrong, and of numbers below 1e-307 more than one
    rounding = {"rtol": 1e-15, "atol": 1e-307} if pd.__version__.startswith("2.") else {"rtol": 0.0, "atol": 0.0}
    np.testing.assert_allclose(record.faces, faces, **rounding)
    np.testing.assert_allclose(record.sensors[:, 0], np.array(inner, float), **rounding)
    np.testing.assert_array_equal(record.time, np.arange(rows) * step)
    assert record.zone == ({"": None, "+0530": "+05:30", "+02": "+02:00"}.get(zone, zone))
    assert record.stamp(0) == np.datetime_as_string(stamps[0], unit="s") + (record.zone or "")


def test_times_in_seconds(reads):
    record = reads(sheet(time=1000.0 + 30.0 * np.arange(ROWS)))()
    assert (record.step, record.time[0], record.stamp(0), record.zone) == (30.0, 0.0, 1000.0, None)
    assert (record.stamp(ROWS - 1), record.stamp(ROWS)) == (1000.0 + 30.0 * 47, 1000.0 + 30.0 * 48)


def test_a_change_of_zone_is_no_change_of_time(reads):
    summer = sheet()["time"] + "+01:00"
    late = pd.Timestamp("2009-01-02") + pd.to_timedelta(np.arange(24) + 1, unit="h")
    summer[24:] = late.strftime("%Y-%m-%dT%H:%M:%S") + "+02:00"
    record = reads(sheet(time=summer))()
    assert (record.zone, record.stamp(47), record.step) == ("+01:00", "2009-01-02T23:00:00+01:00", 3600.0)


def test_days_without_a_clock_have_no_zone(reads):
    record = reads(sheet(time=pd.date_range("2009-01-01", periods=ROWS).strftime("%Y-%m-%d")))()
    assert (record.zone, record.stamp(1), record.step) == (None, "2009-01-02T00:00:00", 86400.0)


def test_half_a_million_rows_in_seconds(tmp_path):
    rows = 500_000
    random = np.random.default_rng(0).normal(20, 3, (rows, 4)).round(2)
    stamps = np.datetime_as_string(np.datetime64("2009-01-01T00:00", "s") + 60 * np.arange(rows), unit="s")
    path = tmp_path / "record.csv"
    with open(path, "w", encoding="utf-8") as file:
        file.write("time,T_left,T_right,T1,T2\n")
        file.writelines(
            f"{stamp}Z,{a},{b},{c},{d}\n" for stamp, (a, b, c, d) in zip(stamps, random.tolist(), strict=True)
        )
    began = time.perf_counter()
    record = read_record(path, **COLUMNS)
    assert time.perf_counter() - began < 10  # about 1 s on an idle core; row by row it would be minutes
    np.testing.assert_array_equal(np.concatenate([record.faces, record.sensors], axis=1), random)


# --------------------------------------------------------------------------------- windows and stamps


@pytest.fixture(scope="module")
def wide(tmp_path_factory):
    path = tmp_path_factory.mktemp("wide") / "record.csv"
    sheet(wind=np.arange(ROWS)).to_csv(path, index=False)
    return read_record(path, **COLUMNS, regressors={"wind": "wind"})


@given(cut=st.integers(2, ROWS - 2))
def test_windows_tile(wide, cut):
    parts = wide.window(0, cut), wide.window(cut, ROWS - cut)
    for name in ("stamps", "faces", "sensors"):
        joined = np.concatenate([getattr(part, name) for part in parts])
        np.testing.assert_array_equal(joined, getattr(wide, name))
    wind = np.concatenate([part.regressors["wind"] for part in parts])
    np.testing.assert_array_equal(wind, wide.regressors["wind"])
    assert parts[0].stamp(cut) == parts[1].stamp(0) == wide.stamp(cut)
    assert parts[1].stamp(ROWS - cut) == wide.stamp(ROWS)
    assert parts[1].time[0] == 0.0
    assert sum(part.rows * part.step for part in parts) == wide.rows * wide.step


def test_the_row_after_the_last_has_a_stamp(record):
    assert record.stamp(ROWS) == "2009-01-03T00:00:00"
    refuses(lambda: record.stamp(ROWS + 1), "record.csv", "row 49; it must lie between 0 and 48")


def test_rows_per_day(record):
    assert (record.rows_in_days(1.0), record.rows_in_days(0.5), record.rows_in_days(1e-9)) == (24, 12, 1)


@pytest.mark.parametrize(("start", "rows"), [(-1, 10), (0, 1), (0, 49), (40, 9)])
def test_a_window_lies_in_the_record(record, start, rows):
    refuses(lambda: record.window(start, rows), f"{rows} rows from row {start}", "at least 2 rows", "record's 48")


@pytest.mark.parametrize(
    ("name", "value", "unit"),
    [("boundary_noise_std", -0.1, "K"), ("flux_noise_std", 0.0, "W/m2"), ("flux_gain_std", "5 %", "")],
)
def test_noise_is_a_number(record, name, value, unit):
    refuses(lambda: replace(record, **{name: value}), f"{name} = ", "it must be a finite number", unit)


# ------------------------------------------------------------------------------------ what is refused


def spoil(column, row, value):
    """The valid table with one other cell; row 0 is line 2."""
    table = sheet()
    table.loc[row, column] = value
    return table


def at(line, column):
    return f'record.csv: line {line}, column "{column}": '


def test_a_missing_file(tmp_path):
    refuses(lambda: read_record(tmp_path / "none.csv", **COLUMNS), "none.csv", "No such file")
    refuses(lambda: read_record(tmp_path, **COLUMNS), "cannot be read")


@pytest.mark.parametrize("text", ["", "\n\ntime,T_left\n"])
def test_an_empty_file(reads, text):
    refuses(reads(text), "record.csv: line 1 is empty", "must be a header")


def test_a_file_in_an_unknown_encoding(reads):
    content = sheet().to_csv(index=False).encode()
    refuses(reads(content + "2009-01-03,я,2,3,4\n".encode("cp1251")), "record.csv: line 50: not UTF-8", "encoding = ")
    refuses(reads(content.replace(b"T1", b"\x81")), "record.csv: line 1: not CP1252", "save the file as UTF-8")
    refuses(
        reads(content + "é".encode(), file_format=FileFormat(encoding="ascii")), "line 50: not ASCII", "encoding = "
    )
    refuses(reads(content.replace(b"T1", b"T\0")), "record.csv: line 1: not text", "export it as text")


def test_commas_between_columns_and_in_numbers(reads):
    text = sheet().to_csv(index=False)
    refuses(reads(text.replace("\n2009", ",0\n2009").replace("T2,0", "T2")), "line 2: more cells than the header")
    refuses(reads(spoil("T1", 5, "20,5")), at(7, "T1"), 'found "20,5"', "decimal point", 'decimal = ","')


def test_one_point_among_commas_is_the_one_that_is_named(reads):
    table = sheet()
    for name in table.columns[1:]:
        table[name] = table[name].astype(float) + 0.25
    lines = table.to_csv(index=False, sep=";", decimal=",").splitlines()
    lines[7] = lines[7].replace(",", ".")
    mixed = "\n".join(lines) + "\n"
    refuses(reads(mixed), "record.csv: line 8, ", "decimal comma", "write all numbers alike", 'decimal = ","')
    stated, plain = reads(mixed, file_format=FileFormat(decimal=","))(), reads(table)()
    np.testing.assert_array_equal(stated.sensors, plain.sensors)
    np.testing.assert_array_equal(stated.faces, plain.faces)


def test_a_row_that_is_too_long(reads):
    text = sheet().to_csv(index=False).replace("2009-01-01T03:00:00", "2009-01-01T03:00:00,1")
    refuses(reads(text), "record.csv: line 5: more cells", "one cell for each column of the header")


def test_a_quotation_mark_that_is_not_closed(reads):
    text = sheet().to_csv(index=False).replace("\n2009-01-01T05", '\n"2009-01-01T05')
    refuses(reads(text), "record.csv: line 7: a quotation mark is not closed")


def test_a_missing_column(reads):
    message = refuses(reads(sheet().rename(columns={"T1": "t_1"})), 'record.csv: no column "T1"')
    assert "the columns are time, T_left, T_right, t_1, T2" in message
    assert 'did you mean "' in message


def test_a_column_that_stands_twice(reads):
    text = sheet(T3=1).to_csv(index=False).replace("T3", "T1")
    refuses(reads(text), 'record.csv: 2 columns are called "T1"; names must differ')


@pytest.mark.parametrize(
    "columns", [{"sensors": ["T1", "T1"]}, {"sensors": ["T_left"]}, {"right": "T_left"}, {"left": "time"}]
)
def test_a_column_that_is_used_twice(reads, columns):
    refuses(reads(sheet(), **columns), "record.csv: column ", "is used 2 times", "a column of their own")


@pytest.mark.parametrize(("column", "value"), [("T_left", "cold"), ("T1", "True"), ("T2", "0x10")])
def test_a_column_that_is_mostly_text(reads, column, value):
    table = sheet()
    table.loc[20:, column] = value
    message = refuses(reads(table), at(22, column), f'found "{value}"; it must be a number, and 28 of the column')
    assert f'missing = ["{value}"]' in message


def test_a_column_of_truth_values(reads):
    refuses(reads(sheet(T1="True")), at(2, "T1"), 'found "True"; it must be a number')


@pytest.mark.parametrize("value", ["inf", "-inf", "Infinity"])
def test_a_column_without_a_finite_number(reads, value):
    refuses(reads(sheet(T1=value)), at(2, "T1"), "infinite", "use another column")


def test_blank_lines_do_not_shift_the_line(reads):
    text = spoil("time", 20, "2009-01-01T25").to_csv(index=False).replace("\n2009-01-01T05", "\n\n\n2009-01-01T05")
    refuses(reads(text), at(24, "time"))


def test_a_sensor_without_a_value(reads):
    refuses(reads(sheet(T2="")), 'record.csv: column "T2": has no value; it must contain numbers')
    refuses(reads(sheet(T2="---")), 'record.csv: column "T2": has no value; it must contain numbers')


def test_a_missing_time(reads):
    refuses(reads(spoil("time", 7, "")), at(9, "time"), "the time is missing")


@pytest.mark.parametrize("value", ["01/02/2009 07:00", "noon", "2009-13-01T07:00:00", "1066-01-01T00:00:00"])
def test_a_time_that_cannot_be_read(reads, value):
    refuses(reads(spoil("time", 7, value)), at(9, "time"), f'found "{value}"', "ISO 8601", "seconds")


def test_a_time_that_is_no_number_among_seconds(reads):
    table = sheet(time=30 * np.arange(ROWS))
    table.loc[7, "time"] = "noon"
    refuses(reads(table), at(9, "time"), 'found "noon"; it must be a number')


def test_times_with_and_without_zone(reads):
    one = spoil("time", 7, "2009-01-01T07:00:00Z")
    refuses(
        reads(one),
        at(9, "time"),
        '"2009-01-01T07:00:00Z" with a zone',
        "every time must have a zone, or none",
    )
    most = sheet(time=sheet()["time"] + "+01:00")
    most.loc[7, "time"] = "2009-01-01T07:00:00"
    refuses(reads(most), at(9, "time"), '"2009-01-01T07:00:00" without a zone', "or none")


def test_a_clock_that_was_set_back(reads):
    """Its rows fall between others, or onto them with other readings."""
    hours = pd.date_range("2009-01-05", periods=ROWS, freq="h")
    for shift in ("5h", "5h20min"):
        times = hours.where(np.arange(ROWS) < 24, hours - pd.Timedelta(shift)).strftime("%Y-%m-%dT%H:%M:%S")
        message = refuses(reads(sheet(time=times)), "record.csv: line ", 'column "time"', "the clock was set back")
        assert 'timezone = "Europe/Berlin"' in message
    seconds = 30.0 * np.arange(ROWS)
    seconds[9] = 0.0
    message = refuses(reads(sheet(time=seconds)), at(11, "time"), "0 s comes after 240 s", "times must increase")
    assert "Europe" not in message


@pytest.mark.parametrize("minutes", [10, 30, 60, 120])
def test_daylight_saving_is_refused_with_its_way_out(reads, minutes):
    step = pd.Timedelta(minutes=minutes)
    for first, change, shift in (("2009-10-24", "2009-10-25T03:00", "-1h"), ("2009-03-28", "2009-03-29T02:00", "1h")):
        clock = pd.date_range(first, periods=400, freq=step)
        clock = clock.where(clock < change, clock + pd.Timedelta(shift)).strftime("%Y-%m-%dT%H:%M:%S")
        refuses(
            reads(sheet(400, time=clock)), 'column "time"', "daylight saving", 'timezone = "Europe/Berlin"', '"UTC"'
        )


def test_a_single_time_far_from_the_others(reads):
    refuses(reads(spoil("time", 30, "2209-01-01T06:00:00")), at(32, "time"), "found 2209", "check this time")


@pytest.mark.parametrize("rows", [0, 7])
def test_too_few_rows(reads, rows):
    refuses(reads(sheet(rows)), f"record.csv: found {rows} rows", "at least 8 are needed")


def test_faces_that_were_never_logged_together(reads):
    table = sheet()
    table.loc[:23, "T_left"] = ""
    table.loc[24:, "T_right"] = ""
    refuses(reads(table), "record.csv: ", "have both faces")


def test_kelvin(reads):
    refuses(
        reads(sheet(T1=283.0)), 'column "T1": the median is 283, so the values are probably in kelvin', 'unit = "K"'
    )
    refuses(reads(sheet(T_left=283.0)), 'column "T_left"', "kelvin")
    options = {"regressors": {"air_outdoor": "air"}}
    refuses(reads(sheet(air=283.0), **options), 'column "air"', "kelvin")


def test_a_unit_that_is_not_the_stated_one(reads):
    text = sheet().to_csv(index=False).replace("T2\n", "T2\n,degC,degC,°F,degC\n", 1)
    refuses(reads(text), 'column "T1": the unit in "°F" is degF', 'unit = "degF"')


def test_regressors(reads):
    options = {"regressors": {"wind": "v"}}
    refuses(reads(sheet(), **options), 'no column "v"')
    refuses(reads(sheet(v="calm"), **options), at(2, "v"), 'found "calm"; it must be a number')
    refuses(reads(sheet(v=""), **options), 'column "v": has no value')
    refuses(reads(sheet(), regressors={"winds": "T1"}), 'unknown regressor "winds"', *REGRESSORS)
    gappy = sheet(v="2.5")
    gappy.loc[3, "v"] = ""
    assert np.isnan(reads(gappy, **options)().regressors["wind"]).sum() == 1


# ---------------------------------------------------------------------------------- measured records

ICE = {"time": "time", "left": "T_0.5m", "right": "T_1.5m", "sensors": ["T_1m"]}


def test_december_in_the_ice(measured, tmp_path):
    rows = pd.read_csv(measured / "glacier_ice" / "borehole_248.csv", dtype=str)
    rows[rows["time"].str.startswith("2014-12")].to_csv(tmp_path / "december.csv", index=False)
    record = read_record(tmp_path / "december.csv", **ICE)
    assert (record.rows, record.step, record.zone) == (31 * 24, 3600.0, None)
    assert (record.stamp(0), record.stamp(record.rows)) == ("2014-12-01T00:00:00", "2015-01-01T00:00:00")
    assert np.isfinite(record.sensors).all()
    assert np.all((record.faces > -9) & (record.faces < -2))


def test_the_ice_record_breaks_in_its_last_days(measured):
    """The odd steps of April 2015 are gaps; what lies before them is as the file has it."""
    path = measured / "glacier_ice" / "borehole_248.csv"
    record = read_record(path, **ICE)
    plain = pd.read_csv(path)
    assert record.unbroken_parts == ((0, 3763), (3766, 3), (3772, 3), (3779, 2))
    assert [round(one.hours) for one in record.cleaning.breaks] == [4, 4, 5]
    read = np.flatnonzero(np.isin(record.stamps, pd.to_datetime(plain["time"]).to_numpy()))
    np.testing.assert_array_equal(record.faces[read], plain[["T_0.5m", "T_1.5m"]])
    np.testing.assert_array_equal(record.sensors[read, 0], plain["T_1m"])
    assert np.isnan(record.sensors[:, 0]).sum() == record.rows - len(plain)


def test_the_other_ice_record_is_regular(measured):
    record = read_record(measured / "glacier_ice" / "borehole_247.csv", **ICE)
    assert (record.rows, record.stamp(0)) == (2366, "2014-11-09T16:00:00")
    assert record.cleaning.unchanged


def test_the_london_wall(measured):
    record = read_record(
        measured / "london_wall" / "owall.csv",
        time="time",
        left="T_int",
        right="T_ext",
        regressors={"flux_left": "Q_in", "flux_right": "Q_out"},
    )
    assert (record.rows, record.step, record.duration) == (864, 300.0, 863 * 300.0)
    assert record.regressors["flux_right"].min() == -18.957


def test_the_tampere_wall(measured):
    record = read_record(
        measured / "tampere_wall" / "wall.csv",
        time="time",
        left="T_indoor",
        right="T_gap",
        sensors=["T_interface"],
    )
    assert (record.rows, record.step) == (21365, 600.0)
    assert record.cleaning.unchanged
