import tomllib
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from refusals import refuses

from wallid.case import case_file
from wallid.case.case_definition import Case, LearningSignal
from wallid.case.case_file import load, packaged
from wallid.case.options import Choices
from wallid.case.wall_and_sensors import Sensor, Wall

WALL_PART = """
[wall]
length = 0.43
diffusivity_prior = 2.8e-7
"""
RECORD_PART = """
[record]
file = "record.csv"
time = "time"
left = "T_left"
right = "T_right"
irradiance = "sun"
"""
SENSOR_PART = """
[[sensor]]
name = "T1"
position = 0.05
position_std = 0.002
noise_std = 0.05

[[sensor]]
name = "T2"
position = 0.3
noise_std = 0.04
"""
CHOICES_PART = """
[choices]
window_days = 1.0
"""
TOML = 'description = "A wall"\n' + WALL_PART + RECORD_PART + SENSOR_PART + CHOICES_PART
FLUX = WALL_PART + RECORD_PART.replace("irradiance", "flux_left")
LEARNING = """
[learning]
file = "learning.csv"
time = "time"
initial_coefficients = [20.0]
[[learning.signal]]
diffusivity = 2.03e-7
left = "T_left_1"
right = "T_right"
[[learning.signal]]
diffusivity = 5.21e-7
left = "T_left_2"
right = "T_right"
"""
LAYERS = """
[[wall.layer]]
thickness = 0.4
conductivity = 1.5
heat_capacity = 2e6
[[wall.layer]]
thickness = 0.03
conductivity = 0.04
heat_capacity = 6e4
"""


@pytest.fixture
def folder(tmp_path):
    """A folder `house` with a record of three days and a learning file of one."""
    home = tmp_path / "house"
    home.mkdir()
    hours = np.arange(72)
    columns = {
        "T_left": 5 + np.sin(hours),
        "T_right": 20 + 0 * hours,
        "T1": 8 + 0 * hours,
        "T2": 16 + 0 * hours,
    }
    write(home / "record.csv", {"time": 3600 * hours, **columns, "sun": 0 * hours})
    rows = np.arange(48)
    columns = {"T_left_1": 20 + np.sin(rows), "T_left_2": 20 + np.cos(rows), "T_right": 20 + 0 * rows}
    write(home / "learning.csv", {"time": 1800 * rows, **columns})
    return home


def write(path, columns):
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    path.write_text("\n".join([",".join(columns), *(",".join(map(repr, row)) for row in rows)]) + "\n", "utf-8")


@pytest.fixture
def loads(folder):
    """Writes a text as case.toml, some of it replaced, and gives a call that loads it."""

    def prepare(text=TOML, *changes, extra=""):
        for old, new in changes:
            assert old in text
            text = text.replace(old, new, 1)
        (folder / "case.toml").write_text(text + extra, "utf-8")
        return lambda: load(folder)

    return prepare


# ------------------------------------------------------------------------------------ what is read


def test_a_case(loads, folder):
    case = loads()()
    assert (case.name, case.description, case.path) == ("house", "A wall", folder / "case.toml")
    assert (case.wall.length, case.wall.diffusivity_prior, case.wall.outside) == (0.43, 2.8e-7, "left")
    assert [(s.name, s.position, s.position_std, s.noise_std, s.offset_std) for s in case.sensors] == [
        ("T1", 0.05, 0.002, 0.05, 0.0),
        ("T2", 0.3, 0.0, 0.04, 0.0),
    ]
    assert (case.record.rows, case.record.names) == (72, ("T1", "T2"))
    assert list(case.record.regressors) == ["irradiance"]
    assert case.learning == ()


def test_defaults(loads):
    case = loads()()
    factors = tuple(factor * 2.8e-7 for factor in (0.25, 1.0, 4.0, 16.0))
    assert case.choices == Choices(window_days=1.0, learning_diffusivities=factors)
    assert (case.choices.order, case.choices.model, case.choices.nodes) == (10, "mim", 101)
    assert (case.choices.initial_profile, case.choices.eta, case.choices.seed) == (2, 1e-10, 0)
    assert (case.record.boundary_noise_std, case.record.flux_noise_std, case.record.flux_gain_std) == (
        0.04,
        None,
        None,
    )


