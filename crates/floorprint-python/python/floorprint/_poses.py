"""Stamped poses as numpy arrays."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from typing import TYPE_CHECKING, Any

from floorprint import _native

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


def structured(columns: Mapping[str, NDArray[Any]]) -> NDArray[np.void]:
    """Columns of equal length as one structured array."""
    import numpy as np

    length = len(next(iter(columns.values())))
    table = np.empty(length, dtype=[(name, column.dtype) for name, column in columns.items()])
    for name, column in columns.items():
        table[name] = column
    return table


def rows(poses: NDArray[Any]) -> NDArray[np.float64]:
    """Poses as an array of shape (n, 4): stamp_s, x, y, theta.

    Takes a structured array with these fields, an array of shape (n, 4), or one of shape (n, 8) as :func:`tum` gives.
    """
    import numpy as np

    array = np.asarray(poses)
    if array.dtype.names is not None:
        missing = {"stamp_s", "x", "y", "theta"} - set(array.dtype.names)
        if missing:
            raise TypeError(f"poses: the fields {', '.join(sorted(missing))} are missing")
        return np.column_stack([array[name] for name in ("stamp_s", "x", "y", "theta")]).astype(np.float64)
    if array.ndim == 2 and array.shape[1] == 8:
        yaw = 2.0 * np.arctan2(array[:, 6], array[:, 7])
        yaw = np.arctan2(np.sin(yaw), np.cos(yaw))
        array = np.column_stack([array[:, :3], yaw])
    if array.ndim != 2 or array.shape[1] != 4:
        raise TypeError(f"poses: expected a structured array, or one of shape (n, 4) or (n, 8), found {array.shape}")
    return np.ascontiguousarray(array, dtype=np.float64)


def tum(poses: NDArray[Any]) -> NDArray[np.float64]:
    """Poses as an array of shape (n, 8): stamp x y z qx qy qz qw, seconds and metres, as TUM files have them."""
    import numpy as np

    stamp_s, x, y, theta = rows(poses).T
    zero = np.zeros_like(x)
    return np.column_stack([stamp_s, x, y, zero, zero, zero, np.sin(theta / 2.0), np.cos(theta / 2.0)])


def read_trajectory(path: str | PathLike[str]) -> NDArray[np.void]:
    """The poses of a TUM file: fields stamp_s (seconds), x, y (metres), theta (radians)."""
    return structured(_native.read_trajectory(path))


def write_trajectory(path: str | PathLike[str], poses: NDArray[Any]) -> None:
    """Writes poses as a TUM file."""
    _native.write_trajectory(path, rows(poses))
