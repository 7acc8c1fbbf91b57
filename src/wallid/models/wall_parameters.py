"""What of a wall itself may be free beside its effective diffusivity: its layers, and films where faces read air.

Each parameter is a logarithm with a normal prior about what the case states, in units of its standard deviation:

- `layers`: `ln(k_i / k_1)` of each layer beyond the first, about the stated ratio. Only ratios move relative to the
  effective diffusivity: the diffusivity of layer i is `alpha (k_i / k_eff) / (c_i / c_eff)`, its capacity as stated.
- `film_left`, `film_right`: `ln(k / h)` about `k` of the wall (1 W/m/K where it is not stated) over the standard
  coefficient: the column of that face is the air's temperature.

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
from .finite_volume_wall import Output, finite_volume_model, grid
from .state_space import StateSpace

LAYER_STD = 0.5  # of ln(k_i / k_1)
FILM_STD = 1.0  # of ln(k / h)
_COEFFICIENT = {"inside": 1 / 0.13, "outside": 1 / 0.04}  # W/m2/K
_FARTHEST = 4.0  # prior standard deviations: no search goes beyond


def free_wall_parameters(case: Case) -> tuple[str, ...]:
    """The names of what is free: "layer 2", "film_left"."""
    names: list[str] = []
    for choice in case.choices.free:
        if choice != "layers":
            names.append(choice)
        else:
            names += [f"layer {place}" for place in range(2, len(case.wall.layers) + 1)]
    return tuple(names)


def std_of(name: str) -> float:
    """Of the prior of a parameter's logarithm."""
    return LAYER_STD if name.startswith("layer") else FILM_STD


def clipped_to_prior(values: np.ndarray) -> np.ndarray:
    """Parameters no farther from their priors than a search goes."""
    return np.clip(values, -_FARTHEST, _FARTHEST)


def film_prior(case: Case, face: str) -> float:
    """Conductivity over the standard film coefficient of a face, m."""
    k = case.wall.effective_conductivity
    return (1.0 if k is None else k) / _COEFFICIENT["inside" if face == case.wall.inside else "outside"]


def film_at(case: Case, names: Sequence[str], values: np.ndarray) -> tuple[float, float]:
    """Film lengths at the left and the right face, m; 0 where none is free."""
    found = {name: film_prior(case, name[5:]) * math.exp(FILM_STD * z) for name, z in zip(names, values, strict=True)}
    return found.get("film_left", 0.0), found.get("film_right", 0.0)


def wall_at(case: Case, names: Sequence[str], values: np.ndarray) -> Wall:
    """The wall with its layers' conductivities at these parameters; its length and prior are as they were."""
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
    """Each layer's diffusivity over the wall's effective one, 1."""
    return np.array([k / c for _, k, c in wall_at(case, names, values).relative_layers()])


def model_at(case: Case, names: Sequence[str], values: np.ndarray, outputs: Sequence[Output]) -> StateSpace:
    """The large model at these parameters, in its modes, on the nodes of the case's own wall."""
    return finite_volume_model(
        wall_at(case, names, values),
        outputs,
        nodes=case.choices.nodes,
        profile_degree=profile_degree(case),
        film=film_at(case, names, values),
        places=grid(case.wall, case.choices.nodes),
    ).modal()
