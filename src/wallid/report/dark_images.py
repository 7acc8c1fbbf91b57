"""Pixels in an SVG, in the colours of the dark page: long lines and many markers are drawn as pixels, not as paths."""

from __future__ import annotations

import base64
import re
from io import BytesIO

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.image import imread, imsave

from ..plot.house_style import DARK

_IMAGE = re.compile(r'<image xlink:href="data:image/png;base64,\s*([^"]+)"([^>]*?)(/?)>(?:</image>)?')
_ID = re.compile(r' id="[^"]*"')
_TOLERANCE = 0.04  # of each channel, 0 to 1: the edge of a line keeps its colour and is transparent
CSS_LIGHT = ".on-dark{display:none}"
CSS_DARK = ".on-light{display:none}.on-dark{display:inline}"


def with_dark_images(svg: str) -> str:
    """An SVG with a second version of each image for the dark page; `CSS_LIGHT` and `CSS_DARK` show one of them.

    An image without a colour of `DARK` stays as it is.
    """
    return _IMAGE.sub(_two_images, svg)


def _two_images(match: re.Match[str]) -> str:
    pixels = imread(BytesIO(base64.b64decode(match[1])), format="png")
    dark = in_dark_colours(pixels)
    if np.array_equal(pixels, dark):
        return match[0]
    stream = BytesIO()
    imsave(stream, dark, format="png")
    light = match[0].replace("<image ", '<image class="on-light" ', 1)
    encoded = base64.b64encode(stream.getvalue()).decode()
    rest = _ID.sub("", match[2])  # an id may occur only once
    return f'{light}<image class="on-dark" xlink:href="data:image/png;base64,{encoded}"{rest}/>'


def in_dark_colours(pixels: np.ndarray) -> np.ndarray:
    """An image with each colour of the figures replaced by that of the dark page.

    Args:
        pixels: red, green, blue and opacity, 0 to 1, (row, column, 4).
    """
    dark = pixels.copy()
    for colour, other in DARK.items():
        same = (np.abs(pixels[..., :3] - np.array(to_rgb(colour))) < _TOLERANCE).all(axis=-1)
        dark[same, :3] = to_rgb(other)
    return dark
