"""What a process can ask of XLA before it starts: to compile faster, and to run small loops as machine code, at once.

A command's first seconds are compilation. XLA's older generator of fused loops makes code as fast for models of this
size in two thirds of the time; JAX's persistent cache, where the user has named a folder for it, takes small programs
too.

On a CPU XLA runs a compiled function as a list of kernels, and a loop's body as such a list in every pass: a loop over
rows of five states spends nearly all its time between kernels. A loop whose body reads and writes little becomes one
kernel; how little is an option of XLA's.

JAX hands what it computes on a CPU to another thread and goes on in Python. Where that is a tenth of a millisecond,
waking the thread and being woken takes as long again.
"""

from __future__ import annotations

import os
import warnings
from functools import cache
from importlib.metadata import version
from typing import Any

import jax

_KNOWN = "0.10."  # jaxlibs that know these: XLA ends a process that names a flag it does not know
_EMITTERS = "--xla_cpu_use_fusion_emitters=false"
_LOOPS = "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=2000000"


def prepare_xla() -> None:
    """Ask XLA for what serves models of this size: shorter compilation, small loops as single kernels, no other thread.

    The commands do so; a notebook or program of your own may, before JAX's first computation (importing `wallid` is
    none; later it warns and asks for nothing). A reduced model then runs two to four times as fast, ten thousand walls
    three times. What the environment says of the same flags stays, and a jaxlib that is not known to have them is left
    alone.
    """
    flags = os.environ.get("XLA_FLAGS", "").split()
    names = [flag.split("=")[0] for flag in flags]
    wanted = [flag for flag in (_EMITTERS, _LOOPS) if flag.split("=")[0] not in names]
    if (wanted or jax.config.read("jax_cpu_enable_async_dispatch")) and version("jaxlib").startswith(_KNOWN):
        if _jax_has_started():
            said = "wallid.prepare_xla: JAX has computed already and no longer hears what is asked; call it first"
            warnings.warn(said, stacklevel=2)
        else:
            os.environ["XLA_FLAGS"] = " ".join([*flags, *wanted])
            jax.config.update("jax_cpu_enable_async_dispatch", False)
    if "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS" not in os.environ:
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.1)


def _jax_has_started() -> bool:
    """Whether JAX has initialised its backends: from then on it refuses another number of CPU devices."""
    options: Any = jax.config  # what it has is not in its type
    before = options.jax_num_cpu_devices
    try:
        jax.config.update("jax_num_cpu_devices", 2 if before == 1 else 1)
    except RuntimeError:
        return True
    jax.config.update("jax_num_cpu_devices", before)
    return False


@cache
def has_small_loops() -> bool:
    """Whether loops with small bodies are single kernels in this process."""
    return jax.default_backend() == "cpu" and _LOOPS in os.environ.get("XLA_FLAGS", "").split()
