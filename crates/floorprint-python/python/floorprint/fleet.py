"""Many logs: each in a process of its own, on this machine or on a cluster of Ray's.

A log that crashes, hangs or cannot be read is an outcome that says why, not the end of the others.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from os import PathLike, fspath
from pathlib import Path
from typing import Any

from floorprint._config import Config, configuration, restored


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
    #: The run's folder, where results are kept.
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
_WORKER = [sys.executable, "-c", "from floorprint.fleet import _work; _work()"]


def _work() -> None:
    """Solves the log that its argument names, and answers on stdout."""
    from floorprint._errors import Error
    from floorprint._run import run

    def end_with_who_asked() -> None:
        # Its end of the pipe closes when it dies, however it does.
        sys.stdin.read()
        os._exit(1)

    threading.Thread(target=end_with_who_asked, daemon=True).start()
    log, layers, folder, threads = json.loads(sys.argv[1])
    try:
        result = run(log, config=restored(*layers), threads=threads)
        if folder is not None:
            # What stands there is of an attempt whose outcome was lost, or of an earlier call.
            result.save(folder, replace=True)
        json.dump([result.report, None], sys.stdout)
    except (Error, OSError) as error:
        json.dump([None, str(error)], sys.stdout)


def _once(job: _Job, stop: threading.Event) -> Outcome:
    """One attempt, in a process that can be killed."""
    question = json.dumps([job.log, job.config.layers, job.folder, job.threads])
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


def _attempt(job: _Job, stop: threading.Event | None = None) -> Outcome:
    """Attempts until it is done, or says why not: what fails by its data fails again, and is not tried again."""
    stop = threading.Event() if stop is None else stop
    outcome = _once(job, stop)
    for _ in range(job.retries):
        if outcome.status != "crashed":
            break
        outcome = _once(job, stop)
    return outcome


def _by_processes(jobs: Sequence[_Job], workers: int) -> Iterator[Outcome]:
    stop = threading.Event()
    with ThreadPoolExecutor(workers) as threads:
        waiting: set[Future[Outcome]] = {threads.submit(_attempt, job, stop) for job in jobs}
        try:
            while waiting:
                done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                for future in done:
                    yield future.result()
        finally:
            # Who takes no more outcomes waits for none.
            stop.set()
            for future in waiting:
                future.cancel()


def _by_ray(jobs: Sequence[_Job], workers: int | None) -> Iterator[Outcome]:
    import ray

    if not ray.is_initialized():
        ray.init(num_cpus=workers, include_dashboard=False, log_to_driver=False)
    # A worker of Ray's that dies is replaced by Ray; the log has a process of its own below it.
    attempt = ray.remote(num_cpus=1, max_retries=3)(_attempt)
    waiting = {attempt.remote(job): job for job in jobs}
    while waiting:
        done, _ = ray.wait(list(waiting), num_returns=1)
        for reference in done:
            job = waiting.pop(reference)
            try:
                yield ray.get(reference)
            except ray.exceptions.RayError as error:
                yield Outcome(job.log, "crashed", error=str(error).splitlines()[0])


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

    Args:
        logs: Data sets.
        out: Folder in which each log's run is saved, below its name, in the place of an earlier one; nothing is saved
            where nothing is said.
        config, preset, settings: As those of :func:`floorprint.run`.
        workers: Logs at a time; as many as there are cores where nothing is said.
        threads: Threads that share the work on a log.
        timeout_s: A log that takes longer is given up, seconds.
        retries: How often a log whose process crashed is tried again.
        cluster: Whether Ray does it (``pip install floorprint[ray]``); where nothing is said, if it is initialised
            already. All else is done by processes of this machine.
    """
    chosen = configuration(config, preset, settings)
    folders: list[str | None] = [None] * len(logs)
    if out is not None:
        folders = [fspath(folder) for folder in _folders(logs, Path(out))]
    jobs = [
        _Job(fspath(log), chosen, folder, threads, timeout_s, retries)
        for log, folder in zip(logs, folders, strict=True)
    ]
    if cluster is None:
        cluster = _ray_is_up()
    if cluster:
        return _by_ray(jobs, workers)
    return _by_processes(jobs, workers or os.cpu_count() or 1)


def _folders(logs: Sequence[str | PathLike[str]], out: Path) -> Iterator[Path]:
    """A folder for each log, of its own also where two logs have the same name."""
    taken: set[str] = set()
    for log in logs:
        name = Path(log).resolve().name.split(".")[0]
        unique, number = name, 1
        while unique in taken:
            number += 1
            unique = f"{name}-{number}"
        taken.add(unique)
        yield out / unique


def _ray_is_up() -> bool:
    ray = sys.modules.get("ray")
    return ray is not None and bool(ray.is_initialized())
