"""The truth that `wallid.diagnose` is judged by, against closed solutions and balances; its scenarios and its score."""

import ast
import inspect
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.accuracy.discrepancy import scenarios, score
from benchmarks.accuracy.next_measurement import measured_again
from benchmarks.reference import simulator_with_effects as truth
from benchmarks.reference.simulator_with_effects import DAY, FINE_STEP, HOUR, Hidden, Spec
from benchmarks.reference.synthetic_twins import slab_response
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import simpson
from scipy.interpolate import CubicSpline
from scipy.special import ndtr

L, ALPHA = 0.3, 5e-7
X = np.array([0.04, 0.11, 0.17, 0.26])
OMEGA = 2 * np.pi / DAY


def wall(*effects, **changes):
    return replace(Spec(length=L, diffusivity=ALPHA), effects=effects, **changes)


def drive(left, right, days=4.0, **columns):
    """Faces as functions of time or constants."""
    time = np.arange(0.0, days * DAY + 1, FINE_STEP)

    def course(value):
        return value(time) if callable(value) else np.full(time.size, float(value))

    names = ("irradiance", "air_outdoor", "air_indoor", "neighbour")
    found = {name: course(columns.get(name, 0.0)) for name in names}
    return found | {"time": time, "left": course(left), "right": course(right), "hour": time / HOUR % 24}


# ------------------------------------------------------------------------------------------- the equation


def test_a_plain_wall_follows_the_analytic_slab():
    daily = drive(lambda t: np.sin(OMEGA * t) + 0.3 * np.sin(8 * OMEGA * t), 0)
    want, _ = slab_response(
        X, daily["time"], length=L, diffusivity=ALPHA, harmonics=[(OMEGA, 0, 1), (8 * OMEGA, 0, 0.3)]
    )
    assert_allclose(truth.temperatures(wall(), daily, X), want, atol=3e-4)


def test_the_adaptive_solver_gives_what_the_modes_give():
    effects = (
        ("layered_conductivity", None, {"log_ratio": 0.8, "interface": 0.12}),
        ("layered_capacity", None, {"log_ratio": -0.6, "interface": 0.12}),
        ("contact_resistance", None, {"thickness": 0.03, "place": 0.2}),
        ("surface_film", "right", {"film_length": 0.04}),
        ("air_flow", None, {"velocity": 4e-7}),
        ("lateral_loss", "outdoor", {"rate": 1e-6}),
        ("heat_source", None, {"rate": 2e-5, "place": 0.15, "hours": [22, 4]}),
    )
    faces = drive(lambda t: 5 * np.sin(OMEGA * t), lambda t: 20 + np.sin(3 * OMEGA * t), air_outdoor=3.0)
    modes = truth.temperatures(wall(*effects), faces, X)
    still = ("diffusivity_drift", None, {"rate": 1e-12})
    later = faces["time"] > 2 * DAY  # they start from different profiles
    assert_allclose(truth.temperatures(wall(*effects, still), faces, X)[later], modes[later], atol=2e-3)


def test_layers_a_joint_and_a_film_share_the_steady_drop():
    effects = (
        ("layered_conductivity", None, {"log_ratio": np.log(4.0), "interface": 0.1}),
        ("contact_resistance", None, {"thickness": 0.06, "place": 0.2}),
        ("surface_film", "left", {"film_length": 0.05}),
    )
    # resistances up to each point, with k = 1/2 left and 2 right of the interface
    up_to = 0.05 + np.where(X < 0.1, X / 0.5, 0.2 + (X - 0.1) / 2) + 0.06 * (X > 0.2)
    want = 10 * up_to / (0.05 + 0.2 + 0.1 + 0.06)
    assert_allclose(truth.temperatures(wall(*effects), drive(0, 10, 0.1), X)[-1], want, rtol=1e-9)
    assert truth.Slab(wall(*effects)).effective == pytest.approx(ALPHA * L**2 / ((0.2 + 0.1 + 0.06) * L))


