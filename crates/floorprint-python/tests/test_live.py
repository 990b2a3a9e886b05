"""A robot of one's own: readings pushed as they come."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import floorprint


def test_raw_readings_make_a_trajectory_and_a_map(drive: Path) -> None:
    recording = floorprint.open(drive)
    slam = floorprint.Slam(recording.config())
    steps = [step for record in recording for step in slam.push(record)]
    assert slam.map is not None and (slam.map.cells == 100).any()
    assert len(slam.trajectory) == len(steps)
    steps += slam.flush()
    session = slam.finish()
    assert len(session) == len(steps) > 100
    error = floorprint.evaluate(drive / "truth.tum", session.trajectory)
    assert error["translation_m"]["rmse"] < 0.05
    with pytest.raises(RuntimeError, match="finished"):
        slam.push(recording[0])


def test_records_are_what_they_were_made_of() -> None:
    geometry = floorprint.ScanGeometry(np.linspace(-1, 1, 5), 0.1, 30.0)
    for ranges in (np.arange(5.0), np.arange(5, dtype=np.float32), [0, 1, 2, 3, 4], np.arange(10)[::2] // 2):
        scan = floorprint.Scan(1.5, ranges, geometry, odometry=(1.0, 2.0, 0.5))
        np.testing.assert_array_equal(scan.ranges_m, np.arange(5, dtype=np.float32))
        assert (scan.stamp_s, scan.odometry, len(scan.geometry)) == (1.5, (1.0, 2.0, 0.5), 5)
    with pytest.raises(TypeError, match=r"ranges_m: expected a one-dimensional array of floats.*\(1, 5\)"):
        floorprint.Scan(0.0, np.zeros((1, 5)), geometry)
    with pytest.raises(ValueError, match="4 ranges for 5 rays"):
        floorprint.Scan(0.0, np.zeros(4), geometry)
    slam = floorprint.Slam()
    with pytest.raises(TypeError, match="expected a Scan"):
        slam.push(3)  # type: ignore[arg-type]


def test_what_is_not_finite_is_refused_and_changes_nothing() -> None:
    geometry = floorprint.ScanGeometry(np.linspace(-2, 2, 90), 0.1, 30.0)
    slam = floorprint.Slam()
    bad = floorprint.Scan(0.0, np.full(90, np.nan), geometry, odometry=(np.nan, 0.0, 0.0))
    slam.push(bad)
    steps = slam.push(floorprint.Scan(1.0, np.full(90, 3.0), geometry, odometry=(0.0, 0.0, 0.0)))
    assert all(np.isfinite(step.pose).all() for step in steps)


def test_a_robot_is_found_in_a_session_and_in_a_map(drive: Path, result: floorprint.Result) -> None:
    recording = floorprint.open(drive)
    config = recording.config()
    frames = recording.frames(config)
    for place in (result.session, result.map):
        localizer = floorprint.Localizer(place, config, start=(0.0, 0.0, 0.0))
        report = None
        for frame in frames[:60]:
            report = localizer.process(frame)
        assert report is not None and report.pose is not None and report.covariance.shape == (3, 3)
        known = result.trajectory[59]
        assert np.hypot(report.pose[0] - known["x"], report.pose[1] - known["y"]) < 0.2


def test_sessions_are_saved_gone_on_with_and_merged(drive: Path, result: floorprint.Result, tmp_path: Path) -> None:
    path = tmp_path / "session.gpkg"
    result.session.save(path)
    stored = floorprint.Session.open(path)
    np.testing.assert_array_equal(stored.trajectory["x"], result.trajectory["x"])
    assert stored.map is not None
    np.testing.assert_array_equal(stored.map.cells, result.map.cells)
    assert stored.floor is not None
    with pytest.raises(floorprint.Error, match="a file stands there"):
        result.session.save(path)
    merged, is_placed = stored.merge(result.session)
    assert is_placed and len(merged) == 2 * len(stored)
    changes = stored.diff(result.session)
    assert sum(change.area_m2 for change in changes) < 1.0, "hardly anything changes between a drive and itself"

    recording = floorprint.open(drive)
    slam = floorprint.Slam(recording.config(), session=stored)
    slam.interrupt()
    slam.process(recording.frames()[0])
    assert len(slam.session) == len(stored) + 1


def test_recordings_are_sequences_of_records(drive: Path) -> None:
    recording = floorprint.open(drive)
    kinds = {type(record) for record in recording}
    assert kinds == {floorprint.Scan, floorprint.Encoders, floorprint.Imu}
    assert len(list(recording)) == len(recording) and recording[-1].stamp_s >= recording[0].stamp_s
    with pytest.raises(IndexError):
        _ = recording[len(recording)]
    assert recording.format == "ece276a" and len(recording.input_sha256) == 64
    assert recording.robot["name"] and not recording.dropped
    assert floorprint.check(drive) == []
