"""The model of a fit's readings for the Kalman filter: the same likelihood as the dense covariance, row by row.

The readings minus the fit's prediction are, in the states of the model,

    y_t = c (C x_t + D (e_t + a_t)) + J_t beta + b_t + v_t

`x` are the wall's modes with the states of the disturbance (`models.disturbance`). `e` and `a` are the white and the
autocorrelated part of the noise of the faces, which goes through the wall with straight lines between rows. `b` is the
autocorrelated noise of the sensors, `v` their white noise. `beta` are the deviations of the estimated parameters from
the fit, constant, with their priors; offsets, calibrations and the initial profile are among them. So are the mean of
the disturbance, and the errors that have one size over a gap of a face or over the window (`noise_of_record`). `c` are
K or W/m2 for one unit of the model's outputs.

Between its rows a face is in error by a process with a known autocovariance (`records.face_variation`). In the filter
it is an autoregression of second order with the same variance and the same first two lags.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Float

from .._internal.arrays import on_device
from ..case.case_definition import Case
from ..case.time_window import Window
from ..models.disturbance import GaussianStep, MaternProcess, gaussian_step
from ..models.flux_plates import face_noise_of_model
from .disturbance_covariance import HEAT_PROFILES, DisturbedReadings, disturbed_readings
from .disturbance_search import Disturbance
from .gls_fit import GLSFit
from .kalman_filter import Filtered, LinearGaussianModel, Smoothed, covariance_root, kalman_filter, kalman_smoother
from .likelihood import LOG_CONDUCTIVITY, PLATE_GAIN, predicted_jacobian
from .noise_covariance import variance_of_mean
from .noise_of_record import courses_of_face_errors, response_to_faces
from .nuisance_kinds import contact_lengths

_UNKNOWN_STD = 3.0  # of ln(alpha), which has no prior
_SMALLEST_STD = 1e-9  # of a reading over its noise, so that no reading is exact


@dataclass(frozen=True, eq=False)
class FilterModel:
    """The filter's model of a window, and its readings.

    Args:
        model: of the states.
        readings: measured minus predicted by the fit, K or W/m2, 0 where missing, `(time, output)`.
        present: where there is a reading.
        disturbance: the states whose sum is the heat, each with its size in the unit of the disturbance; None without
            one.
        unit: of the disturbance.
    """

    model: LinearGaussianModel
    readings: np.ndarray
    present: np.ndarray
    disturbance: tuple[tuple[int, float], ...] | None
    unit: str

    def filtered(self, rows: int | None = None) -> Filtered:
        """The states given the readings up to each row, of the first rows."""
        rows = len(self.readings) if rows is None else rows
        return kalman_filter(self.model.first_rows(rows), *self._data(rows))

    def smoothed(self) -> Smoothed:
        """The states given all readings."""
        return kalman_smoother(self.model, self.filtered(), *self._data(len(self.readings)))

    def _data(self, rows: int) -> tuple:
        return on_device(self.readings[:rows]), jnp.asarray(self.present[:rows])

    def smoothed_heat(self) -> tuple[np.ndarray, np.ndarray]:
        """The course of the disturbance given all readings and its standard deviation, in `unit`, `(time,)`.

        Raises:
            ValueError: the fit has no disturbance.
        """
        if self.disturbance is None:
            raise ValueError("smoothed_heat: the fit has no disturbance")
        row = np.zeros(len(self.model.transition))
        for state, unit in self.disturbance:
            row[state] = unit
        smoothed = self.smoothed()
        return np.asarray(smoothed.mean) @ row, np.linalg.norm(row @ np.asarray(smoothed.root), axis=1)


@dataclass(frozen=True, eq=False)
class FittedReadings:
    """What the filter's model is made of: the readings of a fit, its noise, its disturbance and its parameters.

    Args:
        sensor_std: stated standard deviations of the noise of the readings.
        face_courses: effect of one standard deviation of each gap's interpolation, and of how the faces bend between
            their rows (`courses_of_face_errors`), `(time, output, error)`.
        face_noise: as from `FaceNoise.limited` at the noise found, K2, `(face, lag)`.
        face_errors: autocovariance of what each face does between its rows, K2, `(face, lag)`.
        spacing: in rows, from one row with readings to the next.
        white, autocorrelated, correlation: of the noise at the rows with readings, as in `NoiseCovariance`.
        disturbance: found in the readings; or None.
        residual: measured minus predicted, K or W/m2, `(time, output)`.
        present: where there is a reading.
        jacobian: of the predictions, by the parameters over `unit`, `(time, output, param)`.
        prior_std: of the parameters over `unit`.
        deviation: the parameters' estimates minus the means of their priors, over `unit`.
    """

    sensor_std: np.ndarray
    face_courses: np.ndarray
    face_noise: np.ndarray
    face_errors: np.ndarray
    spacing: int
    white: float
    autocorrelated: float
    correlation: float
    disturbance: Disturbance | None
    residual: np.ndarray
    present: np.ndarray
    jacobian: np.ndarray
    prior_std: np.ndarray
    deviation: np.ndarray

    def beside(self, disturbance: Disturbance) -> FittedReadings:
        """The same readings with another disturbance, and the noise that was found beside it."""
        white, autocorrelated = disturbance.noise_variances
        return replace(self, disturbance=disturbance, white=white, autocorrelated=autocorrelated)


def filter_model(case: Case, window: Window, fit: GLSFit) -> FilterModel:
    """The filter's model of the window of a fit.

    Args:
        case, window: of the fit.
        fit: its noise, the errors of the faces, its disturbance and the priors of its parameters are the model's.
    """
    return filter_model_of(fitted_readings(case, window, fit), readings_at(case, fit))


def alternative_filter_models(case: Case, window: Window, fit: GLSFit) -> list[tuple[float, FilterModel]]:
    """The filter's model for each probable disturbance of a fit, with its probability; one without a disturbance.

    Args:
        case, window, fit: as for `filter_model`.
    """
    if fit.disturbance is None:
        return [(1.0, filter_model(case, window, fit))]
    fitted, readings = fitted_readings(case, window, fit), readings_at(case, fit)
    return [(share, filter_model_of(fitted.beside(one), readings)) for share, one in fit.disturbance.alternatives]


def fitted_readings(case: Case, window: Window, fit: GLSFit) -> FittedReadings:
    """The readings of a fit, with what was fitted."""
    data = fit.problem.data
    noise = fit.noise if fit.disturbance is not None else fit.robust or fit.noise  # robust noise holds the heat too
    prior_std, deviation = np.ones(len(fit.z)), fit.deviation.copy()
    prior_std[0], deviation[0] = _UNKNOWN_STD, 0.0
    face_errors = face_noise_of_model(case)[1]
    record = case.record.window(window.row, window.rows)
    return FittedReadings(
        sensor_std=fit.noise_shape.sensor_std,
        face_courses=courses_of_face_errors(record, response_at_rows(case, window, fit), face_errors),
        face_noise=fit.noise_shape.face_noise.limited(noise.white, noise.autocorrelated, noise.correlation),
        face_errors=face_errors.autocovariance,
        spacing=fit.problem.bins.rows_per_bin // fit.noise_shape.rows_per_bin,
        white=noise.white,
        autocorrelated=noise.autocorrelated,
        correlation=noise.correlation,
        disturbance=fit.disturbance,
        residual=np.asarray(data.observed) - np.asarray(fit.minimum.predicted),
        present=np.asarray(data.weight) > 0,
        jacobian=np.asarray(predicted_jacobian(fit.problem, fit.minimum.vector))[:, :, fit.estimated_indices],
        prior_std=prior_std,
        deviation=deviation,
    )


def filter_model_of(fitted: FittedReadings, readings: DisturbedReadings) -> FilterModel:
    """The filter's model of fitted readings.

    Args:
        fitted: the readings with what was fitted.
        readings: how heat changes them.
    """
    disturbance, present = fitted.disturbance, fitted.present
    size = 0.0 if disturbance is None else disturbance.std * readings.unit_rate
    time_constant = readings.reference_time if disturbance is None else disturbance.time_constant
    smoothness = "matern-1/2" if disturbance is None else disturbance.smoothness
    process = MaternProcess(size, time_constant / readings.reference_time, smoothness)
    column = 2 + (0 if disturbance is None else HEAT_PROFILES.index(disturbance.profile))
    wall = gaussian_step(readings.slow, readings.fourier, readings.step, process, column, cubic=False)
    states = _States(wall, readings)
    states.add_wall()
    for side, own in enumerate(fitted.face_noise):
        states.add_face_noise(math.sqrt(fitted.white * own[0]), _second_order(own), (side,))
    if fitted.autocorrelated > 0:
        total = math.sqrt(fitted.autocorrelated)
        by_row = fitted.correlation ** (1.0 / fitted.spacing)
        # the mean of a face's noise over `spacing` rows has its variance over `spacing`, as in the dense covariance
        of_mean = variance_of_mean(by_row, fitted.spacing)
        for side, own in enumerate(fitted.face_noise):
            variance = 2.0 * own @ by_row ** np.arange(len(own)) - own[0]
            std = total * math.sqrt(max(variance, 0.0) / (fitted.spacing * of_mean))
            states.add_face_noise(std, _product([by_row], _second_order(own)), (side,))
        states.add_sensor_noise(fitted.sensor_std * total, by_row)
    for side, autocovariance in enumerate(fitted.face_errors):
        if autocovariance[0] > 0:
            states.add_face_noise(math.sqrt(autocovariance[0]), _second_order(autocovariance), (side,))
    errors = fitted.face_courses.shape[2]
    columns = np.concatenate([fitted.jacobian, fitted.face_courses], axis=2)
    prior_std = np.append(fitted.prior_std, np.ones(errors))
    mean = np.append(-fitted.deviation, np.zeros(errors))
    if disturbance is not None:  # the mean of the heat, before the parameters
        mean_heat = disturbance.std * readings.of_constant_heat(disturbance.profile, len(present))
        columns = np.concatenate([mean_heat[:, :, None], columns], axis=2)
        prior_std, mean = np.append(1.0, prior_std), np.append(0.0, mean)
    outputs = states.add_constants(columns, prior_std)
    constant = len(states.transition) - len(prior_std)
    white = fitted.sensor_std * math.sqrt(fitted.white)
    model = LinearGaussianModel(
        transition=states.transition,
        noise_root=states.noise_root,
        initial_mean=np.concatenate([np.zeros(constant), mean]),
        initial_root=states.initial_root,
        outputs=outputs,
        output_std=np.maximum(white, _SMALLEST_STD * fitted.sensor_std),
    )
    heat = None
    if disturbance is not None:
        heat = ((readings.slow.order, 1.0 / readings.unit_rate), (constant, disturbance.std))
    return FilterModel(model, np.where(present, fitted.residual, 0.0), present, heat, readings.unit)


def readings_at(case: Case, fit: GLSFit) -> DisturbedReadings:
    """How heat changes the readings, by the full-order model at a fit."""
    parameters, (conductance, contacts) = fit.parameters, _conductance_and_contacts(case, fit)
    gains = np.asarray(parameters.vector(parameters.of_kind(PLATE_GAIN)))
    return disturbed_readings(
        case, fit.problem.data, fit.diffusivity,
        conductance=conductance, contacts=contacts, wall=fit.wall, gains=gains,
    )  # fmt: skip


def response_at_rows(case: Case, window: Window, fit: GLSFit) -> Float[np.ndarray, "face row output"]:
    """The readings' response to 1 K more at one row of one face, over the window of a fit, K or W/m2."""
    conductance, contacts = _conductance_and_contacts(case, fit)
    problem = fit.problem
    return response_to_faces(
        case, problem.system, fit.diffusivity, problem.data.step, window.rows,
        conductance=conductance, contacts=contacts, wall=fit.wall,
    )  # fmt: skip


