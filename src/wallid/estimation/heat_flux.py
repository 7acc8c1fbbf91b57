"""Thermal properties from heat fluxes: conductivity, heat capacity, resistance and transmittance.

A flux is a further output, `j = (1 + gain) (k T_ref / L) J(u; Fo)`. Its amplitude gives the conductivity, its variation
in time the diffusivity. For a wall of length L: `R = L / k`, areal heat capacity `L k / alpha`,
`U = 1 / (R_si + R + R_se)`. R and the areal heat capacity depend on `k / L` and `alpha / L^2` only, so they do not
depend on the stated length. A contact resistance between a face and its sensor is part of R.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

from .._internal.html import html_table, interval_row
from .._internal.result_object import ResultObject, plain_value
from ..case.case_definition import Case
from ..case.mixups import visible_mixups
from ..case.time_window import Window, entire_record
from ..case.wall_and_sensors import SIDES
from ..inference.generalised_least_squares import fit_generalised_least_squares
from ..inference.gls_fit import GLSFit
from ..inference.likelihood import LOG_CONDUCTIVITY, PLATE_GAIN, predicted_jacobian
from ..inference.nuisance_kinds import ContactResistances, contact_lengths
from ..inference.parameters import kind_of, target_of
from ..inference.physical_bounds import PHYSICAL_BOUNDS
from ..inference.quantity import NORMAL_95, Quantity, lognormal, quantity_frame
from ..models.flux_plates import flux_gain_std, fluxes_of
from ..models.wall_parameters import R_INSIDE, R_OUTSIDE
from ..models.window_inputs import window_data
from .iso_9869 import AverageMethod, average_method
from .pooled_mean import PooledMean, covariance_with_shared_errors, pooled_mean

if TYPE_CHECKING:
    from pandas import DataFrame

R_SURFACES = R_INSIDE + R_OUTSIDE
SURFACES_TEXT = f"with surface resistances of {R_INSIDE:g} inside and {R_OUTSIDE:g} m2 K/W outside (ISO 6946)"
_IMPROBABLE = 0.01  # p-value of the difference of two plates' calibration errors, below which the plates disagree
_MIN_HALF_ROWS = 50  # of the first half of a window, to predict the second half


@dataclass(frozen=True)
class HeldOutFlux(ResultObject):
    """The flux of the second half of a window predicted with the estimate from the first half.

    Only the places and memories of unknown heat are those of the entire window.

    Args:
        coverage: fraction of the second half's readings inside their 95 % interval.
        rms: root mean square of measured minus predicted, W/m2.
        hours: length of each half, h. readings: number of readings in the second half.
    """

    coverage: float
    rms: float
    hours: float
    readings: int

    def __str__(self) -> str:
        return (
            f"held out     the first {self.hours:.3g} h predict the flux of the last {self.hours:.3g} h to "
            f"{self.rms:.2g} W/m2 root mean square; {self.coverage:.0%} of {self.readings} readings "
            "lie in their 95 % interval"
        )


@dataclass(frozen=True)
class ThermalProperties(ResultObject):
    """The thermal properties of a wall from temperatures and heat fluxes.

    Args:
        conductivity, heat_capacity: W/m/K and J/m3/K, for the stated length.
        resistance, areal_heat_capacity: m2 K/W and J/m2/K, from sensor to sensor of the faces; independent of the
            stated length.
        transmittance: W/m2/K, with the standard surface resistances of ISO 6946.
        contact_resistances: of each face that has a plate, between the face and its sensor, m2 K/W; `resistance`
            contains them.
        plate_gains: calibration error of each plate: name -> (value, std), dimensionless; above 0 it reads too high.
        mean_residuals: mean of each plate's readings minus the model's, W/m2.
        resistance_shares: share of each source of error in the variance of ln(resistance); empty for several windows.
        disagreement: advice where the calibration errors of two plates are improbable; else empty.
        average_methods: the average method of ISO 9869-1 for each plate.
        held_out: the second half's flux predicted from the first half; None where a half is too short or has no flux,
            and for several windows together.
        gains_assumed: whether the plates' calibration uncertainty was assumed, not stated in the case.
    """

    conductivity: Quantity
    heat_capacity: Quantity
    resistance: Quantity
    areal_heat_capacity: Quantity
    transmittance: Quantity
    contact_resistances: dict[str, Quantity]
    plate_gains: dict[str, tuple[float, float]]
    mean_residuals: dict[str, float]
    resistance_shares: dict[str, float]
    disagreement: str
    average_methods: tuple[AverageMethod, ...]
    held_out: HeldOutFlux | None
    gains_assumed: bool

    @property
    def quantities(self) -> dict[str, Quantity]:
        """The five properties by name."""
        names = ("conductivity", "heat_capacity", "resistance", "areal_heat_capacity", "transmittance")
        return {name: getattr(self, name) for name in names}

    def to_dict(self) -> dict[str, Any]:
        """The properties, the plates' calibration errors and what the resistance rests on, as plain numbers."""
        gains = {face: {"value": value, "std": std} for face, (value, std) in self.plate_gains.items()}
        names = ("contact_resistances", "mean_residuals", "resistance_shares", "disagreement")
        entries = {"plate_gains": gains} | {name: getattr(self, name) for name in names}
        return plain_value(self.quantities | entries | {"iso_9869": self.average_methods})

    def to_frame(self) -> DataFrame:
        """One row for each property: `value`, `std`, `low` and `high` of the 95 % interval, `unit`."""
        return quantity_frame(self.quantities)

    def _repr_html_(self) -> str:
        rows = [interval_row(name.replace("_", " "), one) for name, one in self.quantities.items()]
        rows += [
            (f"{face} plate, calibration", f"{gain:+.1%}", f"± {std:.1%}", "")
            for face, (gain, std) in self.plate_gains.items()
        ]
        rows += [one.html_row() for one in self.average_methods]
        return html_table("Thermal properties", rows)

    @property
    def property_lines(self) -> list[str]:
        """A line for each property, those that do not depend on the stated length first."""
        return [
            f"resistance   {self.resistance}, from face to face",
            f"U-value      {self.transmittance}, {SURFACES_TEXT}",
            f"capacity     {self.areal_heat_capacity}",
            f"conductivity {self.conductivity}, for the stated length"
            f"{' and without the contact resistances' if self.contact_resistances else ''}",
        ]

    @property
    def evidence_lines(self) -> list[str]:
        """The plates' calibration, the average method, and the prediction of the second half, line by line."""
        lines = [
            f"contact      {face}: {one} between this face and its sensor, part of the resistance"
            for face, one in self.contact_resistances.items()
        ]
        for face, (gain, std) in self.plate_gains.items():
            calibration = f"{100 * gain + 0.0:+.1f} +- {100 * std:.1f} % (above 0: reads too high)"
            line = f"plate        {face}: calibration {calibration}"
            if face in self.mean_residuals:
                line += f"; beyond that it differs from the model by {self.mean_residuals[face]:+.2g} W/m2 on average"
            lines.append(line)
        if self.gains_assumed:
            lines.append("             (5 % assumed; state [record] flux_gain_std)")
        if self.resistance_shares:
            shares = ", ".join(f"{name} {share:.0%}" for name, share in self.resistance_shares.items())
            lines.append(f"variance     of the resistance: {shares}")
        lines += [str(average) for average in self.average_methods]
        return [*lines, *([str(self.held_out)] if self.held_out is not None else [])]

    def __str__(self) -> str:
        return "\n".join([*self.property_lines, *self.evidence_lines])


