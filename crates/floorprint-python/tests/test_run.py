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


def test_a_plot_shows_the_map_and_how_far_it_is_off(result: floorprint.Result) -> None:
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("agg")
    from matplotlib import pyplot

    assert result.truth is not None
    map_axes, position, heading = result.plot().axes
    assert [line.get_label() for line in map_axes.lines] == ["odometry", "trajectory", "truth"]
    # The drawn error is that of the report.
    drawn = np.asarray(position.lines[1].get_ydata())
    rmse = result.report["errors"]["trajectory"]["translation_m"]["rmse"]
    assert np.sqrt(np.mean(drawn**2)) == pytest.approx(rmse, rel=1e-3)
    assert position.get_ylim()[1] > drawn.max() and len(heading.lines) == 3
    # Into axes of one's own goes the map, and nothing else is made.
    figure, axes = pyplot.subplots()
    assert result.plot(axes) is figure and len(figure.axes) == 1
    pyplot.close("all")


def test_a_plot_of_a_log_without_truth_or_with_that_of_another_day(room_log: Path, tmp_path: Path) -> None:
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("agg")
    from matplotlib import pyplot

    without = floorprint.run(room_log)
    (axes,) = without.plot().axes
    assert without.truth is None and axes.get_xlim() == without.map.extent[:2]
    log = tmp_path / "robot.clf"
    log.write_bytes(room_log.read_bytes())
    another_day = without.trajectory.copy()
    another_day["stamp_s"] += 86400.0
    floorprint.write_trajectory(tmp_path / "robot.truth.tum", another_day)
    beside = floorprint.run(log)
    assert "trajectory" not in beside.report["errors"]
    assert beside.truth is not None and len(beside.plot().axes) == 1
    pyplot.close("all")


def test_a_missing_package_is_named_with_what_to_do(result: floorprint.Result, monkeypatch: pytest.MonkeyPatch) -> None:
    for package in ("matplotlib", "pandas", "pyarrow", "tqdm"):
        for inside in [name for name in sys.modules if name.startswith(f"{package}.")]:
            monkeypatch.delitem(sys.modules, inside)
        monkeypatch.setitem(sys.modules, package, None)
    for needs, extra in (
        (result.plot, "plot"),
        (result.map.plot, "plot"),
        (result.to_pandas, "pandas"),
        (result.to_arrow, "arrow"),
        (lambda: floorprint.run("anything", progress=True), "progress"),
    ):
        with pytest.raises(ImportError, match=rf"not installed: pip install 'floorprint\[{extra}\]'"):
            needs()


def test_errors_over_time_are_those_of_the_report(result: floorprint.Result) -> None:
    assert result.truth is not None
    errors = floorprint.errors_over_time(result.truth, result.trajectory)
    stated = result.report["errors"]["trajectory"]
    assert errors["translation_m"].max() == pytest.approx(stated["translation_m"]["max"], abs=1e-9)
    assert errors["rotation_deg"].max() == pytest.approx(stated["rotation_deg"]["max"], abs=1e-9)
    assert set(errors["stamp_s"]) <= set(result.trajectory["stamp_s"])
    # Where nothing is known of the truth there is no error.
    shifted = result.truth.copy()
    shifted["stamp_s"] += 1e6
    assert len(floorprint.errors_over_time(shifted, result.trajectory)) == 0


def test_tables_are_frames_of_pandas_and_of_arrow(result: floorprint.Result, tmp_path: Path) -> None:
    pandas, pyarrow = pytest.importorskip("pandas"), pytest.importorskip("pyarrow")
    names: tuple[Any, ...] = ("trajectory", "odometry", "steps", "closures")
    for name in names:
        array = getattr(result, name)
        frame, table = result.to_pandas(name), result.to_arrow(name)
        assert table.column_names == list(array.dtype.names) and len(frame) == table.num_rows == len(array)
        np.testing.assert_array_equal(table["x"].to_numpy(), array["x"])
        np.testing.assert_array_equal(frame["x"].to_numpy(), array["x"])
    assert result.to_pandas().index.name == "stamp_s"
    assert set(result.to_pandas("closures")["verdict"]) == set(result.closures["verdict"])
    assert pyarrow.types.is_boolean(result.to_arrow("steps").schema.field("is_lost").type)
    # An empty table has its columns.
    assert list(floorprint.to_pandas(result.steps[:0])) == list(result.steps.dtype.names or ())
    assert floorprint.to_arrow(result.closures[:0]).num_rows == 0
    with pytest.raises(ValueError, match="there is no table 'poses'; there are trajectory"):
        result.to_pandas("poses")  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="structured array"):
        floorprint.to_pandas(result.map.cells)  # type: ignore[arg-type]
    pytest.importorskip("pyarrow.parquet").write_table(result.to_arrow(), tmp_path / "trajectory.parquet")
    assert len(pandas.read_parquet(tmp_path / "trajectory.parquet")) == len(result.trajectory)


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