def test_everything_stated(loads):
    choices = {
        "order": '"auto"',
        "learning_diffusivities": "[1e-7, 1e-6]",
        "model": '"lom"',
        "nodes": 75,
        "initial_profile": 0,
        "initial_coefficients": "[20, -1.5]",
        "eta": "1e-14",
        "seed": 3,
        "diagnose_days": 2,
        "max_iterations": 7,
        "largest_interval_factor": 2,
    }
    extra = "\n".join(f"{key} = {value}" for key, value in choices.items())
    noise = "boundary_noise_std = 0.2\nflux_noise_std = 0.5\nflux_gain_std = 0.05\n"
    text = TOML.replace('description = "A wall"', '[case]\nname = "North"\ndescription = "Cold"')
    case = loads(text, ("[[sensor]]", f"{noise}[[sensor]]"), extra=extra)()
    assert case.choices == Choices(1.0, "auto", (1e-7, 1e-6), "lom", 75, 0, (20.0, -1.5), 1e-14, 3, 2.0, 7, 2.0)
    record = case.record
    assert (record.boundary_noise_std, record.flux_noise_std, record.flux_gain_std) == (0.2, 0.5, 0.05)
    assert (case.name, case.description) == ("North", "Cold")


def test_a_case_by_its_file_has_the_name_of_the_file(loads, folder):
    loads()
    (folder / "case.toml").rename(folder / "north.toml")
    assert load(folder / "north.toml").name == "north"
    assert load(str(folder / "north.toml")).path == folder / "north.toml"


def test_a_byte_order_mark_is_ignored(loads, folder):
    call = loads()
    content = (folder / "case.toml").read_bytes()
    (folder / "case.toml").write_bytes(b"\xef\xbb\xbf" + content.replace(b"\n", b"\r\n"))
    assert call().name == "house"


def test_the_prior_may_be_left_out(loads):
    prior = "diffusivity_prior = 2.8e-7"
    case = loads(TOML, (prior, "conductivity = 1.5\nheat_capacity = 2e6"))()
    assert case.wall.diffusivity_prior == 1.5 / 2e6
    case = loads(TOML, (prior, LAYERS))()
    assert len(case.wall.layers) == 2
    assert case.wall.diffusivity_prior == pytest.approx(
        0.43**2 / ((0.4 / 1.5 + 0.03 / 0.04) * (0.4 * 2e6 + 0.03 * 6e4))
    )


def test_learning_signals(loads):
    one, two = loads(extra=LEARNING)().learning
    assert (one.diffusivity, two.diffusivity) == (2.03e-7, 5.21e-7)
    assert one.coefficients == two.coefficients == (20.0,)
    assert one.faces.shape == (48, 2)
    np.testing.assert_array_equal(one.time, 1800.0 * np.arange(48))
    np.testing.assert_allclose(two.faces[:, 0], 20 + np.cos(np.arange(48)))
    np.testing.assert_array_equal(one.faces[:, 1], two.faces[:, 1])


def test_flux_needs_no_sensor(loads):
    case = loads(FLUX)()
    assert (case.sensors, case.record.sensors.shape) == ((), (72, 0))
    assert (case.choices.initial_profile, case.record.boundary_noise_std) == (1, 0.1)
    assert "sensors   none" in str(case)


def test_a_window_as_long_as_the_record(loads, folder):
    assert loads(FLUX, extra="[choices]\nwindow_days = 3.0")().record.rows == 72
    rows = np.arange(2881)
    write(
        folder / "record.csv",
        {"time": 30 * rows, "T_left": 0.0 * rows, "T_right": 0.0 * rows, "sun": 0.0 * rows},
    )
    case = loads(FLUX, extra="[choices]\nwindow_days = 1.0")()
    assert case.record.rows_in_days(1.0) == 2880