def why_flux_is_doubtful(case: Case, thermal: ThermalProperties) -> str:
    """Why the fluxes cannot be right: their sign, or a property that no material has; empty where nothing is wrong."""
    for mixup in visible_mixups(case):
        if mixup.kind == "flux_sign":
            return mixup.words
    for name, one in thermal.quantities.items():
        lowest, highest = PHYSICAL_BOUNDS[one.unit]
        if not lowest <= one.value <= highest:
            return f"no material has this {name.replace('_', ' ')}, {one.value:.2g} {one.unit}: check the plates' unit"
    return ""


def thermal_properties(case: Case, window: Window, fit: GLSFit) -> ThermalProperties:
    """The thermal properties from a GLS fit with fluxes."""
    logs = _log_properties(fit, case.wall.length)

    def quantity(name: str, unit: str) -> Quantity:
        value, combination = logs[name]
        return lognormal(math.exp(value), fit.variance(combination), fit.quantile, unit)

    gains = {
        face: (value, math.sqrt(fit.variance(combination)))
        for face in fluxes_of(case)
        for value, combination in [logs[face]]
    }
    return replace(
        _derived_properties(case, window, _primary(logs, quantity), gains),
        held_out=_second_half_prediction(case, window, fit),
        mean_residuals=_mean_residuals(case, fit),
        resistance_shares=_variance_shares(fit, logs["resistance"][1]),
    )


def _mean_residuals(case: Case, fit: GLSFit) -> dict[str, float]:
    """Mean of each plate's readings minus the model's, W/m2; only of plates with a reading."""
    data, plates = fit.problem.data, fluxes_of(case)
    present = np.asarray(data.weight)[:, -len(plates) :] > 0
    residual = (np.asarray(data.observed) - np.asarray(fit.minimum.predicted))[:, -len(plates) :]
    columns = zip(plates, residual.T, present.T, strict=True)
    return {face: float(column[used].mean()) for face, column, used in columns if used.any()}


