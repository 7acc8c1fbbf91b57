"""A section from a picture whose colours are materials: its pixels are the geometry."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..._internal.errors import InputError
from ..._internal.validation import number
from .section_definition import Section
from .section_materials import SectionMaterial

_LISTED = 5  # colours in a message
_MANY = 12  # colours, beyond which a picture is a photograph and not a drawing
_PROPORTION = 0.02  # by which a pixel's width and height may differ


def section_of_picture(
    length: float,
    height: float,
    materials: Sequence[SectionMaterial],
    picture: str | os.PathLike[str] | np.ndarray,
    **edges: Any,
) -> Section:
    """A section from a picture: its left edge is the left face, its lowest row the bottom.

    Args:
        length, height: of the section, m.
        materials: each with the colour of its pixels.
        picture: a file (PNG, or what Pillow reads), or an array `(row, column, channel)` of bytes, the top row first.
        edges: `step`, `surface_resistance_left`, `surface_resistance_right`, `bottom`, `top` of `Section`.

    Raises:
        InputError: the file cannot be read; a material without a colour, or two with the same; a colour without a
            material; pixels that are not square.
    """
    length, height = number("length", length, "m", above=0.0), number("height", height, "m", above=0.0)
    name, pixels = ("the picture", picture) if isinstance(picture, np.ndarray) else (str(picture), _read(Path(picture)))
    cells = _materials_of_pixels(name, np.asarray(pixels)[::-1], materials)
    rows, columns = cells.shape
    width, tall = length / columns, height / rows
    if abs(tall / width - 1.0) > _PROPORTION:
        raise InputError(
            f"{name}: has {columns} x {rows} pixels for {length:g} x {height:g} m; with square pixels the height is "
            f"{rows * width:.4g} m"
        )
    # lines stay where a material begins or ends
    x_kept = np.flatnonzero((np.diff(cells, axis=1) != 0).any(axis=0)) + 1
    y_kept = np.flatnonzero((np.diff(cells, axis=0) != 0).any(axis=1)) + 1
    x_first, y_first = np.concatenate([[0], x_kept]), np.concatenate([[0], y_kept])
    return Section(
        tuple(materials),
        np.append(x_first, columns) * width,
        np.append(y_first, rows) * tall,
        cells[np.ix_(y_first, x_first)],
        **edges,
    )


def _read(path: Path) -> np.ndarray:
    """The pixels of a picture with their opacity."""
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(path) as image:
            return np.asarray(image.convert("RGBA"))
    except UnidentifiedImageError:
        raise InputError(f"{path}: is not a picture; save the traced drawing as PNG") from None
    except Image.DecompressionBombError:
        message = f"{path}: has too many pixels; scale it down: a few pixels across a joint are enough"
        raise InputError(message) from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error


def _materials_of_pixels(name: str, pixels: np.ndarray, materials: Sequence[SectionMaterial]) -> np.ndarray:
    """The index of the material of each pixel."""
    known: dict[str, int] = {}
    for index, material in enumerate(materials):
        if material.color is None:
            raise InputError(f'material "{material.name}" has no color; state the colour of its pixels in {name}')
        if material.color in known:
            other = materials[known[material.color]].name
            raise InputError(f'materials "{other}" and "{material.name}" have one color, {material.color}')
        known[material.color] = index
    if pixels.ndim != 3 or pixels.shape[2] not in (3, 4) or pixels.dtype != np.uint8:
        raise InputError(
            f"{name}: must be an array (row, column, 3 or 4) of bytes; it is {pixels.dtype} {pixels.shape}"
        )
    if pixels.shape[2] == 4 and (pixels[..., 3] < 255).any():
        raise InputError(f"{name}: has transparent pixels; every pixel must have the colour of a material")
    codes = pixels[..., :3].astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32)
    found, places, counts = np.unique(codes, return_inverse=True, return_counts=True)
    colours = [f"#{code:06x}" for code in found.tolist()]
    if unknown := [k for k, colour in enumerate(colours) if colour not in known]:
        raise InputError(_unknown_colours(name, colours, counts, unknown, known))
    return np.array([known[colour] for colour in colours])[places.reshape(codes.shape)]


def _unknown_colours(
    name: str, colours: Sequence[str], counts: np.ndarray, unknown: Sequence[int], known: dict[str, int]
) -> str:
    """The message of colours without a material."""
    order = sorted(unknown, key=lambda k: -counts[k])
    listed = ", ".join(f"{colours[k]} ({counts[k]} pixels)" for k in order[:_LISTED])
    more = f" and {len(order) - _LISTED} more" if len(order) > _LISTED else ""
    message = f"{name}: no material has the color {listed}{more}; the materials have {', '.join(known) or 'none'}"
    if len(colours) > _MANY:
        message += (
            f". With {len(colours)} colours it is a photograph, or was drawn with smooth edges or saved as JPEG: trace "
            "it with one flat colour for each material, without smoothing, and save it as PNG"
        )
    return message
