"""The training signals of a window, and the reduced-order model learned from them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np

from .._internal.errors import InputError
from .._internal.progress import Progress, part_of, shown_progress
from ..case.case_definition import Case
from ..case.initial_profile import dimensionless_profile, profile_degree, scales
from ..case.time_window import MIN_FACE_RANGE, HasBestWindow, Window, as_window
from ..models.flux_plates import flux_noise_std, plate_outputs, wall_conductance
from ..models.integration import Integrator
from ..models.window_inputs import full_order_model
from ..records.uniform_record import cubic_slopes
from .modal_identification import LearnedModel, choose_order, learn_system
from .variable_projection import TrainingSignals

_MAX_ROWS = 1000  # of a signal: three days of one row a minute would take a minute to learn from


def learn(
    case: Case,
    window: Window | HasBestWindow,
    order: int | Literal["auto"] | None = None,
    *,
    plates: bool | None = None,
    tied: bool = True,
    integrator: Integrator = "propagator",
    on_try: Callable[[LearnedModel], None] = lambda learned: None,
    progress: Progress | None = None,
) -> LearnedModel:
    """A reduced-order model for a window of a case.

    Args:
        window: the window, or a design, whose best window is taken.
        order: None for the case's; "auto" for the smallest order whose error is below a tenth of the smallest noise
            and whose sensitivity is within 1 %.
        plates: whether the fluxes at the plates are outputs too, after the sensors; None: only in a case without
            sensors. A flux needs faster modes than a temperature inside, so the temperatures are less accurate then.
        tied: one H for field and sensitivity; False learns H_theta separately (the paper).
        integrator: how the signals' rows are stepped through.
        on_try: with "auto", called with each model tried.
        progress: called as `progress(text, share)` with the step that begins and the completed share, 0 to 1;
            None for a bar in a notebook, and nothing elsewhere.

    Returns:
        the model with its errors.

    Raises:
        InputError: neither face varies in the window.

    Example:
        `model = wallid.learn(case, wallid.design(case))`

    Source: Berger and Kadoch, Section 3.2.
    """
    window = as_window(window)
    order = case.choices.order if order is None else order
    outputs = plate_outputs(case) if plates or (plates is None and not case.sensors) else []
    with shown_progress(progress) as report:
        report("learn: the full-order model and its training signals", 0.0)
        model, signals = full_order_model(case, outputs), training_signals(case, window)
        searching = part_of(report, 0.1, 1.0)
        if order == "auto":
            noise = [sensor.noise_std for sensor in case.sensors]
            noise += [flux_noise_std(case) / wall_conductance(case)] if outputs else []
            tolerance = 0.1 * min(noise) / scales(case).temperature
            return choose_order(
                model,
                signals,
                tolerance=tolerance,
                tied=tied,
                integrator=integrator,
                on_try=on_try,
                progress=searching,
            )
        return learn_system(model, order, signals, tied=tied, integrator=integrator, progress=searching)


def training_signals(case: Case, window: Window) -> TrainingSignals:
    """The signals that the reduced-order model of a window is learned from.

    The case's own learning signals, if it has any. Otherwise, at each learning diffusivity, the variation of each face
    alone over the window, from a steady state, so that both columns of G are learned. Of a long window only every so
    many rows are used. The signals are cubics between rows, as a case's faces are. A face that is constant takes the
    other face's variation. In both cases there is one more signal for each coefficient of the initial profile that is
    not a steady state.
    """
    scale = scales(case)
    count, stride = profile_degree(case) + 1, 1
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
        stride = -(-window.rows // _MAX_ROWS)
        step = stride * part.step
        signals = [signal[::stride] / scale.temperature for signal in _face_signals(np.asarray(part.faces))]
        diffusivities = list(case.choices.learning_diffusivities or ())
        runs += [(alpha, signal, np.zeros(count)) for alpha in diffusivities for signal in signals]
    rows = runs[0][1].shape[0] if case.learning else -(-window.rows // stride)
    # a straight line is a steady state of a homogeneous wall: it need not be learned
    for degree in range(1 if case.wall.layers else 2, count):
        faces = np.tile([0.0, 1.0], (rows, 1))
        runs += [(alpha, faces, np.eye(count)[degree]) for alpha in diffusivities]
    if not runs:
        raise InputError(
            "record: neither face varies in this window, so there is nothing to learn a reduced-order model from; "
            'take another window, or [choices] model = "lom"'
        )
    return TrainingSignals(
        fourier=np.array([scale.fourier_number(alpha) for alpha, _, _ in runs]),
        step=step / scale.time,
        inputs=np.stack(
            [np.concatenate([faces, cubic_slopes(faces, step / scale.time)], axis=1) for _, faces, _ in runs]
        ),
        initial=np.stack([initial for _, _, initial in runs]),
    )


def _face_signals(faces: np.ndarray) -> list[np.ndarray]:
    """The variation of each face from its first value, the other one constant; none where both are constant."""
    variation = faces - faces[0]
    constant = np.ptp(variation, axis=0) < MIN_FACE_RANGE
    signals = []
    for side in (0, 1) if not constant.all() else ():
        signal = np.zeros_like(variation)
        signal[:, side] = variation[:, 1 - side if constant[side] else side]
        signals.append(signal)
    return signals