def _conductance_and_contacts(case: Case, fit: GLSFit) -> tuple[float, tuple[float, float]]:
    """Conductivity over length, W/m2/K, 0 without plates; and each face's contact resistance as a length of wall, m."""
    parameters = fit.parameters
    if LOG_CONDUCTIVITY not in parameters:
        return 0.0, (0.0, 0.0)
    reference = float(fit.problem.nuisance.flux[0]) / float(fit.problem.data.temperature)
    values = np.asarray(parameters.vector(fit.contacts))
    contacts = contact_lengths(reference * case.wall.length, fit.contacts, values)
    return reference * math.exp(float(parameters[LOG_CONDUCTIVITY])), contacts


def _second_order(autocovariance: np.ndarray) -> list[float]:
    """The coefficients of an autoregression with these first lags (Yule and Walker); none where it is white or zero."""
    if autocovariance[0] <= 0.0:
        return []
    lags = np.pad(autocovariance, (0, 3))[:3] / autocovariance[0]
    if abs(lags[1]) < 1e-12 and abs(lags[2]) < 1e-12:
        return []
    first, second = scipy.linalg.solve_toeplitz(lags[:2], lags[1:])
    return [float(first), float(second)] if abs(second) > 1e-12 else [float(first)]


def _product(one: list[float], other: list[float]) -> list[float]:
    """The coefficients of the autoregression whose spectrum is the product of those of two."""
    first, second = ([1.0, *(-value for value in coefficients)] for coefficients in (one, other))
    return [-float(value) for value in np.convolve(first, second)[1:]]


