import json
import re
from dataclasses import replace

import jsonschema
import numpy as np
import pandas as pd
import pytest
from own_case import write_own
from pages import check
from results import SCHEMA
from typer.testing import CliRunner

import wallid
from wallid.cli.commands import app
from wallid.workflow import Run


@pytest.fixture
def command(tmp_path):
    def call(*words):
        return CliRunner().invoke(app, [*map(str, words), "--out", str(tmp_path / "out")])

    return call


@pytest.mark.slow
def test_design_alone(command, tmp_path):
    ended = command("design", "saint_julien", "--json", "--of", "constants", "--criterion", "E", "--add", 2)
    assert ended.exit_code == 0
    result = json.loads(ended.stdout)
    jsonschema.validate(result, SCHEMA)
    assert result["diffusivity"] is None and result["window"]["criterion"] == 1.0
    told = result["design"]
    assert (told["criterion"], told["of"], told["robust"], told["full"]) == ("E", "constants", "no", True)
    assert len(told["further_sensors"]) == 2 and len(told["places"]["m"]) == 19
    assert told["further_sensors"][1]["relative_std"] < told["relative_std_without"]
    assert len(told["sampling"]["step_s"]) == len(told["sampling"]["relative_std"])
    out = tmp_path / "out"
    assert (out / "design.png").exists() and (out / "places.png").exists()
    assert "a fourth sensor helps most" in check((out / "report.html").read_text("utf-8")).text
    assert len(told["starts"]["start"]) == len(told["starts"]["criterion"]) and max(told["starts"]["criterion"]) == 1.0
    assert len(result["lengths"]["days"]) == len(result["lengths"]["criterion"]) > 1


@pytest.mark.slow
def test_a_window_by_hand(command):
    ended = command("estimate", "saint_julien", "--from-row", 240, "--model", "lom", "--json")
    assert json.loads(ended.stdout)["window"]["start"] == "2009-01-11T00:00:00"
    assert command("estimate", "saint_julien", "--from-row", 2600).exit_code == 2


@pytest.mark.slow
def test_the_summary_is_for_people(command):
    ended = command("estimate", "saint_julien")
    assert ended.exit_code == 1  # a sun is hidden in it
    assert "diffusivity" in ended.stdout and "m²/s" in ended.stdout and "T3" in ended.stdout
    verdict = next(line for line in ended.stdout.splitlines() if line.startswith("verdict"))
    assert "NOT TO BE RELIED ON" in verdict and "solar gain of the right face" in verdict
    assert "next         wallid diagnose saint_julien: name" in ended.stdout
    assert [line.split()[0] for line in ended.stderr.splitlines() if not line.startswith("  ")] == [
        *("record", "design", "learn", "estimate", "screening", "report")
    ]
    assert all(re.search(r"\(\d+\.\d s\)$", line) for line in ended.stderr.splitlines() if not line.startswith("  "))
    assert "an effect is missing" in ended.stderr and "\x1b" not in ended.stderr
    sound = command("estimate", "validation")
    assert sound.exit_code == 0 and "verdict" not in sound.stdout
    assert "next         wallid diagnose validation: search" in sound.stdout
    assert command("estimate", "validation", "--quiet").output == ""


def test_validation_case_finds_its_truth(command, tmp_path):
    ended = command("run", "validation", "--json", "--orders", "2,3")
    assert ended.stderr == ""
    result = json.loads(ended.stdout)
    assert [one["order"] for one in result["orders"]] == [2, 3]
    jsonschema.validate(result, SCHEMA)
    low, high = result["diffusivity"]["interval_95"]
    assert low < 5.21e-7 < high
    assert result["window"] == {"start": 0.0, "end": 86430.0, "criterion": 1.0}
    assert (tmp_path / "out" / "orders.png").exists()


def test_orders_that_are_no_numbers(command):
    wrong = command("run", "validation", "--orders", "two")
    assert wrong.exit_code == 2 and "--orders" in wrong.stderr


