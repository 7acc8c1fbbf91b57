"""A linear model that is affine in the conductivity and in the heat capacity of each material.

    (sum_m c_m E_m) x' = (K_0 + sum_m k_m K_m) x + (B_0 + sum_m k_m B_m) q,      x(0) = P a
    y = C x + D q

`q` are the temperatures given at the two faces. The full-order model of a section and its projections are of this one
class: the full one has sparse matrices, a projected one dense ones. All `E` and `-K` are symmetric; their sums are
positive definite.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy

Matrix = Any  # a NumPy array or a sparse array of SciPy


@dataclass(frozen=True, eq=False)
class AffineModel:
    """Matrices of a model, a part for each material.

    Args:
        capacity: E_m, `(state, state)`, m2; of a full-order model diagonal.
        conduction: K_m, `(state, state)`, 1.
        drive: B_m, `(state, input)`, 1.
        film: K_0, the surface resistances' part, W/m/K. film_drive: B_0.
        C, D: outputs, `(output, state)` and `(output, input)`.
        P: the initial state for a unit of each coefficient of the initial profile, `(state, param)`.
        output_names: one for each output.
    """

    capacity: tuple[Matrix, ...]
    conduction: tuple[Matrix, ...]
    drive: tuple[np.ndarray, ...]
    film: Matrix
    film_drive: np.ndarray
    C: Matrix
    D: np.ndarray
    P: np.ndarray
    output_names: tuple[str, ...]

    @property
    def order(self) -> int:
        """The number of states."""
        return self.film_drive.shape[0]

    @property
    def is_sparse(self) -> bool:
        """Whether the matrices are sparse."""
        return scipy.sparse.issparse(self.film)

    def at(self, conductivity: np.ndarray, heat_capacity: np.ndarray) -> tuple[Matrix, Matrix, np.ndarray]:
        """E, K and B for values of the materials, W/m/K and J/m3/K."""
        E = sum((c * part for c, part in zip(heat_capacity, self.capacity, strict=True)), 0.0 * self.capacity[0])
        K = sum((k * part for k, part in zip(conductivity, self.conduction, strict=True)), self.film)
        return E, K, self.drive_at(conductivity)

    def drive_at(self, conductivity: np.ndarray) -> np.ndarray:
        """B for conductivities of the materials, W/m/K."""
        return sum((k * part for k, part in zip(conductivity, self.drive, strict=True)), self.film_drive)

    def projected(self, basis: np.ndarray) -> AffineModel:
        """The model on the columns of a basis, which keeps it symmetric and affine.

        Args:
            basis: V, `(state, mode)`; `x` is about `V z`.
        """
        E, K = ([basis.T @ (part @ basis) for part in parts] for parts in (self.capacity, self.conduction))
        weight = sum(self.capacity[1:], self.capacity[0])
        mass = basis.T @ (weight @ basis)
        return replace(
            self,
            capacity=tuple(0.5 * (part + part.T) for part in E),
            conduction=tuple(0.5 * (part + part.T) for part in K),
            drive=tuple(basis.T @ part for part in self.drive),
            film=basis.T @ (self.film @ basis),
            film_drive=basis.T @ self.film_drive,
            C=np.asarray(self.C @ basis),
            P=np.linalg.solve(mass, basis.T @ (weight @ self.P)),
        )


class Factorised:
    """A symmetric positive definite matrix, decomposed to solve with it; sparse or dense."""

    def __init__(self, matrix: Matrix):
        if scipy.sparse.issparse(matrix):
            # a symmetric ordering, and no pivoting: less fill for matrices of this kind
            options = {"SymmetricMode": True}
            decomposed = scipy.sparse.linalg.splu(
                matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options
            )
            self.solve = decomposed.solve
        else:
            decomposed = scipy.linalg.lu_factor(matrix)
            self.solve = lambda b: scipy.linalg.lu_solve(decomposed, b)
