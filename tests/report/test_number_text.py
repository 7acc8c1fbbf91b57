"""Values with their standard deviations, in units that a person uses."""

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from wallid._internal.number_formats import (
    format_interval,
    format_quantity,
    format_text,
    p_value_text,
    terminal_text,
    value_and_interval,
    value_and_std,
)


@pytest.mark.parametrize(
    ("value", "std", "unit", "text"),
    [
        (-1220.0, 21.0, "s", "-20.33 +- 0.35 min"),
        (0.0708, 0.0012, "m", "70.8 +- 1.2 mm"),
        (0.25, 0.013, "m", "25.0 +- 1.3 cm"),
        (0.00302, 3.6e-5, "K m2/W", "0.003020 +- 0.000036 K m2/W"),
        (1.061e-6, 1.2e-8, "m2/s", "(1.061 +- 0.012)e-06 m2/s"),
        (2e-4, 3.7e-6, "K/s", "17.28 +- 0.32 K/d"),
        (200000.0, 9000.0, "s", "2.31 +- 0.10 d"),
        (3.0, 0.0, "K", "3 K"),
        (math.nan, 1.0, "K", "nan K"),
    ],
)
def test_two_digits_of_the_standard_deviation_count(value, std, unit, text):
    assert value_and_std(value, std, unit) == text


@given(st.floats(-1e8, 1e8), st.floats(1e-9, 1e6))
def test_the_text_is_the_value_to_within_a_tenth_of_its_standard_deviation(value, std):
    assume(std > 1e-12 * abs(value))  # below, a double does not hold the digits
    text = value_and_std(value, std)
    power = float(f"1{text[text.index(')') + 1 :]}") if text.startswith("(") else 1.0
    shown, spread = (float(part) * power for part in text.strip("(").split(")")[0].split(" +- "))
    assert abs(shown - value) <= 0.1 * std and spread == pytest.approx(std, rel=0.06)


def test_an_interval_has_the_digits_and_the_unit_of_its_value():
    assert value_and_interval(1.096e-6, 3e-8, (1.046e-6, 1.149e-6), "m2/s", ", by profile") == (
        "(1.096 +- 0.030)e-06 m2/s   (95 %: 1.046e-06 to 1.149e-06, by profile)"
    )
    assert value_and_interval(-1220.0, 21.0, (-1261.0, -1179.0), "s") == (
        "-20.33 +- 0.35 min   (95 %: -21.02 to -19.65)"
    )
    entry = {"value": 0.432, "std": 0.017, "interval_95": [0.401, 0.466], "unit": "m2 K/W"}
    assert format_quantity(entry) == "0.432 ± 0.017 m² K/W (95 %: 0.401 to 0.466)"
    assert format_interval(entry) == "0.401 to 0.466" and format_interval(entry | {"interval_95": None}) == ""
    assert format_quantity({"value": None, "std": None, "interval_95": [None, None], "unit": "m2/s"}).startswith("–")


def test_no_p_value_is_zero():
    assert p_value_text(0.0) == "p < 0.0005" and p_value_text(0.03) == "p = 0.03"


def test_a_terminal_has_the_signs_that_its_encoding_holds():
    text = "(1.1 +- 0.2)e-06 m2/s at -5 degC\x07"
    assert terminal_text(text, "utf-8") == "(1.1 ± 0.2) × 10⁻⁶ m²/s at −5 °C\ufffd"
    assert terminal_text(text, "ascii") == terminal_text(text, None) == "(1.1 +- 0.2)e-06 m2/s at -5 degC?"


def test_signs_and_powers_on_a_page():
    assert format_text("+-5% of -9%") == "±5 % of −9 %"
    assert (
        format_text("(1.1 +- 0.2)e-06 m2/s at -5 degC on 2009-01-02")
        == "(1.1 ± 0.2) × 10⁻⁶ m²/s at −5 °C on 2009-01-02"
    )
