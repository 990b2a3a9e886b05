"""Recordings and results in stores that are no folders of this machine: whatever fsspec opens, by address."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from floorprint._errors import Error
from floorprint._optional import needed


def is_address(path: str) -> bool:
    """Whether it is an address (``s3://bucket/drive.bag``), not a path."""
    return "://" in path


def check_addresses(paths: Iterable[str]) -> set[str]:
    """Makes sure that what addresses need is installed; gives their protocols.

    Raises:
        ImportError: A package is missing; which one.
        Error: Nothing knows such addresses.
    """
    protocols = {path.partition("://")[0] for path in paths if is_address(path)}
    for protocol in protocols:
        fsspec = needed("fsspec", f"addresses as {protocol}://…", "floorprint[store]")
        try:
            fsspec.get_filesystem_class(protocol)
        except ImportError as error:
            raise ImportError(f"addresses as {protocol}://… cannot be opened: {error}") from None
        except ValueError as error:
            raise Error(f"addresses as {protocol}://… cannot be opened: {error}") from None
    return protocols


def _opened(address: str) -> tuple[Any, str]:
    fs, path = needed("fsspec", "addresses", "floorprint[store]").core.url_to_fs(address)
    # What others wrote since is to be seen: listings are kept otherwise.
    fs.invalidate_cache()
    return fs, path


def fetch(address: str, folder: Path) -> Path:
    """Copies a recording, a file or a folder, into a folder of this machine; with a file the truth beside it.

    Raises:
        Error: It cannot be had.
    """
    try:
        fs, path = _opened(address)
        name = path.rstrip("/").rpartition("/")[2]
        here = folder / name
        if fs.isdir(path):
            fs.get(path.rstrip("/") + "/", str(here) + "/", recursive=True)
            return here
        fs.get_file(path, str(here))
        stem = name.split(".")[0]
        for beside in (f"{stem}.relations", f"{stem}.truth.tum"):
            there = path[: -len(name)] + beside
            if fs.exists(there):
                fs.get_file(there, str(folder / beside))
        return here
    except FileNotFoundError:
        raise Error(f"there is nothing at {address}") from None
    # Every kind of store fails in a way of its own.
    except Exception as error:
        raise Error(f"cannot fetch {address}: {error}") from error


def put(folder: Path, address: str) -> None:
    """Copies a run's folder to a store, its report last: where that stands, the run is complete.

    Raises:
        Error: It cannot be written.
    """
    try:
        fs, path = _opened(address)
        path = path.rstrip("/")
        names = sorted(str(file.relative_to(folder)) for file in folder.rglob("*") if file.is_file())
        last = "report.json"
        if fs.exists(f"{path}/{last}"):
            fs.rm_file(f"{path}/{last}")
        # Object stores, which are those with an asynchronous side, have no folders: making one there may make a bucket.
        if not fs.async_impl:
            fs.makedirs(path, exist_ok=True)
        others = [name for name in names if name != last]
        fs.put([str(folder / name) for name in others], [f"{path}/{name}" for name in others])
        fs.put_file(str(folder / last), f"{path}/{last}")
    except Exception as error:
        raise Error(f"cannot write {address}: {error}") from error
