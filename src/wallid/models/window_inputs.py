"""A window of a case as model inputs and weighted readings, and the full-order model of a case."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._internal.arrays import is_traced, on_device
from .._internal.errors import InputError
from ..case.case_definition import Case
from ..case.initial_profile import dimensionless_profile, fit_profile, profile_degree, scales
from ..case.scaling import Scales
from ..case.time_window import MIN_FACE_RANGE, Window, check_unbroken, entire_record
from ..case.wall_and_sensors import SIDES, Wall
from ..records.reading_pipeline import PLATES
from .finite_volume_wall import HeatProfile, Output, finite_volume_model
from .section.section_state_space import section_modes
from .state_space import StateSpace


class WindowData(eqx.Module):
    """The inputs of a model over one window, and the readings it is compared with.

    Args:
        step: of the rows, in t_ref.
        inputs: dimensionless boundary temperatures (left, right), then their slopes per t_ref, by which they are cubics
            between rows; without slopes, `(time, 2)`, straight lines.
        initial: dimensionless coefficients of the initial profile in x*.
        observed: readings of the sensors, degC, 0 where missing; plates' fluxes after them, W/m2.
        weight: of each reading, one over its standard deviation, 1/K; 0 where missing.
        offset_std: prior standard deviation of each sensor's constant offset, K; 0 where none is estimated.
        profile_per_offset: change of the initial profile, which is fitted through readings, with each sensor's offset,
            1/K; zero for a profile that is given.
        temperature, temperature_min: T = temperature_min + temperature u.
        offsets: indices of the sensors whose offset is estimated.
    """

    step: Float[Array, ""] = eqx.field(converter=on_device)
    inputs: Float[Array, "time column"] = eqx.field(converter=on_device)
    initial: Float[Array, " param"] = eqx.field(converter=on_device)
    observed: Float[Array, "time sensor"] = eqx.field(converter=on_device)
    weight: Float[Array, "time sensor"] = eqx.field(converter=on_device)
    offset_std: Float[Array, " sensor"] = eqx.field(converter=on_device)
    profile_per_offset: Float[Array, "param sensor"] = eqx.field(converter=on_device)
    temperature: Float[Array, ""] = eqx.field(converter=on_device)
    temperature_min: Float[Array, ""] = eqx.field(converter=on_device)
    offsets: tuple[int, ...] = eqx.field(static=True, default=())

    def celsius(self, u: Array) -> Array:
        """The temperatures in degC of dimensionless ones."""
        return self.temperature_min + self.temperature * u

    def starting_from(self, initial: Float[Array, " param"]) -> WindowData:
        """The same window from another initial profile."""
        return eqx.tree_at(lambda data: data.initial, self, initial)

    @property
    def time(self) -> Float[Array, " time"]:
        """The rows' times in t_ref, from the window's start."""
        return self.step * jnp.arange(self.inputs.shape[0])


def boundary_inputs(
    scale: Scales, faces: Float[np.ndarray, "*rows face"], slopes: Float[np.ndarray, "*rows face"]
) -> Float[np.ndarray, "*rows column"]:
    """The inputs of a model that are cubics between rows: dimensionless boundary temperatures, then their slopes.

    Args:
        faces: boundary temperatures, degC.
        slopes: their rates of change at the rows, K/s.
    """
    return np.concatenate([scale.dimensionless(faces), slopes * (scale.time / scale.temperature)], axis=-1)


def window_data(case: Case, window: Window | None = None, *, weighted: bool = True) -> WindowData:
    """The model inputs and the readings of a window of a case.

    Args:
        window: None for the entire record, interpolated across its breaks.
        weighted: whether each reading is weighted by its sensor's noise; False gives the paper's plain sum of squares
            (one noise for all readings, the root mean square of the sensors').

    Raises:
        InputError: no inner sensor has a reading in the window, or the record breaks in it.
    """
    if window is None:
        window = Window(0, case.record.rows)
    else:
        check_unbroken(case, window)
    part = case.record.window(window.row, window.rows)
    scale = scales(case)
    noise = np.array([sensor.noise_std for sensor in case.sensors])
    if not weighted:
        noise = np.full_like(noise, np.sqrt(np.mean(noise**2)))
    profile = fit_profile(case, window.row)
    offset_std = np.array([sensor.offset_std for sensor in case.sensors])
    present = np.isfinite(part.sensors)
    if not present.any() and not (part.regressors.keys() & set(PLATES)):
        raise InputError(
            f"{case.record.file}: no inner sensor has a reading from {part.stamp(0)} on, over {window.rows} rows; "
            "take another window"
        )
    return WindowData(
        step=part.step / scale.time,
        inputs=boundary_inputs(scale, part.faces, case.record.face_slopes[window.as_slice]),
        initial=dimensionless_profile(profile.coefficients, scale),
        observed=np.where(present, part.sensors, 0.0),
        weight=present / noise,
        offset_std=offset_std,
        profile_per_offset=profile.coefficients_per_reading / scale.temperature,
        temperature=scale.temperature,
        temperature_min=scale.temperature_min,
        offsets=tuple(int(s) for s in np.flatnonzero(offset_std > 0)),
    )


def sensor_outputs(
    case: Case, kind: Literal["temperature", "gradient"] = "temperature", positions: Sequence[float] | None = None
) -> list[Output]:
    """The outputs of a model at the inner sensors of a case.

    Args:
        case: the case.
        kind: of the outputs.
        positions: of the sensors, m from the left face; None for the stated ones.
    """
    positions = [sensor.position for sensor in case.sensors] if positions is None else positions
    return [
        Output(position, kind, sensor.name, sensor.height)
        for sensor, position in zip(case.sensors, positions, strict=True)
    ]


def full_order_model(
    case: Case, extra: Sequence[Output] = (), *, cells: Sequence[int] | None = None, heat: tuple[HeatProfile, ...] = ()
) -> StateSpace:
    """The full-order model of a case: `U' = Fo (A U + B Q)`, `Y = C U + D Q`, in its modes, with a diagonal A.

    A section in two dimensions has too many nodes for its modes: its model is projected first (`section_modes`).

    JAX may trace the values of the wall and the positions of the sensors. Where it traces the layers, the model is in
    its nodes, with a dense A: a derivative of modes is not defined where two of them have the same eigenvalue.

    Args:
        case: the wall, its sensors and the options.
        extra: further outputs, after the sensors.
        cells: the number of cells of each layer, from `wallid.models.layer_cells`; None for those of the case's own
            layers. It is needed where a compiled or vectorised function traces the layers.
        heat: profiles of heat, as inputs after the boundary temperatures.

    Returns:
        a state space with the two boundary temperatures as inputs.

    Raises:
        InputError: the case has no inner sensor, or fewer nodes than its layers need.
        ValueError: `cells` does not fit the layers, or is needed and missing.
    """
    if not case.sensors and not extra:
        raise InputError(
            f"{case.path}: no [[sensor]]: this needs a temperature inside the wall; `wallid run`, `wallid design` and "
            "`wallid estimate` take a case with heat flux alone"
        )
    outputs, nodes, degree = (*sensor_outputs(case), *extra), case.choices.nodes, profile_degree(case)
    if case.section is not None:
        return section_modes(case.section).state_space(outputs, degree, heat)
    layers = [value for layer in case.wall.layers for value in vars(layer).values()]
    if cells is None and not is_traced(*vars(case.wall).values(), *layers, *(output.position for output in outputs)):
        return _model_in_modes(case.wall, outputs, nodes, degree, heat)
    model = finite_volume_model(case.wall, outputs, nodes=nodes, profile_degree=degree, cells=cells, heat=heat)
    return model if is_traced(*layers) else model.modal()


def order_of_full_model(case: Case) -> int:
    """The number of states of `full_order_model`."""
    return case.choices.nodes - 2 if case.section is None else len(section_modes(case.section).rates)


@lru_cache(maxsize=32)
def _model_in_modes(
    wall: Wall, outputs: tuple[Output, ...], nodes: int, degree: int, heat: tuple[HeatProfile, ...]
) -> StateSpace:
    """The model in its modes, built once for all that use it in a run."""
    return finite_volume_model(wall, outputs, nodes=nodes, profile_degree=degree, heat=heat).modal()


def check_driven(model: StateSpace, case: Case, window: Window | None = None) -> None:
    """Refuse a reduced-order model that was learned without one of the faces that vary in a window.

    Raises:
        InputError: such a face varies in this window, or differs from the initial profile.
    """
    window = entire_record(case) if window is None else window
    faces = np.asarray(case.record.window(window.row, window.rows).faces)
    coefficients = fit_profile(case, window.row).coefficients
    ends = np.array([coefficients[0], coefficients.sum()])
    largest = np.max(np.abs(faces - ends), axis=0)
    for side, name in enumerate(SIDES):
        if not model.driven[side] and largest[side] > MIN_FACE_RANGE:
            raise InputError(
                f"record: the {name} face differs by up to {largest[side]:.3g} K from the initial profile, and the "
                f"reduced-order model was learned without the {name} face; add a learning signal in which it "
                'varies ([[learning.signal]]), or use [choices] model = "lom"'
            )
