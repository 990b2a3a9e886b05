"""Sessions: all that is needed to go on, in a file that QGIS and GDAL open."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING

from floorprint import _native
from floorprint._errors import Error
from floorprint._map import Floor, Map, floor_of, map_of
from floorprint._poses import structured

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class Change:
    """A patch of the floor that changed."""

    #: ``new``: something stands where the floor was free; ``gone``: the floor is free where something stood.
    kind: str
    #: Area, square metres.
    area_m2: float
    #: Its outlines, metres: the outer ones run counter-clockwise, those of holes clockwise.
    outlines_m: list[list[list[float]]]


class Session:
    """A drive, or several that were put together."""

    def __init__(self, native: _native.Session) -> None:
        self._native = native

    @staticmethod
    def open(path: str | PathLike[str]) -> Session:
        """Reads a session, as runs leave it (session.gpkg)."""
        return Session(_native.Session.open(path))

    def save(self, path: str | PathLike[str]) -> None:
        """Writes it to a new file.

        Raises:
            Error: A file stands there already, or it cannot be written.
        """
        self._native.save(path)

    def merge(self, other: Session) -> tuple[Session, bool]:
        """This session with the other looked for on it, and whether it was recognised; else both are kept apart."""
        merged, is_placed = self._native.merge(other._native)
        return Session(merged), is_placed

    def diff(self, later: Session, *, tolerance_m: float = 0.15, least_area_m2: float = 0.02) -> list[Change]:
        """What is new and what is gone in a later session; the largest patches first.

        Args:
            later: Session of the same place. If it goes on from this one, what its new drives saw is compared.
            tolerance_m: Walls that moved by no more than this did not change, metres.
            least_area_m2: Smaller patches are left out, square metres.

        Raises:
            Error: The later session is not recognised on this one.
        """
        changes = self._native.diff(later._native, tolerance_m, least_area_m2)
        if changes is None:
            raise Error("the later session was not recognised on this one: how they lie to each other is not known")
        return [Change(*change) for change in changes]

    @property
    def trajectory(self) -> NDArray[np.void]:
        """The body's pose in the world at each scan: fields stamp_s (seconds), x, y (metres), theta (radians)."""
        return structured(self._native.trajectory())

    @property
    def map(self) -> Map | None:
        """The occupancy map; None where nothing was seen."""
        return map_of(self._native.map())

    @property
    def floor(self) -> Floor | None:
        """The floor's colours; None where it was not painted."""
        return floor_of(self._native.floor())

    def __len__(self) -> int:
        return len(self._native)

    def __repr__(self) -> str:
        return repr(self._native)
