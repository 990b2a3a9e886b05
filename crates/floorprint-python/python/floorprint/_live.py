"""SLAM and localization, pushed by hand."""

from __future__ import annotations

from typing import TYPE_CHECKING

from floorprint import _native
from floorprint._config import Config, configuration
from floorprint._map import Floor, Map, floor_of, map_of
from floorprint._native import Frame, LocalizationReport, RgbdImage, StepReport
from floorprint._poses import structured
from floorprint._recording import Record
from floorprint._session import Session

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

Pose = tuple[float, float, float]


class Slam:
    """Simultaneous localisation and mapping, live: readings go in as they come, reports come out.

    Args:
        config: Configuration, with the robot's calibration.
        session: Session to go on with, where it ended.
        preset, settings: As those of :class:`Config`, in its place or over it.
    """

    def __init__(
        self,
        config: Config | None = None,
        *,
        session: Session | None = None,
        preset: str | None = None,
        **settings: object,
    ) -> None:
        self.config = configuration(config, preset, settings)
        layers = self.config.layers
        self._native = _native.Slam(layers) if session is None else _native.Slam.resume(session._native, layers)

    def push(self, record: Record | RgbdImage) -> list[StepReport]:
        """Takes in a record, or an image; gives a report for each scan that is ready by now.

        A scan waits until the odometry has passed it, unless it brings its own. Images paint the floor where the
        configuration states the robot's camera, ``robot={"depth_camera": …}``; one that shows no floor, or was taken
        where the one before was, adds nothing.

        Raises:
            Error: An image of a robot that states no camera; what the record leads to cannot be computed.
            RuntimeError: The drive is finished.
        """
        return self._native.push(record)

    def process(self, frame: Frame) -> StepReport:
        """Takes in a frame of a recording."""
        return self._native.process(frame)

    def flush(self) -> list[StepReport]:
        """No record follows soon: takes in the scans that still wait for the odometry."""
        return self._native.flush()

    def interrupt(self) -> None:
        """The next scan may be from anywhere: the robot was switched off and may have been moved."""
        self._native.interrupt()

    @property
    def map(self) -> Map | None:
        """The map so far; None as long as nothing was seen. Only what changed is drawn anew."""
        return map_of(self._native.map())

    @property
    def floor(self) -> Floor | None:
        """The floor's colours so far, painted anew along the trajectory; None as long as no image showed any."""
        return floor_of(self._native.floor())

    @property
    def trajectory(self) -> NDArray[np.void]:
        """The trajectory so far: fields stamp_s (seconds), x, y (metres), theta (radians)."""
        return structured(self._native.trajectory())

    @property
    def session(self) -> Session:
        """All that was seen so far, to be saved."""
        return Session(self._native.session())

    def finish(self) -> Session:
        """Ends the drive: closes the last loops, and fits all scans to each other."""
        return Session(self._native.finish())


class Localizer:
    """Finds a robot in a finished map and follows it; the map is never changed.

    Args:
        map: A session, or a map such as of ``map_server``.
        config: Configuration, with the robot's calibration.
        start: (x, y, theta) where the robot starts in the map's frame, metres and radians; None: anywhere.
        preset, settings: As those of :class:`Config`, in its place or over it.
    """

    def __init__(
        self,
        map: Session | Map,
        config: Config | None = None,
        *,
        start: Pose | None = None,
        preset: str | None = None,
        **settings: object,
    ) -> None:
        self.config = configuration(config, preset, settings)
        layers = self.config.layers
        if isinstance(map, Session):
            self._native = _native.Localizer.in_session(map._native, layers, start)
        else:
            self._native = _native.Localizer.in_map(map.cells, map.resolution_m, map.origin_m, layers, start)

    def push(self, record: Record) -> list[LocalizationReport]:
        """Takes in a record; gives a report for each scan that is ready by now."""
        return self._native.push(record)

    def process(self, frame: Frame) -> LocalizationReport:
        """Takes in a frame of a recording."""
        return self._native.process(frame)