def test_the_effective_diffusivity_counts_resistance_and_capacity():
    layered = wall(("layered_capacity", None, {"log_ratio": np.log(4.0), "interface": 0.1}))
    assert truth.Slab(layered).effective == pytest.approx(ALPHA * L / (0.1 / 2 + 0.2 * 2))


def test_layers_of_capacity_pass_a_slow_wave_as_the_equation_says():
    # a face that rises steadily: T = r (t - f(x)) with k f'' = -c, here c = 1/2 and 2 on halves
    rate = 1 / HOUR
    layered = wall(("layered_capacity", None, {"log_ratio": np.log(4.0), "interface": L / 2}))
    rising = drive(lambda t: rate * t, lambda t: rate * t, days=8)
    f = CubicSpline(np.linspace(0, L, 4001), np.where(np.linspace(0, L, 4001) < L / 2, 0.5, 2.0))
    bend = f.antiderivative(2)
    lag = (bend(L) * X / L - bend(X)) / ALPHA
    found = truth.temperatures(layered, rising, X)[-1]
    assert_allclose((rate * rising["time"][-1] - found) / rate, lag, rtol=2e-3)


def test_air_flow_bends_the_steady_profile_to_an_exponential():
    v = 6 * ALPHA / L
    found = truth.temperatures(wall(("air_flow", None, {"velocity": v})), drive(0, 10, 0.1), X)[-1]
    assert_allclose(found, 10 * np.expm1(v * X / ALPHA) / np.expm1(v * L / ALPHA), atol=3e-3)


def test_a_uniform_source_and_a_loss_have_their_steady_profiles():
    q, s = 1e-4, 2e-5
    source = wall(("heat_source", None, {"rate": q, "place": None, "hours": None}))
    assert_allclose(truth.temperatures(source, drive(0, 0, 0.1), X)[-1], q * X * (L - X) / (2 * ALPHA), rtol=1e-3)
    loss = wall(("lateral_loss", "indoor", {"rate": s}))
    m = np.sqrt(s / ALPHA)
    want = 10 * (1 - np.cosh(m * (X - L / 2)) / np.cosh(m * L / 2))
    assert_allclose(truth.temperatures(loss, drive(0, 0, 0.1, air_indoor=10), X)[-1], want, atol=2e-3)


def test_a_local_source_heats_as_much_as_its_profile_holds():
    # the flux out through both faces is what the Gaussian holds
    place, rate = 0.12, 1e-4
    local = wall(("heat_source", None, {"rate": rate, "place": place, "hours": None}))
    at = np.array([1e-3, L - 1e-3])
    found = truth.temperatures(local, drive(0, 0, 0.1), at)[-1]
    held = rate * np.sqrt(2 * np.pi) * L / 20 * (ndtr((L - place) / (L / 20)) - ndtr(-place / (L / 20)))
    assert ALPHA * (found / 1e-3).sum() == pytest.approx(held, rel=1e-3)


def test_conductivity_that_depends_on_temperature_is_steady_after_kirchhoff():
    slope, T0 = 0.03, 8.0
    bent = wall(("temperature_dependent_conductivity", None, {"slope": slope}))
    found = truth.temperatures(bent, drive(0, 20, 10), X, reference=T0)[-1]
    low, high = (T - T0 + slope / 2 * (T - T0) ** 2 for T in (0.0, 20.0))
    theta = low + (high - low) * X / L
    assert_allclose(found, T0 + (np.sqrt(1 + 2 * slope * theta) - 1) / slope, atol=2e-3)


