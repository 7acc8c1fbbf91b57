"""No number passes the bounds of any material."""

import math

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wallid
from wallid.inference.physical_bounds import HIGHEST, LOWEST, PHYSICAL_BOUNDS, clip_to_physical
from wallid.inference.quantity import lognormal
from wallid.inference.validity import distinguishable_range


@given(st.sampled_from(sorted(PHYSICAL_BOUNDS)), st.floats(0.0, 1e5), st.floats(0.0, 1.0))
def test_an_interval_stays_within_the_bounds_of_its_unit(unit, variance, share):
    lowest, highest = PHYSICAL_BOUNDS[unit]
    value = math.exp(math.log(lowest) + share * math.log(highest / lowest))
    low, high = lognormal(value, variance, 1.96, unit).interval_95
    assert lowest <= low <= value * (1 + 1e-9) and value * (1 - 1e-9) <= high <= highest


@given(st.floats(), st.floats())
def test_an_end_inside_is_not_moved(low, high):
    for end, clipped in zip((low, high), clip_to_physical(low, high, "m2/s"), strict=True):
        assert math.isnan(clipped) if math.isnan(end) else LOWEST <= clipped <= HIGHEST
        assert clipped == end or not LOWEST <= end <= HIGHEST
    assert clip_to_physical(low, high, "m")[0] is low


@pytest.mark.parametrize("length", [1e-4, 0.4, 40.0, 4e3])
def test_a_window_can_distinguish_a_range_within_the_bounds(length):
    """A wall stated in cm or mm has a range too, so that a diagnosis can say what is wrong."""
    hours = np.arange(72)
    faces = {"left": 10 + 5 * np.sin(hours / 4), "right": np.full(72, 20.0)}
    frame = pd.DataFrame({"time": 3600.0 * hours, **faces, "T": np.full(72, 15.0)})
    case = wallid.Case.from_dataframe(
        frame,
        length=length,
        diffusivity_prior=7e-7,
        time="time",
        left="left",
        right="right",
        sensors={"T": length / 2},
        noise_std=0.05,
    )
    low, high = distinguishable_range(case, wallid.Window(0, 72))
    assert LOWEST <= low < high / 50 and high <= HIGHEST