@pytest.mark.slow
def test_a_case_of_ones_own(command, tmp_path):
    ended = command("run", write_own(tmp_path), "--json")
    assert ended.exit_code == 0
    result = json.loads(ended.stdout)
    jsonschema.validate(result, SCHEMA)
    assert "lengths" not in result and "lengths" not in result["seconds"]
    page = check((tmp_path / "out" / "report.html").read_text("utf-8"))
    assert "design criterion" in page.text and "window length" not in page.text
    assert result["reliability"]["loads"] is None
    assert not (tmp_path / "out" / "loads.png").exists()


@pytest.mark.slow
def test_other_window_lengths_on_request(command, tmp_path):
    ended = command("run", write_own(tmp_path), "--lengths")
    assert ended.exit_code == 0 and "lengths      1 to 5 days" in ended.stderr
    result = json.loads((tmp_path / "out" / "result.json").read_text("utf-8"))
    jsonschema.validate(result, SCHEMA)
    assert result["lengths"]["days"] == [1.0, 2.0, 3.0, 5.0] and "lengths" in result["seconds"]
    page = check((tmp_path / "out" / "report.html").read_text("utf-8"))
    assert "Bottom: the criterion by window length" in page.text


def test_a_record_without_signal_ends_with_status_1(command, tmp_path):
    ended = command("run", write_own(tmp_path, still=True), "--json")
    assert ended.exit_code == 1
    result = json.loads(ended.stdout)
    jsonschema.validate(result, SCHEMA)
    assert result["verdict"] == "uninformative" and result["reason"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"position = 0.23": "position = 0.5"}, ["case.toml", "position", "0.5", "0.43"]),
        ({"length = 0.43": "length = -1"}, ["length"]),
        ({'left = "left"': 'left = "lft"'}, ["lft", "left"]),
        ({"columns": {"left": np.full(240, 285.0)}}, ["left", "kelvin"]),
        ({"[wall]": "[wall"}, ["case.toml"]),
    ],
)
def test_bad_input_ends_with_status_2_and_leaves_nothing(command, tmp_path, change, words):
    ended = command("run", write_own(tmp_path, **change))
    assert ended.exit_code == 2
    for word in words:
        assert word in ended.stderr
    assert "Traceback" not in ended.stderr and ended.stdout == ""
    assert ended.stderr.startswith("wallid: ") and ended.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()
    assert sorted(file.name for file in tmp_path.iterdir()) == ["case.toml", "record.csv"]


def test_daily_rows(command, tmp_path):
    """A step of a day: no window of one day is tried."""
    days = pd.date_range("2020-03-01", periods=240, freq="D").strftime("%Y-%m-%d")
    path = write_own(tmp_path, columns={"time": days})
    path.write_text(path.read_text() + "[choices]\nwindow_days = 60\n")
    assert command("design", path, "--quiet").exit_code in (0, 1)


def test_a_window_without_readings_is_named(command, tmp_path):
    readings = np.array(wallid.load("saint_julien").record.sensors[:240, 1])
    readings[100:] = np.nan
    ended = command("estimate", write_own(tmp_path, columns={"in": readings}), "--from-row", 120)
    assert ended.exit_code == 2 and "no inner sensor has a reading" in ended.stderr


def test_an_open_quotation_mark_is_named(command, tmp_path):
    path = write_own(tmp_path)
    record = tmp_path / "record.csv"
    record.write_text('"' + record.read_text() * 20)
    ended = command("run", path)
    assert ended.exit_code == 2 and "quotation mark" in ended.stderr


@pytest.mark.slow
def test_lom_and_mim_agree_and_what_one_left_is_not_taken_for_the_others(command, tmp_path):
    values = []
    for model in ("mim", "lom"):
        ended = command("estimate", "saint_julien", "--model", model, "--json")
        assert ended.exit_code == 1
        result = json.loads(ended.stdout)
        assert result["verdict"] == "uninformative" and result["screening"]["missing"]
        assert result["screening"]["candidate"] == "solar gain of the right face"
        values.append(result["diffusivity"]["value"])
        names = {file.name for file in (tmp_path / "out").iterdir()}
        assert ("model.npz" in names) == (model == "mim") and "result.json" in names
        (tmp_path / "out" / "notes.txt").write_text("mine")
    assert "notes.txt" in names
    assert values[0] == pytest.approx(values[1], rel=5e-3)


