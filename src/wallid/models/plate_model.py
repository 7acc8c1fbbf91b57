"""The full-order model of a case with its sensors and flux plates as outputs."""

from __future__ import annotations

import numpy as np

from ..case.case_definition import Case
from .finite_volume_wall import Output
from .flux_plates import plate_outputs
from .state_space import StateSpace
from .wall_parameters import free_wall_parameters, model_at
from .window_inputs import full_order_model


def full_order_model_with_plates(
    case: Case, structure: np.ndarray | None = None, *, gradients: bool = False
) -> StateSpace:
    """The case's large model with the sensors, then the plates, as outputs.

    Args:
        structure: where the wall's own parameters are that are free, prior standard deviations; None for 0.
        gradients: at the sensors come last.
    """
    more = [*plate_outputs(case), *(Output(sensor.position, "gradient") for sensor in case.sensors if gradients)]
    names = free_wall_parameters(case)
    if not names:
        return full_order_model(case, more)
    sensors = [Output(sensor.position, name=sensor.name) for sensor in case.sensors]
    return model_at(case, names, np.zeros(len(names)) if structure is None else structure, [*sensors, *more])
