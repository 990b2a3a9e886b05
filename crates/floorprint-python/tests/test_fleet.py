"""Many logs, some of which crash or hang."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import floorprint
from floorprint import fleet


def test_every_log_has_one_outcome(drive: Path, tmp_path: Path) -> None:
    damaged = tmp_path / "damaged.clf"
    damaged.write_text("FLASER nonsense\n")
    logs = [drive, damaged, drive, tmp_path / "missing"]
    outcomes = list(fleet.map(logs, out=tmp_path / "runs", workers=2, scan={"every": 4}))
    by_log = sorted((outcome.log, outcome.status) for outcome in outcomes)
    assert by_log == sorted(
        [(str(drive), "done")] * 2 + [(str(damaged), "failed"), (str(tmp_path / "missing"), "failed")]
    )
    for outcome in outcomes:
        if outcome.status == "done":
            assert outcome.report is not None and outcome.report["drive"]["poses"] > 10
            assert outcome.folder is not None and (Path(outcome.folder) / "report.json").exists()
        else:
            assert outcome.error
    assert {path.name for path in (tmp_path / "runs").iterdir()} == {"drive", "drive-2"}


def test_what_hangs_is_given_up_and_what_crashes_says_so(drive: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    slow = fleet._Job(str(drive), floorprint.Config("seed", filter={"particles": 20000}), None, 1, 1.0, 0)
    assert fleet._attempt(slow).status == "timed out"
    monkeypatch.setattr(fleet, "_WORKER", [sys.executable, "-c", "import os; os.abort()"])
    crashed = fleet._attempt(fleet._Job(str(drive), floorprint.Config(), None, 1, 60.0, 1))
    assert crashed.status == "crashed" and crashed.error is not None and "SIGABRT" in crashed.error


def test_what_cannot_work_is_said_at_once(drive: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(TypeError, match="expected a list of paths"):
        fleet.map(str(drive))
    with pytest.raises(floorprint.ConfigError, match="did you mean"):
        fleet.map([drive], filter={"particels": 3})
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(
        ImportError, match=r"clusters need ray, which is not installed: pip install 'floorprint\[ray\]'"
    ):
        fleet.map([drive], cluster=True)
    assert list(fleet.map([])) == []


def test_a_script_needs_no_guard_and_may_stop_early(drive: Path) -> None:
    script = (
        "from floorprint import fleet\n"
        f"for outcome in fleet.map([{str(drive)!r}] * 6, workers=2, preset='fast'):\n"
        "    print(outcome.status)\n"
        "    break\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (0, "done\n"), done.stderr
