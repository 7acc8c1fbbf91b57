"""The temperatures of all of a section at a time of a record."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..._internal.arrays import on_device
from ...case.case_definition import Case
from ...case.initial_profile import profile_degree, scales
from ...case.time_window import Window
from ..sensitivity_equations import simulate_window
from ..window_inputs import window_data
from .section_state_space import section_modes


def temperatures_at(case: Case, row: int, diffusivity: float | None = None) -> np.ndarray:
    """The temperatures of a section's nodes at a row of the record, simulated from its first row, degC, `(y, x)`.

    Args:
        case: with a section.
        row: of the record, above 0.
        diffusivity: of the equivalent wall, m2/s; None for that of the stated materials.

    Raises:
        ValueError: the case has no section.
        InputError: the record breaks before the row.
    """
    if case.section is None:
        raise ValueError("temperatures_at: the case has no section")
    modes = section_modes(case.section)
    data = window_data(case, Window(0, row + 1))
    states = modes.state_space((), profile_degree(case))
    all_modes = replace(
        states,
        C=np.eye(states.order),
        D=np.zeros((states.order, 2)),
        output_names=(),
    )
    fourier = scales(case).fourier_number(modes.equivalent.diffusivity if diffusivity is None else diffusivity)
    amplitudes = np.asarray(simulate_window(all_modes, on_device(fourier), data)[0])[-1]
    inputs = np.asarray(data.inputs)[-1, :2]
    return np.asarray(scales(case).celsius(modes.section.field(modes.vectors @ amplitudes, inputs)))