def _variance_shares(fit: GLSFit, combination: np.ndarray) -> dict[str, float]:
    """Share of the plates' calibration, of other errors of instruments and of the rest in a combination's variance."""
    sources = {kind.kind: kind.source_of_variance for kind in fit.kinds} | {PLATE_GAIN: "plates' calibration"}
    shares = {sources[PLATE_GAIN]: 0.0}
    total = fit.variance(combination)
    if fit.robust is None:  # without the inflation of the noise, which the errors of instruments do not have either
        total = float(np.sum((combination @ fit.generalised_inverse) ** 2))
    for name, effect in fit.instrument_error_effects(combination).items():
        source = sources[kind_of(name)]
        shares[source] = shares.get(source, 0.0) + effect**2 / total
    return shares | {"noise and all else": max(1.0 - sum(shares.values()), 0.0)}


def _disagreement(case: Case, gains: Mapping[str, tuple[float, float]]) -> str:
    """Advice where two plates' calibration errors differ by more than their accuracy allows; else empty.

    The readings tell only the difference of the two errors, whose variance before the measurement is `2 s^2`.
    """
    accuracy = flux_gain_std(case)
    if len(gains) < 2 or accuracy == 0.0:
        return ""
    (one, _), (other, _) = gains.values()
    if scipy.special.chdtrc(1, 0.5 * ((one - other) / accuracy) ** 2) > _IMPROBABLE:
        return ""
    found = " and ".join(
        f"the {face} one reads {100 * abs(gain):.2g} % too {'high' if gain > 0 else 'low'}"
        for face, (gain, _) in gains.items()
    )
    source = "assumed" if case.record.flux_gain_std is None else "stated"
    return (
        f"the plates disagree: for this model {found}, where {100 * accuracy:.2g} % is {source}; check their contact "
        "and calibration, or exchange them for some days; the intervals of R and U trust the plates as "
        f"{source} ([record] flux_gain_std)"
    )


def pooled_thermal_properties(case: Case, fits: Sequence[GLSFit]) -> tuple[ThermalProperties, PooledMean]:
    """The thermal properties from several windows together, and the mean of their ln(conductivity).

    The logarithm of each property and the calibration error of each plate are pooled over the windows, whose
    instrument errors are the same (`pooled_mean`). The average method is over the entire record, or its longest
    unbroken part.
    """
    logs, quantile = [_log_properties(one, case.wall.length) for one in fits], max(one.quantile for one in fits)
    means = {}
    estimated = [name for name, (_, combination) in logs[0].items() if combination.any()]  # a calibration may be exact
    for name in estimated:
        values, combinations = (np.array(part) for part in zip(*(one[name] for one in logs), strict=True))
        stds = np.sqrt([one.variance(row) for one, row in zip(fits, combinations, strict=True)])
        shared = np.stack(
            [list(one.instrument_error_effects(row).values()) for one, row in zip(fits, combinations, strict=True)]
        )
        means[name] = pooled_mean(values, covariance_with_shared_errors(stds, shared), quantile)

    def quantity(name: str, unit: str) -> Quantity:
        return lognormal(math.exp(means[name].value), means[name].std ** 2, means[name].quantile, unit)

    gains = {face: (means[face].value, means[face].std) if face in means else (0.0, 0.0) for face in fluxes_of(case)}
    return _derived_properties(case, entire_record(case), _primary(logs[0], quantity), gains), means["conductivity"]


def _primary(logs: Mapping[str, Any], quantity: Callable[[str, str], Quantity]) -> dict[str, Quantity]:
    """The properties whose logarithms are combinations of the parameters."""
    units = {"conductivity": "W/m/K", "heat_capacity": "J/m3/K", "resistance": "m2 K/W"}
    units |= {name: "m2 K/W" for name in logs if kind_of(name) == ContactResistances.kind}
    return {name: quantity(name, unit) for name, unit in units.items()}


