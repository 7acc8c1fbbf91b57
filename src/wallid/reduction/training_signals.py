"""From a case's window to its reduced model: what to learn from, and of which order."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np

from .._internal.errors import InputError
from ..case.case_definition import Case
from ..case.initial_profile import dimensionless_profile, profile_degree, scales
from ..case.time_window import MIN_FACE_RANGE, HasBestWindow, Window, as_window
from ..models.flux_plates import conductance_of, flux_noise_std, plate_outputs
from ..models.integration import Integrator
from ..models.window_inputs import full_order_model
from .modal_identification import LearnedModel, choose_order, learn_system
from .variable_projection import TrainingSignals

_MOST_ROWS = 1000  # to learn from: three days of a row a minute would take a minute


def learn(
    case: Case,
    window: Window | HasBestWindow,
    order: int | Literal["auto"] | None = None,
    *,
    plates: bool | None = None,
    tied: bool = True,
    integrator: Integrator = "propagator",
    on_try: Callable[[LearnedModel], None] = lambda learned: None,
) -> LearnedModel:
    """A reduced model for a window of a case, of the case's order or another.

    Args:
        order: None for the case's; "auto" for the smallest whose error is under a tenth of the
            smallest noise and whose sensitivity is within 1 %.
        plates: whether the faces' fluxes are outputs too, after the sensors; None for where there is no sensor. A flux
            needs faster modes than a temperature inside, which of the same order then knows less.
        tied: one H for field and sensitivity; False leaves H_theta free (the paper).
        integrator: how the signals' rows are stepped through.
        on_try: with "auto", told of each order.

    Raises:
        InputError: neither face moves in the window.
    """
    window = as_window(window)
    order = case.choices.order if order is None else order
    outputs = plate_outputs(case) if plates or (plates is None and not case.sensors) else []
    lom, signals = full_order_model(case, outputs), training_signals(case, window)
    if order == "auto":
        noise = [sensor.noise_std for sensor in case.sensors]
        noise += [flux_noise_std(case) / conductance_of(case)] if outputs else []
        tolerance = 0.1 * min(noise) / scales(case).temperature
        return choose_order(lom, signals, tolerance=tolerance, tied=tied, integrator=integrator, on_try=on_try)
    return learn_system(lom, order, signals, tied=tied, integrator=integrator)


def training_signals(case: Case, window: Window) -> TrainingSignals:
    """What the reduced model of a window learns from.

    The case's own learning signals where it lists some. Otherwise, at each learning diffusivity:
    each face's course over the window alone (from rest), so that both columns of G are learned; of
    many rows only some, between which the course goes straight: a model learned from them is as good. A
    face that stands still in the window borrows the other's course. In both cases each
    coefficient of the initial profile that is no steady state alone, with faces that meet it.
    """
    scale = scales(case)
    count, every = profile_degree(case) + 1, 1
    runs: list[tuple[float, np.ndarray, np.ndarray]] = []
    if case.learning:
        step = float(case.learning[0].time[1] - case.learning[0].time[0])
        for signal in case.learning:
            given = np.asarray(signal.coefficients, float)
            initial = dimensionless_profile(np.pad(given, (0, count - len(given))), scale)
            runs.append((signal.diffusivity, np.asarray(scale.dimensionless(signal.faces)), initial))
        diffusivities = sorted({signal.diffusivity for signal in case.learning})
    else:
        part = case.record.window(window.row, window.rows)
        every = -(-window.rows // _MOST_ROWS)
        step = every * part.step
        courses = [course[::every] / scale.temperature for course in _face_courses(np.asarray(part.faces))]
        diffusivities = list(case.choices.learning_diffusivities or ())
        runs += [(alpha, course, np.zeros(count)) for alpha in diffusivities for course in courses]
    rows = runs[0][1].shape[0] if case.learning else -(-window.rows // every)
    # a straight line is at rest in a homogeneous wall: the model has it without learning
    for degree in range(1 if case.wall.layers else 2, count):
        faces = np.tile([0.0, 1.0], (rows, 1))
        runs += [(alpha, faces, np.eye(count)[degree]) for alpha in diffusivities]
    if not runs:
        raise InputError(
            "record: neither face moves in this window, so a reduced model has nothing to learn from; "
            'take another window, or [choices] model = "lom"'
        )
    return TrainingSignals(
        fourier=np.array([scale.fourier_number(alpha) for alpha, _, _ in runs]),
        step=step / scale.time,
        inputs=np.stack([faces for _, faces, _ in runs]),
        initial=np.stack([initial for _, _, initial in runs]),
    )


def _face_courses(faces: np.ndarray) -> list[np.ndarray]:
    """Each face alone, from its first value, with the other one at rest; none where both stand still."""
    moves = faces - faces[0]
    still = np.ptp(moves, axis=0) < MIN_FACE_RANGE
    courses = []
    for side in (0, 1) if not still.all() else ():
        course = np.zeros_like(moves)
        course[:, side] = moves[:, 1 - side if still[side] else side]
        courses.append(course)
    return courses
