"""A reduced-order model of a section by projection, valid over the priors of its materials.

The full-order model `E(c) x' = K(k) x + B(k) q` is projected on a basis V of few columns (`krylov_basis`):

    V' E_m V,   V' K_m V,   V' B_m,   C V

so it stays symmetric, stable, and affine in the conductivity and the capacity of each material. The order is the
smallest whose measured error is below a tolerance: at values of the materials and at frequencies that are not among the
snapshots, the transfer functions of the full and of the reduced model are compared.

Source: A. C. Antoulas, Approximation of Large-Scale Dynamical Systems (2005), 11.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..._internal.progress import Progress, shown_progress
from .affine_model import AffineModel, Factorised
from .krylov_basis import DAY, Values, log_frequencies, orthonormal_basis, snapshots
from .material_range import MaterialRange

_SHIFTS = 8
_FASTEST = 3.0  # times the shortest period: of the fastest shift; faster ones cost directions that sensitivities need
_SAMPLES = 12  # values of the materials with snapshots
_TESTED = 4  # values of the materials, unseen, beside the one at which the section is slowest
_TESTED_FREQUENCIES = 7
_ORDERS = (10, 15, 20, 25, 30, 40, 50, 60, 80, 100)  # that an order of None is chosen from


@dataclass(frozen=True, eq=False)
class ReducedSection:
    """A reduced-order model of a section.

    Args:
        model: dense, affine in the materials.
        error: largest error of an output over the tested values and frequencies, K, for an input of 1 K at periods of a
            day and more, and in proportion to the period below.
        theta_error: the same of its derivatives by the logarithm of each conductivity and capacity, over the largest
            value of each.
        materials: the range of the materials.
    """

    model: AffineModel
    error: float
    theta_error: float
    materials: MaterialRange

    @property
    def order(self) -> int:
        """The number of states."""
        return self.model.order


def reduce_section(
    model: AffineModel,
    materials: MaterialRange,
    *,
    order: int | None = None,
    tolerance: float = 1e-4,
    periods: tuple[float, float] = (3600.0, 30.0 * 86400.0),
    seed: int = 0,
    progress: Progress | None = None,
) -> ReducedSection:
    """A reduced-order model of a section's full-order model.

    Args:
        model: full-order, with its outputs.
        materials: values over which it is to hold.
        order: number of states; None for the smallest whose error is below the tolerance, or the largest that is tried.
        tolerance: of the error, K.
        periods: of the inputs, shortest and longest, s.
        seed: of the values of the materials.
        progress: called as `progress(text, share)`; None for a bar in a notebook, and nothing elsewhere.
    """
    with shown_progress(progress) as report:
        points = np.vstack([np.zeros((1, 2 * len(materials.log_std))), materials.points(_SAMPLES - 1, seed)])
        shifts = log_frequencies(_FASTEST * periods[0], periods[1], _SHIFTS)
        columns = snapshots(
            model, [materials.at(point) for point in points], shifts, lambda text, share: report(text, 0.6 * share)
        )
        report("reduce: basis", 0.6)
        basis = orthonormal_basis(model, columns, max(_ORDERS) if order is None else order)
        report("reduce: error of the reduced model", 0.7)
        tests = _ErrorTest(model, materials, periods, seed + 1)
        reduced, error, theta_error = model, np.inf, np.inf
        for tried in _ORDERS if order is None else (order,):
            reduced = model.projected(basis[:, :tried])
            error, theta_error = tests.errors(reduced)
            if error < tolerance or tried >= basis.shape[1]:
                break
        return ReducedSection(reduced, error, theta_error, materials)


class _ErrorTest:
    """The transfer functions of a full-order model at unseen values of the materials and frequencies."""

    def __init__(self, model: AffineModel, materials: MaterialRange, periods: tuple[float, float], seed: int):
        points = [*materials.points(_TESTED, seed), materials.slowest]
        self.values = [materials.at(point) for point in points]
        self.frequencies = [0.0, *log_frequencies(*periods, _TESTED_FREQUENCIES)]
        self.exact = [self._transfer(model, values) for values in self.values]

    def errors(self, reduced: AffineModel) -> tuple[float, float]:
        """The largest error of the outputs, and of their derivatives over the largest of each."""
        pairs = [
            (self._transfer(reduced, values), exact) for values, exact in zip(self.values, self.exact, strict=True)
        ]
        difference = np.max([np.abs(own - exact) for own, exact in pairs], axis=(0, 1, 3, 4))
        size = np.max([np.abs(exact) for _, exact in pairs], axis=(0, 1, 3, 4))
        return float(difference[0]), float(np.max(difference[1:] / np.maximum(size[1:], 1e-300)))

    def _transfer(self, model: AffineModel, values: Values) -> np.ndarray:
        """From the inputs to the outputs: value and derivatives, `(frequency, 1 + 2 material, output, input)`.

        With `X = (s E - K)^-1 B` the derivative by `ln k_m` is `C (s E - K)^-1 k_m (K_m X + B_m)`, and that by `ln c_m`
        is `-C (s E - K)^-1 c_m s E_m X`.
        """
        k, c = values
        E, K, B = model.at(k, c)
        result = []
        for frequency in self.frequencies:
            s = 1j * frequency
            solver = Factorised(s * E - K)
            X = solver.solve(B.astype(complex))
            right = [k_m * (K_m @ X + B_m) for k_m, K_m, B_m in zip(k, model.conduction, model.drive, strict=True)]
            right += [-c_m * s * (E_m @ X) for c_m, E_m in zip(c, model.capacity, strict=True)]
            each = [model.C @ X + model.D, *(model.C @ solver.solve(one) for one in right)]
            result.append(np.array(each) / (1.0 + frequency / DAY))
        return np.array(result)
