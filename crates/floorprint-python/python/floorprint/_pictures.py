"""Figures of matplotlib, where it is installed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from floorprint._optional import needed

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: The colours of the command line's pictures: trajectory, dead reckoning, truth.
RED, BLUE, GREEN = "#dc2626", "#2563eb", "#15803d"


def new_figure(charts: int = 0) -> tuple[Axes, list[Axes]]:
    """Axes for a map in a new figure, and for charts beside each other below it.

    Raises:
        ImportError: matplotlib is not installed.
    """
    pyplot = needed("matplotlib.pyplot", "pictures", "floorprint[plot]")
    if charts == 0:
        return pyplot.subplots(figsize=(7.5, 7.0), layout="constrained")[1], []
    figure = pyplot.figure(figsize=(9.0, 9.0), layout="constrained")
    grid = figure.add_gridspec(2, charts, height_ratios=[3.2, 1.0])
    return figure.add_subplot(grid[0, :]), [figure.add_subplot(grid[1, chart]) for chart in range(charts)]