def test_orders_that_cannot_be_learned_are_refused_first(command):
    assert "--model mim" in command("run", "validation", "--model", "lom", "--orders", "3").stderr
    assert "73" in command("run", "validation", "--orders", "200").stderr


def test_an_unknown_case_lists_the_packaged_ones(command):
    ended = command("run", "nowhere")
    assert ended.exit_code == 2
    for name in wallid.case.packaged():
        assert name in ended.stderr


def test_figures_as_drawings_on_request(command, tmp_path):
    ended = command("check", "validation", "--format", "svg")
    assert ended.exit_code == 0 and "record.svg" in ended.stdout
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "record.svg",
        "wall.svg",
        "report.html",
        "result.json",
    }
    wrong = command("check", "validation", "--format", "jpg")
    assert wrong.exit_code == 2 and "--format 'jpg'" in wrong.stderr


def test_an_output_folder_that_is_a_file(tmp_path):
    (tmp_path / "out").write_text("here already")
    ended = CliRunner().invoke(app, ["design", "validation", "--out", str(tmp_path / "out"), "--quiet"])
    assert ended.exit_code == 2 and "--out" in ended.stderr
    assert (tmp_path / "out").read_text() == "here already"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "Commands"),
        (["demo"], "saint_julien"),
        (["run"], "--orders"),
        (["design"], "--format"),
        (["design"], "CASE"),
        (["estimate"], "--model"),
        (["run"], "wallid diagnose"),
        (["diagnose"], "diagnose_days"),
    ],
)
def test_help_of_every_command(words, said):
    ended = CliRunner().invoke(app, [*words, "--help"], env={"COLUMNS": "120", "NO_COLOR": "1", "TERM": "dumb"})
    assert ended.exit_code == 0 and said in ended.output


@pytest.mark.slow
def test_a_plate_that_reads_temperatures_determines_nothing(command, tmp_path):
    """A diagnosis of a plate alone runs; what is no flux is no wall, and the status says so."""
    path = write_own(tmp_path)
    path.write_text(path.read_text().split("[[sensor]]")[0].replace("[record]", '[record]\nflux_left = "in"'))
    ended = command("diagnose", path)
    assert ended.exit_code == 1 and "flux" in ended.output


def test_version():
    assert CliRunner().invoke(app, ["--version"]).output.strip() == wallid.__version__


@pytest.mark.parametrize(
    ("typed", "offered"),
    [("wallid es", ["estimate"]), ("wallid run --int", ["--integrator"]), ("wallid design x --robust w", ["worst"])],
)
def test_a_shell_completes_commands_options_and_values(typed, offered):
    asked = {"_WALLID_COMPLETE": "complete_bash", "COMP_WORDS": typed, "COMP_CWORD": str(len(typed.split()) - 1)}
    ended = CliRunner().invoke(app, [], prog_name="wallid", env=asked)
    assert ended.exit_code == 0 and ended.output.split() == offered


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_can_be_shown_and_installed(monkeypatch, tmp_path, shell):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION", "1")  # the shell is then stated
    shown = CliRunner().invoke(app, ["--show-completion", shell], prog_name="wallid")
    assert shown.exit_code == 0 and f"complete_{shell}" in shown.output and "wallid" in shown.output
    installed = CliRunner().invoke(app, ["--install-completion", shell], prog_name="wallid")
    assert installed.exit_code == 0, installed.output
    written = [path for path in tmp_path.rglob("*") if path.is_file() and "wallid" in path.name]
    assert written and f"complete_{shell}" in written[0].read_text()


def test_with_a_window_by_hand_its_own_fit_decides():
    """A design that finds nothing at the prior does not overrule the fit of a window that was named."""
    case = wallid.load("saint_julien")
    fit = wallid.estimate(case, wallid.Window(168, 72), wallid.full_order_model(case))
    hopeless = replace(wallid.design(case), information=np.zeros((1, 109)))
    assert Run(case, design=hopeless).unreliable_reason
    assert not Run(case, design=hopeless, fit=fit).unreliable_reason