def test_what_a_person_sees(loads):
    lines = str(loads()()).split("\n")
    assert lines[0] == "house: A wall"
    assert 7 <= len(lines) <= 10
    text = "\n".join(lines)
    for part in (
        "0.43 m, outside on the left, prior diffusivity 2.8e-07 m2/s",
        "T1 at 0.05 m, T2 at 0.3 m; noise 0.04 to 0.05 K, position +-0 to 2 mm",
        "72 rows, one every 3600 s",
        "windows of 1 d, model mim of order 10, 101 nodes",
    ):
        assert part in text


# --------------------------------------------------------------------------------- where cases are


def test_packaged_cases_load():
    assert {"validation", "validation_high_noise", "saint_julien"} <= set(packaged())
    for name in packaged():
        case = load(name)
        assert case.name == name
        assert case.description


def test_an_existing_path_goes_before_a_packaged_name(loads, folder, monkeypatch):
    loads()
    folder.rename(folder.parent / "validation")
    monkeypatch.chdir(folder.parent)
    assert load("validation").wall.length == 0.43
    assert load("validation").path == Path("validation/case.toml")


def test_an_unknown_name(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    refuses(lambda: load("saint_julian"), "saint_julian: ", *packaged(), 'did you mean "saint_julien"?')


def test_a_folder_without_a_case(tmp_path):
    refuses(lambda: load(tmp_path), "the folder holds no case.toml")


def test_a_package_without_examples(monkeypatch, tmp_path):
    monkeypatch.setattr(case_file, "_EXAMPLES", tmp_path)
    assert packaged() == ()


# ------------------------------------------------------------------------------------ what is refused


def test_broken_toml(loads):
    refuses(loads(TOML, ("length = 0.43", "length = ")), "case.toml: not valid TOML", "at line 4, column 10")


def test_a_file_that_is_not_utf8(loads, folder):
    call = loads()
    (folder / "case.toml").write_bytes(b'description = "\xb0C"')
    refuses(call, "case.toml: not UTF-8", "saved as UTF-8")


# what is replaced in the valid case, by what, and what the message must hold
WRONG = {
    "outside the wall": (
        "position = 0.3",
        "position = 0.5",
        '[[sensor]] 2 "T2": position = 0.5 m is not inside the wall; it must lie between 0 and length = 0.43',
    ),
    "on a face": ("position = 0.3", "position = 0.43", '[[sensor]] 2 "T2": position = 0.43 m is not inside'),
    "same place": (
        "position = 0.3",
        "position = 0.05",
        '[[sensor]] 2 "T2": position = 0.05 m is that of [[sensor]] 1; positions must differ',
    ),
    "same name": (
        'name = "T2"',
        'name = "T1"',
        '[[sensor]] 2 "T1": name is that of [[sensor]] 1; names must differ',
    ),
    "no noise": ("noise_std = 0.05\n", "", '[[sensor]] 1 "T1": noise_std is missing'),
    "no name": ('name = "T2"\n', "", "[[sensor]] 2: name is missing"),
    "number as name": ('name = "T2"', "name = 2", "[[sensor]] 2: name = 2; it must be a text"),
    "no position": ("position = 0.3\n", "", '[[sensor]] 2 "T2": position is missing'),
    "noise of zero": (
        "noise_std = 0.04",
        "noise_std = 0",
        "noise_std = 0; it must be a finite number above 0 (K)",
    ),
    "noise as truth": (
        "noise_std = 0.04",
        "noise_std = true",
        "noise_std = true; it must be a finite number above 0 (K)",
    ),
    "noise as text": (
        "noise_std = 0.04",
        'noise_std = "0.04"',
        'noise_std = "0.04"; it must be a finite number',
    ),
    "negative position_std": (
        "position_std = 0.002",
        "position_std = -1e-3",
        "position_std = -0.001; it must be a finite number at least 0 (m)",
    ),
    "negative offset_std": (
        "position_std = 0.002",
        "offset_std = -0.1",
        "offset_std = -0.1; it must be a finite number at least 0 (K)",
    ),
    "unknown sensor key": (
        "position_std",
        "positon_std",
        '[[sensor]] 1 "T1": unknown key "positon_std"; did you mean "position_std"?',
    ),
    "single brackets": (SENSOR_PART, "[sensor]\n", "write [[sensor]], with double brackets"),
    "no length": ("length = 0.43\n", "", "[wall]: length is missing"),
    "misspelt length": ("length =", "lenght =", '[wall]: unknown key "lenght"; did you mean "length"?'),
    "far-off key": ("length =", "zzz =", '[wall]: unknown key "zzz"; known are length, conductivity'),
    "text as length": (
        "length = 0.43",
        'length = "43 cm"',
        '[wall]: length = "43 cm"; it must be a finite number above 0 (m)',
    ),
    "no prior": (
        "diffusivity_prior = 2.8e-7",
        "",
        "[wall]: diffusivity_prior is missing; give it, or conductivity and heat_capacity, or layers",
    ),
    "prior of another unit": (
        "2.8e-7",
        "0.28",
        "[wall]: diffusivity_prior = 0.28; it must be a finite number at least 1e-09 and at most 0.001",
    ),
    "nan as prior": ("2.8e-7", "nan", "[wall]: diffusivity_prior = nan; it must be a finite number"),
    "north": (
        "length =",
        'outside = "north"\nlength =',
        '[wall]: outside = "north"; it must be "left" or "right"',
    ),
    "one layer as table": (
        "[record]",
        "[wall.layer]\nthickness = 0.43\n[record]",
        "write [[wall.layer]], with double brackets",
    ),
    "layers too thin": (
        "[record]",
        LAYERS.replace("0.4\n", "0.3\n") + "[record]",
        "[wall]: the layers' thicknesses sum to 0.33 m; they must sum to length = 0.43 m",
    ),
    "a layer's conductivity": (
        "[record]",
        LAYERS.replace("0.04", "-0.04") + "[record]",
        "[[wall.layer]] 2: conductivity = -0.04; it must be a finite number above 0 (W/m/K)",
    ),
    "a layer's key": (
        "[record]",
        LAYERS.replace("heat_capacity = 6e4", "") + "[record]",
        "[[wall.layer]] 2: heat_capacity is missing",
    ),
    "no wall": (WALL_PART, "", "wall is missing"),
    "wall as number": (WALL_PART, "wall = 3\n", "[wall]: found 3; it must be a table"),
    "no record": (RECORD_PART, "", "record is missing"),
    "unknown table": ("[choices]", "[choice]", 'unknown key "choice"; did you mean "choices"?'),
    "no file": ('file = "record.csv"\n', "", "[record]: file is missing"),
    "number as column": ('left = "T_left"', "left = 1", "[record]: left = 1; it must be a text"),
    "unknown regressor": (
        "irradiance",
        "iradiance",
        '[record]: unknown key "iradiance"; did you mean "irradiance"?',
    ),
    "face noise": (
        "irradiance",
        "boundary_noise_std = -1\nirradiance",
        "[record]: boundary_noise_std = -1; it must be a finite number at least 0 (K)",
    ),
    "flux noise": (
        "irradiance",
        "flux_noise_std = 0\nirradiance",
        "[record]: flux_noise_std = 0; it must be a finite number above 0 (W/m2)",
    ),
    "flux gain": (
        "irradiance",
        "flux_gain_std = true\nirradiance",
        "[record]: flux_gain_std = true; it must be a finite number at least 0",
    ),
    "empty description": ('"A wall"', '""', 'description = ""; it must be a text'),
    "unknown case key": (
        "[wall]",
        '[case]\ntitle = "x"\n[wall]',
        '[case]: unknown key "title"; known are name, description',
    ),
    "case name": ("[wall]", "[case]\nname = 3\n[wall]", "[case]: name = 3; it must be a text"),
}


@pytest.mark.parametrize("kind", WRONG)
def test_a_wrong_field(loads, kind):
    old, new, message = WRONG[kind]
    refuses(loads(TOML, (old, new)), f"case.toml: {message}" if message[0] == "[" else "case.toml: ", message)


# a line of [choices], and what the message must hold
WRONG_CHOICES = {
    "window_days = 0": "window_days = 0; it must be a finite number above 0",
    'window_days = "3"': 'window_days = "3"; it must be a finite number',
    "window_days = 1e300": "window_days = 1e+300; it must be a finite number above 0 and at most 100000",
    "window_days = 0.25": "window_days = 0.25 makes 6 rows of 3600 s; it must make at least 8",
    "window_days = 3.1": "window_days = 3.1 is longer than the record of 72 rows of 3600 s; "
    "it must be at most 3 (days)",
    "diagnose_days = 4": "diagnose_days = 4 is longer than the record of 72 rows of 3600 s",
    "diagnose_days = -1": "diagnose_days = -1; it must be a finite number above 0",
    "order = 0": 'order = 0; it must be a whole number from 1 to 60 or "auto"',
    "order = 61": "order = 61; it must be a whole number from 1 to 60",
    "order = 10.0": "order = 10.0; it must be a whole number",
    "order = true": "order = true; it must be a whole number",
    'order = "automatic"': 'order = "automatic"; it must be a whole number from 1 to 60 or "auto"',
    "nodes = 11": "order = 10; it must be less than nodes - 1 = 10",
    "nodes = 4": "nodes = 4; it must be a whole number from 5 to 5000",
    "nodes = 5001": "nodes = 5001; it must be a whole number from 5 to 5000",
    'model = "rom"': 'model = "rom"; it must be "mim" or "lom"',
    "initial_profile = 3": "initial_profile = 3; it must be a whole number from 0 to 2",
    "initial_coefficients = []": "initial_coefficients = []; it must be a list of at least 1 number",
    "initial_coefficients = 20.0": "initial_coefficients = 20.0; it must be a list of numbers",
    'initial_coefficients = [20, "1"]': 'value 2 of initial_coefficients = "1"; it must be a finite number',
    "eta = 0": "eta = 0; it must be a finite number above 0",
    "seed = -1": "seed = -1; it must be a whole number of at least 0",
    "max_iterations = 0": "max_iterations = 0; it must be a whole number of at least 1",
    "largest_interval_factor = 1": "largest_interval_factor = 1; it must be a finite number above 1",
    "learning_diffusivities = [1e-7]": "learning_diffusivities = [1e-07]; it must be a list of at least 2",
    "learning_diffusivities = [1e-7, 1e-7]": "learning_diffusivities = [1e-07, 1e-07]; at least 2",
    "learning_diffusivities = [1e-7, -1]": "value 2 of learning_diffusivities = -1; it must be a finite",
    "windows_days = 1": 'unknown key "windows_days"; did you mean "window_days"?',
}


@pytest.mark.parametrize("line", WRONG_CHOICES)
def test_a_wrong_choice(loads, line):
    refuses(loads(TOML, ("window_days = 1.0", line)), f"case.toml: [choices]: {WRONG_CHOICES[line]}")


def test_a_profile_that_faces_and_sensors_cannot_give(loads):
    choices = "[choices]\ninitial_profile = 2"
    refuses(loads(FLUX, extra=choices), "[choices]: initial_profile = 2; it must be below", "2")


def test_a_large_model_as_small_as_its_default_order_is_no_matter_without_a_reduced_one(loads):
    assert loads(TOML, ("window_days = 1.0", 'nodes = 9\nmodel = "lom"'))().choices.nodes == 9


def test_no_sensor_and_no_flux(loads):
    refuses(
        loads(FLUX.replace("flux_left", "wind")),
        "case.toml: no [[sensor]] and no flux",
        "at least one sensor",
    )


# what is replaced in the learning table, by what, and what the message must hold
WRONG_LEARNING = {
    "no file": ('file = "learning.csv"\n', "", "[learning]: file is missing"),
    "another file": ('"learning.csv"', '"other.csv"', "other.csv: cannot be read"),
    "no signal": (LEARNING[LEARNING.index("[[") :], "", "[learning]: signal is missing"),
    "single brackets": (
        LEARNING[LEARNING.index("[[") :],
        "[learning.signal]",
        "write [[learning.signal]], with double brackets",
    ),
    "no coefficients": ("initial_coefficients = [20.0]", "", "[learning]: initial_coefficients is missing"),
    "wrong coefficients": (
        "[20.0]",
        "[true]",
        "[learning]: value 1 of initial_coefficients = true; it must be a finite number (degC)",
    ),
    "diffusivity": (
        "5.21e-7",
        "0.0",
        "[[learning.signal]] 2: diffusivity = 0.0; it must be a finite number above 0 (m2/s)",
    ),
    "no column": ('left = "T_left_2"\n', "", "[[learning.signal]] 2: left is missing"),
    "unknown key": (
        'left = "T_left_2"',
        'Left = "T_left_2"',
        '[[learning.signal]] 2: unknown key "Left"; did you mean "left"?',
    ),
    "number as column": ('"T_left_2"', "2", "[[learning.signal]] 2: left = 2; it must be a text"),
    "another column": (
        '"T_left_2"',
        '"T_left_3"',
        'learning.csv: no column "T_left_3"; the columns are time, T_left_1',
    ),
}


@pytest.mark.parametrize("kind", WRONG_LEARNING)
def test_a_wrong_learning_table(loads, kind):
    old, new, message = WRONG_LEARNING[kind]
    refuses(loads(TOML + LEARNING, (old, new)), message)


def test_learning_faces_are_complete_and_regular(loads, folder):
    call = loads(extra=LEARNING)
    text = (folder / "learning.csv").read_text("utf-8")
    (folder / "learning.csv").write_text(text.replace("\n3600,", "\n3700,"), "utf-8")
    refuses(call, 'learning.csv: line 4, column "time": ', "the usual one 1800 s", "uniform step")
    (folder / "learning.csv").write_text(text.replace("20.0,", ",").replace("21.0,", ",", 1), "utf-8")
    refuses(call, "learning.csv: line 2, column ", "the cell is empty")


def test_what_is_wrong_in_the_record_is_told_with_its_own_name(loads, folder):
    call = loads()
    text = (folder / "record.csv").read_text("utf-8")
    (folder / "record.csv").write_text(text.replace("T1", "t1"), "utf-8")
    message = refuses(call, f'{folder / "record.csv"}: no column "T1"', 'did you mean "t1"?')
    assert "case.toml" not in message
    refuses(loads(TOML, ('"record.csv"', '"records.csv"')), f"{folder / 'records.csv'}: cannot be read")


# ------------------------------------------------------------------------------------- in Python


def test_parts_made_in_python_are_checked_too(loads):
    case = loads()()
    with_order = replace(case, choices=replace(case.choices, order=5))
    assert (with_order.choices.order, with_order.record) == (5, case.record)
    refuses(
        lambda: replace(case, sensors=case.sensors[:1]),
        "the record's sensors are T1, T2",
        "must be the case's, T1",
    )
    refuses(lambda: replace(case, wall=replace(case.wall, length=0.2)), '[[sensor]] 2 "T2": position = 0.3 m')
    refuses(lambda: replace(case, choices=Choices(window_days=30)), "[choices]: window_days = 30 is longer")
    refuses(lambda: LearningSignal(-1e-7, np.arange(3.0), np.zeros((3, 2)), (20.0,)), "diffusivity = -1e-07")
    plain = Case("name", case.path, case.wall, case.sensors, case.record, Choices(1.0))
    assert plain.choices.learning_diffusivities == case.choices.learning_diffusivities


def test_choices_take_arrays():
    choices = Choices(learning_diffusivities=np.array([1e-7, 1e-6]), order=np.int64(5))
    assert choices == Choices(learning_diffusivities=(1e-7, 1e-6), order=5)


# --------------------------------------------------------------------------------- from a DataFrame

ROLES = {"left": "T_left", "right": "T_right", "time": "time", "regressors": {"irradiance": "sun"}}
SENSORS = (Sensor("T1", 0.05, position_std=0.002, noise_std=0.05), Sensor("T2", 0.3, noise_std=0.04))


def test_a_dataframe_and_its_file_give_the_same_case(loads, folder):
    noise = "boundary_noise_std = 0.2\nface_position_std = 0.001\nlongest_gap = 2.0\n"
    text = (folder / "record.csv").read_text("utf-8").replace("8,16,", ",16,", 1).replace("\n3600,", "\n3700,")
    (folder / "record.csv").write_text(text, "utf-8")
    case = loads(TOML, ("[[sensor]]", f"{noise}[[sensor]]"))()
    data = pd.read_csv(folder / "record.csv")
    options = {"boundary_noise_std": 0.2, "face_position_std": 0.001, "longest_gap": 2.0, "window_days": 1.0}
    same = Case.from_dataframe(data, wall=case.wall, sensors=SENSORS, **ROLES, **options)
    assert (same.wall, same.sensors, same.choices) == (case.wall, case.sensors, case.choices)
    for field in fields(case.record):
        one, other = getattr(case.record, field.name), getattr(same.record, field.name)
        if field.name == "regressors":
            np.testing.assert_array_equal(one["irradiance"], other["irradiance"])
        elif field.name == "cleaning":
            assert (one.steps, one.breaks) == (other.steps, other.breaks)
        elif field.name != "file":
            np.testing.assert_array_equal(one, other)
    assert (same.record.file, same.name, same.path) == ("DataFrame", "DataFrame", Path("DataFrame"))


def test_times_of_a_dataframe(folder):
    data = pd.read_csv(folder / "record.csv")
    few = {"left": "T_left", "right": "T_right", "length": 0.43, "diffusivity_prior": 2.8e-7, "window_days": 1.0}
    few |= {"sensors": {"T1": 0.05}, "noise_std": 0.05}
    seconds = Case.from_dataframe(data, time="time", **few)
    assert seconds.sensors == (Sensor("T1", 0.05, noise_std=0.05),)
    since = pd.to_timedelta(data["time"], unit="s")
    for index, first in (
        (pd.Timestamp("2020-01-01") + since, "2020-01-01T00:00:00"),
        (pd.Timestamp("2020-01-01", tz="Europe/Berlin") + since, "2020-01-01T00:00:00+01:00"),
        (since, 0.0),
    ):
        case = Case.from_dataframe(data.set_index(pd.Index(index, name="T1")), **few)
        assert case.record.stamp(0) == first
        np.testing.assert_array_equal(case.record.time, seconds.record.time)
        np.testing.assert_array_equal(case.record.faces, seconds.record.faces)
    nullable = data.convert_dtypes()
    nullable.loc[3, "T1"] = pd.NA
    assert np.flatnonzero(np.isnan(Case.from_dataframe(nullable, time="time", **few).record.sensors)).tolist() == [3]


# arguments in place of valid ones, and what the message must hold
WRONG_ARGUMENTS = {
    "no length": ({"length": None}, "[wall]: length is missing"),
    "text as length": ({"length": "43 cm"}, '[wall]: length = "43 cm"; it must be a finite number above 0 (m)'),
    "wall and length": ({"wall": Wall(0.43, 2.8e-7)}, "length and diffusivity_prior must then be left out"),
    "no noise": ({"noise_std": None}, '[[sensor]] 1 "T1": noise_std is missing'),
    "noise and sensors": ({"sensors": SENSORS}, "each Sensor has its own"),
    "outside the wall": ({"sensors": {"T1": 0.5}}, '[[sensor]] 1 "T1": position = 0.5 m is not inside the wall'),
    "no such sensor": ({"sensors": {"T3": 0.3}}, 'DataFrame: no column "T3"; the columns are time, T_left'),
    "no such face": ({"left": "T_lft"}, 'DataFrame: no column "T_lft"', 'did you mean "T_left"?'),
    "number as column": ({"left": 1}, "[record]: left = 1; it must be a text"),
    "twice": ({"right": "T_left"}, 'DataFrame: column "T_left" is used 2 times'),
    "unknown regressor": ({"regressors": {"iradiance": "sun"}}, '[record]: unknown key "iradiance"; did you mean'),
    "unknown option": ({"windows_days": 1}, 'unknown option "windows_days"; did you mean "window_days"?'),
    "option of the record": ({"flux_noise": 1}, 'unknown option "flux_noise"; did you mean "flux_noise_std"?'),
    "no such option": ({"xyz": 1}, 'unknown option "xyz"; known are ', "longest_gap", "window_days"),
    "window": ({"window_days": 30}, "[choices]: window_days = 30 is longer than the record"),
    "face noise": ({"boundary_noise_std": -1}, "[record]: boundary_noise_std = -1; it must be a finite number"),
    "unit": ({"unit": "C"}, '[record]: unit = "C"; it must be "degC" or "degF" or "K"'),
    "index of rows": ({"time": None}, "DataFrame: the index holds no times; state their column"),
    "nothing measured": ({"sensors": {}}, "no [[sensor]] and no flux"),
    "a path": ({"data": "record.csv"}, 'DataFrame: data = "record.csv"; it must be a pandas DataFrame'),
}


@pytest.mark.parametrize("kind", WRONG_ARGUMENTS)
def test_a_wrong_argument(folder, kind):
    changes, *messages = WRONG_ARGUMENTS[kind]
    valid = {"data": pd.read_csv(folder / "record.csv"), "length": 0.43, "diffusivity_prior": 2.8e-7, "noise_std": 0.05}
    valid |= {"sensors": {"T1": 0.05, "T2": 0.3}, "window_days": 1.0, **ROLES}
    assert Case.from_dataframe(**valid).record.rows == 72
    refuses(lambda: Case.from_dataframe(**{**valid, **changes}), *messages)


def test_a_wrong_cell_of_a_dataframe(folder):
    data = pd.read_csv(folder / "record.csv", dtype={"time": str})
    data.loc[2, "time"] = "noon"
    refuses(
        lambda: Case.from_dataframe(data, length=0.43, diffusivity_prior=2.8e-7, sensors=SENSORS, **ROLES),
        'DataFrame: line 4, column "time": found "noon"; it must be a number of seconds',
    )


# ---------------------------------------------------------------------------------- measured records


def test_the_london_wall(measured, tmp_path):
    (tmp_path / "case.toml").write_text(
        f"""
        [wall]
        length = 0.4
        diffusivity_prior = 5e-7
        outside = "right"
        [record]
        file = '{(measured / "london_wall" / "owall.csv").resolve()}'
        time = "time"
        left = "T_int"
        right = "T_ext"
        flux_left = "Q_in"
        flux_right = "Q_out"
        flux_noise_std = 0.5
        """,
        "utf-8",
    )
    case = load(tmp_path)
    assert (case.sensors, case.record.rows, case.record.step) == ((), 864, 300.0)
    assert list(case.record.regressors) == ["flux_left", "flux_right"]
    assert case.record.rows_in_days(case.choices.window_days) == 864
    assert case.choices.initial_profile == 1


def test_the_manual_shows_every_choice_with_its_default():
    manual = (Path(__file__).parents[2] / "docs" / "how-to" / "case-file.md").read_text(encoding="utf-8")
    block = next(part for part in manual.split("```") if part.startswith("toml") and "[choices]" in part)
    shown = tomllib.loads(block.removeprefix("toml"))["choices"]
    defaults = {field.name: field.default for field in fields(Choices)}
    optional = {name for name in defaults if f"# {name} = " in block}
    assert set(shown) | optional == set(defaults)
    by_record = {"noise", "disturbance"}  # None stands for what the manual shows where there is no flux
    assert {name: value for name, value in shown.items() if name not in by_record} == {
        name: defaults[name] for name in set(shown) - by_record
    }
    assert all(defaults[name] is None for name in by_record)
