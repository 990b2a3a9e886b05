"""Many logs: each in a process of its own, on this machine or on a cluster of Ray's.

A log that crashes, hangs or cannot be read is an outcome that says why, not the end of the others.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field, replace
from itertools import islice
from os import PathLike, fspath
from pathlib import Path
from typing import Any

from floorprint._config import Config, configuration
from floorprint._errors import ConfigError, Error
from floorprint._optional import needed
from floorprint._store import check_addresses, fetch, is_address, put


@dataclass(frozen=True)
class Outcome:
    """What became of a log."""

    #: The log, as it was given.
    log: str
    #: ``done``, ``failed`` (it says why), ``crashed`` or ``timed out``.
    status: str
    #: What ``report.json`` says; None unless it is done.
    report: dict[str, Any] | None = field(default=None, repr=False)
    #: Why there is no report.
    error: str | None = None
    #: The run's folder, or its address, where results are kept.
    folder: str | None = None
    #: How long it took, seconds.
    wall_s: float = 0.0


@dataclass(frozen=True)
class _Job:
    log: str
    config: Config
    folder: str | None
    threads: int
    timeout_s: float | None
    retries: int


#: What starts the process of a log. It imports nothing of the program that asked, unlike one of multiprocessing's:
#: scripts and notebooks need not be written for it.
_WORKER = [sys.executable, "-m", "floorprint._worker"]

#: So many logs wait at Ray, and at least twice as many as it can work on: an autoscaler sees by them what is needed.
_AT_RAY = 1000


@dataclass(frozen=True)
class _Files:
    """Where a log and its results lie on this machine."""

    path: str
    folder: str | None
    #: Folder of what is there only for the while.
    scratch: str | None = None


def _once(job: _Job, files: _Files, stop: threading.Event) -> Outcome:
    """One attempt, in a process that can be killed."""
    question = json.dumps([job.log, files.path, job.config.layers, files.folder, job.threads, files.scratch])
    started = time.monotonic()
    here, there = os.pipe()
    # Ctrl-C is for who asked, who then ends the process.
    process = subprocess.Popen(
        [*_WORKER, question],
        stdin=here,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    os.close(here)
    try:
        while True:
            try:
                answer, said = process.communicate(timeout=0.1)
                break
            except subprocess.TimeoutExpired:
                wall_s = time.monotonic() - started
            if stop.is_set() or (job.timeout_s is not None and wall_s > job.timeout_s):
                process.kill()
                process.communicate()
                text = "was stopped" if stop.is_set() else f"took longer than {job.timeout_s:g} s"
                return Outcome(job.log, "timed out", error=text, wall_s=wall_s)
    finally:
        os.close(there)
    wall_s = time.monotonic() - started
    if process.returncode != 0:
        code = process.returncode
        how = signal.Signals(-code).name if code < 0 else f"exit code {code}"
        last = said.strip().splitlines()[-1:]
        text = ": ".join([f"the process ended with {how}", *last])
        return Outcome(job.log, "crashed", error=text, wall_s=wall_s)
    report, error = json.loads(answer)
    if report is None:
        return Outcome(job.log, "failed", error=error, wall_s=wall_s)
    return Outcome(job.log, "done", report, folder=job.folder, wall_s=wall_s)


def _again(job: _Job, files: _Files, stop: threading.Event) -> Outcome:
    """Attempts until it is done, or says why not: what fails by its data fails again, and is not tried again."""
    outcome = _once(job, files, stop)
    for _ in range(job.retries):
        if outcome.status != "crashed":
            break
        outcome = _once(job, files, stop)
    return outcome


def _attempt(job: _Job, stop: threading.Event | None = None) -> Outcome:
    """Has a log solved. What lies in a store is fetched before, and put there after that; here and not in the log's
    process, so that the store's package is imported once and not for each log."""
    stop = threading.Event() if stop is None else stop
    is_fetched, is_put = is_address(job.log), job.folder is not None and is_address(job.folder)
    if not is_fetched and not is_put:
        return _again(job, _Files(job.log, job.folder), stop)
    started = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="floorprint-", ignore_cleanup_errors=True) as scratch:
        try:
            path = str(fetch(job.log, Path(scratch))) if is_fetched else job.log
            results = Path(scratch) / "results" / "run"
            folder = str(results) if is_put else job.folder
            outcome = _again(job, _Files(path, folder, scratch), stop)
            if outcome.status == "done" and is_put and job.folder is not None:
                put(results, job.folder)
        except Error as error:
            outcome = Outcome(job.log, "failed", error=str(error))
    return replace(outcome, wall_s=time.monotonic() - started)


def _by_processes(jobs: Iterator[_Job], workers: int) -> Iterator[Outcome]:
    stop = threading.Event()
    with ThreadPoolExecutor(workers) as threads:

        def begun(count: int) -> set[Future[Outcome]]:
            return {threads.submit(_attempt, job, stop) for job in islice(jobs, count)}

        waiting = begun(2 * workers)
        try:
            while waiting:
                done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                waiting |= begun(len(done))
                for future in done:
                    yield future.result()
        finally:
            # Who takes no more outcomes waits for none.
            stop.set()
            for future in waiting:
                future.cancel()


