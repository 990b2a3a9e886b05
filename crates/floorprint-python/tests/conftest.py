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
