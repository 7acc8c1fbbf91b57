"""Whether a record shows a resistance between a face with a plate and the face's sensor: a score test.

With `c` the change of the readings by a small resistance, whitened and projected on what the parameters do not explain,
and `r` the whitened residual of a fit without it:

    z = c' r / |c|

which is normal where there is no resistance. A resistance is positive, so only a positive z counts.

Source: C. R. Rao, Proc. Camb. Phil. Soc. 44 (1948), 50.
"""

from __future__ import annotations

import numpy as np

from .._internal.arrays import on_device
from ..case.case_definition import Case
from ..case.initial_profile import scales
from ..models.flux_plates import fluxes_of, full_order_model_with_plates
from ..models.sensitivity_equations import simulate_window
from .gls_fit import GLSFit
from .likelihood import LOG_CONDUCTIVITY

SIGNIFICANT = 3.0
"""Standard deviations of the score, from which on contact resistances are tried: one false alarm in 700.

Beside a disturbance they must also explain as much as is asked of a disturbance (`generalised_least_squares`)."""
_SMALL = 2e-3  # of the length: a resistance whose effect is linear


def contact_scores(case: Case, fit: GLSFit) -> dict[str, float]:
    """The score of each plate's contact resistance, in standard deviations.

    Args:
        case: with plates.
        fit: without contact resistances.
    """
    problem = fit.problem
    fourier = on_device(scales(case).fourier_number(fit.diffusivity))
    scale = np.full(problem.bins.observed.shape[1], float(problem.data.temperature))
    plates = fluxes_of(case)
    assert LOG_CONDUCTIVITY in fit.parameters
    scale[-len(plates) :] = np.asarray(problem.flux_scale(fit.minimum.vector))

    def readings(contacts: tuple[float, float]) -> np.ndarray:
        model = full_order_model_with_plates(case, fit.wall, contacts=contacts)
        u = simulate_window(model, fourier, problem.data)[0]
        return np.asarray(problem.bins.mean(on_device(scale * np.asarray(u))))

    without, small = readings((0.0, 0.0)), _SMALL * case.wall.length
    basis, _ = np.linalg.qr(fit.jacobian / np.maximum(np.linalg.norm(fit.jacobian, axis=0), 1e-300))
    scores = {}
    for face in plates:
        change = readings((small, 0.0) if face == "left" else (0.0, small)) - without
        column = np.concatenate([fit.noise.whitening @ change, np.zeros(len(fit.z) - 1)])
        column = column - basis @ (basis.T @ column)
        scores[face] = float(column @ fit.whitened_residual / max(np.linalg.norm(column), 1e-300))
    return scores
