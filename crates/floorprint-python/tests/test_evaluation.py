"""Our errors beside those of evo, which many use."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import floorprint


def for_evo(poses: NDArray[Any]) -> Any:
    """Poses as evo has them."""
    from evo.core.trajectory import PoseTrajectory3D

    tum = floorprint.tum(poses)
    return PoseTrajectory3D(tum[:, 1:4], np.roll(tum[:, 4:], 1, axis=1), tum[:, 0])


@pytest.mark.parametrize("align", ["none", "best"])
def test_errors_are_those_of_evo(drive: Path, result: floorprint.Result, align: str) -> None:
    pytest.importorskip("evo")
    from evo.core import metrics, sync

    true_poses = floorprint.read_trajectory(drive / "truth.tum")
    truth, estimate = sync.associate_trajectories(for_evo(true_poses), for_evo(result.trajectory), max_diff=1e-4)
    if align == "best":
        estimate.align(truth)
    error = metrics.APE(metrics.PoseRelation.translation_part)
    error.process_data((truth, estimate))
    ours = floorprint.evaluate(true_poses, result.trajectory, align=align)
    assert ours["matched"] == estimate.num_poses
    for name in ("rmse", "mean", "max"):
        assert ours["translation_m"][name] == pytest.approx(error.get_all_statistics()[name], abs=1e-6), name


def test_a_drive_tells_of_the_robot(drive: Path) -> None:
    told = floorprint.calibrate(drive)
    assert told["stretches"] > 5 and 0.0 < told["residual_m"] < 0.1
    parameters = {parameter["key"]: parameter for parameter in told["parameters"]}
    assert all(parameter["sigma"] > 0.0 for parameter in parameters.values() if parameter["is_told"])
    # What was found is a setting.
    found = {key: parameter["found"] for key, parameter in parameters.items() if parameter["is_told"]}
    assert found
    floorprint.open(drive).config().copy(**found)


def test_trajectories_are_read_and_written(result: floorprint.Result, run_folder: Path, tmp_path: Path) -> None:
    poses = floorprint.read_trajectory(run_folder / "trajectory.tum")
    for form in (result.trajectory, result.trajectory_tum):
        floorprint.write_trajectory(tmp_path / "again.tum", form)
        again = floorprint.read_trajectory(tmp_path / "again.tum")
        for name in ("stamp_s", "x", "y", "theta"):
            np.testing.assert_allclose(again[name], poses[name], atol=1e-6)
    with pytest.raises(TypeError, match=r"\(5, 3\)"):
        floorprint.evaluate(np.zeros((5, 3)), np.zeros((5, 3)))
