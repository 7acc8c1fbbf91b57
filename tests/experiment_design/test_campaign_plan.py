"""The plan of a campaign: the typical year against exact solutions, expected errors against simulated estimates."""

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pvlib
import pytest
from own_case import write_own
from typer.testing import CliRunner

import wallid
from wallid._internal.number_formats import counted, date_of
from wallid._internal.progress import no_progress
from wallid.case.options import Choices
from wallid.case.planned_campaign import CampaignSettings
from wallid.case.wizard_plan import PlanAnswers, new_plan, parse_azimuth, parse_indoor
from wallid.cli.commands import app
from wallid.experiment_design.campaign_plan import typical_case as typical
from wallid.experiment_design.campaign_plan.expected_intervals import (
    EQUAL_CHANCES,
    Instruments,
    TypicalYear,
    chance_of_uninformative,
    half_width,
)
from wallid.experiment_design.campaign_plan.plan_result import Curve
from wallid.experiment_design.campaign_plan.plan_search import PlanSearch, plan_campaign
from wallid.records.weather_year import HOURS, WeatherYear, read_weather_year

TMY3 = Path(pvlib.__file__).parent / "data" / "723170TYA.CSV"
CASE = """
[wall]
length = 0.3
diffusivity_prior = 5e-7
outside = "left"

[plan]
weather = "weather.csv"
azimuth = 180
sensors = 2
plates = ["right"]
days = 14
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("plan")
    shutil.copy(TMY3, path / "weather.csv")
    (path / "case.toml").write_text(CASE)
    return path


@pytest.fixture(scope="module")
def found(folder):
    return wallid.plan(wallid.load_campaign(folder))


def constant_weather(air):
    zeros = np.zeros(HOURS)
    return WeatherYear(np.broadcast_to(air, HOURS).astype(float), zeros, zeros, zeros, zeros, 50.0, 10.0, 1.0, "none")


def test_weather_of_a_tmy3_file():
    weather = read_weather_year(TMY3)
    assert weather.latitude == pytest.approx(36.1) and weather.utc_offset == -5
    south, north = (weather.irradiance_on(azimuth, 90.0).reshape(365, 24) for azimuth in (180.0, 0.0))
    winter = slice(0, 60)
    assert south[winter, 12].mean() > 3 * north[winter, 12].mean() and south[:, 0].max() == 0.0
    east, west = (weather.irradiance_on(azimuth, 90.0).reshape(365, 24) for azimuth in (90.0, 270.0))
    assert east[:, 8].mean() > 2 * west[:, 8].mean() and west[:, 16].mean() > 2 * east[:, 16].mean()
    assert np.allclose(weather.irradiance_on(0.0, 0.0), weather.global_horizontal, atol=60.0)  # a horizontal plane


def test_files_that_are_no_weather(tmp_path):
    for name, content, words in (
        ("none.epw", None, "there is no such file"),
        ("short.csv", "a,b\n1,2\n", "cannot be read as TMY3"),
        ("short.epw", "a,b\n1,2\n", "cannot be read as EPW"),
    ):
        if content is not None:
            (tmp_path / name).write_text(content)
        with pytest.raises(wallid.InputError, match=words):
            read_weather_year(tmp_path / name)


def an_epw(path, leap=False, missing=False):
    """A file of a typical year: ten times the air's temperature is the day of the year, the sun is that of noon."""
    year = 2024 if leap else 2023
    first = np.datetime64(f"{year}-01-01T00")
    hours = first + np.arange(8784 if leap else HOURS) * np.timedelta64(1, "h")
    lines = ["LOCATION,Town,-,AUT,-,110350,48.2,16.4,1.0,200.0"] + [f"HEADER {k}" for k in range(7)]
    for k, one in enumerate(hours):
        month, day, hour = (int(part) for part in (str(one)[5:7], str(one)[8:10], str(one)[11:13]))
        air = 99.9 if missing and k == 30 else (k // 24) / 10.0
        noon = 400 if hour == 11 else 0
        lines.append(f"{year},{month},{day},{hour + 1},60,x,{air},5,60,100000,0,0,300,{noon},{noon},0" + ",0" * 19)
    path.write_text("\n".join(lines))
    return path


def test_weather_of_an_epw_file(tmp_path):
    """A leap day is left out; the codes of missing values are no weather."""
    weather, leap = (read_weather_year(an_epw(tmp_path / f"{one}.epw", leap=one)) for one in (False, True))
    assert len(weather.air) == len(leap.air) == HOURS and weather.utc_offset == 1.0
    assert np.array_equal(leap.air[: 59 * 24], weather.air[: 59 * 24])
    assert leap.air[59 * 24] == pytest.approx(6.0) and weather.air[59 * 24] == pytest.approx(5.9)  # 1 March
    sun = weather.irradiance_on(180.0, 90.0).reshape(365, 24)
    assert (np.argmax(sun, axis=1) == 11).all() and 100 < sun.max() < 800
    with pytest.raises(wallid.InputError, match=r"temp_air is missing or impossible in 1 of 8760 hours, first 99.9"):
        read_weather_year(an_epw(tmp_path / "missing.epw", missing=True))


def test_steady_faces_are_those_of_resistances_in_series(folder):
    campaign = wallid.load_campaign(folder)
    wall = replace(campaign.wall, conductivity=0.8)
    campaign = replace(campaign, wall=wall, settings=replace(campaign.settings, indoor=20.0))
    case = typical.typical_case(campaign, constant_weather(0.0), 5e-7, [0.1], ["left", "right"])
    resistance = 0.3 / 0.8 + typical.R_INSIDE + typical.R_OUTSIDE
    flux = 20.0 / resistance
    days = case.record.faces[:HOURS].reshape(365, 24, 2).mean(axis=1)
    assert days == pytest.approx(
        np.tile([flux * typical.R_OUTSIDE, 20.0 - flux * typical.R_INSIDE], (365, 1)), abs=1e-3
    )
    for face in ("left", "right"):
        flux_of_hours = case.record.regressors[f"flux_{face}"][:HOURS]
        assert flux_of_hours.reshape(365, 24).mean(axis=1) == pytest.approx(-flux, abs=1e-2)
    assert case.record.sensors[:, 0].mean() == pytest.approx(flux * (typical.R_OUTSIDE + 0.1 / 0.8), abs=1e-3)


def test_a_daily_cycle_outdoors_is_damped_as_by_the_transmission_matrix(folder):
    """ISO 13786: films and slab as complex matrices."""
    campaign = wallid.load_campaign(folder)
    campaign = replace(campaign, wall=replace(campaign.wall, conductivity=0.8))
    hours = np.arange(HOURS)
    weather = constant_weather(10.0 + 8.0 * np.cos(2 * np.pi * hours / 24.0))
    # the room has a cycle of its own: the difference of two walls' faces is that of the outdoor cycle
    both = [
        typical.typical_case(campaign, one, 5e-7, [], ["right"]).record.faces
        for one in (weather, constant_weather(10.0))
    ]
    cycle = (both[0] - both[1])[-240:]
    omega = 2j * np.pi / 86400.0
    q = np.sqrt(omega / 5e-7) * 0.3
    slab = np.array([[np.cosh(q), -0.3 / 0.8 * np.sinh(q) / q], [-0.8 / 0.3 * q * np.sinh(q), np.cosh(q)]])
    film = [np.array([[1.0, -r], [0.0, 1.0]]) for r in (typical.R_OUTSIDE, typical.R_INSIDE)]
    whole = film[1] @ slab @ film[0]
    flux = -whole[0, 0] / whole[0, 1]  # at the outdoor air, with the indoor air constant
    surfaces = np.stack([film[0] @ [1.0, flux], slab @ film[0] @ [1.0, flux]])[:, 0]
    amplitude = np.exp(-2j * np.pi * hours[-240:] / 24.0) @ cycle * 2 / 240
    assert amplitude == pytest.approx(8.0 * surfaces, rel=0.02)


@pytest.mark.slow
def test_expected_errors_are_those_of_simulated_estimates(folder):
    """The scatter of estimates from simulated records, over their expected standard error."""
    campaign = wallid.load_campaign(folder)
    sensor = replace(campaign.sensor, position_std=0.001, offset_std=0.0)
    campaign = replace(campaign, sensor=sensor)
    weather = read_weather_year(TMY3)
    case = typical.typical_case(campaign, weather, 5e-7, [0.1, 0.2], [])
    start, days = 24 * 30, 4
    expected = TypicalYear(case, [start], days, 3600.0).errors(0, days, Instruments((0, 1))).diffusivity
    rng, scores = np.random.default_rng(1), []
    true = np.array([0.1, 0.2]) + 0.001 * rng.standard_normal((16, 2))
    exact = typical.typical_case(campaign, weather, 5e-7, true.ravel().tolist(), []).record.window(start, 24 * days)
    record, noise = case.record.window(start, 24 * days), case.sensors[0].noise_std
    for k in range(len(true)):
        faces = exact.faces + noise * rng.standard_normal(exact.faces.shape)
        sensors = exact.sensors[:, 2 * k : 2 * k + 2] + noise * rng.standard_normal((24 * days, 2))
        choices = replace(case.choices, window_days=float(days), model="lom")  # nothing to learn for each
        measured = replace(case, record=replace(record, faces=faces, sensors=sensors), choices=choices)
        fit = wallid.estimate(measured, wallid.Window(0, 24 * days))
        scores.append(np.log(fit.value / 5e-7) / expected)
    assert 0.6 < np.sqrt(np.mean(np.square(scores))) < 1.5  # 16 draws: 99 %


def test_less_noise_longer_and_more_sensors_give_smaller_errors(found):
    campaign = found.campaign
    case = typical.typical_case(campaign, read_weather_year(TMY3), 5e-7, [0.06, 0.15], ["right"])
    year = TypicalYear(case, [0, 24 * 90], 10.0, 1800.0)
    everything = Instruments((0, 1), (0,))
    assert year.errors(0, 10.0, everything).diffusivity <= year.errors(0, 5.0, everything).diffusivity
    alone = year.errors(0, 10.0, Instruments((0,)))
    assert year.errors(0, 10.0, everything).diffusivity <= alone.diffusivity
    assert alone.resistance == np.inf  # temperatures alone do not determine it
    precise = replace(case.sensors[0], noise_std=1e-3, position_std=0.0, offset_std=0.0)
    assert year.errors(0, 10.0, Instruments((0,)), precise).diffusivity < alone.diffusivity
    assert year.errors(0, 10.0, Instruments()).diffusivity == np.inf


def test_a_plan_says_how_to_instrument_the_wall(found):
    assert len(found.positions) + len(found.plates) > 0 and found.plates == ("right",)
    assert all(0 < position < 0.3 for position in found.positions)
    assert 1 <= found.start <= 365 and 3 <= found.days <= 14 and found.uninformative < 0.05
    assert set(found.expected) == {"diffusivity", "resistance", "transmittance", "capacity"}
    assert 0 < found.expected["transmittance"] < found.expected["resistance"]
    middle = found.season.errors[:, 2]
    assert middle[found.season.days.index(found.start)] == middle.min()
    assert found.season_ratio >= 1.0 and "interval" in found.season_sentence
    weathers, diffusivities = found.errors.diffusivity.shape  # from the first days within two weeks
    assert 3 <= weathers <= 5 and diffusivities == len(found.diffusivities)
    typical = np.median(found.errors.diffusivity, axis=0)
    assert found.expected["diffusivity"] == pytest.approx(half_width(np.median(typical)))
    assert found.season.errors[found.season.days.index(found.start)] == pytest.approx(typical)
    widths = [curve.median[-1] for curve in found.curves]
    assert [curve.sensors for curve in found.curves] == [0, 1, 2] and widths == sorted(widths, reverse=True)
    entries = found.to_dict()
    assert {"sensors", "plates", "columns", "step", "days", "start", "expected", "uninformative"} <= set(entries)
    assert json.loads(json.dumps(entries))["sensors"] == [{"position": one} for one in found.positions]
    assert "irradiance" not in found.columns or "solar gain of the left face" in found.columns["irradiance"]
    assert found.average_method_days.keys() == {"right"}
    text = found.summary()
    assert date_of(found.start) in text and "ISO 9869-1" in text and "+-" in text
    assert len(found.to_frame()) == sum(len(curve.days) for curve in found.curves)
    assert "<table>" in found._repr_html_()


def test_the_interval_of_a_plan_is_a_point_of_its_curves(found):
    """Each length is from its best first day on, beside the plates that are planned."""
    (curve,) = [one for one in found.curves if one.sensors == len(found.positions)]
    planned = curve.errors[curve.days.index(found.days)]
    assert planned == pytest.approx(np.median(found.errors.diffusivity, axis=0))
    best, worst = (
        half_width(found.season.median[found.season.days.index(found.start)]),
        half_width(found.season.median.max()),
    )
    assert found.season_ratio == pytest.approx(worst / best)


def test_a_campaign_may_go_past_the_end_of_the_year(folder):
    """A day of December is a neighbour of January, and a long campaign hides no season."""
    text = CASE.replace('plates = ["right"]\n', "").replace("sensors = 2", "sensors = 1")
    (folder / "long.toml").write_text(text.replace("days = 14", "days = 300"))
    search = PlanSearch(wallid.load_campaign(folder / "long.toml"), read_weather_year(TMY3), no_progress)
    assert search.starts[0] == 0 and search.starts[-1] > 24 * 355 and len(search.starts) == 53
    assert set(search.nearby(0)) == {0, 1, 2, 51, 52}
    record = search.years[0].case.record
    assert record.rows == HOURS + 300 * 24
    assert record.faces[HOURS : HOURS + 2000] == pytest.approx(record.faces[:2000], abs=1e-2)
    assert np.isfinite(search.years[2].errors(52, 300.0, Instruments((4,))).diffusivity)


@pytest.mark.slow
def test_a_heavy_unheated_wall_is_told_that_winter_tells_more(folder):
    """And by how much."""
    text = CASE.replace("length = 0.3", "length = 0.8").replace("azimuth = 180", 'azimuth = 225\nindoor = "unheated"')
    text = text.replace('plates = ["right"]\n', "").replace("sensors = 2", "sensors = 1")
    (folder / "heavy.toml").write_text(text)
    found = wallid.plan(wallid.load_campaign(folder / "heavy.toml"))
    assert found.start < 60 or found.start > 335, date_of(found.start)
    assert 150 < found.worst_start < 245, date_of(found.worst_start)
    assert 1.8 < found.season_ratio < 4.0
    for text in (date_of(found.start), date_of(found.worst_start), f"{found.season_ratio:.1f} times as wide"):
        assert text in found.season_sentence
    days, median = np.array(found.season.days), found.season.median
    january, august = (median[(first <= days) & (days < first + 31)] for first in (1, 213))
    assert np.median(august) > 1.5 * np.median(january)


def test_a_day_is_planned_whatever_the_windows_of_a_design_are(folder):
    """`window_days` is three by default, and may be less than a record of hours can have."""
    text = CASE.replace('plates = ["right"]\n', "").replace("sensors = 2", "sensors = 1")
    options = "[choices]\nwindow_days = 0.1\ndiagnose_days = 0.2\n"  # two rows of an hour, and five
    (folder / "short.toml").write_text(text.replace("days = 14", "days = 1") + options)
    found = wallid.plan(wallid.load_campaign(folder / "short.toml"))
    assert found.days == 1.0 and len(found.curves[0].days) == 1


def test_words_of_a_plan():
    assert (counted(0, "plate"), counted(1, "sensor"), counted(3, "sensor")) == ("no plate", "1 sensor", "3 sensors")
    assert (date_of(1), date_of(60), date_of(365)) == ("1 January", "1 March", "31 December")
    curve = Curve(1, (1.0, 3.0, 7.0, 30.0), np.array([[0.3], [0.1], [0.021], [0.02]]))
    assert curve.enough(1.1, 0.0) == 7.0 and curve.enough(1.1, 0.2) == 3.0 and curve.enough(1.0, 0.0) == 30.0
    assert half_width(np.inf) == np.inf and half_width(0.1) == pytest.approx(np.expm1(0.196))


def test_the_chance_of_an_uninformative_record():
    """Against random draws, for a standard error that grows as a power of the diffusivity, whose distance is exact."""
    x = 0.4 * np.array(EQUAL_CHANCES)
    alphas, flat = (5e-7 * np.exp(x)).tolist(), np.ones(5)

    def chance(*stds):
        return chance_of_uninformative(np.array(stds), alphas, 3.0)

    assert chance(0.02 * flat) == 0.0 and chance(2.0 * flat) == 1.0 == chance(np.inf * flat)
    assert chance(0.02 * flat, 2.0 * flat) == 0.5  # in the weather of every second year
    for std, expected in ((0.02, 0.0), (2.0, 1.0)):  # the diffusivity is known, or at a limit of the search
        assert chance_of_uninformative(np.full((1, 3), std), [5e-7] * 3, 3.0) == expected
    growth, at_prior, rng = 1.5, 0.15, np.random.default_rng(0)
    to_infinity = np.exp(-growth * x) / (growth * at_prior)  # standard errors from x to an infinite diffusivity
    best = to_infinity[:, None] - rng.standard_normal((5, 4000))
    reach = 1.96 * np.exp(0.15 * rng.standard_normal((5, 4000)))
    with np.errstate(invalid="ignore"):
        too_wide = ~(np.log((best + reach) / (best - reach)) / growth < np.log(3.0))  # NaN: no upper end
    assert chance(at_prior * np.exp(growth * x)) == pytest.approx(too_wide.mean(), abs=0.05)


def test_settings_that_cannot_be(folder):
    good = {"weather": "a.epw", "azimuth": 180.0}
    wrongs = {"azimuth": 400.0, "tilt": -1.0, "sensors": 0, "plates": "top", "days": 0.1, "uncertainty": 1.0}
    wrongs |= {"days": 366.0, "latitude": 100.0, "indoor": "warm"}
    for key, value in wrongs.items():
        wrong = {key: value}
        with pytest.raises(wallid.InputError, match=next(iter(wrong))):
            CampaignSettings(**(good | wrong))
    with pytest.raises(wallid.InputError, match='"unheated"'):
        CampaignSettings(**good, indoor="warm")
    assert CampaignSettings(**good, plates="left", sensors=0).plates == ("left",)
    with pytest.raises(wallid.InputError, match='plates = 1; it must be a list of "left", "right"'):
        CampaignSettings(**good, plates=1)
    with pytest.raises(wallid.InputError, match="free = 1; it must be a list"):
        Choices(free=1)
    (folder / "far.toml").write_text(CASE + '[[sensor]]\nname = "T1"\nposition = 7.0\nnoise_std = 0.05\n')
    with pytest.raises(wallid.InputError, match="not inside the wall"):
        wallid.load_campaign(folder / "far.toml")


def test_a_plan_beside_a_record(tmp_path):
    """The plan of another campaign at a wall with a record, with its sensors' noise."""
    shutil.copy(TMY3, tmp_path / "weather.csv")
    path = write_own(tmp_path)
    assert wallid.load(path).plan is None
    path.write_text(path.read_text() + '[plan]\nweather = "weather.csv"\nazimuth = 90\n')
    case, campaign = wallid.load(path), wallid.load_campaign(path)
    assert case.plan == campaign.settings and case.plan.azimuth == 90.0
    assert case.planned_campaign.weather_file == campaign.weather_file == tmp_path / "weather.csv"
    assert campaign.wall == case.wall and campaign.sensor.noise_std == case.sensors[0].noise_std == 0.1
    path.write_text(path.read_text() + "azimut = 90\n")
    with pytest.raises(wallid.InputError, match=r"\[plan\].*azimut"):
        wallid.load(path)


def test_other_commands_say_that_a_record_is_needed(folder):
    for command in ("run", "diagnose", "check"):
        result = CliRunner().invoke(app, [command, str(folder)])
        assert result.exit_code == 2 and "wallid plan" in result.output
    result = CliRunner().invoke(app, ["plan", "saint_julien"])
    assert result.exit_code == 2 and "has no [plan]" in result.output


def test_a_new_plan_by_questions(tmp_path):
    shutil.copy(TMY3, tmp_path / "weather.csv")
    asked = []

    def ask(question, default, parse):
        asked.append(question)
        answers = {"Length": "43 cm", "Where": "SW", "Temperature": "unheated", "plates": "1", "days": "10"}
        return parse(next((one for key, one in answers.items() if key in question), default))

    campaign = new_plan(tmp_path / "weather.csv", PlanAnswers(outside="right"), ask=ask)
    assert len(asked) == 6 and campaign.wall.length == 0.43 and campaign.wall.outside == "right"
    settings = campaign.settings
    assert (settings.azimuth, settings.indoor, settings.sensors, settings.plates, settings.days) == (
        225.0, "unheated", 2, ("left",), 10.0
    )  # fmt: skip
    with pytest.raises(wallid.InputError, match="exists"):
        new_plan(tmp_path / "weather.csv", ask=ask)
    with pytest.raises(wallid.InputError, match="5 heat flux plates"):
        answers = PlanAnswers(length=0.4, azimuth=180.0, plates=5)
        new_plan(tmp_path / "weather.csv", answers, to=tmp_path / "other.toml")
    with pytest.raises(wallid.InputError, match="--length and --azimuth"):
        new_plan(tmp_path / "weather.csv", to=tmp_path / "other.toml")
    assert (parse_azimuth("n"), parse_azimuth("12,5"), parse_indoor("-3")) == (0.0, 12.5, -3.0)
    assert parse_azimuth("0") == 0.0
    for parse, text in ((parse_azimuth, "up"), (parse_indoor, "warm")):
        with pytest.raises(wallid.InputError, match="must be a number"):
            parse(text)
    assert not os.path.exists(tmp_path / "other.toml")


def test_a_new_plan_by_options(tmp_path):
    shutil.copy(TMY3, tmp_path / "weather.csv")
    new = ["new", "--plan", str(tmp_path / "weather.csv"), "--length", "0.4", "--azimuth", "S"]
    result = CliRunner().invoke(app, [*new, "--sensors", "1", "--plates", "2", "--days", "9"])
    assert result.exit_code == 0, result.output
    settings = wallid.load_campaign(tmp_path).settings
    assert (settings.sensors, settings.plates, settings.days) == (1, ("left", "right"), 9.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--plan", "w.epw", "--noise", "0.1", "--sensor", "T1=0.1"], "--sensor, --noise: only without --plan"),
        (["a.csv", "--days", "9", "--indoor", "20"], "--indoor, --days: only with --plan"),
    ],
)
def test_new_refuses_options_that_it_would_not_use(options, message):
    result = CliRunner().invoke(app, ["new", *options])
    assert result.exit_code == 2 and message in result.output


