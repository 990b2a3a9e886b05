"""A robot of one's own: readings pushed as they come."""

from __future__ import annotations

import heapq
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


def test_images_pushed_by_hand_paint_the_floor(drive: Path, result: floorprint.Result) -> None:
    recording = floorprint.open(drive)
    slam = floorprint.Slam(recording.config())
    images = list(recording.images())
    assert len(images) > 10 and images[0].rgb.shape[2] == 3 and images[0].depth.ndim == 2
    for record in heapq.merge(recording, images, key=lambda record: record.stamp_s):
        if record is images[len(images) // 2]:
            assert slam.floor is not None, "there is a floor on the way"
        slam.push(record)
    session = slam.finish()
    assert session.floor is not None and result.floor is not None
    # The floor that `run` paints from the same images: as much of it, in the same colours.
    seen, known = (floor.rgba[..., 3] > 0 for floor in (session.floor, result.floor))
    assert seen.sum() == pytest.approx(known.sum(), rel=0.05)
    cells = [
        tuple(round(origin / floor.resolution_m) for origin in floor.origin_m)
        for floor in (session.floor, result.floor)
    ]
    left, low = (max(corner[axis] for corner in cells) for axis in (0, 1))
    both = [
        floor.rgba[low - y :, left - x :] for floor, (x, y) in zip((session.floor, result.floor), cells, strict=True)
    ]
    rows, columns = (min(part.shape[axis] for part in both) for axis in (0, 1))
    ours, theirs = (part[:rows, :columns].astype(float) for part in both)
    common = (ours[..., 3] > 0) & (theirs[..., 3] > 0)
    assert common.sum() > 0.9 * known.sum()
    assert np.abs(ours - theirs)[common][:, :3].mean() < 5.0


def test_images_are_what_they_were_made_of() -> None:
    rgb = np.arange(2 * 3 * 3, dtype=np.uint8).reshape(2, 3, 3)
    metres = np.array([[0.5, np.nan, 0.0], [1.2345, 70.0, -1.0]])
    for depth in (metres, metres.astype(np.float32), np.array([[500, 0, 0], [1234, 0, 0]], dtype=np.uint16)):
        image = floorprint.RgbdImage(2.0, rgb[::-1], depth, depth_stamp_s=1.9)
        np.testing.assert_array_equal(image.rgb, rgb[::-1])
        np.testing.assert_allclose(image.depth, [[500, 0, 0], [1234, 0, 0]], atol=1)
        assert (image.stamp_s, image.depth_stamp_s) == (2.0, 1.9) and image.depth.dtype == np.uint16
    for wrong, what in (
        (rgb[..., :2], "rgb: expected"),
        (rgb.astype(float), "rgb: expected"),
        (rgb[0], "rgb: expected"),
    ):
        with pytest.raises(TypeError, match=what):
            floorprint.RgbdImage(0.0, wrong, metres)
    with pytest.raises(TypeError, match=r"depth: expected .* of shape \(2, 3\), int64"):
        floorprint.RgbdImage(0.0, rgb, np.zeros((2, 3), dtype=np.int64))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="finite"):
        floorprint.RgbdImage(float("nan"), rgb, metres)
    with pytest.raises(floorprint.Error, match="states no camera"):
        floorprint.Slam().push(floorprint.RgbdImage(0.0, rgb, metres))


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
