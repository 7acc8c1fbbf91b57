"""One thread of BLAS and LAPACK for the stages that decompose many small or thin matrices."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

_P = ParamSpec("_P")
_T = TypeVar("_T")


def one_blas_thread(function: Callable[_P, _T]) -> Callable[_P, _T]:
    """The function with one thread of BLAS; afterwards the process has as many as before.

    Several threads only wait for each other there: on two cores an estimate beside heat flux took twice as long. The
    limit is that of the entire process. Calls that overlap in several threads of Python may leave it at one.
    """

    @wraps(function)
    def with_one_thread(*args: _P.args, **kwargs: _P.kwargs) -> _T:
        with threadpool_limits(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return with_one_thread
