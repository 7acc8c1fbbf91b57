"""The parameters of one window: the diffusivity, and the nuisance parameters of all kinds with their priors.

The kinds are offsets, position errors, common noise and others (`nuisance_kinds`). The amplitudes of the initial
profile (a polynomial fitted through few readings), the conductivity and the plates' calibrations are parts of the model
itself.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..case.case_definition import Case
from ..case.initial_profile import fit_profile, profile_mode_count, window_temperature_range
from ..case.time_window import Window
from ..models.flux_plates import flux_gain_std, fluxes_of
from ..models.state_space import StateSpace
from .likelihood import LOG_CONDUCTIVITY, LOG_DIFFUSIVITY, PLATE_GAIN, PROFILE_MODE, NuisanceModel
from .nuisance_kinds import (
    NUISANCE_KINDS,
    ContactResistances,
    FacePositions,
    Linearisation,
    NuisanceKind,
    SensorPositions,
)
from .parameters import Parameter, Parameters, kind_of, target_of

CONDUCTIVITY_STD = 3.0  # of ln(conductivity): a wide prior


def window_parameters(case: Case, window: Window, kinds: Sequence[NuisanceKind] = NUISANCE_KINDS) -> Parameters:
    """The diffusivity and all nuisance parameters of a window, each with its prior.

    In this order: the logarithm of the diffusivity over its prior value; the kinds; the amplitudes of the initial
    profile's modes, K, known exactly where the case gives the profile; and, with flux plates, the logarithm of the
    conductivity and the calibration error of each plate.

    Args:
        kinds: of nuisance parameters.
    """
    profile_known = fit_profile(case, window.row).eps_2 is None
    mode_std = 0.0 if profile_known else window_temperature_range(case, window)
    parameters = [Parameter(LOG_DIFFUSIVITY)]
    for kind in kinds:
        parameters += kind.parameters(case, window)
    modes = range(1, profile_mode_count(case) + 1)
    parameters += [Parameter(f"{PROFILE_MODE}[{k}]", "K", prior_std=mode_std / k) for k in modes]
    if plates := fluxes_of(case):
        parameters.append(Parameter(LOG_CONDUCTIVITY, prior_std=CONDUCTIVITY_STD))
        parameters += [Parameter(f"{PLATE_GAIN}[{face}]", prior_std=flux_gain_std(case)) for face in plates]
    return Parameters.of(parameters)


def instrument_error_kinds(kinds: Sequence[NuisanceKind]) -> tuple[str, ...]:
    """The names of the kinds that are constant errors of instruments, plates included."""
    return (*(kind.kind for kind in kinds if kind.is_instrument_error), PLATE_GAIN)


def describe_instrument_error(name: str) -> str:
    """An instrument error in words: "offset of T1", "position error of the left face's sensor"."""
    descriptions = {
        SensorPositions.kind: "position error of {}",
        ContactResistances.kind: "contact resistance at the {} face",
        FacePositions.kind: "position error of the {} face's sensor",
        PLATE_GAIN: "calibration of the {} plate",
    }
    kind = kind_of(name)
    default = kind.removeprefix("sensor_").replace("_", " ") + " of {}"
    return descriptions.get(kind, default).format(target_of(name))


def linearise_nuisance(
    point: Linearisation, kinds: Sequence[NuisanceKind], model: StateSpace, conductivity: float = 1.0
) -> NuisanceModel:
    """The effect of the nuisance parameters on the readings, linear about a point.

    Args:
        point: of the linearisation.
        kinds: of nuisance parameters.
        model: the case's full-order model with all outputs, at the estimates so far.
        conductivity: W/m/K, the reference value of a case with fluxes.
    """
    case, parameters = point.case, point.parameters
    effects = [kind.effect(names, point) for kind in kinds if (names := parameters.of_kind(kind.kind))]
    modes, plates = len(parameters.of_kind(PROFILE_MODE)), len(fluxes_of(case))
    change, slope = np.zeros((2, *point.shape))
    for effect in effects:
        change, slope = change + effect.change, slope + effect.change_slope
    return NuisanceModel(
        columns=np.concatenate([np.zeros((0, *point.shape)), *(effect.columns for effect in effects)]),
        linearised_at=np.concatenate([np.zeros(0), *(effect.linearised_at for effect in effects)]),
        change=change,
        change_slope=slope,
        log_alpha=math.log(point.diffusivity / case.wall.diffusivity_prior),
        rates=np.asarray(model.A)[::-1][:modes],
        shapes=np.asarray(model.C)[:, ::-1][:, :modes],
        flux=np.full(plates, conductivity / case.wall.length * float(point.data.temperature)),
        gains=point.gains,
        heat_by_gain=np.zeros((plates, point.shape[0], plates)),
    )
