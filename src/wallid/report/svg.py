"""Figures as SVG for the page, with lines and text in the colour of the reader's light or dark setting."""

from __future__ import annotations

import base64
import re
from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from ..plot.house_style import GREY, KEEP_COLOUR
from .figures import encode_figure

_DECIMALS = re.compile(r"(\.\d\d)\d+")  # below a hundredth of a point, differences are not visible
_MOST_BYTES = 2_500_000  # of all figures: the page stays under 3 MB
_FEW_POINTS = 50  # of a line; in a figure that is too large, longer lines become pixels
_BLACK, _KEPT = "#000000", "#010203"  # the second is a placeholder for black that stays black
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
        uris[k] = _data_uri(figures[k].figure, figures[k].stem, most_points=_FEW_POINTS)
    return uris


def _data_uri(figure: Figure, stem: str, **options: int) -> str:
    """A figure as the data URI of an SVG without background, in the colour of the reader's text."""
    _prepare(figure)
    text = encode_figure(figure, "svg", salt=stem, facecolor="none", **options).decode()
    text = re.sub(r'(?<= d=")[^"]*|(?<= [xy]=")[^"]*', lambda match: _DECIMALS.sub(r"\1", match[0]), text)
    svg = _with_page_colours(text[text.index("<svg") :])
    return f"data:image/svg+xml;base64,{base64.b64encode(svg.encode()).decode()}"


def _prepare(figure: Figure) -> None:
    """Remove white backgrounds, and mark black text on a coloured background, which stays black on the dark page."""
    for ax in figure.axes:
        if to_hex(ax.get_facecolor()) == "#ffffff":
            ax.set_facecolor("none")
    for artist in figure.findobj(lambda artist: artist.get_gid() == KEEP_COLOUR):
        for part in ("color", "markeredgecolor", "edgecolor"):
            if hasattr(artist, f"get_{part}") and _is_black(getattr(artist, f"get_{part}")()):
                artist.set(**{part: _KEPT})
        artist.set_gid(None)  # an id may occur only once in an SVG


def _is_black(colour: object) -> bool:
    return isinstance(colour, str | tuple) and to_hex(colour) == _BLACK


def _with_page_colours(svg: str) -> str:
    """An SVG with black replaced by the colour of the page's text, and light grey by that colour, transparent."""
    svg = svg.replace(_BLACK, "var(--ink)").replace(_KEPT, "#000").replace(GREY.lower(), "var(--grey)")
    svg = _LIGHT_GREY.sub(_as_transparent, svg)
    dark = "@media(prefers-color-scheme:dark){:root{--ink:#e3e6e8;--grey:#a9b0b6}}"
    paper = f"@media print{{:root{{--ink:#000;--grey:{GREY}}}}}"
    rules = f"<style>:root{{--ink:#1d2329;--grey:{GREY}}}{dark}{paper}svg{{fill:var(--ink)}}</style>"
    return re.sub(r"(<svg[^>]*>)", rf"\1{rules}", svg, count=1)


def _as_transparent(match: re.Match[str]) -> str:
    """A light grey as the transparent colour of the text; white stays white."""
    level = int(match[1], 16)
    return match[0] if level == 255 else f"fill: var(--ink); fill-opacity: {(255 - level) / 255:.2f}"