def test_the_command_writes_the_plan(folder, tmp_path):
    result = CliRunner().invoke(app, ["plan", str(folder), "--out", str(tmp_path / "out"), "--format", "svg"])
    assert result.exit_code == 0, result.output
    entries = json.loads((tmp_path / "out" / "result.json").read_text())
    assert entries["plan"]["plates"] == ["right"] and entries["verdict"] is None
    assert sorted(entries["files"]) == sorted(path.name for path in (tmp_path / "out").iterdir())
    page = (tmp_path / "out" / "report.html").read_text()
    assert "What to do" in page and "plan of a campaign" in page and "<svg" not in page.split("</style>")[0]


def test_the_accuracy_of_the_case_has_the_interval_of_the_plan(folder):
    """At the stated standard deviations the tolerances have the error of the plan itself."""
    text = CASE.replace('plates = ["right"]\n', "").replace("sensors = 2", "sensors = 1")
    (folder / "inside.toml").write_text(text)
    found = plan_campaign(wallid.load_campaign(folder / "inside.toml"), read_weather_year(TMY3), no_progress)
    for one, stated in zip(found.tolerances, (0.002, 0.05), strict=True):
        expected = found.errors.typical[2].diffusivity
        assert one.errors[one.values.index(stated)] == pytest.approx(expected)
