"""The wall parameters that can be estimated besides the effective diffusivity: of layers, surface films, materials.

Each one is a logarithm with a normal prior about the case's value, in units of the prior standard deviation:

- `layers`: `ln(k_i / k_1)` of each layer after the first, about the case's ratio. Heat capacities are those of the
  case. The diffusivity of layer i is `alpha (k_i / k_eff) / (c_i / c_eff)`, so only the ratios of conductivities count.
- `film_left`, `film_right`: `ln(k / h)`, for a face whose column in the record is the air temperature. The prior mean
  has the case's `k` (1 W/m/K where it is not stated) and the standard film coefficient `h`.
- `conductivity of NAME`, `heat_capacity of NAME`: `ln(k)` and `ln(c)` of a material of a section, about the stated. The
  prior standard deviation is its `uncertainty`. The model scales with the diffusivity of the equivalent
  wall, so the readings depend on the ratios of conductivities and of capacities only.

Source: ISO 6946 for the surface coefficients.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..case.case_definition import Case
from ..case.initial_profile import profile_degree
from ..case.wall_and_sensors import Wall
from .finite_volume_wall import HeatProfile, Output, finite_volume_model, grid
from .section.section_state_space import SectionModes, section_modes, section_over_range
from .state_space import StateSpace

LAYER_STD = 0.5  # of ln(k_i / k_1)
FILM_STD = 1.0  # of ln(k / h)
R_INSIDE, R_OUTSIDE = 0.13, 0.04
"""Surface resistances inside and outside (ISO 6946), m2 K/W."""
MATERIAL_VALUES = ("conductivity", "heat_capacity")
"""Beginning of the names of a material's parameters, and their names as keys of the case."""
_BOUND = 4.0  # of the search, in prior standard deviations


def free_wall_parameters(case: Case) -> tuple[str, ...]:
    """The names of the wall parameters that a case estimates: "layer 2", "film_left"."""
    names: list[str] = []
    for choice in case.choices.free:
        layers = [f"layer {number}" for number in range(2, len(case.wall.layers) + 1)]
        names += layers if choice == "layers" else material_parameters(case) if choice == "materials" else [choice]
    return tuple(names)


def material_parameters(case: Case) -> list[str]:
    """The names of the values of a section's materials that are not known exactly."""
    materials = () if case.section is None else case.section.materials
    uncertain = [material.name for material in materials if material.uncertainty > 0.0]
    return [f"{kind} of {name}" for kind in MATERIAL_VALUES for name in uncertain]


def prior_std_of(case: Case, name: str) -> float:
    """Standard deviation of the prior of a wall parameter's logarithm."""
    kind, _, material = name.partition(" of ")
    if kind in MATERIAL_VALUES and case.section is not None:
        return next(one.uncertainty for one in case.section.materials if one.name == material)
    return LAYER_STD if name.startswith("layer") else FILM_STD


def clipped_to_prior(values: np.ndarray) -> np.ndarray:
    """Wall parameters (in prior standard deviations) within the bounds of the search."""
    return np.clip(values, -_BOUND, _BOUND)


def film_prior(case: Case, face: str) -> float:
    """The prior film length of a face: conductivity times its standard surface resistance, m."""
    k = case.wall.effective_conductivity
    return (1.0 if k is None else k) * (R_INSIDE if face == case.wall.inside else R_OUTSIDE)


def film_lengths_at(case: Case, names: Sequence[str], values: np.ndarray) -> tuple[float, float]:
    """Film lengths `k / h` at the left and the right face, m; 0 where none is estimated."""
    lengths = {name: film_prior(case, name[5:]) * math.exp(FILM_STD * z) for name, z in zip(names, values, strict=True)}
    return lengths.get("film_left", 0.0), lengths.get("film_right", 0.0)


def wall_at(case: Case, names: Sequence[str], values: np.ndarray) -> Wall:
    """The wall with its layers' conductivities at these parameters (in prior standard deviations)."""
    factors = np.ones(len(case.wall.layers))
    for name, value in zip(names, values, strict=True):
        if name.startswith("layer"):
            factors[int(name.split()[1]) - 1] = math.exp(LAYER_STD * value)
    layers = (
        replace(layer, conductivity=layer.conductivity * float(factor))
        for layer, factor in zip(case.wall.layers, factors, strict=True)
    )
    return replace(case.wall, layers=tuple(layers))


def layer_ratios(case: Case, names: Sequence[str], values: np.ndarray) -> np.ndarray:
    """Each layer's diffusivity over the wall's effective diffusivity."""
    return np.array([k / c for _, k, c in wall_at(case, names, values).relative_layers()])


def materials_at(case: Case, names: Sequence[str], values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Conductivities and heat capacities of a section's materials, W/m/K and J/m3/K, at these parameters."""
    assert case.section is not None
    factors = {name: math.exp(prior_std_of(case, name) * z) for name, z in zip(names, values, strict=True)}
    conductivity, heat_capacity = (
        np.array([getattr(one, kind) * factors.get(f"{kind} of {one.name}", 1.0) for one in case.section.materials])
        for kind in MATERIAL_VALUES
    )
    return conductivity, heat_capacity


def section_modes_at(case: Case, names: Sequence[str], values: np.ndarray) -> SectionModes:
    """The modes of a case's section at these parameters; without any, those of the stated materials."""
    assert case.section is not None
    if not names:
        return section_modes(case.section)
    return section_over_range(case.section).modes_at(*materials_at(case, names, values))


def model_at(
    case: Case,
    names: Sequence[str],
    values: np.ndarray,
    outputs: Sequence[Output],
    *,
    contacts: tuple[float, float] = (0.0, 0.0),
    heat: Sequence[HeatProfile] = (),
) -> StateSpace:
    """The full-order model at these parameters, in its modes, on the nodes of the case's own wall.

    Args:
        case: the case.
        names, values: of the wall's parameters, in prior standard deviations.
        outputs: of the model.
        contacts: length of wall with the resistance between each face and its sensor, m.
        heat: profiles of heat, as inputs after the boundary temperatures.
    """
    if case.section is not None:
        return section_modes_at(case, names, values).state_space(outputs, profile_degree(case), heat)
    films = film_lengths_at(case, names, values)
    return finite_volume_model(
        wall_at(case, names, values),
        outputs,
        nodes=case.choices.nodes,
        profile_degree=profile_degree(case),
        film=(films[0] + contacts[0], films[1] + contacts[1]),
        node_positions=grid(case.wall, case.choices.nodes),
        heat=heat,
    ).modal()
