"""The wanted columns of a pandas DataFrame as a raw table, as if they were read from a CSV file."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .._internal.errors import InputError
from .._internal.validation import format_value
from .logger_file import RawTable, column_indices

if TYPE_CHECKING:
    from pandas import DataFrame

DATAFRAME = "DataFrame"
"""What messages name in place of a file."""


def source_name(source: str | os.PathLike[str] | DataFrame) -> str:
    """The path of a file, or "DataFrame"."""
    return str(source) if isinstance(source, (str, os.PathLike)) else DATAFRAME


def with_time_column(data: DataFrame, time: str | None) -> tuple[DataFrame, str]:
    """The DataFrame and the name of its column of times; for a time of None the index becomes a column.

    Raises:
        InputError: not a DataFrame, or the index only counts the rows or has several levels.
    """
    import pandas as pd

    _check_dataframe(data)
    if time is not None:
        return data, time
    index = data.index
    if index.nlevels > 1 or (isinstance(index, pd.RangeIndex) and index.step == 1):
        raise InputError(f'{DATAFRAME}: the index holds no times; state their column, such as time = "time"')
    name = str(index.name or "index")
    name = f"index ({name})" if name in data.columns else name
    return data.reset_index(names=name), name


def raw_table_from_dataframe(data: DataFrame, wanted: Sequence[str]) -> RawTable:
    """The wanted columns; messages count lines as in the file that `data.to_csv` writes.

    Raises:
        InputError: not a DataFrame, or a column that is missing or has the same name as another.
    """
    _check_dataframe(data)
    header, wanted = [str(name) for name in data.columns], list(dict.fromkeys(wanted))
    cells: Any = data.iloc[:, column_indices(DATAFRAME, header, wanted)].set_axis(wanted, axis=1)
    cells = cells.replace("", np.nan).set_axis(np.arange(2, len(data) + 2))
    for name in wanted:
        kind = cells[name].dtype.kind
        if kind == "m":
            cells[name] = cells[name].dt.total_seconds()
        elif kind in "iuf" and not isinstance(cells[name].dtype, np.dtype):  # nullable numbers: NaN in place of NA
            cells[name] = cells[name].to_numpy(float, na_value=np.nan)
    return RawTable(DATAFRAME, header, cells, dict.fromkeys(wanted, ""), "utf-8", ",", ".", 1, 0)


def _check_dataframe(data: object) -> None:
    import pandas as pd

    if not isinstance(data, pd.DataFrame):
        raise InputError(f"{DATAFRAME}: data = {format_value(data)}; it must be a pandas DataFrame")
