"""The predicted response of sensors at any positions, and of the flux plates, in windows of a record.

Only the face temperatures are taken from the record, so the sensors need not exist. A flux is scaled to `q L / k`, K,
which makes its information on the diffusivity independent of the conductivity.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Literal

import equinox as eqx
import jax
import numpy as np
import scipy
from jaxtyping import Array, Float

from .._internal.arrays import on_device
from ..case.case_definition import Case
from ..case.initial_profile import dimensionless_profile, fit_profile, profile_mode_count, scales
from ..inference.likelihood import face_response
from ..models.finite_volume_wall import Output
from ..models.flux_plates import plate_outputs
from ..models.integration import run_rows
from ..models.state_space import StateSpace
from ..models.wall_parameters import model_at
from ..models.window_inputs import boundary_inputs


@dataclass(frozen=True, eq=False)
class PredictedResponse:
    """The predicted response at one diffusivity; the outputs are the sensors, then the plates.

    Args:
        temperature: degC; of a plate q L / k, K.
        sensitivity: dT/d(ln alpha), K.
        gradient: dT/dx at the sensors, K/m.
        face_response: response to a face temperature that is 1 K higher at one row, dimensionless.
        initial_modes: the decaying modes of the initial profile, dimensionless; amplitude 1 at the window's start.
        faces: face temperatures in each window, degC.
        positions: of the sensors, m from the left face.
    """

    temperature: Float[np.ndarray, "window time output"]
    sensitivity: Float[np.ndarray, "window time output"]
    gradient: Float[np.ndarray, "window time sensor"]
    face_response: Float[np.ndarray, "face time output"]
    initial_modes: Float[np.ndarray, "mode time output"]
    faces: Float[np.ndarray, "window time face"]
    positions: Float[np.ndarray, " sensor"]

    def first_rows(self, rows: int) -> PredictedResponse:
        """The response in the first `rows` rows of each window."""
        timed = [field.name for field in fields(self) if field.name != "positions"]
        return replace(self, **{name: getattr(self, name)[:, :rows] for name in timed})


def _outputs_at(
    case: Case, positions: Sequence[float], kind: Literal["temperature", "gradient"] = "temperature"
) -> list[Output]:
    """The outputs at positions: of a sensor of the case at its height, of others the mean over a section's height."""
    heights = {number: sensor.height for number, sensor in enumerate(case.sensors)}
    own = [number < len(case.sensors) and x == case.sensors[number].position for number, x in enumerate(positions)]
    return [
        Output(x, kind, height=heights[number] if is_own else None)
        for number, (x, is_own) in enumerate(zip(positions, own, strict=True))
    ]


class ResponseModel:
    """The full-order model of a case, with temperatures and gradients at any positions and the plates' fluxes.

    Args:
        positions: of the sensors, m from the left face.
        refinement: time steps per row of the record; the face temperatures are cubics between rows.
    """

    def __init__(self, case: Case, positions: Sequence[float], refinement: int = 1):
        self.case, self.refinement, self.positions = case, refinement, np.asarray(positions, dtype=float)
        self.outputs = [*_outputs_at(case, positions), *plate_outputs(case)]
        self.system = model_at(case, (), np.zeros(0), [*self.outputs, *_outputs_at(case, positions, "gradient")])
        self.scale = scales(case)

    def faces(self, start: int, rows: int) -> tuple[Float[np.ndarray, "time face"], Float[np.ndarray, "time face"]]:
        """Face temperatures in a window, degC, and their rates of change, K/s; constant after the record's end."""
        record = self.case.record
        given = [np.asarray(part[start : start + rows]) for part in (record.faces, record.face_slopes)]
        beyond = (0, rows - len(given[0])), (0, 0)
        faces, slopes = np.pad(given[0], beyond, mode="edge"), np.pad(given[1], beyond)
        if self.refinement == 1:
            return faces, slopes
        times = record.step * np.arange((rows - 1) * self.refinement + 1) / self.refinement
        cubics = scipy.interpolate.CubicHermiteSpline(record.step * np.arange(rows), faces, slopes)
        return cubics(times), cubics.derivative()(times)

    def predict(
        self,
        starts: np.ndarray,
        rows: int,
        diffusivity: float,
        faces: Sequence[tuple[np.ndarray, np.ndarray]] | None = None,
    ) -> PredictedResponse:
        """The predicted response in several windows.

        Args:
            starts: first rows of the windows, `(window,)`. rows: of the record in each window.
            diffusivity: m2/s.
            faces: face temperatures, degC, and their slopes, K/s, in each window; None for those of the record.
        """
        case, scale = self.case, self.scale
        faces = [self.faces(int(row), rows) for row in starts] if faces is None else faces
        values, slopes = (np.stack(part) for part in zip(*faces, strict=True))
        profiles = [fit_profile(case, int(row)) for row in starts]
        initial = np.stack([dimensionless_profile(profile.coefficients, scale) for profile in profiles])
        fourier, step = scale.fourier_number(diffusivity), case.record.step / scale.time / self.refinement
        u, theta, response = _run(
            self.system,
            on_device(fourier),
            on_device(step),
            on_device(boundary_inputs(scale, values, slopes)),
            on_device(initial),
        )
        P, outputs, modes = len(self.positions), len(self.outputs), profile_mode_count(case)
        rates = np.asarray(self.system.A)[::-1][:modes]
        shapes = np.asarray(self.system.C)[:outputs, ::-1][:, :modes]
        decay = np.exp(fourier * step * np.outer(rates, np.arange(values.shape[1])))
        u = np.asarray(u)
        return PredictedResponse(
            temperature=np.concatenate([scale.celsius(u[:, :, :P]), scale.temperature * u[:, :, P:outputs]], axis=2),
            sensitivity=scale.temperature * fourier * np.asarray(theta)[:, :, :outputs],
            gradient=scale.temperature / case.wall.length * u[:, :, outputs:],
            face_response=np.asarray(response)[:, :, :outputs],
            initial_modes=decay[:, :, None] * shapes.T[:, None, :],
            faces=values,
            positions=self.positions,
        )


@eqx.filter_jit
def _run(
    system: StateSpace,
    fourier: Float[Array, ""],
    step: Float[Array, ""],
    inputs: Float[Array, "window time column"],
    initial: Float[Array, "window param"],
) -> tuple[Array, Array, Array]:
    """u and theta in each window, and the face response; compiled once for all diffusivities."""

    def one(window: tuple[Array, Array]) -> tuple[Array, Array]:
        u, theta = run_rows(system, fourier, step, *window, sensitivity=True)
        assert theta is not None
        return u, theta

    u, theta = jax.lax.map(one, (inputs, initial))
    return u, theta, face_response(system, fourier, step, inputs.shape[1])


def response_to_sampled_faces(response: np.ndarray, stride: int) -> np.ndarray:
    """The response to faces that are read every `stride` rows and interpolated linearly between two readings."""
    hat = 1.0 - np.abs(np.arange(1 - stride, stride)) / stride
    sampled = slice(stride - 1, stride - 1 + response.shape[1], stride)
    return np.stack([[np.convolve(column, hat)[sampled] for column in face.T] for face in response]).transpose(0, 2, 1)
