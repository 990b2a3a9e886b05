"""Structured arrays as tables of other libraries."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from floorprint._optional import needed

if TYPE_CHECKING:
    import numpy as np
    import pandas
    import pyarrow
    from numpy.typing import NDArray


def _columns(table: NDArray[np.void]) -> dict[str, NDArray[Any]]:
    names = table.dtype.names
    if names is None:
        raise TypeError(f"expected a structured array, as trajectories and steps are, found one of {table.dtype}")
    return {name: table[name] for name in names}


def to_pandas(table: NDArray[np.void]) -> pandas.DataFrame:
    """A structured array, such as a trajectory, as a data frame: a column for each field.

    Raises:
        ImportError: pandas is not installed.
    """
    frame: pandas.DataFrame = needed("pandas", "data frames", "floorprint[pandas]").DataFrame(_columns(table))
    return frame


def to_arrow(table: NDArray[np.void]) -> pyarrow.Table:
    """A structured array, such as a trajectory, as a table of Arrow: a column for each field.

    Polars and DuckDB take it as it is; ``pyarrow.parquet.write_table`` writes it.

    Raises:
        ImportError: pyarrow is not installed.
    """
    arrow: pyarrow.Table = needed("pyarrow", "tables of Arrow", "floorprint[arrow]").table(_columns(table))
    return arrow
