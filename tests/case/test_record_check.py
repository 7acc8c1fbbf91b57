"""`wallid check` and `wallid new`, and what broken records do to the stages after them."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from benchmarks.stress.fuzz import plain_record, write_case
from refusals import refuses
from typer.testing import CliRunner

import wallid
from wallid.case.record_check import check
from wallid.case.time_window import Window, check_unbroken, diagnosis_window, entire_record
from wallid.case.wizard import Answers, new_case, parse_length, parse_sensor
from wallid.cli.commands import app
from wallid.models.window_inputs import window_data
from wallid.workflow import Run


@pytest.fixture
def command(tmp_path):
    def call(*words, out=True):
        extra = ["--out", str(tmp_path / "out")] if out else []
        return CliRunner().invoke(app, [*map(str, words), *extra])

    return call


def without(rows, content=None):
    """The plain record without some rows."""
    lines = (content or plain_record()).splitlines()
    return "\n".join([*(line for k, line in enumerate(lines) if k - 1 not in rows), ""])


@pytest.fixture
def house(tmp_path):
    def make(content=None, extra=""):
        write_case(tmp_path, (content or plain_record()).encode(), extra)
        return tmp_path

    return make


BROKEN = without(range(60, 70))


# ------------------------------------------------------------------------------------------------ check


def test_check_says_which_instrument_stopped():
    """A sensor and a plate that stop after the third day of ten, and a plate with one reading."""
    hours = np.arange(240)
    frame = pd.DataFrame({"in": 20 + np.sin(hours / 4), "out": 5 + 4 * np.sin(hours / 4), "T": 12.0, "q1": 30.0})
    frame["q2"] = 30.0
    frame.index = pd.date_range("2024-01-05", periods=240, freq="h")
    frame.iloc[72:, [2, 3]] = np.nan
    frame.iloc[1:, 4] = np.nan
    case = wallid.Case.from_dataframe(
        frame, left="in", right="out", length=0.4, diffusivity_prior=5e-7, sensors={"T": 0.2}, noise_std=0.1,
        regressors={"flux_left": "q1", "flux_right": "q2"},
    )  # fmt: skip
    notes = str(check(case))
    assert "T has its last reading at 2024-01-07T23:00:00" in notes
    assert "flux_left has its last reading at 2024-01-07T23:00:00" in notes
    assert "flux_right has readings in 1 of 240 rows" in notes
    assert "T has no reading" not in notes


def test_check_tells_counts_and_draws(command, house, tmp_path):
    lines = BROKEN.splitlines()
    lines[5] = lines[5].rpartition(",")[0] + ",Err"
    lines[20] = lines[20].rpartition(",")[0] + ",85.0"
    ended = command("check", house("\n".join(lines)))
    assert ended.exit_code == 0, ended.stderr
    for words in (
        'T2: 1 cell with a missing-value marker ("Err" in line 6)',
        "T2: 1 spike masked (from 85 in line 21)",
        "T_left and T_right: no reading from 2020-03-07T11:00:00 to 2020-03-07T22:00:00 (11 h)",
        "the record has 1 break(s)",
        "nothing would stop a run",
    ):
        assert words in ended.stdout
    assert {file.name for file in (tmp_path / "out").iterdir()} == {
        "record.png",
        "wall.png",
        "report.html",
        "result.json",
    }
    assert (tmp_path / "out" / "record.png").stat().st_size > 20_000


def test_check_as_json(command, house):
    ended = command("check", house(BROKEN), "--json")
    found = json.loads(ended.stdout)
    assert (found["verdict"], found["stops"], found["diffusivity"], found["effects"]) == (None, [], None, [])
    assert [part["rows"] for part in found["record"]["parts"]] == [60, 50]
    assert found["record"]["breaks"][0]["columns"] == ["T_left", "T_right"]
    assert found["record"]["missing"] == {"T1": 10, "T2": 10}


def test_check_says_what_would_stop_a_run(command, house, tmp_path):
    """Breaks leave no window of two days: status 1, with the way out; a run says the same with status 2."""
    content = without([*range(40, 50), *range(80, 90)])
    ended = command("check", house(content))
    assert ended.exit_code == 1
    assert "STOPS A RUN  [choices] window_days = 2 makes 48 rows of 3600 s; it must make 8 to 40" in ended.stdout
    assert json.loads((tmp_path / "out" / "result.json").read_text())["verdict"] == "uninformative"
    refused = command("run", tmp_path)
    assert refused.exit_code == 2 and "window_days = 2 makes 48 rows" in refused.stderr
    assert command("check", house(content, "longest_gap = 12")).exit_code == 0


def test_a_record_whose_sensors_and_faces_never_meet(house):
    lines = plain_record().splitlines()
    spoilt = [
        line if 0 <= k - 1 < 5 or not k else ",".join([*line.split(",")[:3], "", ""]) for k, line in enumerate(lines)
    ]
    case = wallid.load(house("\n".join(spoilt)))
    assert check(case).stops == ()
    still = replace(case.record, faces=np.full_like(case.record.faces, 5.0))
    assert "both face temperatures are constant" in check(replace(case, record=still)).stops[0]
    blind = replace(case.record, sensors=np.full_like(case.record.sensors, np.nan))
    found = check(replace(case, record=blind))
    assert "no unbroken window of 2 days holds a reading" in found.stops[0]
    assert "T1 has no reading" in found.notes[0]


def test_check_of_a_bad_file_leaves_nothing(command, house, tmp_path):
    ended = command("check", house("time,T_left\n"))
    assert ended.exit_code == 2 and ended.stderr.startswith("wallid: ") and ended.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["saint_julien", "validation", "validation_high_noise"])
def test_the_packaged_cases_are_clean(name):
    case = wallid.load(name)
    assert case.record.cleaning.unchanged and check(case).stops == ()


# ------------------------------------------------------------------------------- broken records afterwards


def test_stages_take_the_longest_part_and_say_so(house):
    case = wallid.load(house(BROKEN))
    assert (entire_record(case), diagnosis_window(case)) == (Window(0, 60), Window(0, 60))
    fit = wallid.estimate(case)
    assert fit.window == Window(0, 60)
    found = wallid.predict(case, fit)
    assert found.measured.shape == (60, 2) and found.days[-1] == pytest.approx(59 / 24)
    assert "its longest unbroken part, 60 rows" in str(Run(case, fit=fit, prediction=found))
    refuses(lambda: window_data(case, Window(50, 20)), "lies across a break", "T_left and T_right", "longest_gap")
    refuses(lambda: check_unbroken(case, Window(65, 20)), "lies across a break")
    best = wallid.design(case).best
    assert case.record.contains_windows(best.row, best.rows)


def test_a_window_by_hand_across_a_break(command, house, tmp_path):
    ended = command("estimate", house(BROKEN), "--from-row", 40)
    assert ended.exit_code == 2 and "lies across a break" in ended.stderr
    assert not (tmp_path / "out").exists()


def test_dirt_hardly_moves_the_estimate(house):
    """A tenth of the cells lost or spoilt, a gap filled: within 1.5 of the larger of the standard errors."""
    clean = wallid.estimate(wallid.load(house()))
    rng, lines = np.random.default_rng(4), plain_record().splitlines()
    for row in rng.choice(np.arange(2, 120), 20, replace=False):
        cells = lines[row].split(",")
        cells[rng.integers(3, 5)] = rng.choice(["", "Err", "85.0", "-127"])
        lines[row] = ",".join(cells)
    dirty = wallid.estimate(wallid.load(house(without([30, 31], "\n".join(lines)))))
    assert abs(np.log(dirty.value / clean.value)) < 1.5 * max(clean.std / clean.value, dirty.std / dirty.value)


# --------------------------------------------------------------------------------------------------- new

OPTIONS = ("--length", "30 cm", "--left", "T_left", "--right", "T_right", "--sensor", "T1=10cm", "--sensor", "T2=0.2")


@pytest.mark.slow
def test_a_new_case_runs(command, tmp_path):
    (tmp_path / "record.csv").write_text(plain_record())
    ended = command("new", tmp_path / "record.csv", *OPTIONS, "--outside", "right", out=False)
    assert ended.exit_code == 0, ended.stderr
    case = wallid.load(tmp_path)
    assert (case.wall.length, case.wall.outside, case.choices.window_days) == (0.3, "right", 2.5)
    assert [(sensor.name, sensor.position) for sensor in case.sensors] == [("T1", 0.1), ("T2", 0.2)]
    text = (tmp_path / "case.toml").read_text()
    assert all("#" in line for line in text.splitlines() if "=" in line)
    again = command("new", tmp_path / "record.csv", *OPTIONS, "--prior", "1e-6", out=False)
    assert again.exit_code == 2 and "--force" in again.stderr
    assert (tmp_path / "case.toml").read_text() == text
    assert command("new", tmp_path / "record.csv", *OPTIONS, "--force", "--quiet", out=False).stdout == ""
    assert command("estimate", tmp_path, "--model", "lom", "--quiet").exit_code == 0


def test_lines_above_a_header_that_are_filled_up_with_separators(command, tmp_path):
    """As spreadsheets write them; the header is the line with the most names."""
    text = plain_record().replace(",", ";")
    above = "Logger XT;No. 817;;;\nPlace;East wall;;;\n"
    header, rows = text.split("\n", 1)
    units = ";".join(["", *["°C"] * (header.count(";"))])
    (tmp_path / "record.csv").write_text(f"{above}{header}\n{units}\n{rows}")
    ended = command("new", tmp_path / "record.csv", *OPTIONS, out=False)
    assert ended.exit_code == 0, ended.stderr
    assert wallid.load(tmp_path).record.names == ("T1", "T2")


def test_without_a_terminal_nothing_is_asked(command, tmp_path):
    (tmp_path / "record.csv").write_text(plain_record())
    ended = command("new", tmp_path / "record.csv", "--length", "0.3", out=False)
    assert ended.exit_code == 2
    assert "give --left, --right, --sensor NAME=POSITION" in ended.stderr
    assert "T_left (temperature" in ended.stderr
    assert [file.name for file in tmp_path.iterdir()] == ["record.csv"]


def test_questions_and_answers(tmp_path):
    (tmp_path / "record.csv").write_text(plain_record())
    asked = []

    def ask(question, default, read):
        asked.append((question, default))
        asks = question.splitlines()[-1]
        words = {"Length": "30 cm", "Column": default, "Which": "right", "Position": "0.1" if "T1" in asks else ""}
        return read(words.get(asks.split()[0], default))

    case = new_case(tmp_path / "record.csv", ask=ask)
    assert [default for _, default in asked] == [None, "T_left", "T_right", None, "none", "none", "", "0.1"]
    assert [question.count("T_left (temperature") for question, _ in asked] == [0, 1, 0, 0, 0, 0, 0, 0], "told once"
    assert [sensor.name for sensor in case.sensors] == ["T1"]
    assert (case.name, case.path) == (tmp_path.name, tmp_path / "case.toml")


@pytest.mark.parametrize(
    ("left", "right", "outside"),
    [
        ("T_in", "T_out", "right"),
        ("outdoor", "indoor", "left"),
        ("Wand innen", "Wand außen", "right"),
        ("Tse", "Tsi", "left"),
        ("T_left", "T_right", "left"),
    ],
)
def test_the_names_of_the_faces_tell_which_is_outdoors(tmp_path, left, right, outside):
    text = plain_record().replace("T_left", left).replace("T_right", right)
    (tmp_path / "record.csv").write_text(text, encoding="utf-8")
    answers = Answers(length=0.3, left=left, right=right, sensors={"T2": 0.2}, conductivity=0.8, noise=0.05)
    assert new_case(tmp_path / "record.csv", answers).wall.outside == outside
    offered = []

    def ask(question, default, read):
        offered.append(default)
        return read(default or "left")

    asked = new_case(tmp_path / "record.csv", answers, force=True, ask=ask)
    assert offered == [outside if "left" not in left else None] and asked.wall.outside == outside
    contrary = new_case(tmp_path / "record.csv", replace(answers, outside="left"), force=True)
    assert contrary.wall.outside == "left", "what is said counts"


def test_a_mistyped_answer_is_asked_for_again(tmp_path, monkeypatch):
    """At a terminal: what was answered before is kept."""
    from typer.testing import CliRunner

    from wallid.cli import commands as cli

    (tmp_path / "record.csv").write_text(plain_record())
    said = ["40 cms", "0", "40 cm", "T_lft", "T_left", "", "out", "right", "41 cm", "10 cm", "10 cm", "0.2", "", ""]
    monkeypatch.setattr(cli, "_is_terminal", lambda: True)
    ended = CliRunner().invoke(cli.app, ["new", str(tmp_path / "record.csv")], input="\n".join(said) + "\n")
    assert ended.exit_code == 0, ended.stderr
    case = wallid.load(tmp_path)
    assert (case.wall.length, case.wall.outside, case.record.names) == (0.4, "right", ("T1", "T2"))
    for wrong in (
        "'40 cms'",
        "above 0",
        'no column "T_lft"',
        '"left" or "right"',
        "not inside the wall",
        "that of T1; positions must differ",
    ):
        assert wrong in ended.stderr


def test_a_german_logger(tmp_path):
    """Semicolons, decimal commas, dates with the day first past the twelfth, units in brackets, flux in words."""
    lines = [line.split(",") for line in plain_record().replace("2020-03-", "2020-05-1").splitlines()[1:]]
    rows = [
        ";".join([f"{t[8:10]}.{t[5:7]}.{t[:4]} {t[11:16]}", *(c.replace(".", ",") for c in cells), "3,5"])
        for t, *cells in ((line[0].replace("-10", "-1"), *line[1:]) for line in lines)
    ]
    header = "Zeit;innen [°C];außen [°C];M1 [°C];M2 [°C];Wärmestrom [W/m²]"
    (tmp_path / "mess.csv").write_bytes("\r\n".join([header, *rows]).encode("cp1252"))
    answers = Answers(length=0.3, left="innen [°C]", right="außen [°C]", sensors={"M1 [°C]": 0.1})
    case = new_case(tmp_path / "mess.csv", answers, to=tmp_path / "haus.toml")
    assert (case.name, case.record.rows, case.record.stamp(0)) == ("haus", 120, "2020-05-15T00:00:00")
    text = (tmp_path / "haus.toml").read_text(encoding="utf-8")
    assert "day_first = true" in text and 'left = "innen [°C]"' in text


def test_units_that_show(tmp_path):
    header, rest = plain_record().split("\n", 1)
    (tmp_path / "record.csv").write_text(f"{header}\n,°C,°C,K,°C\n{rest}".replace("T1,", "T1,"))
    answers = Answers(length=0.3, left="T_left", right="T_right", sensors={"T2": 0.2})
    assert new_case(tmp_path / "record.csv", answers).sensors[0].unit is None
    refuses(lambda: parse_length("--length", "430"), "--length = '430': is this in m?", '"430 mm"')
    assert parse_length("--length", "12 m") == 12.0
    refuses(lambda: parse_length("length", "wide"), "length = 'wide'; it must be a length, such as 0.43, \"43 cm\"")
    refuses(lambda: parse_sensor("T1"), "it must be NAME=POSITION")
    assert (parse_length("x", "430 mm"), parse_length("x", "0,43"), parse_sensor("a=b=2 cm")) == (
        0.43,
        0.43,
        ("a=b", 0.02),
    )


def test_times_that_do_not_look_like_it(tmp_path):
    """Seconds under any name."""
    lines = [line.split(",", 1) for line in plain_record().splitlines()]
    spoilt = [f"count,{lines[0][1]}", *(f"{600 * k},{cells}" for k, (_, cells) in enumerate(lines[1:]))]
    (tmp_path / "record.csv").write_text("\n".join(spoilt))
    answers = Answers(length=0.3, left="T_left", right="T_right", sensors={"T2": 0.2})
    refuses(lambda: new_case(tmp_path / "record.csv", answers), "no column of times", "--time")
    assert new_case(tmp_path / "record.csv", replace(answers, time="count")).record.step == 600.0


def test_an_unknown_column_writes_nothing(tmp_path):
    (tmp_path / "record.csv").write_text(plain_record())
    answers = Answers(length=0.3, left="T_lft", right="T_right", sensors={"T2": 0.2})
    refuses(lambda: new_case(tmp_path / "record.csv", answers), 'no column "T_lft"')
    assert [file.name for file in tmp_path.iterdir()] == ["record.csv"]


def test_dates_that_do_not_tell(tmp_path):
    (tmp_path / "record.csv").write_text(plain_record().replace("2020-03-0", "0").replace("T", " T"))
    lines = [line.replace("T", " ") for line in plain_record().replace("2020-03-0", "03/0").splitlines()]
    lines = [lines[0].replace(" ", "T"), *(line[:5] + "/2020" + line[5:] for line in lines[1:])]
    (tmp_path / "record.csv").write_text("\n".join(lines))
    answers = Answers(length=0.3, left="T_left", right="T_right", sensors={"T2": 0.2})
    refuses(lambda: new_case(tmp_path / "record.csv", answers), "--day-first or --month-first")


def test_long_curves_keep_their_extremes():
    from wallid.plot.logged_record import downsampled

    days, values = np.arange(50_000.0), np.sin(np.arange(50_000) / 900)
    values[30_001], values[1000:9000] = 7.0, np.nan
    at, shown = downsampled(days, values)
    assert len(at) < 4000 and (np.diff(at) >= 0).all()
    assert (np.nanmax(shown), np.nanmin(shown)) == (7.0, np.nanmin(values))
    np.testing.assert_array_equal(shown, values[at.astype(int)])
    assert np.isnan(shown).any()
    assert len(downsampled(days[:100], values[:100])[0]) == 100
