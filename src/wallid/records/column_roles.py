"""What the name of a column says about its use: in English, German, French, Spanish, Italian and Dutch."""

from __future__ import annotations

import re
import unicodedata

_OUTDOORS = (
    r"outer|outdoor|outside|out\b|aussen|draussen|exteri|extern|ext\b|dehors|estern|fuori|fuera|buiten|"
    r"\b[tq]?se\b|^[tq] s?e$"
)
_INDOORS = r"inner|indoor|inside|\bin$|innen|interi|intern|(?<!po)int\b|dedans|dentro|binnen|\b[tq]?si\b|^[tq] s?i$"
_LEFT, _RIGHT = r"left|links|gauche|izquierd|sinistr", r"right|rechts|droit|derech|destr"
_AIR = r"\bt?air\b|luft|\baire\b|\baria\b|lucht|ambient|ambiance|\broom|raum|kamer|weather|wetter|meteo"
_SURFACE = r"\b[tq]? ?s[ie]\b|surf|superf|oberfl|opperv|wand|wall|\bmur|pared|parete|muur"
_TEMPERATURE_ALONE = r"(?:t|temp|temperatu\w*)"

# in this order: a pyranometer's unit is also that of a heat flux, and "heating" begins like "heat flux"
_USES = (
    ("humidity", r"humid|feucht|hygro|humedad|umidit|vocht|\brh\b|\brf\b|\bhr\b|\bur\b"),
    ("heating", r"heating|heiz|chauff|calefac|riscald|verwarm"),
    (
        "irradiance",
        r"irrad|irraggia|radiation|radiacion|radiazion|rayonn|ensoleil|solar|solaire|solare|soleil|sonne|strahl|"
        r"insolac|soleggia|zonne|straling|\bsun|pyrano|piranom|\bghi\b|\bdni\b|global",
    ),
    ("wind", r"wind|\bvent\b|viento|vento\b"),
    ("rain", r"\brain|regen|niederschlag|precipit|pluie|lluvia|pioggia|neerslag"),
    ("flux", r"flux|fluss|flujo|flusso|w(?:a|ae)rmestrom|warmtestroom|heat|^q|\bw m\b"),
)


def _plain(name: str) -> str:
    """Words of small letters without accents, separated by one space."""
    apart = re.sub(r"(?<=[a-zß-ÿ])(?=[A-ZÀ-Þ])", " ", name)
    letters = "".join(c for c in unicodedata.normalize("NFKD", apart.casefold()) if not unicodedata.combining(c))
    return re.sub(r"[\W\d_]+", " ", letters).strip()


def stated_use(name: str, unit: str = "") -> str | None:
    """The use of a column that is no temperature: "flux", or a regressor's key, or "humidity"; None where none shows.

    Args:
        name: of the column.
        unit: text below the name, in a row of units.
    """
    for text in (_plain(name), _plain(unit)):
        for use, pattern in _USES:
            if re.search(pattern, text):
                return use
    return None


def is_outdoors(name: str) -> bool:
    """Whether a name says outdoors."""
    return bool(re.search(_OUTDOORS, _plain(name)))


def is_indoors(name: str) -> bool:
    """Whether a name says indoors."""
    return bool(re.search(_INDOORS, _plain(name)))


def is_left(name: str) -> bool:
    """Whether a name says left, or indoors, which is left by habit."""
    return bool(re.search(rf"{_LEFT}|{_INDOORS}", _plain(name)))


def is_right(name: str) -> bool:
    """Whether a name says right, or outdoors, which is right by habit."""
    return bool(re.search(rf"{_RIGHT}|{_OUTDOORS}", _plain(name)))


def is_air(name: str) -> bool:
    """Whether a name says that a temperature is that of the air."""
    return bool(re.search(_AIR, _plain(name)))


def air_key(name: str) -> str | None:
    """The regressor "air_outdoor" or "air_indoor" of a temperature that is no face; None where the name says neither.

    It says so by a word for air with or without a side, or by a side alone, such as in "T_ext".
    """
    plain = _plain(name)
    bare = re.fullmatch(rf"{_TEMPERATURE_ALONE}? ?\w+(?: {_TEMPERATURE_ALONE})?", plain)
    compound = re.fullmatch(r"\w*temperatu\w*", plain)
    if re.search(_SURFACE, plain) or not (is_air(name) or bare or compound):
        return None
    if is_outdoors(name):
        return "air_outdoor"
    if is_indoors(name):
        return "air_indoor"
    if re.search(r"\broom|raum|kamer", plain):
        return "air_indoor"
    return "air_outdoor" if re.search(r"weather|wetter|meteo", plain) else None
