"""What every figure must have, whoever draws it."""


def check_complete(ax, legend=True, named=False):
    """Labels, or names on the axes; a legend where there are several curves; nothing past the figure's edges."""
    figure = ax.get_figure()
    figure.canvas.draw()
    assert (ax.get_xlabel() or named) and (ax.get_ylabel() or ax.get_yticklabels() or not len(ax.get_yticks()))
    if legend:
        assert ax.get_legend() is not None
    for axes in figure.axes:
        extent, edges = axes.get_tightbbox(), figure.bbox.padded(1.0)
        assert edges.x0 <= extent.x0 and extent.x1 <= edges.x1, extent
        assert edges.y0 <= extent.y0 and extent.y1 <= edges.y1, extent
