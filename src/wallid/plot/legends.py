"""Legends that keep inside their figure: in as many columns as fit, long names shortened, with room made for them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.transforms import ScaledTranslation

_LONGEST = 18  # letters of a name
_MOST_COLUMNS = 8
_MOST_SHARE = 0.45  # of the Axes' height: a higher legend stands under them
_MANY = 10  # entries, from which letters are smaller
_TIGHT = {"columnspacing": 1.2, "handletextpad": 0.5}
_APART = 0.05  # inches from an axis's label to the legend under it


def shortened(name: str, longest: int = _LONGEST) -> str:
    """A name with an ellipsis in its middle where it is long: names in a row often differ at their ends."""
    if len(name) <= longest:
        return name
    end = (longest - 1) // 2
    return f"{name[: longest - 1 - end]}…{name[-end:]}"


def make_room(ax: Axes) -> None:
    """Have a figure that has no layout of its own make room for what stands outside its Axes."""
    made = ax.get_figure(root=True)
    if made is not None and made.get_layout_engine() is None:
        made.set_layout_engine("constrained")


def legend_above(ax: Axes) -> None:
    """A legend over the curves, the ordinate's range extended for it; one of very many rows stands under the Axes."""
    make_room(ax)
    handles, labels = ax.get_legend_handles_labels()
    if not handles:
        return
    frame = ax.get_window_extent()
    made = _in_columns(ax, handles, labels, frame.width, loc="upper left")
    around = 2.0 * made.borderaxespad * made.prop.get_size_in_points() * _dots_per_inch(ax) / 72.0
    share = (made.get_window_extent().height + around) / frame.height
    if share > _MOST_SHARE:
        legend_below(ax)
        return
    along = ax.yaxis.get_transform()
    low, high = along.transform(ax.get_ylim())
    _, higher = along.inverted().transform([low, low + (high - low) / (1.0 - share)])
    ax.set_ylim(top=higher)


def legend_below(ax: Axes, handles: Sequence[Any] | None = None) -> None:
    """A legend under the Axes and their label.

    Args:
        handles: what it tells of; None for all that has a label.
    """
    make_room(ax)
    made = ax.get_figure(root=True)
    drawn = list(ax.get_legend_handles_labels()[0] if handles is None else handles)
    under = ax.xaxis.get_tightbbox()
    if made is None or under is None or not drawn:
        return
    frame = ax.get_window_extent()
    down = ScaledTranslation(0.0, -(frame.y0 - under.y0) / made.dpi - _APART, made.dpi_scale_trans)
    where = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0), "bbox_transform": ax.transAxes + down}
    labels = [str(handle.get_label()) for handle in drawn]
    _in_columns(ax, drawn, labels, frame.width, borderaxespad=0.0, **where)


def shared_legend(made: Figure, ax: Axes) -> None:
    """One legend under a figure for all of its panels, whose curves are those of one of them."""
    handles, labels = ax.get_legend_handles_labels()
    _in_columns(made, handles, labels, made.bbox.width, loc="outside lower center")


def _in_columns(on: Axes | Figure, handles: Sequence[Any], labels: Sequence[str], width: float, **where: Any) -> Legend:
    """The legend of the most columns that are no wider together, in small letters where it tells of many."""
    words: dict[str, Any] = _TIGHT | where | ({"fontsize": "small"} if len(handles) > _MANY else {})
    columns = min(len(handles), _MOST_COLUMNS)
    while True:
        made = on.legend(handles, labels, ncols=columns, **words)
        if columns == 1 or made.get_window_extent().width <= width:
            return made
        made.remove()
        columns -= 1


def _dots_per_inch(ax: Axes) -> float:
    made = ax.get_figure(root=True)
    return 72.0 if made is None else made.dpi
