"""Whether a line of a panel runs through its legend."""

import numpy as np


def lines_in_legend(ax):
    """Labels of the lines that run through the legend of these Axes, once the figure is laid out."""
    figure = ax.get_figure()
    figure.draw_without_rendering()
    legend = ax.get_legend()
    if legend is None:
        return []
    box = legend.get_window_extent().padded(-1.0)
    found = []
    for line in ax.lines:
        path = line.get_transform().transform_path(line.get_path())
        points = path.vertices[np.isfinite(path.vertices).all(axis=1)]
        if len(points) == 0:
            continue
        share = np.linspace(0.0, 1.0, 201)[:, None, None]
        dense = (points[:-1] * (1 - share) + points[1:] * share).reshape(-1, 2) if len(points) > 1 else points
        dense = dense if line.get_linestyle() != "None" else points
        if box.count_contains(dense):
            found.append(line.get_label())
    return found
