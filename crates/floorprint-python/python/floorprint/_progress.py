"""How far the work is."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from floorprint._optional import needed

#: Called with the task (``solving`` …), the steps done and the steps in all (0 where that is not known).
Progress = Callable[[str, int, int], object]


@contextmanager
def shown(progress: bool | Progress) -> Iterator[Progress | None]:
    """A callback: the given one, a bar of tqdm's for ``True``, none for ``False``."""
    if not isinstance(progress, bool):
        yield progress
        return
    if not progress:
        yield None
        return
    tqdm = needed("tqdm.auto", "progress bars", "floorprint[progress]").tqdm

    bar: Any = None

    def show(task: str, done: int, total: int) -> None:
        nonlocal bar
        if bar is None or bar.desc != task:
            if bar is not None:
                bar.close()
            bar = tqdm(desc=task, total=total or None)
            bar.set_description_str(task)
        bar.total = total or None
        bar.update(done - bar.n)

    try:
        yield show
    finally:
        if bar is not None:
            bar.close()
