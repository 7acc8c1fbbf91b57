"""Figures as SVG for the page, with lines and text in the colour of the reader's light or dark setting."""

from __future__ import annotations

import base64
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.collections import QuadMesh
from matplotlib.colors import is_color_like, to_hex
from matplotlib.figure import Figure

from ..plot.house_style import DARK, KEEP_COLOUR
from .dark_images import CSS_DARK, CSS_LIGHT, with_dark_images
from .figures import encode_figure

_DECIMALS = re.compile(r"(\.\d\d)\d+")  # below a hundredth of a point, differences are not visible
_MOST_BYTES = 2_500_000  # of all figures: the page stays under 3 MB
_FEW_POINTS = 50  # of a line; in a figure that is too large, longer lines become pixels
_BLACK = "#000000"
_DARK_INK = "#E3E6E8"
_NAMES = {_BLACK: "ink"} | {colour.lower(): f"mark{count}" for count, colour in enumerate(DARK)}
"""Name in the style sheet of each colour that is different on the dark page."""
_PLACEHOLDERS = {colour: f"#01020{count}" for count, colour in enumerate(_NAMES)}
"""Stand for the same colours where they stay as they are."""
_LIGHT_GREY = re.compile(r"fill: #([c-f][0-9a-f])\1\1(?=[;\"])")


@dataclass(frozen=True)
class DrawnFigure:
    """A figure, its files, and its SVG for the page.

    Args:
        stem: name of its files without extension.
        figure: the matplotlib figure.
        files: contents of its files, by format.
        data_uri: SVG without background, for the page.
    """

    stem: str
    figure: Figure
    files: dict[str, bytes]
    data_uri: str


def draw_figure(stem: str, figure: Figure, formats: Sequence[str] = ()) -> DrawnFigure:
    """A figure as files of the given formats, and as SVG for the page."""
    files = {kind: encode_figure(figure, kind, salt=stem) for kind in formats}  # before its background is removed
    return DrawnFigure(stem, figure, files, _data_uri(figure, stem))


def data_uris(figures: Sequence[DrawnFigure]) -> list[str]:
    """The data URI of each figure; where all are too large together, the largest have long lines as pixels."""
    uris = [drawn.data_uri for drawn in figures]
    for k in sorted(range(len(uris)), key=lambda k: -len(uris[k])):
        if sum(map(len, uris)) <= _MOST_BYTES:
            break
        pixels = _data_uri(figures[k].figure, figures[k].stem, most_points=_FEW_POINTS)
        uris[k] = min(uris[k], pixels, key=len)
    return uris


def _data_uri(figure: Figure, stem: str, **options: int) -> str:
    """A figure as the data URI of an SVG without background, in the colour of the reader's text."""
    _prepare(figure)
    text = encode_figure(figure, "svg", salt=stem, facecolor="none", **options).decode()
    text = re.sub(r'(?<= d=")[^"]*|(?<= [xy]=")[^"]*', lambda match: _DECIMALS.sub(r"\1", match[0]), text)
    svg = _with_page_colours(text[text.index("<svg") :])
    if not figure.findobj(QuadMesh):  # the colours of a map have a meaning
        svg = with_dark_images(svg)
    return f"data:image/svg+xml;base64,{base64.b64encode(svg.encode()).decode()}"


def _prepare(figure: Figure) -> None:
    """Remove white backgrounds, and mark the colours that stay as they are on the dark page."""
    for ax in figure.axes:
        if to_hex(ax.get_facecolor()) == "#ffffff":
            ax.set_facecolor("none")
    for artist in figure.findobj(lambda artist: artist.get_gid() == KEEP_COLOUR):
        for part in ("markerfacecolor", "markeredgecolor", "edgecolor", "color"):
            if hasattr(artist, f"get_{part}") and (kept := _placeholder(getattr(artist, f"get_{part}")())):
                artist.set(**{part: kept})
        artist.set_gid(None)  # an id may occur only once in an SVG


def _placeholder(colour: object) -> str | None:
    """What stands for a colour that would change on the dark page; None where it would not, or is no single colour."""
    if isinstance(colour, np.ndarray) and colour.shape == (1, 4):  # of a collection
        colour = tuple(colour[0])
    return _PLACEHOLDERS.get(to_hex(colour)) if isinstance(colour, str | tuple) and is_color_like(colour) else None


def _with_page_colours(svg: str) -> str:
    """An SVG with the colours of the page: those of `DARK` and light text where it is dark.

    Black becomes the colour of the page's text, and light grey that colour, transparent.
    """
    for colour, name in _NAMES.items():
        svg = svg.replace(colour, f"var(--{name})")
    for colour, placeholder in _PLACEHOLDERS.items():
        svg = svg.replace(placeholder, "#000" if colour == _BLACK else colour)
    svg = _LIGHT_GREY.sub(_as_transparent, svg)
    light = {_BLACK: "#1d2329"} | {colour.lower(): colour for colour in DARK}
    dark = {_BLACK: _DARK_INK} | {colour.lower(): other for colour, other in DARK.items()}
    paper = light | {_BLACK: "#000"}
    rules = (
        f"<style>:root{{{_variables(light)}}}{CSS_LIGHT}"
        f"@media screen and (prefers-color-scheme:dark){{:root{{{_variables(dark)}}}{CSS_DARK}}}"
        f"@media print{{:root{{{_variables(paper)}}}}}svg{{fill:var(--ink)}}</style>"
    )
    return re.sub(r"(<svg[^>]*>)", rf"\1{rules}", svg, count=1)


def _variables(values: dict[str, str]) -> str:
    """The style sheet's definition of each colour."""
    return ";".join(f"--{_NAMES[colour]}:{value}" for colour, value in values.items())


def _as_transparent(match: re.Match[str]) -> str:
    """A light grey as the transparent colour of the text; white stays white."""
    level = int(match[1], 16)
    return match[0] if level == 255 else f"fill: var(--ink); fill-opacity: {(255 - level) / 255:.2f}"
