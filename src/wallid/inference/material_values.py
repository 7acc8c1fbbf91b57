"""Conductivity and heat capacity of each material of a section, from a fit in which their ratios are free.

The readings say the diffusivity of the equivalent wall, and by their course the ratios of the materials' values; with
flux plates they say its conductivity too. The fit has the equivalent wall's diffusivity (and conductivity) as
parameters of their own, without a prior or with a wide one. What joins them to the materials is a condition,

    g(y) = ln(alpha) - ln(alpha_eq(k_1, ..., c_1, ...)) = 0,        with plates also  ln(k) - ln(k_eq(k_1, ...)) = 0

so the values of the materials are those nearest to the fit, in the metric of its covariance C, that fulfil it:

    y = m - C G' (G C G')^-1 (g(y) + G (m - y)),      Cov(y) = C - C G' (G C G')^-1 G C,      G = dg/dy

Source: D. Simon, T. L. Chia, IEEE Trans. Aerosp. Electron. Syst. 38 (2002), 128 (estimates under equality conditions).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .._internal.html import html_table, interval_row
from .._internal.result_object import ResultObject, plain_value
from ..case.case_definition import Case
from ..case.initial_profile import scales
from ..models.section.section_state_space import section_over_range
from ..models.wall_parameters import MATERIAL_VALUES, materials_at, prior_std_of
from .gls_fit import GLSFit
from .likelihood import LOG_CONDUCTIVITY
from .nuisance_kinds import WallParameters
from .parameters import target_of
from .quantity import Quantity, lognormal

_UNITS = {"conductivity": "W/m/K", "heat_capacity": "J/m3/K"}
_ITERATIONS = 20
_STEP = 1e-4  # prior standard deviations
_LEARNED = 0.5  # posterior over prior standard deviation, below which a combination counts as determined


@dataclass(frozen=True, eq=False)
class MaterialValues(ResultObject):
    """The values of a section's materials.

    Args:
        quantities: conductivity, W/m/K, and heat capacity, J/m3/K, by names such as "conductivity of stone".
        combinations: ratios of conductivities and of heat capacities to those of the first material, 1, and the
            diffusivity of each material, m2/s, by names such as "diffusivity of stone".
        prior_log_std: standard deviation of the logarithm of each of both, by the priors alone.
        correlations: of the logarithms of the values, `(value, value)`.
        learned: number of independent combinations that the record determines at least twice as well as the priors.
    """

    quantities: dict[str, Quantity]
    combinations: dict[str, Quantity]
    prior_log_std: dict[str, float]
    correlations: np.ndarray = field(repr=False)
    learned: int

    def to_dict(self) -> dict[str, Any]:
        """Values and combinations with their priors, and the correlations, as plain numbers."""
        entries: dict[str, Any] = {
            key: {name: one.result() | {"prior_log_std": self.prior_log_std[name]} for name, one in group.items()}
            for key, group in (("values", self.quantities), ("combinations", self.combinations))
        }
        entries |= {"parameters": list(self.quantities), "correlations": self.correlations, "learned": self.learned}
        return plain_value(entries)

    def _repr_html_(self) -> str:
        rows = [interval_row(name, one) for name, one in (self.quantities | self.combinations).items()]
        return html_table("Materials", rows)

    def is_learned(self, name: str) -> bool:
        """Whether the record determines a value or a combination at least twice as well as its prior."""
        one = (self.quantities | self.combinations)[name]
        return one.std / one.value < _LEARNED * self.prior_log_std[name]

    def __str__(self) -> str:
        count = len(self.quantities)
        known = (
            "no combination"
            if not self.learned
            else f"{self.learned} independent combination" + "s" * (self.learned > 1)
        )
        lines = [f"materials    the record determines {known} of their {count} values twice as well as the priors do"]
        lines += [
            f"             {name.replace('_', ' ')} {one}: relative error {one.std / one.value:.2g}, by the priors "
            f"alone {self.prior_log_std[name]:.2g}"
            for name, one in (self.quantities | self.combinations).items()
        ]
        return "\n".join(lines)


def material_values(case: Case, fit: GLSFit) -> MaterialValues | None:
    """The values of a section's materials; None where they are not estimated.

    Args:
        case: with a section.
        fit: of its record, with the materials free.
    """
    indices = fit.indices(WallParameters.kind).tolist()
    if case.section is None or not indices or not fit.finite:
        return None
    names = [target_of(fit.names[k]) for k in indices]
    flux = [fit.names.index(LOG_CONDUCTIVITY)] if LOG_CONDUCTIVITY in fit.names else []
    used = [0, *flux, *indices]
    condition = _Condition(case, fit, names, bool(flux))
    z, covariance = conditioned(fit.z[used], fit.covariance[np.ix_(used, used)], condition)
    z, covariance = z[1 + len(flux) :], covariance[1 + len(flux) :, 1 + len(flux) :]
    prior = np.array([prior_std_of(case, name) for name in names])
    covariance = covariance * np.outer(prior, prior)
    materials = [material.name for material in case.section.materials]
    values = {
        f"{kind} of {material}": float(value)
        for kind, row in zip(MATERIAL_VALUES, materials_at(case, names, z), strict=True)
        for material, value in zip(materials, row, strict=True)
    }

    def quantity(powers: dict[str, float], unit: str) -> tuple[Quantity, float]:
        """A product of powers of values, and the standard deviation of its logarithm by the priors alone."""
        row = np.array([powers.get(name, 0.0) for name in names])
        value = math.exp(sum(power * math.log(values[name]) for name, power in powers.items()))
        return lognormal(value, float(row @ covariance @ row), fit.quantile, unit), float(np.linalg.norm(row * prior))

    found = {name: quantity({name: 1.0}, _UNITS[name.partition(" of ")[0]]) for name in names}
    combinations = {
        name: (one, std)
        for name, powers, unit in _combinations(materials)
        for one, std in [quantity(powers, unit)]
        if std > 0.0
    }
    std = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    return MaterialValues(
        {name: one for name, (one, _) in found.items()},
        {name: one for name, (one, _) in combinations.items()},
        {name: prior_std for name, (_, prior_std) in (found | combinations).items()},
        covariance / np.outer(std, std),
        int(np.count_nonzero(np.linalg.eigvalsh(covariance / np.outer(prior, prior)) < _LEARNED**2)),
    )


def _combinations(materials: Sequence[str]) -> list[tuple[str, dict[str, float], str]]:
    """Name, powers of the values and unit of the ratios to the first material, and of each diffusivity."""
    first, *others = materials
    ratios = [
        (f"{kind} of {other} over {first}", {f"{kind} of {other}": 1.0, f"{kind} of {first}": -1.0}, "")
        for kind in MATERIAL_VALUES
        for other in others
    ]
    conductivity, heat_capacity = MATERIAL_VALUES
    return ratios + [
        (f"diffusivity of {name}", {f"{conductivity} of {name}": 1.0, f"{heat_capacity} of {name}": -1.0}, "m2/s")
        for name in materials
    ]


class _Condition:
    """`g(y)`: what joins the equivalent wall's diffusivity, and with plates its conductivity, to the materials."""

    def __init__(self, case: Case, fit: GLSFit, names: Sequence[str], flux: bool):
        assert case.section is not None
        self.case, self.fit, self.names, self.flux = case, fit, names, flux
        self.projection = section_over_range(case.section)
        self.log_start = math.log(float(fit.problem.start))
        if flux:  # a unit of the model's flux output is k / L for each kelvin of the scale
            per_unit, parameters = float(fit.problem.nuisance.flux[0]), fit.problem.parameters
            self.log_conductivity = math.log(per_unit * case.wall.length / scales(case).temperature)
            self.conductivity_std = float(parameters.prior_std[parameters.index(LOG_CONDUCTIVITY)])

    def __call__(self, y: np.ndarray) -> np.ndarray:
        """The condition's value at ln(alpha/start), with plates ln(k/reference), and the materials' parameters."""
        wall = self.projection.equivalent_at(*materials_at(self.case, self.names, y[1 + self.flux :]))
        values = [self.log_start + y[0] - math.log(wall.diffusivity)]
        if self.flux:
            values.append(self.log_conductivity + self.conductivity_std * y[1] - math.log(wall.conductivity))
        return np.array(values)


def conditioned(mean: np.ndarray, covariance: np.ndarray, condition: Any) -> tuple[np.ndarray, np.ndarray]:
    """A normal distribution under a condition `g(y) = 0`, linearised where it is fulfilled.

    Args:
        mean: `(param,)`. covariance: `(param, param)`.
        condition: g, a function of y with an array as value.

    Returns:
        mean and covariance under the condition.
    """
    y = mean
    gain = slope = np.zeros((0, 0))
    for _ in range(_ITERATIONS):
        steps = _STEP * np.eye(len(y))
        slope = np.stack([(condition(y + step) - condition(y - step)) / (2.0 * _STEP) for step in steps], axis=1)
        spread = slope @ covariance
        gain = np.linalg.solve(spread @ slope.T, spread).T
        following = mean - gain @ (condition(y) + slope @ (mean - y))
        done = np.max(np.abs(following - y)) < 1e-9
        y = following
        if done:
            break
    return y, covariance - gain @ slope @ covariance
