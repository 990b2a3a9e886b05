"""Packages that only some need."""

from __future__ import annotations

import importlib
from typing import Any


def needed(module: str, what: str, install: str) -> Any:
    """A module that is imported where it is used.

    Args:
        module: Its name.
        what: What it is for, in the plural: ``pictures``.
        install: What to ask of pip.

    Raises:
        ImportError: It is not installed; what to do.
    """
    package = module.partition(".")[0]
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        # That something it needs itself is missing is another matter.
        if error.name not in (package, module):
            raise
        raise ImportError(f"{what} need {package}, which is not installed: pip install {install!r}") from None
