"""Results against the truth, recordings examined, drives simulated."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from os import PathLike, fspath
from typing import TYPE_CHECKING, Any

from floorprint import _native
from floorprint._config import Config, configuration
from floorprint._poses import read_trajectory, rows, structured
from floorprint._progress import Progress, shown
from floorprint._recording import choice

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


def _poses(poses: str | PathLike[str] | NDArray[Any]) -> Any:
    return rows(read_trajectory(poses) if isinstance(poses, (str, PathLike)) else poses)


def evaluate(
    truth: str | PathLike[str] | NDArray[Any],
    estimate: str | PathLike[str] | NDArray[Any],
    *,
    align: str = "none",
    stretches_m: Sequence[float] = (1.0, 10.0),
) -> dict[str, Any]:
    """Absolute and relative errors of a trajectory against the true one.

    Args:
        truth, estimate: Poses, or TUM files.
        align: How the estimate is moved onto the truth first: ``none``, ``first`` (by the first common pose) or
            ``best`` (by the rigid motion with the least squared distances).
        stretches_m: Lengths of the stretches for relative errors, metres.

    Returns:
        ``translation_m`` and ``rotation_deg`` with ``mean``, ``rmse``, ``max`` …; ``matched`` poses; ``relative``.
    """
    error: dict[str, Any] = json.loads(
        _native.evaluate_trajectory(_poses(truth), _poses(estimate), align, list(map(float, stretches_m)))
    )
    return error


def errors_over_time(
    truth: str | PathLike[str] | NDArray[Any], estimate: str | PathLike[str] | NDArray[Any]
) -> NDArray[np.void]:
    """How far each pose of a trajectory is from the true one at its time, without any alignment.

    Args:
        truth, estimate: Poses, or TUM files. Between two true poses it is interpolated, over gaps of up to half a
            second; poses at whose time nothing is known of the truth are left out.

    Returns:
        Fields stamp_s (seconds), translation_m (metres) and rotation_deg (degrees, at least 0).
    """
    return structured(_native.errors_over_time(_poses(truth), _poses(estimate)))


def evaluate_relations(relations: str | PathLike[str], estimate: str | PathLike[str] | NDArray[Any]) -> dict[str, Any]:
    """A trajectory against relations of the Freiburg SLAM benchmark: groups ``all``, ``short`` and ``long``."""
    report: dict[str, Any] = json.loads(_native.evaluate_relations(relations, _poses(estimate)))
    return report


def check(
    path: str | PathLike[str],
    *,
    config: Config | None = None,
    preset: str | None = None,
    drive: int | None = None,
    scan: str | Sequence[str] = (),
    odom: str | None = None,
    base: str | None = None,
    **settings: object,
) -> list[dict[str, Any]]:
    """What is wrong with a recording: units, stamps, clocks, mounts, signs.

    Returns:
        A dictionary for each symptom: ``severity``, ``evidence``, ``effect``, ``remedy`` and its numbers.
    """
    layers = configuration(config, preset, settings).layers
    told: list[dict[str, Any]] = json.loads(_native.check(path, choice(drive, scan, odom, None, base, None), layers))
    return told


def calibrate(
    path: str | PathLike[str],
    *,
    config: Config | None = None,
    preset: str | None = None,
    drive: int | None = None,
    scan: str | Sequence[str] = (),
    odom: str | None = None,
    base: str | None = None,
    **settings: object,
) -> dict[str, Any]:
    """What an ordinary drive tells of the robot: wheels, scales, mounts and clocks, with uncertainties.

    Returns:
        ``parameters``, each a dictionary with the option's ``key``, ``before``, ``found``, ``sigma``, ``unit``, and
        whether it ``is_told`` by this drive; over how many ``stretches`` motions were compared, and by how much they
        differ: ``residual_m``, ``residual_rad``.
    """
    layers = configuration(config, preset, settings).layers
    told: dict[str, Any] = json.loads(_native.calibrate(path, choice(drive, scan, odom, None, base, None), layers))
    return told


def simulate(
    out: str | PathLike[str],
    *,
    world: str = "rooms",
    seed: int = 0,
    drive: int = 1,
    settings: Mapping[str, object] | None = None,
    replace: bool = False,
    progress: bool | Progress = False,
) -> float:
    """Simulates a drive with exact truth into a folder, in the file layout of the course ECE276A.

    Args:
        out: Folder to make.
        world: World to drive through.
        seed: Seed of the world's furniture and of all errors of the sensors.
        drive: Number of the drive in the files' names.
        settings: Robot, sensors and faults, as in docs/simulation.md.
        replace: Whether an earlier simulation is replaced.
        progress: ``True`` for a bar, or a callback.

    Returns:
        The length of the drive, seconds.
    """
    with shown(progress) as show:
        return _native.simulate(fspath(out), world, seed, drive, json.dumps(settings or {}), replace, show)
