"""A small simulated drive, and what the command line makes of it."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

import floorprint

#: Few rays and no camera: quick, and still a drive.
SMALL = {
    "motion": {"speed_m_s": 2.0},
    "lidar": {"beams": 181, "rate_hz": 5.0},
    "camera": {"rate_hz": 0.5},
}


@pytest.fixture(scope="session")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated drive in the file layout of the course, with its truth."""
    folder = tmp_path_factory.mktemp("data") / "drive"
    floorprint.simulate(folder, world="rooms", settings=SMALL)
    return folder


@pytest.fixture(scope="session")
def result(drive: Path) -> floorprint.Result:
    return floorprint.run(drive, threads=2)


@pytest.fixture(scope="session")
def program() -> list[str]:
    """The command line: the binary where one is named, else that of the package."""
    binary = os.environ.get("FLOORPRINT_PROGRAM")
    return [binary] if binary else ["floorprint"]


@pytest.fixture(scope="session")
def run_folder(drive: Path, program: list[str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The drive as the command line solves it."""
    out = tmp_path_factory.mktemp("runs") / "command-line"
    subprocess.run([*program, "run", "--quiet", str(drive), "--out", str(out)], check=True)
    return out


def write_room_log(path: Path, scans: int = 40, width_m: float = 5.0) -> Path:
    """A robot that drives half a circle in a room 6 m long, as a CARMEN log."""
    import numpy as np

    angles_rad = np.radians(np.arange(180) - 90.0)
    lines = []
    for stamp_s in 0.2 * np.arange(scans):
        turned = np.pi * stamp_s / 8.0
        x, y = 1.5 * np.sin(turned), -1.5 * np.cos(turned)
        cos, sin = np.cos(turned + angles_rad), np.sin(turned + angles_rad)
        with np.errstate(divide="ignore"):
            ranges_m = np.minimum((np.copysign(3.0, cos) - x) / cos, (np.copysign(width_m / 2.0, sin) - y) / sin)
        pose = f"{x:.4f} {y:.4f} {turned:.5f}"
        text = " ".join(f"{range_m:.3f}" for range_m in ranges_m)
        lines.append(f"FLASER 180 {text} {pose} {pose} {stamp_s:.3f} robot {stamp_s:.3f}\n")
    path.write_text("".join(lines))
    return path


@pytest.fixture(scope="session")
def room_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short log."""
    return write_room_log(tmp_path_factory.mktemp("logs") / "robot.clf")