@pytest.mark.parametrize("name", ["phase_change", "temperature_dependent_capacity"])
def test_enthalpy_is_conserved(name):
    parameters = {"area": 12.0, "temperature": 0.0} if name == "phase_change" else {"slope": 0.02}
    faces = drive(lambda t: -6 * np.sin(OMEGA * t), lambda t: 8 + 0 * t)
    time, field, slab = truth.adaptive(wall((name, None, parameters)), faces, reference=2.0)
    step = round(truth.COARSE_STEP / FINE_STEP)
    left, right = faces["left"][::step], faces["right"][::step]
    entering = slab.flux(np.column_stack([left, field, right]))[:, [0, -1]]
    if name == "phase_change":
        held = field + 12.0 * ndtr(field / truth.MELTING_WIDTH)
    else:
        held = field + 0.01 * (field - 2.0) ** 2
    gained = (held[-1] - held[0]) @ slab.width
    came = ALPHA * simpson(entering[:, 1] - entering[:, 0], x=time)
    passed = ALPHA * simpson(np.abs(entering).sum(axis=1), x=time)
    assert abs(gained - came) < 1e-4 * passed
    if name == "phase_change":
        assert np.ptp(np.sign(field), axis=0).max() == 2  # some of it froze


@pytest.mark.parametrize("name", ["diffusivity_drift", "wetting", "oscillating_diffusivity"])
def test_a_diffusivity_that_changes_is_another_pace_of_time(name):
    r, jump, memory, begin, amplitude = 0.1 / DAY, 0.5, 1.5 * DAY, 1.2 * DAY, 0.3
    parameters = {
        "diffusivity_drift": {"rate": r * DAY},
        "wetting": {"jump": jump, "time_constant": memory, "time": begin},
        "oscillating_diffusivity": {"amplitude": amplitude},
    }[name]

    def passed(t):
        if name == "diffusivity_drift":
            return t + r * t**2 / 2
        if name == "wetting":
            return t + jump * memory * -np.expm1(-np.maximum(t - begin, 0) / memory)
        turn = 2 * np.pi / truth.OSCILLATION
        return t + amplitude / turn * (1 - np.cos(turn * t))

    faces = drive(lambda t: 5 * np.sin(OMEGA * t), lambda t: 3 * np.sin(2 * OMEGA * t))
    found = truth.temperatures(wall((name, None, parameters)), faces, X)
    dense = np.linspace(0, 8 * DAY, 400001)
    pace = passed(dense)
    moment = np.arange(0, passed(faces["time"][-1]) + FINE_STEP, FINE_STEP)
    when = np.interp(moment, pace, dense)
    even = faces | {"time": moment, "left": 5 * np.sin(OMEGA * when), "right": 3 * np.sin(2 * OMEGA * when)}
    want = CubicSpline(moment, truth.temperatures(wall(), even, X))(passed(faces["time"]))
    read = slice(30, None, round(truth.COARSE_STEP / FINE_STEP))  # between, splines bridge the bend at the rain
    assert_allclose(found[read], want[read], atol=1e-3)


def test_a_corner_has_the_rectangles_steady_profile():
    y = 0.15
    corner = wall(("corner", None, {"distance": y}))
    found = truth.temperatures(corner, drive(0, 0, 10, neighbour=10), X)[-1]
    n = np.arange(1, 200, 2)[:, None]
    k = n * np.pi / L
    across = (np.exp(-k * y) + np.exp(-k * (6 * y - y))) / (1 + np.exp(-k * 6 * y))
    want = (40 / (n * np.pi) * np.sin(k * X) * across).sum(axis=0)
    assert_allclose(found, want, atol=0.02)


def test_hysteresis_vanishes_with_its_amplitude_and_opens_a_loop_with_it():
    faces = drive(lambda t: 5 * np.sin(OMEGA * t), 0)
    plain = truth.temperatures(wall(), faces, X)
    none = truth.temperatures(wall(("hysteresis", None, {"amplitude": 0.0, "play": 1.0})), faces, X)
    some = truth.temperatures(wall(("hysteresis", None, {"amplitude": 0.4, "play": 1.0})), faces, X)
    later = faces["time"] > 2 * DAY
    assert_allclose(none[later], plain[later], atol=3e-3)
    # a conductivity that only depended on the direction leaves a mean that a symmetric wave has not
    assert np.abs((some - plain)[later]).max() > 0.2


# ------------------------------------------------------------------------------------------- the sensors