class _States:
    """The states of the filter's model, added part by part."""

    def __init__(self, wall: GaussianStep, readings: DisturbedReadings):
        self.wall, self.readings = wall, readings
        self.W0, self.W1 = np.asarray(wall.W0), np.asarray(wall.W1)
        self.outputs_count = len(np.asarray(wall.C))
        self.transition = self.noise_root = self.initial_root = np.zeros((0, 0))
        self.C = np.zeros((self.outputs_count, 0))

    def _append(self, transition: np.ndarray, noise: np.ndarray, initial: np.ndarray, C: np.ndarray) -> None:
        """Independent states after the ones that are there."""
        self.transition = scipy.linalg.block_diag(self.transition, transition)
        self.noise_root = scipy.linalg.block_diag(self.noise_root, noise)
        self.initial_root = scipy.linalg.block_diag(self.initial_root, initial)
        self.C = np.concatenate([self.C, C], axis=1)

    def add_wall(self) -> None:
        """The wall's modes, and the disturbance."""
        wall = self.wall
        noise, initial = covariance_root(np.asarray(wall.noise)), covariance_root(np.asarray(wall.initial))
        self._append(np.asarray(wall.transition), noise, initial, self.readings.scale[:, None] * np.asarray(wall.C))
        self.wall_states = len(self.transition)

    def add_face_noise(self, std: float, coefficients: list[float], sides: tuple[int, ...] = (0, 1)) -> None:
        """Noise of the faces as an autoregression, which enters the wall on straight lines between rows.

        Args:
            std: K. coefficients: of the autoregression; none for white noise.
            sides: 0 for the left face, 1 for the right one.
        """
        if std == 0.0:
            return
        order = max(1, len(coefficients))
        companion = np.eye(order, k=-1)
        companion[0, : len(coefficients)] = coefficients
        stationary = _stationary_covariance(companion, std / self.readings.temperature)
        step = stationary - companion @ stationary @ companion.T
        innovation = math.sqrt(max(float(step[0, 0]), 0.0))
        for side in sides:
            first = len(self.transition)
            own = covariance_root(stationary)
            direct = self.readings.scale * np.asarray(self.wall.D)[:, side]
            C = np.zeros((self.outputs_count, order))
            C[:, 0] = direct
            self._append(companion, np.eye(order, 1) * innovation, own, C)
            # x_{t+1} = .. + W0 e_t + W1 e_{t+1}
            rows = slice(0, self.wall_states)
            self.transition[rows, first] += self.W0[:, side]
            self.transition[rows, first : first + order] += np.outer(self.W1[:, side], companion[0])
            self.noise_root[rows, -1] += self.W1[:, side] * innovation
            columns = slice(self.initial_root.shape[1] - own.shape[1], None)
            self.initial_root[rows, columns] += np.outer(self.W1[:, side], own[0])

    def add_sensor_noise(self, std: np.ndarray, correlation: float) -> None:
        """Autocorrelated noise of each reading, `(output,)`."""
        count = len(std)
        innovation = math.sqrt(1.0 - correlation**2)
        self._append(correlation * np.eye(count), innovation * np.diag(std), np.diag(std), np.eye(count))

    def add_constants(self, columns: np.ndarray, prior_std: np.ndarray) -> np.ndarray:
        """States that are constant, such as the deviations of the parameters.

        Args:
            columns: of the readings, by each of them, `(time, output, constant)`.
            prior_std: of each.

        Returns:
            the outputs of all states at each row, `(time, output, state)`.
        """
        rows, outputs, count = columns.shape
        self._append(np.eye(count), np.zeros((count, 0)), np.diag(prior_std), np.zeros((outputs, count)))
        each = np.broadcast_to(self.C, (rows, *self.C.shape)).copy()
        each[:, :, -count:] = columns
        return each


def _stationary_covariance(companion: np.ndarray, std: float) -> np.ndarray:
    """The covariance of an autoregression's states, for a standard deviation of its value."""
    innovation = np.zeros_like(companion)
    innovation[0, 0] = 1.0
    covariance = scipy.linalg.solve_discrete_lyapunov(companion, innovation)
    return covariance * std**2 / covariance[0, 0]
