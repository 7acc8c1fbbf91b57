"""What one dimension costs: the error of an estimate that takes a wall of stones and mortar as homogeneous.

A sensor in the section reads `T(x, y)`, where the equivalent homogeneous wall has `T_1(x)`. To first order the estimate
in one dimension is off by

    ln(alpha_1 / alpha) = sum_s b_s(y_s),      b_s(y) = K_s (T(x_s, y) - T_1(x_s))

with the row K of the generalised inverse that gives ln(alpha) from the readings. Where heights are not known, each b_s
varies with the weights of the heights.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from .._internal.arrays import on_device
from .._internal.errors import InputError
from .._internal.result_object import ResultObject, plain_value
from ..case.case_definition import Case
from ..case.initial_profile import scales
from ..case.time_window import Window, entire_record
from ..inference.sensor_heights import heights_in_section, section_minus_homogeneous
from ..models.section.section_state_space import section_modes
from ..models.sensitivity_equations import simulate_window
from ..models.window_inputs import full_order_model, window_data
from .diffusivity import estimate_by_gls


@dataclass(frozen=True, eq=False)
class HeightBias(ResultObject):
    """The error of the estimate in one dimension that one sensor causes, by its height.

    Args:
        heights: that the sensor may have, m. weights: of them, of sum 1.
        bias: of ln(alpha), at each height.
    """

    heights: np.ndarray
    weights: np.ndarray
    bias: np.ndarray

    @property
    def mean(self) -> float:
        """Over the heights."""
        return float(self.weights @ self.bias)

    @property
    def std(self) -> float:
        """Over the heights; 0 for a known height."""
        return float(np.sqrt(self.weights @ (self.bias - self.mean) ** 2))

    def to_dict(self) -> dict[str, Any]:
        """The entry of result.json."""
        ends = {"smallest": float(self.bias.min()), "largest": float(self.bias.max())}
        return {"mean": self.mean, "std": self.std, **ends}


@dataclass(frozen=True, eq=False)
class CostOfOneDimension(ResultObject):
    """The error of an estimate that takes a section as a homogeneous wall.

    Args:
        sensors: what each sensor causes, by its name.
        log_std: standard error of ln(alpha) that the estimate in one dimension states.
    """

    sensors: dict[str, HeightBias] = field(repr=False)
    log_std: float

    @property
    def mean(self) -> float:
        """Expected error of ln(alpha)."""
        return sum(one.mean for one in self.sensors.values())

    @property
    def std(self) -> float:
        """Standard deviation of this error over the heights that are not known."""
        return float(np.sqrt(sum(one.std**2 for one in self.sensors.values())))

    def to_dict(self) -> dict[str, Any]:
        """The entry of result.json."""
        sensors = {name: one.to_dict() for name, one in self.sensors.items()}
        return plain_value({"bias": self.mean, "std": self.std, "stated_std": self.log_std, "sensors": sensors})

    def __str__(self) -> str:
        spread = f" +- {self.std:.1%} over the heights that are not known" if self.std > 0.0 else ""
        lines = [
            f"one dimension: an estimate of a homogeneous wall is off by {np.expm1(self.mean):+.1%}{spread}; it would "
            f"state +- {self.log_std:.1%}"
        ]
        lines += [
            f"             {name} alone by {np.expm1(one.bias.min()):+.1%} to {np.expm1(one.bias.max()):+.1%}"
            if one.std > 0.0
            else f"             {name} alone by {np.expm1(one.mean):+.1%}"
            for name, one in self.sensors.items()
        ]
        return "\n".join(lines)


def cost_of_one_dimension(case: Case, window: Window | None = None) -> CostOfOneDimension:
    """The error of an estimate in one dimension from the faces of a record, by the section's model.

    The materials are as stated, the noise is that stated, no reading is missing, and fluxes are not used.

    Args:
        case: with a section and inner sensors.
        window: rows of the record; None for the entire record.

    Raises:
        InputError: the case has no section or no sensor.
    """
    if case.section is None or not case.sensors:
        raise InputError(f"{case.path}: the cost of one dimension needs a [section] and a [[sensor]]")
    window = entire_record(case) if window is None else window
    temperatures = {name: one for name, one in case.record.regressors.items() if not name.startswith("flux_")}
    case = replace(case, record=replace(case.record, regressors=temperatures))
    alpha = section_modes(case.section).equivalent.diffusivity
    deviations = section_minus_homogeneous(case, window, alpha)
    plain = _homogeneous_record(case, window, alpha)
    _, fit = estimate_by_gls(plain, window, full_order_model(plain), alpha, plain.choices.eta)
    readings = len(fit.noise.whitening)
    gain = fit.generalised_inverse[0, :readings] @ fit.noise.whitening
    found = {}
    for number, (sensor, own) in enumerate(zip(case.sensors, deviations, strict=True)):
        changes = np.zeros((*own.readings.shape, len(case.sensors)))
        changes[:, :, number] = own.readings
        bias = np.array([gain @ np.asarray(fit.problem.bins.mean(on_device(one))) for one in changes])
        found[sensor.name] = HeightBias(*heights_in_section(case, sensor), bias)
    return CostOfOneDimension(found, fit.log_std)


def _homogeneous_record(case: Case, window: Window, diffusivity: float) -> Case:
    """The case in one dimension, with the readings that the homogeneous wall has, without noise."""
    plain = case.in_one_dimension()
    data = window_data(plain, window)
    fourier = on_device(scales(plain).fourier_number(diffusivity))
    readings = np.array(case.record.sensors)
    readings[window.as_slice] = scales(plain).celsius(
        np.asarray(simulate_window(full_order_model(plain), fourier, data)[0])
    )
    choices = replace(plain.choices, noise="stated", disturbance="none")
    return replace(plain, record=replace(plain.record, sensors=readings), choices=choices)
