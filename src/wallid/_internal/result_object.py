"""What all result objects have in common: their numbers as a dict and as a DataFrame, and a table in notebooks."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from .html import html_frame

if TYPE_CHECKING:
    from pandas import DataFrame


class ResultObject:
    """Base class of the result objects, without fields: `to_dict`, `to_frame` and the table of a notebook.

    The methods here hold for a dataclass (or `equinox.Module`) whose fields are its result. A class overrides those
    for which there is a better form.
    """

    def to_dict(self) -> dict[str, Any]:
        """The result as plain numbers, strings, lists and dicts; None for a number that is not finite."""
        return plain_fields(self)

    def to_frame(self) -> DataFrame:
        """The single values of `to_dict` as a pandas DataFrame of one row."""
        import pandas as pd

        single = {key: value for key, value in self.to_dict().items() if not isinstance(value, dict | list)}
        return pd.DataFrame([single])

    def _html_title(self) -> str:
        """The title of the notebook's table: the name of the class in words."""
        return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", type(self).__name__).capitalize()

    def _repr_html_(self) -> str:
        return html_frame(self._html_title(), self.to_frame())


def plain_fields(result: Any) -> dict[str, Any]:
    """The fields of a dataclass as plain values, see `plain_value`."""
    names = (field.name for field in dataclasses.fields(result) if not field.name.startswith("_"))
    return {name: plain_value(getattr(result, name)) for name in names}


def plain_value(value: Any) -> Any:
    """A value as numbers, strings, lists and dicts, which JSON can hold; None for a number that is not finite."""
    if isinstance(value, ResultObject):
        return value.to_dict()
    if dataclasses.is_dataclass(value):
        return plain_fields(value)
    if isinstance(value, Mapping):
        return {str(key): plain_value(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set):
        return [plain_value(item) for item in value]
    if isinstance(value, np.datetime64):
        return str(value)
    if hasattr(value, "tolist"):  # an array or a scalar of NumPy or JAX
        return plain_value(np.asarray(value).astype(str).tolist() if _is_time(value) else value.tolist())
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value if isinstance(value, bool | int | str) or value is None else str(value)


def _is_time(value: Any) -> bool:
    return getattr(value, "dtype", None) is not None and np.issubdtype(value.dtype, np.datetime64)
