"""A figure as the page holds it: an SVG whose ink follows the reader's light or dark setting."""

from __future__ import annotations

import base64
import re
from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from ..plot.house_style import GREY, KEEP
from .figures import encode

_DECIMALS = re.compile(r"(\.\d\d)\d+")  # past a hundredth of a point nothing is seen
_MOST_BYTES = 2_500_000  # of all pictures: a page stays under 3 MB
_FEW_POINTS = 50  # of a line in a picture that is too large
_BLACK, _KEPT = "#000000", "#010203"  # the second stands for black that stays black
_PALE = re.compile(r"fill: #([c-f][0-9a-f])\1\1(?=[;\"])")  # a light grey


Rendered = tuple[dict[str, bytes], str]
"""A figure's files by their formats, and its data URI for the page."""


@dataclass(frozen=True)
class Drawn:
    """A figure, and what was drawn of it.

    Args:
        stem: of its files. files: their contents, by format. source: a data URI, for the page.
    """

    stem: str
    made: Figure
    files: dict[str, bytes]
    source: str


def render(stem: str, made: Figure, formats: Sequence[str] = ()) -> Rendered:
    """A figure's files, then the SVG without a background that the page holds."""
    return {kind: encode(made, kind, salt=stem) for kind in formats}, _source(made, stem)


def draw(stem: str, made: Figure, formats: Sequence[str] = ()) -> Drawn:
    """A figure, drawn."""
    return Drawn(stem, made, *render(stem, made, formats))


def sources(drawn: Sequence[Drawn]) -> list[str]:
    """Each figure's data URI; where they are too large together, the largest with lines as pixels."""
    found = [one.source for one in drawn]
    for k in sorted(range(len(found)), key=lambda k: -len(found[k])):
        if sum(map(len, found)) <= _MOST_BYTES:
            break
        found[k] = _source(drawn[k].made, drawn[k].stem, most_points=_FEW_POINTS)
    return found


def _source(made: Figure, stem: str, **options: int) -> str:
    """A figure as the data URI of an SVG without a background, in the colour of the reader's text."""
    _prepare(made)
    text = encode(made, "svg", salt=stem, facecolor="none", **options).decode()
    text = re.sub(r'(?<= d=")[^"]*|(?<= [xy]=")[^"]*', lambda found: _DECIMALS.sub(r"\1", found[0]), text)
    return f"data:image/svg+xml;base64,{base64.b64encode(_in_ink(text[text.index('<svg') :]).encode()).decode()}"


def _prepare(made: Figure) -> None:
    """Take away white grounds, and mark black that stands on a colour of its own: it stays black on any page."""
    for ax in made.axes:
        if to_hex(ax.get_facecolor()) == "#ffffff":
            ax.set_facecolor("none")
    for artist in made.findobj(lambda artist: artist.get_gid() == KEEP):
        for part in ("color", "markeredgecolor", "edgecolor"):
            if hasattr(artist, f"get_{part}") and _is_black(getattr(artist, f"get_{part}")()):
                artist.set(**{part: _KEPT})
        artist.set_gid(None)  # one name on several parts is none in an SVG


def _is_black(colour: object) -> bool:
    return isinstance(colour, str | tuple) and to_hex(colour) == _BLACK


def _in_ink(svg: str) -> str:
    """What is black, said or left unsaid, in the text's colour; light greys as a thin wash of it."""
    svg = svg.replace(_BLACK, "var(--ink)").replace(_KEPT, "#000").replace(GREY.lower(), "var(--grey)")
    svg = _PALE.sub(_wash, svg)
    dark = "@media(prefers-color-scheme:dark){:root{--ink:#e3e6e8;--grey:#a9b0b6}}"
    paper = f"@media print{{:root{{--ink:#000;--grey:{GREY}}}}}"
    rules = f"<style>:root{{--ink:#1d2329;--grey:{GREY}}}{dark}{paper}svg{{fill:var(--ink)}}</style>"
    return re.sub(r"(<svg[^>]*>)", rf"\1{rules}", svg, count=1)


def _wash(found: re.Match[str]) -> str:
    """A light grey as ink that lets the page through; white stays white."""
    level = int(found[1], 16)
    return found[0] if level == 255 else f"fill: var(--ink); fill-opacity: {(255 - level) / 255:.2f}"
