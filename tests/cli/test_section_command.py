"""`wallid section`, and the commands that take a case with a section."""

import json

import numpy as np
import pandas as pd
import pytest
import scipy
from benchmarks.reference.analytic_slab import weather
from benchmarks.reference.section_by_finite_elements import ElementSection, Rectangle
from pages import check
from typer.testing import CliRunner

from wallid.cli.commands import app

STONE, MORTAR = (1.7, 2.1e6), (0.6, 1.5e6)  # W/m/K, J/m3/K
FACTOR = 0.8  # of all conductivities: what the case does not know
CASE = """
[wall]
length = 0.3

[section]
height = 0.2

[[section.material]]
name = "stone"
conductivity = 1.7
heat_capacity = 2.1e6

[[section.material]]
name = "mortar"
conductivity = 0.6
heat_capacity = 1.5e6

[[section.region]]
material = "mortar"
x = [0.0, 0.3]
y = [0.0, 0.2]

[[section.region]]
material = "stone"
x = [0.0, 0.12]
y = [0.0, 0.18]

[[section.region]]
material = "stone"
x = [0.15, 0.3]
y = [0.0, 0.18]

[[sensor]]
name = "T1"
position = 0.08
height = 0.1
noise_std = 0.05

[[sensor]]
name = "T2"
position = 0.2
height = 0.19
noise_std = 0.05
"""
RECORD = '\n[record]\nfile = "record.csv"\ntime = "time"\nleft = "L"\nright = "R"\n\n[choices]\nmodel = "lom"\n'


@pytest.fixture
def command(tmp_path):
    def call(*words):
        return CliRunner().invoke(app, [*map(str, words), "--out", str(tmp_path / "out")])

    return call


@pytest.fixture(scope="module")
def measured_case(tmp_path_factory):
    """Six days simulated by finite elements, between faces that are smooth."""
    folder = tmp_path_factory.mktemp("section")
    rectangles = [
        Rectangle((0.0, 0.3), (0.0, 0.2), FACTOR * MORTAR[0], MORTAR[1]),
        Rectangle((0.0, 0.12), (0.0, 0.18), FACTOR * STONE[0], STONE[1]),
        Rectangle((0.15, 0.3), (0.0, 0.18), FACTOR * STONE[0], STONE[1]),
    ]
    rng = np.random.default_rng(2902)
    faces = weather(9 * 288, 300.0, rng, hours=(8.0, 2.0))
    inside = ElementSection(0.3, 0.2, rectangles, 0.01).temperatures(
        faces, 300.0, np.array([[0.08, 0.1], [0.2, 0.19]]), 6
    )
    rows = slice(3 * 48, None)
    readings = np.concatenate([faces[::6][: len(inside)], inside], axis=1)[rows]
    readings = readings + 0.05 * rng.standard_normal(readings.shape)
    frame = pd.DataFrame(readings, columns=["L", "R", "T1", "T2"])
    frame.insert(0, "time", 1800.0 * np.arange(len(frame)))
    frame.to_csv(folder / "record.csv", index=False)
    (folder / "case.toml").write_text(CASE + RECORD)
    return folder


def test_a_section_without_a_record_is_solved(command, tmp_path):
    (tmp_path / "case.toml").write_text(CASE)
    ended = command("section", tmp_path, "--left", 20, "--right", 0, "--json")
    assert ended.exit_code == 0, ended.output
    result = json.loads(ended.stdout)["section"]
    assert set(result) >= {"cells", "order", "error", "conductivity", "heat_capacity", "diffusivity", "resistance"}
    assert result["resistance"] == pytest.approx(0.3 / result["conductivity"])
    assert result["steady"]["heat_flow"] == pytest.approx(0.2 * 20 / result["resistance"], rel=1e-6)
    assert 0.0 < result["steady"]["temperatures"]["T2"] < result["steady"]["temperatures"]["T1"] < 20.0
    assert result["error"] < 1e-4 and result["mesh_error"] < 1e-2
    page = check((tmp_path / "out" / "report.html").read_text("utf-8"))
    assert "the equivalent homogeneous wall" in page.text
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "materials.png", "steady.png", "report.html", "result.json"
    }  # fmt: skip


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--left", 20), "belong together"),
        (("--at", 3600), "has no [record]"),
        (("--left", "nan", "--right", 0), "--left = nan"),
    ],
)
def test_what_a_section_needs_is_said(command, tmp_path, words, message):
    (tmp_path / "case.toml").write_text(CASE)
    ended = command("section", tmp_path, *words)
    assert ended.exit_code == 2 and message in ended.stderr and not (tmp_path / "out").exists()


