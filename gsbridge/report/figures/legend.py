"""A legend above a figure's panels that breaks into lines where the figure is narrow."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.artist import Artist
from matplotlib.figure import FigureBase

FILLED = 0.98
"""Share of the figure's width that a line of the legend may take."""


def legend_above(figure: FigureBase, handles: Sequence[Artist], labels: Sequence[str], fontsize: float = 9) -> None:
    """Draw the legend with as many columns as fit.

    Args:
        figure: Figure or subfigure with constrained layout.
        handles: Artists that the legend explains. [N].
        labels: Words of the legend. [N].
        fontsize: Points.
    """
    for columns in range(len(labels), 0, -1):
        legend = figure.legend(handles, labels, loc="outside upper center", ncols=columns, frameon=False, fontsize=fontsize)
        if columns == 1 or legend.get_window_extent().width <= FILLED * figure.get_window_extent().width:
            return
        legend.remove()
