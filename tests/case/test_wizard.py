"""`wallid new`: what it suggests, which options it has, and what it does with answers that make no valid case."""

import re

import numpy as np
import pytest
from benchmarks.stress.fuzz import plain_record
from refusals import refuses
from typer.testing import CliRunner

import wallid
from wallid.case.toml_writer import Answers
from wallid.case.wizard import new_case
from wallid.cli import commands as cli

OPTIONS = ("--length", "0.3", "--left", "T_left", "--right", "T_right")


def with_columns(**columns):
    """The plain record with further columns of constant or given values."""
    lines = plain_record().splitlines()
    rows = [lines[0] + "".join(f",{name}" for name in columns)]
    for k, line in enumerate(lines[1:]):
        rows.append(line + "".join(f",{np.broadcast_to(value, len(lines) - 1)[k]:.2f}" for value in columns.values()))
    return "\n".join(rows) + "\n"


@pytest.fixture
def new(tmp_path, monkeypatch):
    """`wallid new` for a record, at a terminal where there are answers."""

    def call(text, *words, said=None):
        (tmp_path / "record.csv").write_text(text, encoding="utf-8")
        monkeypatch.setattr(cli, "_is_terminal", lambda: said is not None)
        given = None if said is None else "".join(f"{answer}\n" for answer in said)
        return CliRunner().invoke(cli.app, ["new", str(tmp_path / "record.csv"), *words], input=given)

    return call


SUN = np.tile(np.maximum(0.0, np.sin(np.arange(24) / 24 * 2 * np.pi)) * 640.0, 6)


# ------------------------------------------------------------------------------------------------ suggestions


@pytest.mark.parametrize(
    ("outdoors", "indoors", "sun"),
    [
        ("Außenluft", "Raumluft", "Globalstrahlung (W/m²)"),
        ("air extérieur", "air intérieur", "Rayonnement global"),
        ("aire exterior", "aire interior", "Radiación solar"),
        ("aria esterna", "aria interna", "Irraggiamento W/m2"),
        ("buitenlucht", "binnenlucht", "Zonnestraling"),
        ("outdoor air", "indoor air", "Irradiance"),
    ],
)
def test_columns_are_suggested_by_their_names(new, tmp_path, outdoors, indoors, sun):
    """Only the defaults are accepted."""
    text = with_columns(**{outdoors: 4.0, indoors: 20.0, sun: SUN[:120]})
    ended = new(text, *OPTIONS, "--outside", "right", said=["0.1", "0.2", "", "", "", "", ""])
    assert ended.exit_code == 0, ended.stderr
    assert set(wallid.load(tmp_path).record.regressors) == {"air_outdoor", "air_indoor", "irradiance"}
    case = (tmp_path / "case.toml").read_text("utf-8")
    assert f'air_outdoor = "{outdoors}"' in case and f'irradiance = "{sun}"' in case


def test_a_suggestion_can_be_declined(new, tmp_path):
    ended = new(with_columns(**{"Außenluft": 4.0}), *OPTIONS, "--outside", "right", said=["0.1", "0.2", "none", "", ""])
    assert ended.exit_code == 0, ended.stderr
    assert not wallid.load(tmp_path).record.regressors


def test_a_face_is_suggested_before_the_air(tmp_path):
    lines = with_columns(**{"Luft außen": 4.0, "Wand außen": 5.0, "Wand innen": 19.0})
    defaults = []

    def ask(question, default, parse):
        defaults.append((question.splitlines()[-1], default))
        return parse(default or "0.3")

    record = tmp_path / "record.csv"
    record.write_text(lines.replace("T_left", "A").replace("T_right", "B"), encoding="utf-8")
    new_case(record, Answers(length=0.3, outside="right", sensors={"T2": 0.1}), ask=ask)
    assert [default for question, default in defaults if question.startswith("Column of the")] == [
        "Wand innen",
        "Wand außen",
    ]


def test_without_a_terminal_the_suggestions_are_options(new):
    text = with_columns(**{"Außenluft": 4.0, "Globalstrahlung (W/m²)": SUN[:120]})
    ended = new(text)
    assert ended.exit_code == 2
    for option in (
        "--left T_left",
        "--right T_right",
        "--air-outdoor 'Außenluft'",
        "--irradiance 'Globalstrahlung (W/m²)'",
    ):
        assert option in ended.stderr


def test_no_brackets_but_for_a_default(new):
    """`typer` shows a default in brackets; nothing else may look like one."""
    text = with_columns(flux=np.linspace(5.0, 9.0, 120))
    ended = new(text, said=["0.3", "", "", "right", "", "", "flux_left", "", ""])
    assert ended.exit_code == 0, ended.stderr
    assert re.findall(r"\[(.*?)\]", ended.stderr) == ["T_left", "T_right", "none", "none", "none", "0.1"]


