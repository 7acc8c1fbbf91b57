"""Records as loggers write them: the truths are the tables that were spoilt, zoneinfo's clocks, and straight lines."""

from datetime import UTC, datetime, timedelta
from zoneinfo import ZoneInfo

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from refusals import refuses

from wallid.experiment_design.window_selection import candidate_starts
from wallid.records.outlier_screening import find_spikes, find_stuck_readings
from wallid.records.uniform_record import FileFormat, read_record

ROWS = 240
COLUMNS = {"time": "time", "left": "T_left", "right": "T_right", "sensors": ["T1", "T2"]}
FACES = ["T_left", "T_right"]


def table(rows=ROWS, step="h", noise=0.02):
    """A record of a wall in weather, as numbers to two decimals."""
    hours, rng = np.arange(rows), np.random.default_rng(1)
    waves = {
        "T_left": 6 * np.sin(hours / 3.8) + 2 * np.sin(hours / 11),
        "T_right": 20 + 0.4 * np.sin(hours / 3.8 + 1),
        "T1": 8 + 3 * np.sin(hours / 3.8 - 0.6),
        "T2": 14 + np.sin(hours / 3.8 - 1.3),
    }
    found = pd.DataFrame({name: np.round(wave + rng.normal(0, noise, rows), 2) for name, wave in waves.items()})
    found.insert(0, "time", pd.date_range("2020-02-01", periods=rows, freq=step))
    return found


def text(frame, sep=",", decimal=".", form="%Y-%m-%dT%H:%M:%S"):
    frame = frame.copy()
    if isinstance(frame["time"].dtype, np.dtype) and frame["time"].dtype.kind == "M":
        frame["time"] = frame["time"].dt.strftime(form)
    cells = frame.astype(object).where(frame.notna(), "").astype(str)
    if decimal != ".":
        cells.iloc[:, 1:] = cells.iloc[:, 1:].apply(lambda one: one.str.replace(".", decimal, regex=False))
    return "\n".join([sep.join(cells.columns), *(sep.join(row) for row in cells.itertuples(index=False)), ""])


@pytest.fixture
def read(tmp_path):
    def call(content, columns=COLUMNS, units=None, **form):
        path = tmp_path / "record.csv"
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return read_record(path, **columns, file_format=FileFormat(**form), units=units)

    return call


def same(record, frame, rows=slice(None)):
    """The record holds exactly the table's values."""
    np.testing.assert_array_equal(record.faces[rows], frame[FACES])
    np.testing.assert_array_equal(record.sensors[rows], frame[["T1", "T2"]])


# --------------------------------------------------------------------------------------- how it is written


UNITS = "time,T_left,T_right,T1,T2\n,°C,°C,°C,°C\n"
HEADER = "time,T_left,T_right,T1,T2\n"
WRITTEN = {
    "semicolons and commas": lambda t: text(t, ";", ","),
    "tabs": lambda t: text(t, "\t"),
    "bars": lambda t: text(t, "|", ","),
    "quoted decimal commas": lambda t: (
        HEADER
        + "\n".join(",".join([first, *(f'"{c.replace(".", ",")}"' for c in cells)]) for first, *cells in split(t))
    ),
    "byte order mark": lambda t: text(t).encode("utf-8-sig"),
    "utf-16": lambda t: text(t).encode("utf-16"),
    "utf-16 without its mark": lambda t: text(t).encode("utf-16-le"),
    "a western code page": lambda t: text(t).replace(HEADER, UNITS).encode("cp1252"),
    "rows of units": lambda t: text(t).replace(HEADER, HEADER + "TS,degC,degC,degC,degC\n,Smp,Smp,Avg,Avg\n"),
    "lines above the header": lambda t: '"Plot Title: house"\nserial 42\n' + text(t),
    "carriage returns": lambda t: text(t).replace("\n", "\r\n"),
    "spaces": lambda t: text(t).replace(",", " , "),
    "a separator at every end": lambda t: text(t, ";", ",").replace("\n", ";\n"),
    "rows that end early": lambda t: text(t).replace("\n", ",,\n").replace("T2,,", "T2,note,"),
    "remarks": lambda t: text(t).replace("\n2020-02-03T00", "\n# battery changed\n\n2020-02-03T00") + "end of file\n",
    "its header again": lambda t: text(t).replace("\n2020-02-03T00", "\n" + HEADER + "2020-02-03T00"),
    "the newest first": lambda t: text(t[::-1]),
    "two parts in the wrong order": lambda t: text(pd.concat([t[100:], t[:100]])),
    "a row that is late": lambda t: text(t.iloc[[*range(50), 53, 50, 51, 52, *range(54, ROWS)]]),
    "a part that stands twice": lambda t: text(pd.concat([t[:150], t[100:]])),
    "one column after the other": lambda t: text(
        pd.concat([t.assign(T1=np.nan, T2=np.nan), t.assign(T_left=np.nan, T_right=np.nan)])
    ),
    "seconds off by rounding": lambda t: text(t.assign(time=t["time"] + pd.to_timedelta(np.arange(ROWS) % 3, "s"))),
    "seconds off by more": lambda t: text(t.assign(time=t["time"] + pd.to_timedelta(11 * (np.arange(ROWS) % 3), "s"))),
}