def _log_properties(fit: GLSFit, length: float) -> dict[str, tuple[float, np.ndarray]]:
    """Logarithms of the properties, and each plate's gain, each with its linear combination of the parameters.

    With contact resistances `r = l / k` of lengths `l`, the resistance from sensor to sensor is `(L + sum l) / k`.
    """
    parameters = fit.parameters
    reference = float(fit.problem.nuisance.flux[0]) / float(fit.problem.data.temperature) * length

    def combination(name: str) -> np.ndarray:
        """The parameter in its own unit, from the parameters in prior standard deviations."""
        if name not in fit.names:  # known exactly
            return np.zeros(len(fit.names))
        return float(parameters.prior_std[parameters.index(name)]) * (np.array(fit.names) == name)

    log_k, row_k = math.log(reference) + float(parameters[LOG_CONDUCTIVITY]), combination(LOG_CONDUCTIVITY)
    logs = {
        "conductivity": (log_k, row_k),
        "heat_capacity": (log_k - math.log(fit.diffusivity), row_k - (np.arange(len(fit.names)) == 0)),
    }
    contacts = parameters.of_kind(ContactResistances.kind)
    lengths = contact_lengths(reference, contacts, np.asarray(parameters.vector(contacts)))
    total, of_length = length + sum(lengths), np.zeros(len(fit.names))
    for name in contacts:
        one = lengths[SIDES.index(target_of(name))]
        of_length = of_length + one / total * combination(name)
        logs[name] = (math.log(one) - log_k, combination(name) - row_k)
    logs["resistance"] = (math.log(total) - log_k, of_length - row_k)
    gains = parameters.of_kind(PLATE_GAIN)
    return logs | {target_of(name): (float(parameters[name]), combination(name)) for name in gains}


def _derived_properties(
    case: Case,
    window: Window,
    primary: dict[str, Quantity],
    gains: dict[str, tuple[float, float]],
) -> ThermalProperties:
    """The properties that follow from the primary ones, and the average method over a window."""
    length, c, resistance = case.wall.length, primary["heat_capacity"], primary["resistance"]
    areal = Quantity(length * c.value, length * c.std, (length * c.interval_95[0], length * c.interval_95[1]), "J/m2/K")
    part = case.record.window(window.row, window.rows)
    return ThermalProperties(
        conductivity=primary["conductivity"],
        heat_capacity=c,
        resistance=resistance,
        areal_heat_capacity=areal,
        transmittance=transmittance(resistance),
        contact_resistances={target_of(name): one for name, one in primary.items() if kind_of(name) == "contact"},
        plate_gains=gains,
        average_methods=tuple(
            average_method(part.faces, part.regressors[f"flux_{face}"], part.step, face, areal.value) for face in gains
        ),
        held_out=None,
        mean_residuals={},
        resistance_shares={},
        disagreement=_disagreement(case, gains),
        gains_assumed=case.record.flux_gain_std is None,
    )


def transmittance(resistance: Quantity) -> Quantity:
    """The U-value, W/m2/K, of a resistance from face to face, with the surface resistances of ISO 6946."""
    low, high = (1.0 / (end + R_SURFACES) for end in resistance.interval_95[::-1])
    value = 1.0 / (resistance.value + R_SURFACES)
    return Quantity(value, value**2 * resistance.std, (low, high), "W/m2/K")


def _second_half_prediction(case: Case, window: Window, fit: GLSFit) -> HeldOutFlux | None:
    """The flux of the second half of a window predicted with the estimate from its first half.

    Half of a window hardly shows where unknown heat is released, and with which memory. So its size is found from the
    first half, at the places and with the memories that the entire window leaves; none where that shows none.
    """
    half, plates = window.rows // 2, len(fluxes_of(case))
    present = np.asarray(fit.problem.data.weight)[:, -plates:] > 0
    if half < _MIN_HALF_ROWS or not (present[:half].any() and present[half:].any()):
        return None
    model, data = fit.problem.system, window_data(case, window)
    places = () if fit.disturbance is None else fit.disturbance.probable
    early = fit_generalised_least_squares(
        case, window, data, model, fit.diffusivity, eta=1e-6, rows_used=half, kinds=fit.kinds, heat_among=places
    )
    J = np.asarray(predicted_jacobian(early.problem, early.minimum.vector))
    data, present = fit.problem.data, present[half:]
    residual = np.asarray(data.observed - early.minimum.predicted)[half:, -plates:]
    noise = early.robust or early.noise
    own = np.asarray(fit.noise_shape.sensor_std)[-plates:] ** 2 * (noise.white + noise.autocorrelated)
    faces = fit.noise_shape.face_variance(noise.white + noise.autocorrelated, 0.0, 0.0)
    late = J[half:, -plates:][..., early.estimated_indices]
    variance = own + faces[-plates:] + np.einsum("tsp,pq,tsq->ts", late, early.covariance, late)
    if early.noise.disturbance is not None:  # its size at the end of the first half, which is stationary by then
        disturbance = np.diag(early.noise.disturbance).reshape(-1, early.noise_shape.bin_count)
        variance = variance + disturbance.max(axis=1)[-plates:]
    inside = np.abs(residual) <= NORMAL_95 * np.sqrt(variance)
    return HeldOutFlux(
        coverage=float(inside[present].mean()),
        rms=float(np.sqrt(np.mean(residual[present] ** 2))),
        hours=half * case.record.step / 3600.0,
        readings=int(present.sum()),
    )