def test_a_column_has_one_use_and_a_use_one_column(new, tmp_path):
    text = with_columns(flux=np.linspace(5.0, 9.0, 120), q2=np.linspace(2.0, 4.0, 120))
    said = ["0.3", "", "", "right", "", "", "flux_left", "flux_left", "flux_rigt", "flux_right", "", ""]
    ended = new(text, said=said)
    assert ended.exit_code == 0, ended.stderr
    assert 'flux_left is the column "flux"; free are' in ended.stderr
    assert 'did you mean "flux_right"' in ended.stderr
    record = wallid.load(tmp_path).record
    assert record.regressors["flux_left"].max() > record.regressors["flux_right"].max()


# ------------------------------------------------------------------------------------------------ options


def test_every_column_and_constant_has_an_option(new, tmp_path):
    text = with_columns(sun=SUN[:120], out=4.0, room=20.0)
    columns = ("--irradiance", "sun", "--air-outdoor", "out", "--air-indoor", "room")
    ended = new(text, *OPTIONS, "--sensor", "T1=0.1", *columns, "--conductivity", "0.8", "--noise", "0.03")
    assert ended.exit_code == 0, ended.stderr
    case = wallid.load(tmp_path)
    assert set(case.record.regressors) == {"irradiance", "air_outdoor", "air_indoor"}
    assert (case.wall.conductivity, case.sensors[0].noise_std) == (0.8, 0.03)


def test_conductivity_and_noise_are_asked_for(new, tmp_path):
    ended = new(plain_record(), *OPTIONS, "--outside", "right", "--sensor", "T1=0.1", said=["0,8", "-1", "0,03"])
    assert ended.exit_code == 0, ended.stderr
    case = wallid.load(tmp_path)
    assert (case.wall.conductivity, case.sensors[0].noise_std) == (0.8, 0.03)
    assert "it must be a number above 0 (K)" in ended.stderr


# ------------------------------------------------------------------------------------- what makes no valid case


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--length", "0.1"), "position = 0.2 m is not inside the wall"),
        (("--prior", "-1"), "diffusivity_prior = -1.0"),
        (("--sensor", "T1=0.2"), "positions must differ"),
    ],
)
def test_without_a_terminal_the_file_is_written_and_says_what_to_edit(new, tmp_path, options, words):
    ended = new(plain_record(), *OPTIONS, "--sensor", "T2=0.2", *options)
    assert ended.exit_code == 2
    assert words in ended.stderr and "is written and cannot be used yet" in ended.stderr
    assert "wallid check" in ended.stderr and len(ended.stderr.splitlines()) == 1
    first = (tmp_path / "case.toml").read_text().splitlines()[0]
    assert first.startswith("# This case must be corrected first") and words in first
    refuses(lambda: wallid.load(tmp_path), words)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["case.toml", "record.csv"]


def test_at_a_terminal_the_answer_at_fault_is_asked_for_again(new, tmp_path):
    """The length is too small for the sensor; the suggested change is that of the columns, and the length is chosen."""
    said = ["", "", "length", "0.4"]
    ended = new(plain_record(), "--length", "0.1", *OPTIONS[2:], "--outside", "right", "--sensor", "T2=0.2", said=said)
    assert ended.exit_code == 0, ended.stderr
    assert "All answers are kept" in ended.stderr and "[columns]" in ended.stderr
    assert wallid.load(tmp_path).wall.length == 0.4


@pytest.mark.parametrize(
    ("options", "suggested", "said"),
    [
        (("--prior", "-1"), "prior", ["", "1e-6"]),
        (("--prior", "-1"), "prior", ["timezone", "Mars", "Europe/Berlin", "", "1e-6"]),
        (("--prior", "-1"), "prior", ["left", "T1", "right", "T_left", "outside", "left", "", "1e-6"]),
        (("--prior", "-1"), "prior", ["conductivity", "0.8", "noise", "0.2", "sand", "", "1e-6"]),
        (("--unit", "degF"), "unit", ["unit", "degC"]),
        (("--sensor", "T1=0.2"), "columns", ["", "0.1", ""]),
    ],
)
def test_each_answer_can_be_changed(new, tmp_path, options, suggested, said):
    stated = (*OPTIONS, "--outside", "right", "--sensor", "T2=0.2", "--conductivity", "0.8", "--noise", "0.1", *options)
    ended = new(
        plain_record() if suggested != "unit" else plain_record().replace("T1,", "T1 [°C],", 1), *stated, said=said
    )
    assert ended.exit_code == 0, ended.stderr
    assert wallid.load(tmp_path).wall.conductivity == 0.8


@pytest.mark.parametrize("said", [["write"], []])
def test_who_stops_finds_the_answers_in_the_file(new, tmp_path, said):
    stated = (*OPTIONS, "--outside", "right", "--sensor", "T2=0.2", "--conductivity", "0.8", "--noise", "0.1")
    ended = new(plain_record(), *stated, "--prior", "-1", said=said)
    assert ended.exit_code == 2 and "is written and cannot be used yet" in ended.stderr
    assert 'left = "T_left"' in (tmp_path / "case.toml").read_text()


def test_a_folder_that_cannot_be_written_is_found_before_the_first_question(new, tmp_path):
    (tmp_path / "there").mkdir()
    ended = new(plain_record(), "--to", str(tmp_path / "there"), "--force", said=[])
    assert ended.exit_code == 2 and "cannot be written; --to FILE" in ended.stderr
    assert "Length" not in ended.stderr
