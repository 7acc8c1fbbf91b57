"""What a process that runs once can ask of XLA before it starts: to compile faster.

A command's first seconds are compilation. XLA's older generator of fused loops makes code as fast for models of this
size in two thirds of the time; JAX's persistent cache, where the user has named a folder for it, takes small programs
too.
"""

from __future__ import annotations

import os
from importlib.metadata import version

import jax

_FLAG = "xla_cpu_use_fusion_emitters"
_KNOWN = "0.10."  # versions that have the flag: XLA ends a process that names one it does not know


def compile_quickly() -> None:
    """Ask for both, leaving alone what the user has set; for before JAX's first computation."""
    flags = os.environ.get("XLA_FLAGS", "")
    if version("jaxlib").startswith(_KNOWN) and _FLAG not in flags:
        os.environ["XLA_FLAGS"] = f"{flags} --{_FLAG}=false".strip()
    if "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS" not in os.environ:
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.1)
