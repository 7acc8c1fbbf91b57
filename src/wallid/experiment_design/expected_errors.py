"""The standard errors that an estimate from a window will have, before it is made.

    std(ln p) = sqrt((M^-1)_pp)

`M` is the information matrix with the full covariance of the estimate's interval: noise of sensors, plates and faces,
position errors, offsets, calibration errors and the initial profile. The further sensors and the sampling steps of a
design have the same errors, so that the numbers of one page can be compared.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..case.case_definition import Case
from ..case.time_window import Window
from ..inference.likelihood import LOG_CONDUCTIVITY
from ..inference.nuisance_parameters import CONDUCTIVITY_STD
from .fisher_information import marginal_information, relative_std
from .information_contributions import WindowContributions, parameter_columns, rows_per_bin
from .predicted_response import ResponseModel
from .window_information import information_of_window
from .window_selection import Design, ExpectedErrors


def expected_errors(case: Case, window: Window, diffusivity: float) -> ExpectedErrors:
    """The relative standard errors of an estimate from a window, with the full covariance of its interval.

    Args:
        window: rows of the record.
        diffusivity: at which the derivatives are taken, m2/s.
    """
    model, starts = ResponseModel(case, [sensor.position for sensor in case.sensors]), np.array([window.row])
    predicted = model.predict(starts, window.rows, diffusivity)
    bin_rows = rows_per_bin(window.rows * len(model.outputs))
    contributions = WindowContributions(case, predicted.first_rows(window.rows), starts, window.rows, bin_rows)
    matrix, each = information_of_window(contributions, 0)
    if not each:
        return ExpectedErrors(math.inf)
    column = parameter_columns(each).get((None, LOG_CONDUCTIVITY))
    if column is None:
        return ExpectedErrors(relative_std(matrix))
    information = float(marginal_information(matrix, [column])[0, 0])
    return ExpectedErrors(relative_std(matrix), CONDUCTIVITY_STD / math.sqrt(information))


def with_expected_errors(case: Case, design: Design) -> Design:
    """A design with the expected errors of an estimate from its best window; unchanged where it is uninformative."""
    if not design.informative:
        return design
    return replace(design, errors=expected_errors(case, design.best, design.diffusivities[0]))