def test_a_case_without_a_section_is_refused(command):
    ended = command("section", "validation")
    assert ended.exit_code == 2 and "has no [section]" in ended.stderr


def test_an_edge_at_a_faces_temperature_has_no_equivalent_wall(command, tmp_path):
    (tmp_path / "case.toml").write_text(CASE.replace("height = 0.2\n", 'height = 0.2\ntop = "right"\n', 1))
    ended = command("section", tmp_path, "--json")
    result = json.loads(ended.stdout)["section"]
    assert ended.exit_code == 0 and result["conductivity"] is None and result["order"] > 0
    steady = json.loads(command("section", tmp_path, "--left", 20, "--right", 0, "--json").stdout)["section"]["steady"]
    assert steady["heat_flow"] is None  # at the corner of two temperatures it has no limit


def test_the_temperatures_at_a_time_are_drawn(command, measured_case, tmp_path):
    ended = command("section", measured_case, "--at", 2 * 86400)
    assert ended.exit_code == 0 and (tmp_path / "out" / "temperatures.png").exists()


@pytest.mark.parametrize(
    ("key", "message"),
    [('top = "right"', 'needs bottom = "adiabatic"'), ("surface_resistance_left = 0.1", "must be 0")],
)
def test_a_check_says_what_an_estimate_would_refuse(command, measured_case, tmp_path, key, message):
    (tmp_path / "record.csv").write_text((measured_case / "record.csv").read_text())
    (tmp_path / "case.toml").write_text((CASE + RECORD).replace("height = 0.2\n", f"height = 0.2\n{key}\n", 1))
    checked, estimated = command("check", tmp_path), command("estimate", tmp_path)
    assert checked.exit_code == 1 and message in checked.output
    assert estimated.exit_code == 2 and "[section]" in estimated.stderr


def test_a_time_outside_the_record_is_refused(command, measured_case):
    ended = command("section", measured_case, "--at", 6 * 86400)
    assert ended.exit_code == 2 and "it must lie between" in ended.stderr


@pytest.mark.slow
def test_the_common_factor_is_estimated_through_the_section(command, measured_case):
    ended = command("estimate", measured_case, "--from-row", 0, "--json")
    assert ended.exit_code == 0, ended.output
    found = json.loads(ended.stdout)["diffusivity"]
    solved = json.loads(command("section", measured_case, "--json").stdout)["section"]
    assert found["value"] == pytest.approx(FACTOR * solved["diffusivity"], rel=0.03)
    assert abs(np.log(found["value"] / (FACTOR * solved["diffusivity"]))) < 3 * found["std"] / found["value"]


def test_the_dynamic_diffusivity_is_that_of_the_slowest_mode(command, tmp_path):
    """A homogeneous section has its own diffusivity; a layered one the slowest eigenvalue of its layers."""
    plain = CASE.replace("conductivity = 0.6\nheat_capacity = 1.5e6", "conductivity = 1.7\nheat_capacity = 2.1e6")
    (tmp_path / "case.toml").write_text(plain)
    found = json.loads(command("section", tmp_path, "--json").stdout)["section"]
    assert found["dynamic_diffusivity"] == pytest.approx(1.7 / 2.1e6, rel=2e-3)
    assert found["dynamic_diffusivity"] == pytest.approx(found["diffusivity"], rel=2e-3)
    # two layers of equal thickness: k1 b1 cot(b1 h) + k2 b2 cot(b2 h) = 0 with b = sqrt(rate / a)
    layers = CASE[: CASE.index("[[section.region]]")] + "".join(
        f'[[section.region]]\nmaterial = "{name}"\nx = [{a}, {b}]\ny = [0.0, 0.2]\n'
        for name, a, b in (("stone", 0.0, 0.15), ("mortar", 0.15, 0.3))
    )
    (tmp_path / "case.toml").write_text(layers)
    found = json.loads(command("section", tmp_path, "--json").stdout)["section"]

    def balance(rate):
        return sum(k * np.sqrt(rate * c / k) / np.tan(np.sqrt(rate * c / k) * 0.15) for k, c in (STONE, MORTAR))

    alpha = 1.0 / (0.5 / STONE[0] + 0.5 / MORTAR[0]) / (0.5 * STONE[1] + 0.5 * MORTAR[1])
    rate = scipy.optimize.brentq(balance, 0.3 * alpha * (np.pi / 0.3) ** 2, 1.5 * alpha * (np.pi / 0.3) ** 2)
    assert found["dynamic_diffusivity"] == pytest.approx(rate * (0.3 / np.pi) ** 2, rel=2e-3)
    assert found["diffusivity"] == pytest.approx(alpha, rel=1e-6)
