"""A section in two dimensions by finite elements, an independent reference for `wallid.models.section`.

Quadratic elements on quadrilaterals (scikit-fem), on lines of their own between the joints, stepped by the implicit
Radau method of order 3 (two stages) with given steps. No part of wallid is used: materials are given as rectangles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy
from skfem import Basis, BilinearForm, ElementQuad2, MeshQuad
from skfem.helpers import grad


@dataclass(frozen=True)
class Rectangle:
    """A rectangle of one material: `x`, `y` from, to in m; conductivity W/m/K; heat capacity J/m3/K."""

    x: tuple[float, float]
    y: tuple[float, float]
    conductivity: float
    heat_capacity: float


class ElementSection:
    """A section between two faces at given temperatures; its bottom and top are adiabatic.

    Args:
        length, height: m.
        rectangles: later ones lie over earlier ones.
        size: largest element, m.
    """

    def __init__(self, length: float, height: float, rectangles: Sequence[Rectangle], size: float):
        lines = []
        for end, ends in (
            (length, [v for r in rectangles for v in r.x]),
            (height, [v for r in rectangles for v in r.y]),
        ):
            joints = np.unique(np.round(np.clip([0.0, end, *ends], 0.0, end), 9))
            parts = [np.linspace(a, b, max(1, int(np.ceil((b - a) / size))) + 1)[:-1] for a, b in pairwise(joints)]
            lines.append(np.append(np.concatenate(parts), end))
        self.length = length
        self.basis = Basis(MeshQuad.init_tensor(*lines), ElementQuad2())

        def values(x: np.ndarray, name: str) -> np.ndarray:
            found = np.full(x[0].shape, np.nan)
            for one in rectangles:
                inside = (x[0] > one.x[0]) & (x[0] < one.x[1]) & (x[1] > one.y[0]) & (x[1] < one.y[1])
                found[inside] = getattr(one, name)
            return found

        @BilinearForm
        def conduction(u, v, w):
            k = values(w.x, "conductivity")
            return k * (grad(u)[0] * grad(v)[0] + grad(u)[1] * grad(v)[1])

        @BilinearForm
        def capacity(u, v, w):
            return values(w.x, "heat_capacity") * u * v

        self.K, self.M = conduction.assemble(self.basis).tocsc(), capacity.assemble(self.basis).tocsc()
        x = self.basis.doflocs[0]
        self.faces = np.flatnonzero(np.isclose(x, 0.0)), np.flatnonzero(np.isclose(x, length))
        self.free = np.setdiff1d(np.arange(len(x)), np.concatenate(self.faces))

    def _held(self, matrix: scipy.sparse.csc_matrix) -> np.ndarray:
        """The columns of a matrix at the faces, summed for each of them, at the free nodes."""
        rows = matrix[self.free]
        return np.stack([np.asarray(rows[:, face].sum(axis=1)).ravel() for face in self.faces], axis=1)

    def steady(self, faces: np.ndarray) -> np.ndarray:
        """The free nodes' temperatures between constant faces, degC."""
        free = self.K[self.free][:, self.free]
        return scipy.sparse.linalg.spsolve(free, -self._held(self.K) @ faces)

    @property
    def diffusivity(self) -> float:
        """Of the homogeneous wall with the same steady heat flow and heat capacity, m2/s."""
        full = np.zeros(self.K.shape[0])
        full[self.faces[0]], full[self.free] = 1.0, self.steady(np.array([1.0, 0.0]))
        flow = full @ (self.K @ full)  # the dissipation is the heat flow times the difference of temperatures, 1 K
        return float(flow * self.length**2 / (np.ones_like(full) @ (self.M @ np.ones_like(full))))

    def temperatures(self, faces: np.ndarray, step: float, points: np.ndarray, stride: int = 1) -> np.ndarray:
        """Temperatures at some points from a steady state on, every `stride` steps, degC, `(time, point)`.

        Args:
            faces: degC, `(time, 2)`; straight lines between their rows.
            step: from row to row, s. points: x, y, m, `(point, 2)`.
        """
        M, K = (part[self.free][:, self.free] for part in (self.M, self.K))
        M_held, K_held = self._held(self.M), self._held(self.K)
        state = self.steady(faces[0])
        probe = self.basis.probes(points.T).tocsr()
        from_free, from_faces = probe[:, self.free], np.stack(
            [np.asarray(probe[:, face].sum(axis=1)).ravel() for face in self.faces], axis=1
        )  # fmt: skip
        # Radau IIA with two stages: (I - h A x L) through the eigenvalues of A^-1, a complex pair
        A = np.array([[5.0, -1.0], [9.0, 3.0]]) / 12.0
        values, vectors = np.linalg.eig(np.linalg.inv(A))
        solver = scipy.sparse.linalg.splu((values[0] * M + step * K).tocsc())
        back = np.linalg.inv(vectors)
        result = [from_free @ state + from_faces @ faces[0]]
        for row, (before, after) in enumerate(pairwise(faces)):
            slope, third = after - before, before + (after - before) / 3.0
            # stages Z of M Z = h A (-K (x + Z) + f):  (A^-1 x M + h K) Z = h (f - K x)
            load = [step * (-K_held @ stage - K @ state) - M_held @ slope for stage in (third, after)]
            right = back @ np.stack(load)
            first = solver.solve(right[0])
            stages = vectors @ np.stack([first, first.conj()])
            state = state + stages[1].real
            if (row + 1) % stride == 0:
                result.append(from_free @ state + from_faces @ after)
        return np.array(result)