def _by_ray(jobs: Iterator[_Job], workers: int | None, threads: int) -> Iterator[Outcome]:
    ray = needed("ray", "clusters", "floorprint[ray]")
    if not ray.is_initialized():
        ray.init(num_cpus=workers, include_dashboard=False, log_to_driver=False)
    # A worker of Ray's that dies is replaced by Ray; the log has a process of its own below it.
    attempt = ray.remote(num_cpus=threads, max_retries=3)(_attempt)
    at_once = max(_AT_RAY, 2 * int(ray.cluster_resources().get("CPU", 0)) // threads)
    waiting = {attempt.remote(job): job for job in islice(jobs, at_once)}
    try:
        while waiting:
            done, _ = ray.wait(list(waiting), num_returns=1)
            for reference in done:
                job = waiting.pop(reference)
                waiting.update({attempt.remote(following): following for following in islice(jobs, 1)})
                try:
                    outcome = ray.get(reference)
                except ray.exceptions.RayError as error:
                    outcome = Outcome(job.log, "crashed", error=str(error).splitlines()[0])
                yield outcome
    finally:
        # Who takes no more outcomes waits for none.
        for reference in waiting:
            ray.cancel(reference, force=True)


def map(
    logs: Sequence[str | PathLike[str]],
    *,
    out: str | PathLike[str] | None = None,
    config: Config | None = None,
    preset: str | None = None,
    workers: int | None = None,
    threads: int = 1,
    timeout_s: float | None = None,
    retries: int = 1,
    cluster: bool | None = None,
    **settings: object,
) -> Iterator[Outcome]:
    """Solves many logs; gives outcomes as they come, in no particular order, exactly one for each log.

    Logs and results may lie in any store that fsspec opens, by address: ``s3://bucket/drive.bag``, ``gs://…``,
    ``file:///…`` (``pip install floorprint[store]`` and the store's own package, such as s3fs). A log is fetched when
    its turn comes, with the truth beside it, and its run is put in its place when it is done, ``report.json`` last.
    Credentials and end points are taken from where the store's package looks for them: ``AWS_…``, ``FSSPEC_…``.

    Args:
        logs: Data sets: paths, or addresses.
        out: Folder, or address, below which each log's run is saved under its name, in the place of an earlier one;
            nothing is saved where nothing is said.
        config, preset, settings: As those of :func:`floorprint.run`.
        workers: Logs at a time; as many as there are cores where nothing is said.
        threads: Threads that share the work on a log.
        timeout_s: A log that takes longer is given up, seconds; what fetching takes does not count.
        retries: How often a log whose process crashed is tried again.
        cluster: Whether Ray does it (``pip install floorprint[ray]``); where nothing is said, if it is initialised
            already. All else is done by processes of this machine.

    Raises:
        ImportError: What addresses or the cluster need is not installed.
        ConfigError: A setting cannot be used.
        Error: An address that nothing can open.
    """
    if isinstance(logs, (str, PathLike)):
        raise TypeError(f"logs: expected a list of paths or addresses, found one: give [{fspath(logs)!r}]")
    chosen = configuration(config, preset, settings)
    names = [fspath(log) for log in logs]
    below = None if out is None else fspath(out)
    protocols = check_addresses(names if below is None else [*names, below])
    if cluster is None:
        cluster = _ray_is_up()
    if cluster and "memory" in protocols:
        raise ConfigError("memory://… is in the memory of one process: a cluster needs a store that all machines reach")
    if cluster:
        needed("ray", "clusters", "floorprint[ray]")
    folders = _folders(names, below)
    jobs = (_Job(log, chosen, folder, threads, timeout_s, retries) for log, folder in zip(names, folders, strict=True))
    if cluster:
        return _by_ray(jobs, workers, threads)
    return _by_processes(jobs, workers or os.cpu_count() or 1)


def _folders(logs: Sequence[str], out: str | None) -> Iterator[str | None]:
    """A folder for each log, of its own also where two logs have the same name."""
    taken: set[str] = set()
    numbers: dict[str, int] = {}
    for log in logs:
        if out is None:
            yield None
            continue
        last = log.rstrip("/").rpartition("/")[2] if is_address(log) else Path(log).resolve().name
        name = last.split(".")[0]
        unique, number = name, numbers.get(name, 1)
        while unique in taken:
            number += 1
            unique = f"{name}-{number}"
        taken.add(unique)
        numbers[name] = number
        yield f"{out.rstrip('/')}/{unique}" if is_address(out) else fspath(Path(out) / unique)


def _ray_is_up() -> bool:
    ray = sys.modules.get("ray")
    return ray is not None and bool(ray.is_initialized())
