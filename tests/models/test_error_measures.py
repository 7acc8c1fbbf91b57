import numpy as np
import pytest

from wallid.models.error_measures import eps_2, eps_inf


def test_the_papers_errors_by_hand():
    """Two rows of two points; a missing value is left out."""
    values, reference = np.array([[1.0, 2.0], [3.0, np.nan]]), np.array([[1.0, 4.0], [2.0, 0.0]])
    assert eps_2(values, reference) == pytest.approx(np.sqrt((0 + 4 + 1) / 3))
    assert eps_inf(values, reference) == 2.0
