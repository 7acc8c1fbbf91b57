"""Options of XLA and JAX that shorten compilation and run small loops faster, set before JAX starts.

Compilation: XLA's older fusion emitters compile models of this size in two thirds of the time, to code of the same
speed. Where the user has set a folder for JAX's persistent cache, small programs are cached too.

Small loops: on a CPU, XLA runs a compiled function, and each pass of a loop in it, as a list of kernels. In a loop over
rows with five states the overhead between kernels dominates. XLA compiles a loop to one kernel where its body accesses
fewer bytes than an option says.

Dispatch: on a CPU, JAX computes in a second thread. For computations of 0.1 ms the change of thread takes as long
again.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from functools import cache
from importlib.metadata import version
from typing import Any, ParamSpec, TypeVar

import equinox as eqx
import jax

_P = ParamSpec("_P")
_T = TypeVar("_T")

_EMITTERS = "--xla_cpu_use_fusion_emitters=false"
_WITH_EMITTERS = range(6, 11)  # minor versions of jaxlib that know this flag; XLA aborts the process at an unknown one
_LOOPS = "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=2000000"  # ignored where unknown


def prepare_xla() -> None:
    """Set XLA and JAX options for models of this size: short compilation, single-kernel loops, synchronous dispatch.

    Call it before the first JAX computation; importing `wallid` computes nothing. The commands of `wallid` call it.
    A reduced-order model then runs two to four times as fast, and a batch of ten thousand walls three times as fast.
    Flags that are already in the environment variable `XLA_FLAGS` are kept. From jaxlib 0.11 on, the option for short
    compilation does not exist.

    Warns:
        UserWarning: JAX has already started, so the options have no effect and are not set.
    """
    flags = os.environ.get("XLA_FLAGS", "").split()
    names = [flag.split("=")[0] for flag in flags]
    missing = [flag for flag in known_flags(version("jaxlib")) if flag.split("=")[0] not in names]
    if missing or jax.config.read("jax_cpu_enable_async_dispatch"):
        if _jax_has_started():
            message = "wallid.prepare_xla: no effect, JAX has already started; call it before the first JAX computation"
            warnings.warn(message, stacklevel=2)
        else:
            os.environ["XLA_FLAGS"] = " ".join([*flags, *missing])
            jax.config.update("jax_cpu_enable_async_dispatch", False)
    if "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS" not in os.environ:
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.1)


def known_flags(jaxlib: str) -> tuple[str, ...]:
    """The flags that a version of jaxlib knows."""
    return (_EMITTERS, _LOOPS) if _knows_emitters(jaxlib) else (_LOOPS,)


def _knows_emitters(jaxlib: str) -> bool:
    """Whether the option for short compilation exists."""
    major, minor = (int(part) for part in jaxlib.split(".")[:2])
    return major == 0 and minor in _WITH_EMITTERS


def filter_jit_shortly(function: Callable[_P, _T]) -> Callable[_P, _T]:
    """`equinox.filter_jit` of a large function that compiles longer than it runs.

    It is compiled as after `prepare_xla`, which a user of the library may not have called: in half the time.
    """
    emitters = {"xla_cpu_use_fusion_emitters": False} if _knows_emitters(version("jaxlib")) else {}
    options: dict[str, Any] = {"compiler_options": emitters}
    compiled: Any = eqx.filter_jit(function, **options)
    return compiled


def _jax_has_started() -> bool:
    """Whether JAX has initialised its backends; the number of CPU devices cannot be changed afterwards."""
    options: Any = jax.config  # its type does not declare the options
    before = options.jax_num_cpu_devices
    try:
        jax.config.update("jax_num_cpu_devices", 2 if before == 1 else 1)
    except RuntimeError:
        return True
    jax.config.update("jax_num_cpu_devices", before)
    return False


@cache
def has_small_loops() -> bool:
    """Whether XLA compiles loops with small bodies to single kernels in this process."""
    return jax.default_backend() == "cpu" and _LOOPS in os.environ.get("XLA_FLAGS", "").split()
