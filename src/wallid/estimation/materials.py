"""Materials with a given diffusivity, and the slip of units that an impossible diffusivity suggests.

Source: EN ISO 10456 (2007), Tables 3 and 4; Incropera, DeWitt, Fundamentals of Heat and Mass Transfer (2007), Appendix
A, for rock, soil, ice and metals. The ranges are conductivity over heat capacity, rounded outwards.
"""

from __future__ import annotations

import math

_MATERIALS = (
    ("wood", 0.8e-7, 2.5e-7),
    ("dry soil or loam", 1.5e-7, 4e-7),
    ("aerated concrete", 1.8e-7, 4e-7),
    ("gypsum or lime plaster", 2.5e-7, 6e-7),
    ("brick", 2.8e-7, 7e-7),
    ("moist soil", 4e-7, 1.1e-6),
    ("soft limestone or tuff", 4e-7, 9e-7),
    ("concrete", 4.5e-7, 1.1e-6),
    ("mineral wool or foam", 6e-7, 2.5e-6),
    ("limestone or marble", 7e-7, 1.5e-6),
    ("sandstone", 9e-7, 1.7e-6),
    ("ice", 1e-6, 1.5e-6),
    ("granite or gneiss", 1.0e-6, 1.9e-6),
    ("quartzite", 1.5e-6, 3e-6),
    ("stainless steel", 3.4e-6, 5e-6),
    ("steel or lead", 1.0e-5, 2.5e-5),
    ("aluminium or copper", 3e-5, 1.2e-4),
)
_USUAL = (6e-8, 3.2e-6)  # m2/s: every wall, soil, rock and ice; metals are above
LENGTH_UNITS = {"feet": 0.3048, "inches": 0.0254, "cm": 0.01, "mm": 0.001}
"""Units of length that may be stated by mistake instead of the metre, in m."""
_SLIPS = (  # of the case's units, and the factor on the diffusivity: it goes with length^2 / time
    *((f"lengths in {unit}", metres**-2) for unit, metres in LENGTH_UNITS.items()),
    ("times in minutes instead of seconds", 60.0),
    ("times in hours instead of seconds", 3600.0),
    ("a record's step of half its true length", 2.0),
    ("a record's step of twice its true length", 0.5),
)


def materials_like(low: float, high: float) -> tuple[str, ...]:
    """The materials whose diffusivity overlaps an interval, at most five: those whose middle is nearest first.

    Args:
        low, high: ends of the interval, m2/s.
    """
    if not (0.0 < low <= high < math.inf):
        return ()
    centre = math.log(low * high) / 2

    def distance(material: tuple[str, float, float]) -> float:
        return abs(math.log(material[1] * material[2]) / 2 - centre)

    overlapping = [material for material in _MATERIALS if material[1] <= high and material[2] >= low]
    return tuple(name for name, _, _ in sorted(overlapping, key=distance)[:5])


def implausible(value: float, prior: float) -> str:
    """Why a diffusivity is not that of a wall, soil or ice, with the likely slip of units; empty where it is plausible.

    A value near the stated prior is plausible whatever it is: the wall may be a metal.

    Args:
        value: the diffusivity, m2/s.
        prior: the stated prior diffusivity, m2/s.
    """
    low, high = min(_USUAL[0], prior / 3.0), max(_USUAL[1], prior * 3.0)
    if not math.isfinite(value) or low <= value <= high:
        return ""
    slips = [(name, value / factor) for name, factor in _SLIPS if _USUAL[0] <= value / factor <= _USUAL[1]]
    text = (
        f"{value:.2g} m2/s is not the diffusivity of a stone, brick, wood, soil or ice ({_USUAL[0]:.0e} to "
        f"{_USUAL[1]:.0e} m2/s): check the units of the case"
    )
    if not slips:
        return text
    slips.sort(key=lambda slip: abs(math.log(slip[1] / prior)))
    return f"{text}; {', or '.join(f'with {name} it would be {corrected:.2g}' for name, corrected in slips[:2])}"
