"""Results as arrays, and the same bytes as those of the command line."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import floorprint


def reproducible(report: dict[str, Any]) -> dict[str, Any]:
    """A report without what differs between two runs."""
    return {key: value for key, value in report.items() if key not in ("cost", "made")}


def test_python_writes_the_bytes_that_the_command_line_writes(
    result: floorprint.Result, run_folder: Path, tmp_path: Path
) -> None:
    result.save(tmp_path / "python")
    names = {path.name for path in run_folder.iterdir()}
    assert {path.name for path in (tmp_path / "python").iterdir()} == names
    # Pages and reports tell what they cost; a database has its own order of writing.
    for name in names - {"report.html", "report.json", "session.gpkg"}:
        assert (tmp_path / "python" / name).read_bytes() == (run_folder / name).read_bytes(), name
    reports = [json.loads((folder / "report.json").read_text()) for folder in (tmp_path / "python", run_folder)]
    assert reproducible(reports[0]) == reproducible(reports[1])
    # A second time there is a folder already.
    with pytest.raises(floorprint.Error, match="python"):
        result.save(tmp_path / "python")
    result.save(tmp_path / "python", replace=True)


def test_arrays_hold_what_the_files_hold(result: floorprint.Result, run_folder: Path) -> None:
    stored = np.loadtxt(run_folder / "trajectory.tum")
    assert result.trajectory_tum.shape == stored.shape
    np.testing.assert_allclose(result.trajectory_tum, stored, atol=1e-5)
    assert len(result.trajectory) == len(result.odometry) == len(result.steps)
    assert result.trajectory["sigma_m"][-1] > 0.0
    assert set(np.unique(result.map.cells)) == {-1, 0, 100} and result.map.cells.dtype == np.int8
    pixels = np.frombuffer((run_folder / "map.pgm").read_bytes()[-result.map.cells.size :], np.uint8)
    picture = pixels.reshape(result.map.cells.shape)[::-1]
    np.testing.assert_array_equal(picture == 0, result.map.cells == 100)
    assert result.floor is not None and result.floor.rgba.shape[2] == 4 and result.floor.rgba[..., 3].any()
    assert result.closures.dtype.names is not None and "verdict" in result.closures.dtype.names


def test_the_start_is_free_and_in_the_map(result: floorprint.Result) -> None:
    (left, bottom), cells = result.map.origin_m, result.map.cells
    row, column = int(-bottom / result.map.resolution_m), int(-left / result.map.resolution_m)
    assert cells[row, column] == 0


def test_frames_pushed_by_hand_give_the_same_trajectory(drive: Path) -> None:
    recording = floorprint.open(drive)
    config = recording.config()
    slam = floorprint.Slam(config)
    steps = [slam.process(frame) for frame in recording.frames(config)]
    session = slam.finish()
    solved = floorprint.run(drive, texture=False)
    np.testing.assert_array_equal(session.trajectory["x"], solved.trajectory["x"])
    np.testing.assert_array_equal([step.pose[0] for step in steps], solved.steps["x"])
    assert session.map is not None
    np.testing.assert_array_equal(session.map.cells, solved.map.cells)


def test_results_show_themselves(result: floorprint.Result) -> None:
    assert result._repr_png_().startswith(b"\x89PNG") and result.map._repr_png_().startswith(b"\x89PNG")
    assert "<img" in result._repr_html_() and "RMSE" in result._repr_html_()
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("agg")
    assert len(result.plot().axes[0].lines) == 2


def test_progress_is_told_and_what_it_raises_ends_the_work(drive: Path) -> None:
    seen = set()

    def show(task: str, done: int, total: int) -> None:
        assert 0 <= done and 0 <= total
        seen.add(task)

    floorprint.run(drive, progress=show)
    assert seen

    def stop(task: str, done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        floorprint.run(drive, progress=stop)


def test_ctrl_c_ends_a_run(drive: Path) -> None:
    # Some seconds of work, during which the signal comes from a timer.
    script = (
        "import floorprint, signal, sys\n"
        # Who runs the tests in the background of a shell has them ignore Ctrl-C.
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "signal.setitimer(signal.ITIMER_REAL, 0.3)\n"
        "signal.signal(signal.SIGALRM, lambda *_: signal.raise_signal(signal.SIGINT))\n"
        "try:\n"
        f"    floorprint.run({str(drive)!r}, preset='seed', filter={{'particles': 20000}})\n"
        "except KeyboardInterrupt:\n"
        "    sys.exit(42)\n"
    )
    assert subprocess.run([sys.executable, "-c", script], timeout=60).returncode == 42


def test_errors_say_what_the_command_line_says(drive: Path, program: list[str], tmp_path: Path) -> None:
    def of_program(*arguments: str) -> str:
        run = subprocess.run([*program, "run", *arguments], capture_output=True, text=True)
        assert run.returncode != 0
        return run.stderr.strip().removeprefix("error: ")

    with pytest.raises(floorprint.ConfigError) as unknown:
        floorprint.run(drive, filter={"particels": 3})
    assert str(unknown.value) == of_program(str(drive), "--set", "filter.particels=3")
    assert "did you mean" in str(unknown.value)
    with pytest.raises(floorprint.Error) as missing:
        floorprint.run(tmp_path / "nothing")
    assert str(missing.value) == of_program(str(tmp_path / "nothing"))


def test_the_command_line_comes_along(drive: Path) -> None:
    run = subprocess.run([sys.executable, "-m", "floorprint", "info", str(drive)], capture_output=True, text=True)
    assert run.returncode == 0 and "ece276a" in run.stdout
    run = subprocess.run([sys.executable, "-m", "floorprint", "run"], capture_output=True, text=True)
    assert run.returncode == 2 and "Usage" in run.stderr
