"""Our errors beside those of evo, which many use."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import floorprint


@pytest.mark.parametrize("align", ["none", "best"])
def test_errors_are_those_of_evo(drive: Path, run_folder: Path, align: str) -> None:
    pytest.importorskip("evo")
    from evo.core import metrics, sync
    from evo.tools import file_interface

    truth = file_interface.read_tum_trajectory_file(drive / "truth.tum")
    estimate = file_interface.read_tum_trajectory_file(run_folder / "trajectory.tum")
    truth, estimate = sync.associate_trajectories(truth, estimate, max_diff=1e-4)
    if align == "best":
        estimate.align(truth)
    error = metrics.APE(metrics.PoseRelation.translation_part)
    error.process_data((truth, estimate))
    ours = floorprint.evaluate(drive / "truth.tum", run_folder / "trajectory.tum", align=align)
    assert ours["matched"] == estimate.num_poses
    for name in ("rmse", "mean", "max"):
        assert ours["translation_m"][name] == pytest.approx(error.get_all_statistics()[name], abs=1e-6), name


def test_trajectories_are_read_and_written(result: floorprint.Result, run_folder: Path, tmp_path: Path) -> None:
    poses = floorprint.read_trajectory(run_folder / "trajectory.tum")
    for form in (result.trajectory, result.trajectory_tum):
        floorprint.write_trajectory(tmp_path / "again.tum", form)
        again = floorprint.read_trajectory(tmp_path / "again.tum")
        for name in ("stamp_s", "x", "y", "theta"):
            np.testing.assert_allclose(again[name], poses[name], atol=1e-6)
    with pytest.raises(TypeError, match=r"\(5, 3\)"):
        floorprint.evaluate(np.zeros((5, 3)), np.zeros((5, 3)))
