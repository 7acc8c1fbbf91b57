"""A section's full-order model as an estimate would have to use it without a reduced one: stepped, or in all its modes.

    E x' = a (K x + B q),      theta = dx / d ln(a):      E theta' = a K theta + a (K x + B q)

Stepped by the implicit Radau method of order 5 (three stages). Two sparse decompositions, a real and a complex one,
serve all steps at one diffusivity, the temperatures and the sensitivity, which is exactly the derivative of the stepped
temperatures.

Source: E. Hairer, G. Wanner, Solving Ordinary Differential Equations II (1996), IV.5 and IV.8.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

import wallid
from wallid.case.initial_profile import profile_degree, scales
from wallid.models.section import SectionModel, SectionModes, SectionPoint, equivalent_wall, full_order_section
from wallid.models.section.affine_model import Factorised
from wallid.models.window_inputs import sensor_outputs

_ROOT = np.sqrt(6.0)
_RADAU = np.array(
    [
        [(88.0 - 7.0 * _ROOT) / 360.0, (296.0 - 169.0 * _ROOT) / 1800.0, (-2.0 + 3.0 * _ROOT) / 225.0],
        [(296.0 + 169.0 * _ROOT) / 1800.0, (88.0 + 7.0 * _ROOT) / 360.0, (-2.0 - 3.0 * _ROOT) / 225.0],
        [(16.0 - _ROOT) / 36.0, (16.0 + _ROOT) / 36.0, 1.0 / 9.0],
    ]
)
_STAGES = _RADAU.sum(axis=1)


@dataclass(frozen=True, eq=False)
class FullOrderModel:
    """The full-order model of a case's section, its sensors as outputs; materials keep their stated ratios.

    Args:
        case: with a section.
    """

    case: wallid.Case

    @cached_property
    def section(self) -> SectionModel:
        """On the mesh of the section, with its sensors."""
        points = [SectionPoint(one.position, one.height, one.name) for one in self.case.sensors]
        return full_order_section(self.case.section, points)

    @cached_property
    def diffusivity(self) -> float:
        """Of the equivalent wall of the stated materials, m2/s."""
        wall = equivalent_wall(self.section)
        assert wall is not None
        return wall.diffusivity

    @cached_property
    def start(self) -> np.ndarray:
        """The state for a unit of each coefficient of the initial profile: 1, the steady state, and so on."""
        own, mesh = self.section, self.section.mesh
        E, K, B = own.model.at(own.conductivity, own.heat_capacity)
        x = np.tile(mesh.x / own.section.length, len(mesh.y))[own.unknown]
        solver, fields = Factorised(-K), []
        for power in range(own.model.P.shape[1]):
            bend = power * (power - 1) * x ** max(power - 2, 0) * self.diffusivity / own.section.length**2
            fields.append(solver.solve(B @ np.array([float(power == 0), 1.0]) - E @ bend))
        return np.stack(fields, axis=1)

    def response(self, diffusivity: float, data: wallid.models.WindowData) -> tuple[np.ndarray, np.ndarray]:
        """The dimensionless temperatures of the sensors and their derivatives by ln(alpha), `(time, sensor)`.

        One step from row to row.

        Args:
            diffusivity: alpha, m2/s.
            data: of the window, with faces that are cubics between rows.
        """
        own, model = self.section, self.section.model
        E, K, B = model.at(own.conductivity, own.heat_capacity)
        h = scales(self.case).time * float(data.step) * diffusivity / self.diffusivity  # s, at the stated values
        inputs = np.asarray(data.inputs)
        stages = _Stages(E, K, h)
        x = self.start[:, : len(data.initial)] @ np.asarray(data.initial)
        theta = np.zeros_like(x)
        result = [(model.C @ x + model.D @ inputs[0, :2], model.C @ theta)]
        for at_stages in _at_stages(inputs, float(data.step)):
            heat = B @ at_stages.T
            change = stages(h * ((K @ x)[:, None] + heat))
            driven = h * (K @ (x[:, None] + change) + heat)
            theta = theta + stages(h * (K @ theta)[:, None] + driven)[:, -1]
            x = x + change[:, -1]
            result.append((model.C @ x + model.D @ at_stages[-1], model.C @ theta))
        u, slope = (np.array(part) for part in zip(*result, strict=True))
        return u, slope

    def in_modes(self) -> wallid.StateSpace:
        """All modes of the model, by a dense decomposition, as a state space of its full order."""
        own = self.section
        E, K, _ = own.model.at(own.conductivity, own.heat_capacity)
        root = np.sqrt(E.diagonal())
        scaled = K.toarray()
        scaled /= root[:, None]
        scaled /= root
        rates, vectors = scipy.linalg.eigh(scaled, overwrite_a=True, check_finite=False, driver="evd")
        wall = equivalent_wall(own)
        assert wall is not None
        total = wall.heat_capacity * own.section.length * own.section.height
        vectors *= np.sqrt(total) / root[:, None]
        profile = (E @ vectors / total).T @ self.start
        modes = SectionModes(own, own.conductivity, own.heat_capacity, wall, rates, vectors, profile)
        return modes.state_space(sensor_outputs(self.case), profile_degree(self.case))


class _Stages:
    """The changes Z of the state at the stages of a step, from the rates F at its start: `E A^-1 Z = h K Z + F`."""

    def __init__(self, E: scipy.sparse.sparray, K: scipy.sparse.sparray, h: float):
        values, vectors = np.linalg.eig(np.linalg.inv(_RADAU))
        back = np.linalg.inv(vectors)
        # a complex pair counts twice by its real part
        self.parts = []
        for value, vector, row in zip(values, vectors.T, back, strict=True):
            if value.imag > 1e-9:
                self.parts.append((Factorised((value * E - h * K).tocsc()).solve, 2.0 * vector, row))
            elif value.imag > -1e-9:
                self.parts.append((Factorised((value.real * E - h * K).tocsc()).solve, vector.real, row.real))

    def __call__(self, rates: np.ndarray) -> np.ndarray:
        """Z for F, `(state, stage)`."""
        return sum(np.real(np.outer(solve(rates @ row), vector)) for solve, vector, row in self.parts)


def _at_stages(inputs: np.ndarray, step: float) -> np.ndarray:
    """The faces at the stages of all steps, by the cubics of their values and slopes at rows, `(step, stage, face)`."""
    cubics = scipy.interpolate.CubicHermiteSpline(step * np.arange(len(inputs)), inputs[:, :2], inputs[:, 2:])
    return cubics(step * (np.arange(len(inputs) - 1)[:, None] + _STAGES))