def test_a_lag_answers_a_sine_as_one_pole_does():
    t = np.arange(0, 4 * DAY, FINE_STEP)
    tau = 3000.0
    want = (np.exp(1j * OMEGA * t) / (1 + 1j * OMEGA * tau)).imag
    found = truth._relax(np.sin(OMEGA * t), 1 / tau, FINE_STEP)
    assert_allclose(found[t > DAY], want[t > DAY], atol=1e-5)


@pytest.fixture(scope="module")
def calm():
    """A record's truth without any effect."""
    return truth.clean(wall(days=14.0, misplaced=False))


def hidden(*effects):
    return truth.clean(wall(*effects, days=14.0, misplaced=False))


def test_sensors_read_as_stated(calm):
    found = hidden(
        ("sensor_lag", "T1", {"time_constant": 1800.0}),
        ("sensor_drift", "T2", {"rate": 0.1}),
        ("sensor_offset", "T3", {"offset": 0.4}),
        ("face_offset", "right", {"offset": -0.3}),
        ("face_lag", "left", {"time_constant": 900.0}),
    )
    before, after, time = calm["courses"], found["courses"], calm["drive"]["time"]
    for name, tau in (("T1", 1800.0), ("left", 900.0)):
        slope = CubicSpline(time, after[name])(time, 1)
        assert_allclose((tau * slope + after[name])[999:], before[name][999:], atol=2e-3)
    assert_allclose(after["T2"] - before["T2"], 0.1 * time / DAY, atol=1e-12)
    assert_allclose(after["T3"] - before["T3"], 0.4, atol=1e-12)
    assert_allclose(after["right"] - before["right"], -0.3, atol=1e-12)


def test_a_clock_shift_holds_what_was_earlier(calm):
    found = hidden(("clock_shift", None, {"delay": 1200.0}))
    assert_allclose(found["courses"]["T2"][10:-1], calm["courses"]["T2"][:-11], atol=1e-9)
    assert_array_equal(found["courses"]["left"], calm["courses"]["left"])
    fast = hidden(("clock_shift", None, {"delay": -1200.0}))
    assert_allclose(fast["readings"][:, 2], calm["courses"]["T1"][calm["rows"] + 10], atol=1e-9)


def test_a_gain_turns_about_the_mean_of_all_readings(calm):
    found = hidden(("sensor_gain", "T1", {"gain": 0.1}))
    mean = calm["readings"].mean()
    assert_allclose(found["readings"][:, 2] - mean, 1.1 * (calm["readings"][:, 2] - mean), atol=1e-9)


def test_faces_read_inside_the_wall_and_miss_the_sun(calm):
    deep = hidden(("face_depth", "right", {"depth": 0.06}))
    assert_allclose(deep["courses"]["right"], calm["courses"]["T3"], atol=1e-9)
    assert_array_equal(deep["courses"]["T1"], calm["courses"]["T1"])
    sunny = hidden(("solar_gain", "left", {"gain": 0.01}))
    assert_array_equal(sunny["courses"]["left"], calm["courses"]["left"])
    faces = calm["drive"]["left"] + 0.01 * calm["drive"]["irradiance"]
    want = truth.temperatures(wall(), calm["drive"] | {"left": faces}, [0.06, 0.15, 0.24])
    assert_allclose(sunny["courses"]["T1"], want[:, 0], atol=1e-12)


def test_a_position_is_the_stated_one_and_its_shift():
    spec = wall(("sensor_position", "T2", {"shift": 0.02}))
    positions, offsets = truth.placed(spec)
    assert positions[1] == pytest.approx(0.17)
    assert 0 < abs(positions[0] - 0.06) < 0.01
    assert_array_equal(offsets, 0)


@pytest.mark.parametrize("blamed", ["sensor_position", "sensor_offset"])
def test_exchanged_sensors_take_their_own_errors_along_and_leave_those_of_places(blamed):
    sizes = {"sensor_position": {"shift": 0.02}, "sensor_offset": {"offset": 0.7}}
    before = wall(Hidden(blamed, "T1", sizes[blamed]), offset_std=0.1, days=14.0)
    after = measured_again(before, {"kind": "swap", "sensors": ["T1", "T3"]})
    places, offsets = truth.placed(before)
    assert_allclose(truth.placed(after)[0], places[[2, 1, 0]], rtol=0, atol=1e-12)
    assert_allclose(truth.placed(after)[1], offsets, rtol=0, atol=1e-12)
    assert after.effects[0].target == {"sensor_position": "T3", "sensor_offset": "T1"}[blamed]