def split(frame):
    return [line.split(",") for line in text(frame).splitlines()[1:]]


@pytest.mark.parametrize("kind", WRITTEN)
def test_the_same_record_written_otherwise(read, kind):
    """Each holds what the plain file holds, at a uniform step."""
    frame = table()
    record = read(WRITTEN[kind](frame))
    same(record, frame)
    assert record.step == pytest.approx(3600, abs=1) and record.unbroken_parts == ((0, ROWS),)


@pytest.mark.parametrize(
    ("form", "first"),
    [("%d.%m.%Y %H:%M:%S", True), ("%d/%m/%y %H:%M", True), ("%m/%d/%Y %I:%M:%S %p", False), ("%m-%d-%Y %H:%M", False)],
)
def test_dates_that_begin_with_the_day_or_the_month(read, form, first):
    frame = table().assign(time=pd.date_range("2020-02-08", periods=ROWS, freq="h"))  # past the twelfth
    record = read(text(frame, form=form), day_first=first)
    same(record, frame)
    np.testing.assert_array_equal(record.stamps, frame["time"])
    refuses(lambda: read(text(frame, form=form)), "line 2", "day_first = true (or false)")
    refuses(lambda: read(text(frame, form=form), day_first=not first), "record.csv: line ", "must be")


def test_a_logger_that_leaves_midnight_out(read):
    frame = table()
    content = text(frame, form="%d.%m.%Y %H:%M").replace(" 00:00,", ",")
    np.testing.assert_array_equal(read(content, day_first=True).stamps, frame["time"])


