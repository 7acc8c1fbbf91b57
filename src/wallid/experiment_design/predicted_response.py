"""What sensors at some places of a case's wall, and its flux plates, would see in some windows of its record.

Nothing but the faces is taken from the record, so that sensors can be thought of where there are none. A plate reads
`q L / k` here, K: what it says of the diffusivity does not depend on the conductivity then.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from .._internal.arrays import on_device
from ..case.case_definition import Case
from ..case.initial_profile import PROFILE_MODES, dimensionless_profile, fit_profile, profile_degree, scales
from ..inference.likelihood import face_response
from ..models.finite_volume_wall import Output, finite_volume_model
from ..models.flux_plates import plate_outputs
from ..models.integration import run_rows
from ..models.state_space import StateSpace


@dataclass(frozen=True, eq=False)
class PredictedResponse:
    """What sensors at some places, then the plates, would see in some windows at one diffusivity.

    Args:
        temperature: degC; of a plate q L / k, K. slope: its derivative by ln(alpha), K. gradient: dT/dx at the places,
            K/m.
        response: to 1 K more at one row of a face, 1.
        waves: the initial profile's modes as they fade, 1, each of them 1 at its start in the middle of its shape.
        faces: in each window, degC.
        places: m from the left face.
    """

    temperature: Float[np.ndarray, "window time output"]
    slope: Float[np.ndarray, "window time output"]
    gradient: Float[np.ndarray, "window time place"]
    response: Float[np.ndarray, "face time output"]
    waves: Float[np.ndarray, "mode time output"]
    faces: Float[np.ndarray, "window time face"]
    places: Float[np.ndarray, " place"]

    def until(self, rows: int) -> PredictedResponse:
        """The first so many rows."""
        timed = [field.name for field in fields(self) if field.name != "places"]
        return replace(self, **{name: getattr(self, name)[:, :rows] for name in timed})


class ResponseModel:
    """A case's large model with temperatures at some places, its plates, and gradients at these places.

    Args:
        places: m from the left face.
        refine: rows of the courses for each row of the record; the faces are straight lines between its rows.
    """

    def __init__(self, case: Case, places: Sequence[float], refine: int = 1):
        self.case, self.refine, self.places = case, refine, np.asarray(places, dtype=float)
        self.outputs = [*(Output(x) for x in places), *plate_outputs(case)]
        outputs = [*self.outputs, *(Output(x, "gradient") for x in places)]
        self.system = finite_volume_model(
            case.wall, outputs, nodes=case.choices.nodes, profile_degree=profile_degree(case)
        ).modal()
        self.scale = scales(case)

    def faces(self, start: int, rows: int) -> Float[np.ndarray, "time face"]:
        """The faces in a window, on straight lines between the record's rows, degC; held past the record's end."""
        own = np.asarray(self.case.record.faces[start : start + rows])
        own = np.pad(own, ((0, rows - len(own)), (0, 0)), mode="edge")
        if self.refine == 1:
            return own
        ends = np.arange((rows - 1) * self.refine + 1) / self.refine
        return np.stack([np.interp(ends, np.arange(rows), course) for course in own.T], axis=1)

    def predict(
        self, starts: np.ndarray, rows: int, diffusivity: float, faces: np.ndarray | None = None
    ) -> PredictedResponse:
        """The courses in windows that begin at these rows, with the record's faces or others in their place."""
        case, scale = self.case, self.scale
        faces = np.stack([self.faces(int(row), rows) for row in starts]) if faces is None else faces
        profiles = [fit_profile(case, int(row)) for row in starts]
        initial = np.stack([dimensionless_profile(profile.coefficients, scale) for profile in profiles])
        fourier, step = scale.fourier(diffusivity), case.record.step / scale.time / self.refine
        u, theta, response = _run(
            self.system,
            on_device(fourier),
            on_device(step),
            on_device(scale.dimensionless(faces)),
            on_device(initial),
        )
        P, outputs, modes = len(self.places), len(self.outputs), min(PROFILE_MODES, case.choices.nodes - 2)
        rates = np.asarray(self.system.A)[::-1][:modes]
        shapes = np.asarray(self.system.C)[:outputs, ::-1][:, :modes]
        fade = np.exp(fourier * step * np.outer(rates, np.arange(faces.shape[1])))
        u = np.asarray(u)
        return PredictedResponse(
            temperature=np.concatenate([scale.celsius(u[:, :, :P]), scale.temperature * u[:, :, P:outputs]], axis=2),
            slope=scale.temperature * fourier * np.asarray(theta)[:, :, :outputs],
            gradient=scale.temperature / case.wall.length * u[:, :, outputs:],
            response=np.asarray(response)[:, :, :outputs],
            waves=fade[:, :, None] * shapes.T[:, None, :],
            faces=faces,
            places=self.places,
        )


@eqx.filter_jit
def _run(
    system: StateSpace,
    fourier: Float[Array, ""],
    step: Float[Array, ""],
    inputs: Float[Array, "window time input"],
    initial: Float[Array, "window param"],
) -> tuple[Array, Array, Array]:
    """u and theta in each window, and the response to the faces: one compilation for all diffusivities."""

    def one(window: tuple[Array, Array]) -> tuple[Array, Array]:
        u, theta = run_rows(system, fourier, step, *window, sensitivity=True)
        assert theta is not None
        return u, theta

    u, theta = jax.lax.map(one, (inputs, initial))
    return u, theta, face_response(system, fourier, step, inputs.shape[1])


def held(response: np.ndarray, stride: int) -> np.ndarray:
    """The response to a face read every so many rows: a straight line up to a reading and down from it."""
    hat = 1.0 - np.abs(np.arange(1 - stride, stride)) / stride
    rows = response.shape[1]
    out = np.stack(
        [[np.convolve(column, hat)[stride - 1 : stride - 1 + rows : stride] for column in face.T] for face in response]
    )
    return out.transpose(0, 2, 1)
