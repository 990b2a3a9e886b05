"""Maps and floors: grids with a place in the world."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from floorprint import _native
from floorprint._pictures import new_figure

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.axes import Axes
    from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class _Grid:
    #: Side of a cell, metres.
    resolution_m: float
    #: x and y of the outer corner of cell (0, 0), metres.
    origin_m: tuple[float, float]

    def _extent(self, cells: NDArray[Any]) -> tuple[float, float, float, float]:
        (x, y), (height, width) = self.origin_m, cells.shape[:2]
        return (x, x + width * self.resolution_m, y, y + height * self.resolution_m)


@dataclass(frozen=True, eq=False)
class Map(_Grid):
    """An occupancy map, in the convention of ROS's OccupancyGrid."""

    #: (height, width) int8: −1 unknown, 0 free, 100 occupied; row 0 at the lowest y.
    cells: NDArray[np.int8]

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, bottom, top in metres, as matplotlib's ``imshow(..., origin="lower")`` takes it."""
        return self._extent(self.cells)

    def plot(self, axes: Axes | None = None) -> Axes:
        """Draws it with matplotlib: white free, grey unknown, black occupied. Gives the axes."""
        import numpy as np

        axes = new_figure()[0] if axes is None else axes
        shade = np.select([self.cells < 0, self.cells >= 50], [205, 0], 255).astype(np.uint8)
        axes.imshow(shade, cmap="gray", vmin=0, vmax=255, origin="lower", extent=self.extent, interpolation="nearest")
        axes.set(xlabel="x, m", ylabel="y, m", aspect="equal")
        return axes

    def _repr_png_(self) -> bytes:
        return _native.map_png(self.cells, self.resolution_m, self.origin_m)


@dataclass(frozen=True, eq=False)
class Floor(_Grid):
    """The floor's colours."""

    #: (height, width, 4) uint8: red, green, blue, opacity (0 where nothing was seen); row 0 at the lowest y.
    rgba: NDArray[np.uint8]

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, bottom, top in metres, as matplotlib's ``imshow(..., origin="lower")`` takes it."""
        return self._extent(self.rgba)

    def plot(self, axes: Axes | None = None) -> Axes:
        """Draws it with matplotlib. Gives the axes."""
        axes = new_figure()[0] if axes is None else axes
        axes.imshow(self.rgba, origin="lower", extent=self.extent, interpolation="nearest")
        axes.set(xlabel="x, m", ylabel="y, m", aspect="equal")
        return axes


def map_of(raster: tuple[Any, float, tuple[float, float]] | None) -> Map | None:
    """A map of what the native module gives; None where nothing was seen."""
    return None if raster is None else Map(raster[1], raster[2], raster[0])


def floor_of(raster: tuple[Any, float, tuple[float, float]] | None) -> Floor | None:
    """A floor of what the native module gives; None where none was painted."""
    return None if raster is None else Floor(raster[1], raster[2], raster[0])
