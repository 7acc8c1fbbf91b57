"""Nuisance parameters by name: a kind from outside, and one compilation for every choice of them."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from benchmarks.accuracy import interval
from benchmarks.reference.analytic_slab import weather as fine_weather

import wallid
from wallid.case.initial_profile import scales
from wallid.inference import likelihood
from wallid.inference.nuisance_kinds import NUISANCE_KINDS, LinearEffect, NuisanceKind
from wallid.inference.nuisance_parameters import describe_instrument_error, window_parameters
from wallid.inference.parameters import Parameter
from wallid.models.sensitivity_equations import explicit

ERRORS = interval.Errors(0.02, 0.005)
GAIN, TRUE_GAIN = 0.3, -0.15


class SensorGains(NuisanceKind):
    """A gain of each sensor about the mean of its readings: a kind that the package does not have."""

    kind, source_of_variance, is_instrument_error = "sensor_gain", "gains", True

    def parameters(self, case, window):
        return [Parameter(f"{self.kind}[{sensor.name}]", prior_std=GAIN) for sensor in case.sensors]

    def effect(self, names, point):
        u, _ = explicit(
            wallid.full_order_model(point.case), scales(point.case).fourier_number(point.diffusivity), point.data
        )
        predicted = np.asarray(point.data.celsius(u))
        observed = np.asarray(point.data.observed)
        columns = np.zeros((len(names), *point.shape))
        for k in range(len(names)):
            columns[k, :, k] = GAIN * (predicted[:, k] - observed[:, k].mean())
        return LinearEffect(columns, np.zeros(len(names)))


def weather(seed):
    """True faces that vary within the rows, with their past."""
    rows, step = (interval.BEFORE + interval.ROWS - 1) * interval.PARTS + 1, interval.STEP / interval.PARTS
    return fine_weather(rows, step, np.random.default_rng(seed), hours=(8.0, 2.0))


def simulated(seed, gain=0.0):
    """A case from the analytic slab, whose second sensor has a gain."""
    faces = weather(seed)
    readings = interval.truth(faces, np.array(interval.PLACES))
    readings[:, 1] += gain * (readings[:, 1] - readings[:, 1].mean())
    readings = readings + 0.02 * np.random.default_rng(seed + 1).standard_normal(readings.shape)
    return interval.case_of(ERRORS, interval.at_rows(faces)[-interval.ROWS :], readings)


def test_a_kind_from_outside_is_estimated():
    """A gain of 0.85: without it the diffusivity is far from the truth, with it both are in their intervals."""
    case = simulated(21, TRUE_GAIN)
    model = wallid.full_order_model(case)
    without = wallid.estimate(case, None, model)
    fit = wallid.estimate(case, None, model, nuisance=(*NUISANCE_KINDS, SensorGains()))
    truth = interval.DIFFUSIVITY
    assert not without.interval_95[0] <= truth <= without.interval_95[1]
    assert fit.interval_95[0] <= truth <= fit.interval_95[1]
    for sensor, gain in zip(case.sensors, (0.0, TRUE_GAIN, 0.0), strict=True):
        value, std = fit.parameters[f"sensor_gain[{sensor.name}]"]
        assert value == pytest.approx(gain, abs=4 * std) and std < 0.03
    assert fit.variance_shares["gains"] > 0
    assert "the gain of T1" in fit.identifiability.names


@pytest.mark.slow
def test_one_compilation_serves_every_choice_of_what_is_estimated(monkeypatch):
    """Offsets, positions, faces' positions and common noise, with other priors or none: the mask is data."""
    case, traced, search = simulated(5), [], likelihood.search
    monkeypatch.setattr(likelihood, "search", lambda *given: traced.append(1) or search(*given))
    model = wallid.full_order_model(case)
    jax.clear_caches()
    estimated = set()
    for offset, position, face in ((0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.2, 0.001, 0.0), (0.0, 0.002, 0.003)):
        sensors = tuple(replace(sensor, offset_std=offset, position_std=position) for sensor in case.sensors)
        chosen = replace(case, sensors=sensors, record=replace(case.record, face_position_std=face))
        fit = wallid.estimate(chosen, None, model)
        assert np.isfinite(fit.value)
        assert set(fit.offsets) == (set(case.record.names) if offset else set())
        assert set(fit.positions) == (set(case.record.names) if position else set())
        assert set(fit.face_positions) == ({"left", "right"} if face else set())
        estimated.add(tuple(fit.parameters))
    assert len(estimated) == 4
    assert len(traced) == 1


def test_names_say_what_a_parameter_is():
    parameters = window_parameters(simulated(3), wallid.Window(0, interval.ROWS))
    assert parameters.names[0] == "log_diffusivity"
    assert parameters.of_kind("sensor_offset") == tuple(f"sensor_offset[T{k}]" for k in range(3))
    assert parameters.units[parameters.index("sensor_position[T2]")] == "m"
    assert "profile_mode[8]" in parameters and "log_conductivity" not in parameters
    assert describe_instrument_error("face_position[left]") == "position error of the left face's sensor"
    assert describe_instrument_error("sensor_gain[T2]") == "gain of T2"