@settings(max_examples=40)
@given(
    zone=st.sampled_from(["Europe/Berlin", "America/New_York", "Australia/Sydney", "Europe/London", "UTC"]),
    newest_first=st.booleans(),
    minutes=st.sampled_from([5, 10, 30, 60]),
    start=st.datetimes(datetime(2019, 1, 1), datetime(2020, 12, 1)),
)
def test_wall_clocks_are_resolved(tmp_path_factory, zone, minutes, start, newest_first):
    """A month by zoneinfo's clock, its repeated or missing hour included, is a uniform record again."""
    start = start.replace(second=0, microsecond=0, minute=0, tzinfo=UTC)
    moments = [start + timedelta(minutes=minutes * k) for k in range(33 * 24 * 60 // minutes)]
    clock = [moment.astimezone(ZoneInfo(zone)).replace(tzinfo=None).isoformat() for moment in moments]
    path = tmp_path_factory.mktemp("clock") / "record.csv"
    lines = [f"{t},{k % 7},{k}e-3" for k, t in enumerate(clock)]
    path.write_text("\n".join(["time,a,b", *(reversed(lines) if newest_first else lines)]))
    record = read_record(path, time="time", left="a", right="b", file_format=FileFormat(timezone=zone, clean=False))
    np.testing.assert_array_equal(record.time, 60.0 * minutes * np.arange(len(moments)))
    first = moments[0].astimezone(ZoneInfo(zone))
    assert record.stamp(0) == first.isoformat()
    np.testing.assert_array_equal(record.faces[:, 0], np.arange(len(moments)) % 7)


def test_a_clock_that_did_not_follow(read):
    frame = table().assign(time=pd.date_range("2020-03-28", periods=ROWS, freq="h"))
    refuses(lambda: read(text(frame), timezone="Europe/Berlin"), "2020-03-29T02:00:00", "does not exist", "Etc/GMT-1")
    assert read(text(frame), timezone="UTC").rows == ROWS
    refuses(lambda: read(text(frame).replace(":00:00,", ":00:00Z,"), timezone="UTC"), "states its own zone")
    refuses(lambda: read(text(frame.assign(time=np.arange(ROWS) * 60)), timezone="UTC"), "seconds have no time zone")


def test_units(read):
    frame = table()
    warm = frame.assign(**{name: frame[name] * 1.8 + 32 for name in (*FACES, "T1")}, T2=frame["T2"] + 273.15)
    record = read(text(warm), unit="degF", units={"T2": "K"})
    np.testing.assert_allclose(record.faces, frame[FACES], atol=1e-9)
    np.testing.assert_allclose(record.sensors, frame[["T1", "T2"]], atol=1e-9)
    assert record.cleaning.count("converted", "T2") == ROWS
    with_units = text(warm).replace(HEADER, HEADER + ",°F,°F,°F,K\n")
    np.testing.assert_allclose(read(with_units, unit="degF", units={"T2": "K"}).faces, frame[FACES], atol=1e-9)
    refuses(lambda: read(with_units), 'column "T_left": the unit in "°F" is degF', 'unit = "degF"')


@pytest.mark.parametrize(
    ("form", "words"),
    [
        ({"separator": "x"}, "separator = "),
        ({"decimal": ";"}, "decimal = "),
        ({"encoding": "utf-99"}, "encoding = "),
        ({"day_first": "yes"}, "day_first = "),
        ({"timezone": "Berlin"}, 'did you mean "Europe/Berlin"'),
        ({"timezone": "../etc"}, "timezone = "),
        ({"unit": "C"}, 'unit = "C"; it must be "degC" or "degF" or "K"'),
        ({"missing": "Err"}, "missing = "),
        ({"step": 0}, "step = 0; it must be a finite number above 0 (s)"),
        ({"longest_gap": -1}, "longest_gap = -1"),
        ({"clean": 1}, "clean = 1; it must be true or false"),
    ],
)
def test_a_wrong_format(form, words):
    refuses(lambda: FileFormat(**form), words)


# ----------------------------------------------------------------------------------- what stands in its cells


def test_texts_are_masked_and_counted(read):
    frame = table().astype(str)
    frame.loc[[3, 4], "T1"] = "---"
    frame.loc[5, "T1"] = "NaN"
    frame.loc[6, "T1"] = "door open"
    frame.loc[7, "T1"] = "inf"
    frame.loc[8, "T1"] = "-250"
    frame.loc[[9, 10], "T1"] = "-99.5"
    frame.loc[11, "T1"] = "void"
    record = read(text(frame), missing=[-99.5, "void"])
    assert np.flatnonzero(np.isnan(record.sensors[:, 0])).tolist() == list(range(3, 12))
    counts = {kind: record.cleaning.count(kind, "T1") for kind in ("marked", "text", "infinite", "impossible", "spike")}
    assert counts == {"marked": 6, "text": 1, "infinite": 1, "impossible": 1, "spike": 0}
    assert 'T1: 1 cell of text masked ("door open" in line 8)' in record.summary()
    assert np.isfinite(record.sensors[:, 1]).all() and "T2" not in {one.column for one in record.cleaning.steps}


def test_a_text_in_a_face_is_a_gap(read):
    frame = table().astype(str)
    frame.loc[20, "T_left"] = "abc"
    record = read(text(frame))
    assert record.cleaning.count("text", "T_left") == record.cleaning.count("filled", "T_left") == 1
    neighbours = table()["T_left"][[19, 21]].mean()
    assert record.faces[20, 0] == pytest.approx(neighbours)


def test_the_uniform_way_changes_nothing(read):
    frame = table()
    record = read(text(frame))
    same(record, frame)
    assert record.cleaning.unchanged and record.fill_std is None


@given(seed=st.integers(0, 10**6), memory=st.sampled_from([0.0, 0.6, 0.95]), size=st.sampled_from([0.0, 0.05, 1.0]))
@settings(max_examples=60)
def test_weather_with_noise_has_no_spikes(seed, memory, size):
    """Smooth weather, white or lasting noise, quantised: nothing is masked."""
    rng, hours = np.random.default_rng(seed), np.arange(1500)
    noise = np.zeros(1500)
    for k in range(1, 1500):
        noise[k] = memory * noise[k - 1] + size * rng.normal()
    wave = rng.normal(0, 5) * np.sin(hours / rng.uniform(2, 30)) + noise
    for values in (wave, np.round(wave, 1), np.round(2 * wave) / 2):
        assert not find_spikes(3600.0 * hours, values).any()
        assert not find_stuck_readings(values).any()


@given(seed=st.integers(0, 10**6), step=st.sampled_from([60.0, 600.0, 3600.0]))
@settings(max_examples=60)
def test_spikes_are_found(seed, step):
    """Single readings that are 15 K off, at a quarter of a per cent of the rows, and no others."""
    rng = np.random.default_rng(seed)
    seconds = step * np.arange(2000)
    values = 10 + 4 * np.sin(seconds / 13_750) + rng.normal(0, 0.05, 2000)
    where = rng.choice(200, 5, replace=False) * 10 + 3
    values[where] += rng.choice([-1, 1], 5) * rng.uniform(15, 60, 5)
    assert np.flatnonzero(find_spikes(seconds, values)).tolist() == sorted(where)


def test_a_jump_that_stays_is_no_spike():
    values = np.where(np.arange(300) < 150, 10.0, 30.0) + np.random.default_rng(0).normal(0, 0.05, 300)
    assert not find_spikes(600.0 * np.arange(300), values).any()
    values[150:153] = 18.0, 24.0, 28.0  # the sun on the face
    assert not find_spikes(600.0 * np.arange(300), values).any()


def test_a_sensor_that_hangs(read):
    frame = table()
    frame.loc[100:160, "T1"] = frame.loc[100, "T1"]
    frame.loc[200:, "T2"] = frame.loc[200, "T2"]
    record = read(text(frame))
    assert np.flatnonzero(np.isnan(record.sensors[:, 0])).tolist() == list(range(101, 161))
    assert np.flatnonzero(np.isnan(record.sensors[:, 1])).tolist() == list(range(201, ROWS))
    assert record.cleaning.count("stuck") == 60 + 39
    plain = read(text(frame), clean=False)
    same(plain, frame)


def test_what_stands_still_for_a_reason_is_not_stuck():
    hours = np.arange(2000)
    wave = 4 * np.sin(hours / 3.8)
    assert not find_stuck_readings(np.full(2000, 20.0)).any()
    assert not find_stuck_readings(np.where(hours < 1500, np.round(wave, 1), 12.0) * 0 + np.round(0.1 * wave, 1)).any()
    snow = np.where((hours > 800) & (hours < 1200), 2.5 + 0.2 * np.sin(hours / 60), wave)
    for resolution in (0.01, 0.1, 0.5):  # quiet, and in steps: up to 400 equal readings
        assert not find_stuck_readings(resolution * np.round(snow / resolution)).any()
    freezing = np.where((hours > 800) & (hours < 860), 0.0, np.round(wave, 2))
    assert not find_stuck_readings(freezing).any()


# ------------------------------------------------------------------------------------------------- gaps


def test_gaps_are_filled_or_break_the_record(read):
    frame = table()
    gappy = frame.assign(T_left=frame["T_left"].mask(frame.index.isin([10, 30, 31, *range(100, 110)])))
    record = read(text(gappy))
    assert record.unbroken_parts == ((0, 100), (110, ROWS - 110)) and record.longest_part == (110, ROWS - 110)
    (one,) = record.cleaning.breaks
    assert (one.row, one.rows, one.hours, one.columns) == (100, 10, 11.0, ("T_left",))
    filled = np.flatnonzero((record.fill_std[:, 0] > 0) & ~record.broken)
    assert filled.tolist() == [10, 30, 31] and record.cleaning.count("filled") == 3
    line = np.interp([10, 30, 31], [9, 11, 29, 32], frame["T_left"][[9, 11, 29, 32]])
    np.testing.assert_allclose(record.faces[filled, 0], line)
    rest = ~np.isin(np.arange(ROWS), [*filled, *range(100, 110)])
    np.testing.assert_array_equal(record.faces[rest, 0], frame["T_left"][rest])
    np.testing.assert_array_equal(record.sensors, frame[["T1", "T2"]])
    assert np.isinf(record.fill_std[105, 0]) and (record.fill_std[rest] == 0.0).all()
    assert read(text(gappy), longest_gap=11).unbroken_parts == ((0, ROWS),)
    assert len(read(text(gappy), longest_gap=0).unbroken_parts) == 4
    assert [record.contains_windows(start, 20) for start in (80, 81, 109, 110, 220, 221)] == [1, 0, 0, 1, 1, 0]


def test_lost_rows_are_gaps_too(read):
    frame = table()
    kept = frame.drop(index=[10, *range(100, 110)])
    record = read(text(kept))
    assert record.unbroken_parts == ((0, 100), (110, ROWS - 110)) and record.rows == ROWS
    same(record, kept, kept.index)
    assert np.isnan(record.sensors[[10, 105]]).all()


def test_the_errors_of_filled_gaps_are_as_large_as_said(read):
    """Over 60 gaps of one to five rows in other weather than the trials': root mean square of error over std near 1."""
    scores = []
    for rows in (1, 2, 5):
        frame = table(1200, noise=0.05)
        gone = np.concatenate([np.arange(50 * k, 50 * k + rows) for k in range(1, 21)])
        record = read(text(frame.assign(T_left=frame["T_left"].mask(frame.index.isin(gone)))), longest_gap=7)
        scores.append((record.faces[gone, 0] - frame["T_left"][gone]) / record.fill_std[gone, 0])
    for score in scores:
        assert 0.75 < np.sqrt(np.mean(score**2)) < 1.3


@pytest.mark.parametrize("every", [None, 7])
def test_no_window_of_the_design_lies_on_a_break(read, every):
    frame = table()
    record = read(text(frame.drop(index=[*range(60, 70), *range(150, 160)])))
    starts = candidate_starts(record, 48, every)
    assert len(starts) > 3 and record.contains_windows(starts, 48).all()
    assert starts[0] == 0 and 70 in starts and 160 in starts


# --------------------------------------------------------------------------------- other steps and offsets


@settings(max_examples=25)
@given(
    offsets=st.tuples(*[st.integers(0, 3599)] * 4),
    steps=st.tuples(*[st.sampled_from([600, 1800, 3600, 5400])] * 4),
    jitter=st.integers(0, 40),
    seed=st.integers(0, 1000),
)
def test_straight_lines_stay_straight(tmp_path_factory, offsets, steps, jitter, seed):
    """Columns logged at steps and moments of their own: a line in time is the same line on the grid's rows."""
    rng, lines = np.random.default_rng(seed), []
    slopes = {"T_left": 1e-5, "T_right": -2e-5, "T1": 3e-5, "T2": 5e-6}
    for k, slope in enumerate(slopes.values()):
        seconds = offsets[k] + steps[k] * np.arange(2 * 86400 // steps[k]) + rng.integers(0, jitter + 1)
        seconds = seconds + rng.integers(-jitter, jitter + 1, len(seconds))
        cells = [""] * 4
        for t in seconds.tolist():
            cells[k] = repr(10 + slope * t)
            lines.append((t, ",".join([str(t), *cells])))
    path = tmp_path_factory.mktemp("lines") / "record.csv"
    path.write_text("\n".join([HEADER.strip(), *(line for _, line in sorted(lines)), ""]))
    record = read_record(path, **COLUMNS)
    at = np.asarray(record.stamps, float)
    within = 0.01 * record.step * 1e-5 * 5  # what stands nearer to a row than a hundredth of the step is taken as it is
    for k, name in enumerate(FACES):
        np.testing.assert_allclose(record.faces[:, k], 10 + slopes[name] * at, rtol=0, atol=within)
    for k, name in enumerate(("T1", "T2")):
        there = np.isfinite(record.sensors[:, k])
        np.testing.assert_allclose(record.sensors[there, k], 10 + slopes[name] * at[there], rtol=0, atol=within)
        readings = 2 * 86400 // steps[2 + k]
        assert 0 < there.sum() <= readings  # a reading is never made two
        # all but those at the ends find their row, where it is not taken
        assert there.sum() >= min(readings, record.rows) - 6 - readings * (steps[2 + k] < record.step)
    assert record.step == min(steps[:2])


def test_a_slower_sensor_keeps_its_readings(read):
    """Hourly readings five minutes past rows of ten: each on its nearest row, nothing between."""
    seconds = 600 * np.arange(600)
    wave = np.sin(seconds / 14_000)
    faces = [f"{t},{10 + 5 * w},{20 - w},," for t, w in zip(seconds, wave, strict=True)]
    inner = [f"{t},,,{12 + np.sin(t / 14_000)},15" for t in 240 + 3600 * np.arange(99)]
    record = read("\n".join([HEADER.strip(), *sorted(faces + inner, key=lambda line: int(line.split(",")[0]))]))
    there = np.flatnonzero(np.isfinite(record.sensors[:, 0]))
    assert record.step == 600.0 and set(np.diff(there)) == {6} and 98 <= len(there) <= 99
    error = record.sensors[there, 0] - (12 + np.sin(record.time[there] / 14_000))
    assert np.abs(error).max() < (3600 / 14_000) ** 2 / 8  # of a straight line over an hour
    assert record.cleaning.count("carried", "T1") == len(there)


def test_a_plates_readings_are_not_made_more(read):
    """A flux is a reading as a sensor's is: a gap stays a gap, where an air temperature is interpolated."""
    columns = {**COLUMNS, "regressors": {"flux_left": "q", "air_outdoor": "air"}}
    frame = table().assign(q=lambda rows: 30 + rows["T_left"], air=lambda rows: rows["T_right"])
    frame.loc[[50, 51], ["q", "air"]] = np.nan
    record = read(text(frame.drop(index=[10])), columns)  # a missing row, so that the readings are put on a new grid
    known = np.setdiff1d(np.arange(ROWS), [10, 50, 51])
    assert np.isnan(record.regressors["flux_left"][[10, 50, 51]]).all()
    np.testing.assert_array_equal(record.regressors["flux_left"][known], frame["q"][known])
    assert np.isfinite(record.regressors["air_outdoor"]).all()


def test_a_slower_plate_keeps_its_readings(read):
    """Hourly fluxes, in the column T1, four minutes past rows of ten; what was done to them is in the list."""
    columns = {**COLUMNS, "sensors": [], "regressors": {"flux_right": "T1"}}
    faces = [f"{t},{10 + np.sin(t / 14_000)},{20 - np.sin(t / 14_000)},," for t in (600 * np.arange(600)).tolist()]
    fluxes = [f"{t},,,{12 + 1e-4 * t}," for t in (240 + 3600 * np.arange(99)).tolist()]
    lines = sorted(faces + fluxes, key=lambda line: int(line.split(",")[0]))
    record = read("\n".join([HEADER.strip(), *lines]), columns)
    there = np.flatnonzero(np.isfinite(record.regressors["flux_right"]))
    assert record.sensors.shape == (600, 0) and set(np.diff(there)) == {6} and 98 <= len(there) <= 99
    np.testing.assert_allclose(record.regressors["flux_right"][there], 12 + 1e-4 * record.time[there])
    assert record.cleaning.count("carried", "T1") == len(there)


def test_a_stated_step(read):
    frame = table()
    coarse = read(text(frame), step=7200)
    assert coarse.step == 7200.0 and abs(coarse.rows - ROWS // 2) <= 1
    assert coarse.cleaning.count("binned", "T1") >= ROWS - 2
    fine = read(text(frame), step=1800)
    assert fine.rows == 2 * ROWS - 1
    same(fine, frame, slice(None, None, 2))
    assert np.isnan(fine.sensors[1::2]).all()
    np.testing.assert_allclose(fine.faces[1::2], (fine.faces[:-2:2] + fine.faces[2::2]) / 2)
    assert fine.unbroken_parts == ((0, 2 * ROWS - 1),) and fine.cleaning.count("between", "T_left") == ROWS - 1


def test_a_sensor_that_dies_and_readings_before_the_faces(read):
    frame = table()
    frame.loc[120:, "T1"] = np.nan
    frame.loc[:4, "T_right"] = np.nan
    record = read(text(frame))
    assert record.rows == ROWS - 5 and record.stamp(0) == "2020-02-01T05:00:00"
    assert np.isnan(record.sensors[115:, 0]).all() and np.isfinite(record.sensors[:115, 0]).all()
    assert record.cleaning.count("trimmed") == 5


def test_windows_of_a_record_with_gaps(read):
    record = read(text(table().drop(index=[10, *range(100, 110)])))
    part = record.window(90, 40)
    assert part.unbroken_parts == ((0, 10), (20, 20)) and part.cleaning.unchanged
    np.testing.assert_array_equal(part.fill_std, record.fill_std[90:130])
