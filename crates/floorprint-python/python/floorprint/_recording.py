"""Recordings, record by record."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from os import PathLike
from typing import Any

from floorprint import _native
from floorprint._config import Config, configuration
from floorprint._native import Encoders, Frame, Imu, Odometry, RgbdImage, Scan

Record = Scan | Odometry | Encoders | Imu
Choice = tuple[int | None, list[str], str | None, str | None, str | None, float | None]


#: So many images are in memory at a time.
IMAGES_AT_ONCE = 16
#: Nothing is chosen: what to use of a recording is found out.
EVERYTHING: Choice = (None, [], None, None, None, None)


def choice(
    drive: int | None,
    scan: str | Sequence[str],
    odom: str | None,
    truth: str | None,
    base: str | None,
    max_expansion: float | None,
) -> Choice:
    """What a call chooses of a recording."""
    return (drive, [scan] if isinstance(scan, str) else list(scan), odom, truth, base, max_expansion)


class Recording:
    """A recorded drive: an iterable of its records, in the order in which they are to be processed."""

    def __init__(self, native: _native.Recording) -> None:
        self._native = native

    def __iter__(self) -> Iterator[Record]:
        return iter(self._native)

    def __len__(self) -> int:
        return len(self._native)

    def __getitem__(self, index: int) -> Record:
        return self._native[index]

    def __repr__(self) -> str:
        return repr(self._native)

    @property
    def format(self) -> str:
        """Name of the format as recognised."""
        return self._native.format

    @property
    def robot(self) -> dict[str, Any]:
        """The robot's calibration, as sections of ``[robot]``."""
        robot: dict[str, Any] = json.loads(self._native.robot_json)
        return robot

    @property
    def notes(self) -> list[str]:
        """What is missing, what was assumed."""
        return self._native.notes

    @property
    def dropped(self) -> dict[str, int]:
        """How much was not used, by reason."""
        return self._native.dropped

    @property
    def input_sha256(self) -> str:
        """SHA-256 of the input; of a single file what ``sha256sum`` prints."""
        return self._native.input_sha256

    def config(self, config: Config | None = None, *, preset: str | None = None, **settings: object) -> Config:
        """The configuration with this recording's robot underneath."""
        return configuration(config, preset, settings)._with(robot=self._native.robot_json)

    def frames(self, config: Config | None = None) -> list[Frame]:
        """The frames that :meth:`Slam.process` takes, as ``run`` makes them: scans with the motion before them."""
        return self._native.frames(self.config(config).layers)

    def images(self, config: Config | None = None) -> Iterator[RgbdImage]:
        """The colour images, each with the depth image that was taken nearest to it, in the order of time.

        They are read as they are asked for, some at a time. With :meth:`Slam.push` they paint the floor.

        Raises:
            Error: An image is damaged.
        """
        pairs = self._native.image_pairs(self.config(config).layers)
        for first in range(0, len(pairs), IMAGES_AT_ONCE):
            yield from self._native.images(pairs[first : first + IMAGES_AT_ONCE])


def open(
    path: str | PathLike[str],
    *,
    drive: int | None = None,
    scan: str | Sequence[str] = (),
    odom: str | None = None,
    truth: str | None = None,
    base: str | None = None,
    max_expansion: float | None = None,
) -> Recording:
    """Reads a recording: a file or a folder, recognised by its content.

    Args:
        path: Data set.
        drive: Number of the drive, for folders that hold several.
        scan: Topics of a bag's scans; what is not chosen is found out.
        odom: Topic of a bag's odometry; ``/tf`` for the odometry among its transforms.
        truth: Topic of a bag's true poses.
        base: Frame of a bag that is taken for the robot's body.
        max_expansion: How many times its size a file may take in memory, besides 256 MB; 64 where nothing is said.

    Raises:
        Error: It cannot be read.
    """
    return Recording(_native.Recording(path, choice(drive, scan, odom, truth, base, max_expansion)))
