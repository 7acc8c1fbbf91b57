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
_MOST_SHARE = 0.45  # of the Axes' height: a higher legend stands beside them
_TIGHT = {"columnspacing": 1.2, "handletextpad": 0.5}
_UNDER = 2.9  # letters' heights from the Axes to a legend under them: the ticks' and the axis's label lie between


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
    """A legend over the curves, the ordinate's range extended for it; one of very many rows beside the Axes."""
    make_room(ax)
    handles, labels = ax.get_legend_handles_labels()
    if not handles:
        return
    frame = ax.get_window_extent()
    made = _in_columns(ax, handles, labels, frame.width, loc="upper left")
    share = (made.get_window_extent().height + made.borderaxespad * _letter(made)) / frame.height
    if share > _MOST_SHARE:
        ax.legend(handles, labels, loc="upper left", bbox_to_anchor=(1.0, 1.0), ncols=1 + len(handles) // 16)
        return
    along = ax.yaxis.get_transform()
    low, high = along.transform(ax.get_ylim())
    _, higher = along.inverted().transform([low, low + (high - low) / (1.0 - share)])
    ax.set_ylim(top=higher)


def legend_below(ax: Axes, handles: Sequence[Any] | None = None) -> None:
    """A legend under the Axes and their label."""
    make_room(ax)
    made = ax.get_figure(root=True)
    assert made is not None
    drawn = list(ax.get_legend_handles_labels()[0] if handles is None else handles)
    if not drawn:
        return
    down = ScaledTranslation(0.0, -_UNDER * ax.xaxis.label.get_fontsize() / 72.0, made.dpi_scale_trans)
    labels = [str(handle.get_label()) for handle in drawn]
    where = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0), "bbox_transform": ax.transAxes + down}
    _in_columns(ax, drawn, labels, ax.get_window_extent().width, borderaxespad=0.0, **where)


def shared_legend(made: Figure, ax: Axes) -> None:
    """One legend under a figure for all of its panels, whose curves are those of one of them."""
    handles, labels = ax.get_legend_handles_labels()
    _in_columns(made, handles, labels, made.bbox.width, loc="outside lower center")


def _in_columns(on: Axes | Figure, handles: Sequence[Any], labels: Sequence[str], width: float, **where: Any) -> Legend:
    """The legend of the most columns that are no wider together."""
    columns = min(len(handles), _MOST_COLUMNS)
    while True:
        made = on.legend(handles, labels, ncols=columns, **_TIGHT, **where)
        if columns == 1 or made.get_window_extent().width <= width:
            return made
        if isinstance(on, Figure):
            made.remove()
        columns -= 1


def _letter(made: Legend) -> float:
    """The height of a legend's letters, pixels."""
    figure = made.get_figure(root=True)
    return made.prop.get_size_in_points() * (72.0 if figure is None else figure.dpi) / 72.0
