"""Logs and results in stores: in memory, by file addresses, and in S3 as a real server on this machine speaks it."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import floorprint
from floorprint import fleet

fsspec = pytest.importorskip("fsspec")


def solved(logs: list[str], out: str, **settings: Any) -> dict[str, fleet.Outcome]:
    """Outcomes by log."""
    outcomes = list(fleet.map(logs, out=out, workers=2, timeout_s=120.0, scan={"every": 4}, **settings))
    assert sorted(outcome.log for outcome in outcomes) == sorted(logs)
    return {outcome.log: outcome for outcome in outcomes}


def test_logs_and_results_are_in_memory(room_log: Path) -> None:
    memory = fsspec.filesystem("memory")
    memory.pipe_file("/logs/robot.clf", room_log.read_bytes())
    outcomes = solved(["memory://logs/robot.clf", "memory://logs/missing.clf"], "memory://runs")
    done = outcomes["memory://logs/robot.clf"]
    assert (done.status, done.folder) == ("done", "memory://runs/robot"), done.error
    report = json.loads(memory.cat_file("/runs/robot/report.json"))
    # The report names what was asked for, not where it lay meanwhile.
    assert report["input"]["path"] == "memory://logs/robot.clf" and "memory://" in report["made"]["command"]
    missing = outcomes["memory://logs/missing.clf"]
    assert (missing.status, missing.error) == ("failed", "there is nothing at memory://logs/missing.clf")
    with pytest.raises(floorprint.ConfigError, match="memory of one process"):
        fleet.map(["memory://logs/robot.clf"], cluster=True)


def test_a_folder_is_fetched_with_its_truth_and_leaves_nothing_behind(drive: Path, tmp_path: Path) -> None:
    before = set(Path(os.environ.get("TMPDIR", "/tmp")).glob("floorprint-*"))
    address, out = drive.as_uri(), (tmp_path / "runs").as_uri()
    outcome = solved([address], out)[address]
    assert outcome.report is not None and "trajectory" in outcome.report["errors"], outcome.error
    # The same files as a run here has.
    (here,) = fleet.map([drive], out=tmp_path / "here", scan={"every": 4})
    names = {path.name for path in (tmp_path / "here" / "drive").iterdir()}
    assert {path.name for path in (tmp_path / "runs" / "drive").iterdir()} == names
    same = (Path(str(folder)) / "map.pgm" for folder in (here.folder, tmp_path / "runs" / "drive"))
    assert len({path.read_bytes() for path in same}) == 1
    assert set(Path(os.environ.get("TMPDIR", "/tmp")).glob("floorprint-*")) <= before


def test_what_cannot_be_opened_is_said_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(floorprint.Error, match="nosuch://… cannot be opened"):
        fleet.map(["nosuch://bucket/log"])
    monkeypatch.setitem(sys.modules, "fsspec", None)
    with pytest.raises(
        ImportError, match=r"s3://… need fsspec, which is not installed: pip install 'floorprint\[store\]'"
    ):
        fleet.map(["s3://bucket/log"])


@pytest.fixture
def s3(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """A store that a server on loopback holds, found by the environment as programs find the real one."""
    pytest.importorskip("s3fs")
    server = pytest.importorskip("moto.server").ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    for name, value in (
        ("AWS_ENDPOINT_URL", f"http://{host}:{port}"),
        ("AWS_ACCESS_KEY_ID", "anyone"),
        ("AWS_SECRET_ACCESS_KEY", "anything"),
        ("AWS_DEFAULT_REGION", "us-east-1"),
    ):
        monkeypatch.setenv(name, value)
    store = fsspec.filesystem("s3", skip_instance_cache=True)
    store.mkdir("logs")
    yield store
    server.stop()


def test_logs_and_results_are_in_s3(s3: Any, room_log: Path, drive: Path) -> None:
    for name in ("one.clf", "two.clf"):
        s3.pipe_file(f"logs/{name}", room_log.read_bytes())
    s3.pipe_file("logs/damaged.clf", b"FLASER nonsense\n")
    s3.put(str(drive) + "/", "logs/drive/", recursive=True)
    logs = [f"s3://logs/{name}" for name in ("one.clf", "two.clf", "damaged.clf", "drive", "missing.clf")]
    outcomes = solved([*logs, "s3://nowhere/log.clf"], "s3://logs/runs")
    statuses = [outcomes[log].status for log in [*logs, "s3://nowhere/log.clf"]]
    assert statuses == ["done", "done", "failed", "done", "failed", "failed"], outcomes
    report = outcomes["s3://logs/drive"].report
    assert report is not None and "trajectory" in report["errors"], "the truth came along"
    s3.invalidate_cache()
    folders = {path.rpartition("/")[2] for path in s3.ls("logs/runs")}
    assert folders == {"one", "two", "drive"}
    for folder in folders:
        stored = json.loads(s3.cat_file(f"logs/runs/{folder}/report.json"))
        assert stored["input"]["path"].startswith("s3://logs/")
        assert s3.info(f"logs/runs/{folder}/session.gpkg")["size"] > 10_000

    # Where nothing may be written a row says so.
    refused = solved(["s3://logs/one.clf"], "s3://no-such-bucket/runs")["s3://logs/one.clf"]
    assert refused.status == "failed" and refused.error is not None
    assert refused.error.startswith("cannot write s3://no-such-bucket/runs/one: "), refused.error
    assert {bucket.rstrip("/") for bucket in s3.ls("")} == {"logs"}, "no bucket is made"