# -------------------------------------------------------------------------------------------- the record


@pytest.mark.parametrize(
    "effects",
    [
        (),
        (("layered_conductivity", None, {"log_ratio": 0.8, "interface": 0.13}),),
        (("surface_film", "left", {"film_length": 0.03}), ("air_flow", None, {"velocity": 5e-7})),
        (("temperature_dependent_conductivity", None, {"slope": 0.01}),),
        (("phase_change", None, {"area": 8.0, "temperature": 4.0}),),
    ],
)
def test_finer_cells_and_tolerance_change_at_most_two_millikelvin(effects):
    spec = wall(*effects, days=5.0)
    usual, finer = truth.clean(spec), truth.clean(spec, cells=240, tolerance=1e-8)
    assert np.abs(usual["readings"] - finer["readings"]).max() < 2e-3


@pytest.mark.parametrize(("kind", "memory"), [("white", 0.0), ("ar06", 0.6), ("ar09", 0.9), ("mixed", 0.45)])
def test_noise_has_unit_variance_and_its_memory(kind, memory):
    course = truth.noise_course(kind, 200000, np.random.RandomState(1))
    assert course.var() == pytest.approx(1, abs=0.05)
    assert np.mean(course[1:] * course[:-1]) == pytest.approx(memory, abs=0.03)


def test_the_same_spec_gives_the_same_record():
    spec = wall(("clock_shift", None, {"delay": 600.0}), days=4.0, rounding=0.0625, offset_std=0.1)
    first = truth.simulate(spec)
    truth._weather.cache_clear()
    again = truth.simulate(spec)
    for name in ("time", "T_left", "T_right", "T1", "T2", "T3", "irradiance", "rain"):
        assert_array_equal(first[name], again[name])
    assert_allclose(first["T1"] / 0.0625, np.round(first["T1"] / 0.0625), atol=1e-9)
    other = truth.simulate(replace(spec, noise_seed=5))
    assert np.abs(other["T1"] - first["T1"]).max() > 0.05


def test_the_main_rain_begins_when_the_wall_is_wetted():
    begin = 2 * DAY
    spec = wall(("wetting", None, {"jump": 0.3, "time_constant": DAY, "time": begin}), days=5.0)
    record = truth.simulate(spec)
    first = int(begin / spec.step)
    assert record["rain"][first] >= 4 > record["rain"][first - 1]


