"""Legends inside the figure, in as many columns as its width allows, with long names shortened."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.transforms import ScaledTranslation

from .._internal.visible_text import visible_text

_LONGEST_NAME = 18  # letters
_MOST_COLUMNS = 8
_LARGEST_SHARE = 0.45  # of the height of the Axes; a higher legend is drawn below them
_MANY = 10  # entries; a legend with more of them has smaller letters
_TIGHT = {"columnspacing": 1.2, "handletextpad": 0.5}
_LEGEND_DISTANCE = 0.05  # inches from the label of the abscissa to a legend below it


def shortened(name: str, longest: int = _LONGEST_NAME) -> str:
    """A name of at most `longest` letters, cut in its middle: similar names often differ at their ends."""
    if len(name) > longest:
        end = (longest - 1) // 2
        name = f"{name[: longest - 1 - end]}…{name[-end:]}"
    return as_drawn(name)


def as_drawn(name: str) -> str:
    """A name from a file as a text that matplotlib draws letter by letter: no formula, no control character."""
    return " ".join(visible_text(name).split()).replace("$", r"\$")


def root_figure(ax: Axes) -> Figure:
    """The figure that contains these Axes and all subfigures."""
    return ax.figure.figure  # get_figure(root=True) is new in matplotlib 3.10


def use_constrained_layout(ax: Axes) -> None:
    """Give a figure without a layout engine the constrained layout, which keeps labels and legends inside it."""
    figure = root_figure(ax)
    if figure.get_layout_engine() is None:
        figure.set_layout_engine("constrained")


def legend_above(ax: Axes) -> None:
    """Draw a legend above the curves and extend the ordinate for it; a very high legend is drawn below the Axes."""
    use_constrained_layout(ax)
    handles, labels = ax.get_legend_handles_labels()
    if not handles:
        return
    frame = ax.get_window_extent()
    legend = _in_columns(ax, handles, labels, frame.width, loc="upper left")
    padding = 2.0 * legend.borderaxespad * legend.prop.get_size_in_points() * root_figure(ax).dpi / 72.0
    share = (legend.get_window_extent().height + padding) / frame.height
    if share > _LARGEST_SHARE:
        legend_below(ax)
        return
    scale = ax.yaxis.get_transform()
    low, high = scale.transform(ax.get_ylim())
    _, higher = scale.inverted().transform([low, low + (high - low) / (1.0 - share)])
    ax.set_ylim(top=higher)


def legend_below(ax: Axes, handles: Sequence[Any] | None = None) -> None:
    """Draw a legend below the Axes and the label of the abscissa.

    Args:
        handles: artists in the legend; None for all with a label.
    """
    use_constrained_layout(ax)
    figure = root_figure(ax)
    entries = list(ax.get_legend_handles_labels()[0] if handles is None else handles)
    axis_box = ax.xaxis.get_tightbbox()
    if axis_box is None or not entries:
        return
    frame = ax.get_window_extent()
    down = ScaledTranslation(0.0, -(frame.y0 - axis_box.y0) / figure.dpi - _LEGEND_DISTANCE, figure.dpi_scale_trans)
    where = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0), "bbox_transform": ax.transAxes + down}
    labels = [str(handle.get_label()) for handle in entries]
    _in_columns(ax, entries, labels, frame.width, borderaxespad=0.0, **where)


def shared_legend(figure: Figure, ax: Axes) -> None:
    """Draw one legend below a figure for all of its panels.

    Args:
        figure: that holds the panels.
        ax: the panel whose curves the legend names.
    """
    handles, labels = ax.get_legend_handles_labels()
    _in_columns(figure, handles, labels, figure.bbox.width, loc="outside lower center")


def _in_columns(on: Axes | Figure, handles: Sequence[Any], labels: Sequence[str], width: float, **where: Any) -> Legend:
    """The legend with the most columns that fit into a width in pixels, in small letters where it has many entries."""
    options: dict[str, Any] = _TIGHT | where | ({"fontsize": "small"} if len(handles) > _MANY else {})
    columns = min(len(handles), _MOST_COLUMNS)
    while True:
        legend = on.legend(handles, labels, ncols=columns, **options)
        if columns == 1 or legend.get_window_extent().width <= width:
            return legend
        legend.remove()
        columns -= 1
