"""The forcing data of a window of a case."""

from __future__ import annotations

import numpy as np

from .._internal.arrays import on_device
from .._internal.units import DAY
from ..case.case_definition import Case
from ..case.initial_profile import fit_profile, profile_mode_count
from ..case.time_window import Window
from ..case.wall_and_sensors import SIDES
from ..inference.common_noise import common_noise_of_face
from ..models.finite_volume_wall import Output, layer_nodes, wall_cells
from ..models.flux_plates import faces_of_model, fluxes_of
from ..models.window_inputs import full_order_model
from ..records.uniform_record import Record, cubic_coefficients, cubic_slopes
from .effects.equation_terms import ForcingData


def forcing_of_window(case: Case, window: Window) -> ForcingData:
    """The forcing data of a window: cubics between its rows, the cells of the wall and its initial profile.

    Args:
        case: the wall in one dimension, and its sensors.
        window: the rows used.
    """
    record, wall = case.record.window(window.row, window.rows), case.wall
    rows = np.arange(record.rows)

    def cubic(values: np.ndarray, slopes: np.ndarray | None = None) -> np.ndarray:
        """Coefficients of the powers of s, (interval, power); slopes per row, None for those of the values alone."""
        present = np.isfinite(values)
        filled = values if present.all() else np.interp(rows, rows[present], values[present])
        slopes = cubic_slopes(filled, 1.0) if slopes is None else slopes
        return cubic_coefficients(filled, slopes)

    zeros = np.zeros(record.rows)

    def regressor(key: str) -> np.ndarray:
        values = record.regressors.get(key)
        return cubic(zeros if values is None or not np.isfinite(values).any() else values)

    heating = record.regressors.get("heating", zeros)
    largest = np.nanmax(np.abs(heating)) if np.isfinite(heating).any() else 0.0
    relative_positions, resistance, capacity = wall_cells(wall, case.choices.nodes)
    positions = wall.length * relative_positions
    faces, slopes = (part[window.as_slice] for part in faces_of_model(case))
    slopes = record.step * slopes
    coefficients = fit_profile(case, window.row).coefficients
    every_node = full_order_model(case, [Output(x) for x in positions[1:-1]])
    temperatures = np.concatenate([record.faces.ravel(), record.sensors.ravel()])
    return ForcingData(
        step=on_device(record.step),
        faces=on_device(np.stack([cubic(faces[:, side], slopes[:, side]) for side in (0, 1)], axis=-1)),
        irradiance=on_device(regressor("irradiance")),
        outdoor=on_device(regressor("air_outdoor")),
        indoor=on_device(regressor("air_indoor")),
        heating=on_device(regressor("heating") / (largest or 1.0)),
        hour=on_device(hours_of_day(record)[:-1]),
        initial=on_device(np.polynomial.polynomial.polyval(relative_positions[1:-1], coefficients)),
        profile_modes=on_device(np.asarray(every_node.C)[len(case.sensors) :, ::-1][:, : profile_mode_count(case)]),
        common_noise=on_device(np.stack([common_noise_of_face(record, side) for side in SIDES], axis=1)),
        reference=on_device(np.nanmean(temperatures)),
        node_positions=on_device(positions),
        resistance=on_device(wall.length * resistance),
        capacity=on_device(wall.length * capacity),
        layer_nodes=on_device(layer_nodes(wall, relative_positions)),
        sensor_positions=on_device(np.array([sensor.position for sensor in case.sensors])),
        length=on_device(wall.length),
        plates=tuple(SIDES.index(face) for face in fluxes_of(case)),
    )


def hours_of_day(record: Record) -> np.ndarray:
    """Hour of the day of each row by the clock of the record; hours since the first row where it has only seconds."""
    stamps = record.stamps
    if np.issubdtype(stamps.dtype, np.datetime64):
        since = (stamps - stamps.astype("datetime64[D]")) / np.timedelta64(1, "s")
        return np.asarray(since, float) / 3600.0
    return np.mod(np.asarray(stamps, float), DAY) / 3600.0