def test_the_truth_owes_nothing_to_the_package():
    for module in (truth, scenarios):
        for node in ast.walk(ast.parse(inspect.getsource(module))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not any(name.split(".")[0] in ("wallid", "jax") for name in names)


def test_a_case_loads_and_does_not_tell(tmp_path):
    import wallid

    spec = wall(("contact_resistance", None, {"thickness": 0.03, "place": 0.2}), days=3.0)
    record = truth.write_case(spec, tmp_path)
    case = wallid.load(tmp_path)
    assert case.record.rows == spec.rows
    assert 0.49 < case.wall.diffusivity_prior / record["truth"]["diffusivity"] < 2.01
    assert_allclose(case.record.sensors[:, 1], record["T2"], atol=1e-9)
    assert set(case.record.regressors) == {"irradiance", "air_outdoor", "air_indoor", "rain", "heating"}
    text = (tmp_path / "case.toml").read_text()
    assert not any(name in text for name in (*truth.EFFECTS, "0.03\n", "thickness"))


def test_what_is_impossible_is_refused():
    with pytest.raises(ValueError, match="step"):
        Spec(step=1000.0)
    with pytest.raises(ValueError, match="unknown effect"):
        Spec(effects=(("ghost", None, {}),))
    with pytest.raises(ValueError, match="corner"):
        wall(("corner", None, {"distance": 0.1}), ("air_flow", None, {"velocity": 1e-7}))


# ------------------------------------------------------------------------------------------ the scenarios


def families(seed):
    specs = [spec for noise in scenarios.NOISES for spec in scenarios.nulls(noise, 20, seed)]
    specs += [spec for name in truth.EFFECTS for spec in scenarios.singles(name, 20, seed)]
    return specs + scenarios.pairs(60, seed) + scenarios.outside(60, seed)


def test_scoring_shares_no_weather_and_no_noise_with_tuning():
    seeds = []
    for group in (scenarios.TUNING, scenarios.SCORING):
        for seed in (group[0], group[1], group[-1]):
            specs = families(seed)
            assert all(spec.weather_seed == spec.noise_seed for spec in specs)
            seeds += [spec.noise_seed for spec in specs]
    assert len(set(seeds)) == len(seeds)
    assert max(seeds) < 2**32
    assert not set(scenarios.TUNING) & set(scenarios.SCORING)
    # a record's number does not depend on how many are drawn
    assert scenarios.pairs(3, 1) == scenarios.pairs(5, 1)[:3]


def test_drawn_records_are_possible():
    for spec in families(scenarios.TUNING[2]):
        places = np.array(spec.positions)
        assert np.all(np.diff(places) > 0.01)
        assert places[0] > 0.01
        assert places[-1] < spec.length - 0.01
        for name, target, p in spec.effects:
            assert set(p) >= ({scenarios._SIZES[name]} if name in scenarios._SIZES else set())
            assert target in (None, "left", "right", "outdoor", "indoor", *spec.names)
            for key in ("place", "interface"):
                if p.get(key) is not None:
                    assert 0 < p[key] < spec.length


@pytest.mark.parametrize("name", ["sensor_position", "solar_gain", "layered_conductivity", "air_flow", "heat_source"])
def test_an_effects_derivative_is_that_of_the_truth(name):
    spec = next(s for s in scenarios.singles(name, 20, 2) if s.days == 30.0)
    (effect,) = spec.effects
    size = scenarios._SIZES[name]
    small = effect._replace(parameters=effect.parameters | {size: 0.05 * effect.parameters[size]})
    judge = scenarios._Judge(replace(spec, effects=(small,)))
    column = judge.column(*small)
    column = column - judge.basis @ (judge.basis.T @ column)
    gap = judge.gap - judge.basis @ (judge.basis.T @ judge.gap)
    fitted = column @ gap / (column @ column)
    assert fitted == pytest.approx(small.parameters[size], rel=0.05)
    assert ((gap - fitted * column) ** 2).sum() < 0.02 * (gap**2).sum()


@pytest.mark.parametrize("noise", ["white", "ar09"])
def test_whitened_noise_is_white(noise):
    spec = wall(days=14.0, step=600.0, noise=noise, rounding=0.0, misplaced=False, boundary_noise_std=0.1)
    judge = scenarios._Judge(spec)
    record = truth.simulate(spec)
    drive, time = judge.known["drive"], judge.known["drive"]["time"]
    row_times = time[judge.known["rows"]]
    noisy = dict(drive)
    for side in ("left", "right"):
        error = record[f"T_{side}"] - judge.known["readings"][:, 0 if side == "left" else 1]
        noisy[side] = drive[side] + np.where(time < 0, 0, np.interp(time, row_times, error))
    model = truth.temperatures(replace(spec, effects=()), noisy, spec.positions)[judge.known["rows"]]
    rest = judge.white(np.stack([record[name] for name in spec.names], axis=1) - model)
    rest = rest - judge.basis @ (judge.basis.T @ rest)
    assert (rest**2).sum() / (rest.size - 30) == pytest.approx(1, abs=0.12)


def test_what_cannot_be_told_apart_is_known():
    spec = wall(("sensor_lag", "T2", {"time_constant": 2400.0}), days=14.0, step=600.0)
    best = scenarios.identifiability(spec)
    assert best["free"] > 1000
    assert best["rivals"] > 400
    # the offset of a face and a constant source through the middle are much the same
    offset = wall(("face_offset", "left", {"offset": 0.1}), days=14.0, step=600.0)
    best = scenarios.identifiability(offset)
    assert best["rivals"] < 0.3 * best["free"]
    assert best["each"][0]["name"] == "face_offset"
    assert scenarios.identifiability(wall())["free"] == 0


# ---------------------------------------------------------------------------------------------- the score


def line(family, kind, hidden, verdict, effects, best=1000.0, **more):
    named = [{"name": n, "target": t, "alternatives": a, "expected_gain": 90.0, "gain": 100.0} for n, t, a in effects]
    each = [{"free": best, "rivals": best} for _ in hidden]
    return {
        "key": "", "family": family, "kind": kind, "hidden": [[n, t, {}] for n, t in hidden], "verdict": verdict,
        "effects": named, "best": {"free": best, "rivals": best, "each": each}, "truth": 5e-7, "seconds": 1.0,
        "gap": {"held_out_before_K": 0.2, "held_out_after_K": 0.06, "floor_K": 0.05},
        "diffusivity": {"value": 5e-7, "std": 1e-9, "interval_95": [4.9e-7, 5.1e-7]},
    } | more  # fmt: skip


def test_the_score_counts_as_the_targets_say():
    lag, position = ("sensor_lag", "T1"), ("sensor_position", "T1")
    rival = {"name": "sensor_lag", "target": "T1"}
    lines = [
        line("nulls", "white", [], "adequate", []),
        line("nulls", "white", [], "unnamed", []),
        line("nulls", "ar06", [], "uninformative", [], diffusivity={"value": None, "interval_95": [None, None]}),
        line("singles", "sensor_lag", [lag], "named", [(*lag, [])]),
        line("singles", "sensor_lag", [lag], "named", [("sensor_lag", "T2", [])]),
        line("singles", "sensor_lag", [lag], "confusable", [(*position, [rival])]),
        line("singles", "sensor_lag", [lag], "adequate", [], best=10.0),
        line("pairs", "pairs", [lag, position], "named", [(*position, []), (*lag, [])]),
        line("outside", "corner", [("corner", None)], "unnamed", []),
        {"key": "x", "family": "nulls", "kind": "white", "error": "ValueError: no"},
    ]
    found = score.summary(lines)
    figures = found["figures"]
    assert figures["false alarm on nulls, white"]["hits"] == 1
    assert figures["false alarm on nulls, ar06"]["hits"] == 0
    assert (figures["single effects, clear of rivals: first name right"]["hits"]) == 1
    assert figures["single effects, seen: among name and alternatives"]["hits"] == 2
    assert figures["both of a hidden pair, each clear"]["rate"] == 1
    assert figures["outside the library, clear: unnamed"]["rate"] == 1
    assert figures["held-out excess, after over before"]["median"] == pytest.approx(0.01 / 0.15)
    assert figures["expected over real gain"]["median"] == pytest.approx(0.9)
    assert figures["crashes"]["count"] == 1
    assert found["confusion"]["sensor_lag"] == {
        "sensor_lag": 1, "sensor_lag, wrong target": 1, "sensor_position (confusable)": 1,
    }  # fmt: skip
    assert len(list(score.tables(found))) == 3
    assert [score.counts(one) for one in lines[2:7]] == [True, True, True, True, False]
    assert not score.counts(line("pairs", "pairs", [lag, position], "named", [], best=100.0))
    left_out = line("singles", "sensor_lag", [lag], "adequate", [], best=10.0) | {"left_out": True}
    assert score.summary([*lines, left_out]) == found
    assert score.interval(0, 10) == pytest.approx((0, 0.3085), abs=1e-4)


def test_a_record_that_no_rate_counts_is_left_out_when_asked():
    spec = wall(("sensor_offset", "T1", {"offset": 1e-4}), days=14.0)
    outcome = score.run(score.Job("key", "singles", "sensor_offset", spec), counted_only=True)
    assert outcome["left_out"] and "verdict" not in outcome
    assert outcome["best"]["free"] < score.SEEN
