"""One thread of BLAS and LAPACK for the stages that decompose many small or thin matrices."""

from __future__ import annotations

from threadpoolctl import threadpool_limits

one_blas_thread = threadpool_limits.wrap(limits=1, user_api="blas")
"""Decorator: the function runs with one thread, those of the caller come back after it.

Several threads only wait for each other there: on two cores an estimate beside heat flux took twice as long.
"""
