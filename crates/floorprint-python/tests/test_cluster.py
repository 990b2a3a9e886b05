"""A cluster of Ray's on this machine, in which everything goes wrong that can."""

from __future__ import annotations

import os
import shutil
import signal
import sys
import threading
import time
from collections import Counter
from pathlib import Path

import pytest

from floorprint import fleet


def process_of(log: Path) -> int | None:
    """The process that solves a log now."""
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            words = (folder / "cmdline").read_bytes().decode(errors="replace")
        except OSError:
            continue
        if "floorprint._worker" in words and f'"{log}"' in words:
            return int(folder.name)
    return None


def parent_of(process: int) -> int:
    status = Path(f"/proc/{process}/status").read_text()
    return int(status.partition("PPid:")[2].split()[0])


@pytest.mark.skipif(sys.platform != "linux", reason="processes are found in /proc")
def test_forty_logs_of_which_one_crashes_one_hangs_and_a_worker_is_killed(room_log: Path, tmp_path: Path) -> None:
    ray = pytest.importorskip("ray")
    logs = [tmp_path / f"robot-{number:02}.clf" for number in range(40)]
    for log in logs:
        shutil.copy(room_log, log)
    crashing, hanging, orphaned = logs[3], logs[11], logs[20]
    done = threading.Event()
    killed: list[int] = []

    def go_wrong() -> None:
        while not done.is_set():
            time.sleep(0.005)
            try:
                # As often as it is tried again.
                if process := process_of(crashing):
                    os.kill(process, signal.SIGSEGV)
                if process := process_of(hanging):
                    os.kill(process, signal.SIGSTOP)
                if not killed and (process := process_of(orphaned)):
                    worker = parent_of(process)
                    # The worker, not its log; that one ends by itself.
                    os.kill(worker, signal.SIGKILL)
                    killed.append(worker)
            except ProcessLookupError:
                continue

    saboteur = threading.Thread(target=go_wrong)
    saboteur.start()
    try:
        ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
        outcomes = list(fleet.map(logs, out=tmp_path / "runs", timeout_s=10.0, preset="fast"))
    finally:
        done.set()
        saboteur.join()
        ray.shutdown()
    assert len(killed) == 1
    assert sorted(outcome.log for outcome in outcomes) == [str(log) for log in logs], "each log once"
    assert Counter(outcome.status for outcome in outcomes) == {"done": 38, "crashed": 1, "timed out": 1}
    by_log = {outcome.log: outcome for outcome in outcomes}
    assert by_log[str(crashing)].error == "the process ended with SIGSEGV"
    assert by_log[str(hanging)].error == "took longer than 10 s"
    assert by_log[str(orphaned)].status == "done"
    complete = {path.parent.name for path in (tmp_path / "runs").glob("*/report.json")}
    assert complete == {log.stem for log in logs} - {crashing.stem, hanging.stem}
    assert process_of(hanging) is None, "what hung is gone"
