"""NumPy and JAX arrays outside compiled functions, converted and indexed without compilation.

In JAX 0.10 `jnp.asarray` of a NumPy array, and every operation on an array outside `jit`, compiles a program for each
new shape. This takes 15 to 30 ms. A transfer with `jax.device_put` compiles nothing.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.core import Tracer


def on_device(value: Any) -> Array:
    """`jnp.asarray(value)`; a NumPy array is copied, and a float becomes an array that is not weakly typed."""
    return jax.device_put(np.array(value)) if isinstance(value, np.ndarray | np.generic | float) else jnp.asarray(value)


def index_array(array: Array, index: Any) -> Array:
    """`array[index]`, outside compiled functions by NumPy."""
    return array[index] if isinstance(array, Tracer) else on_device(np.asarray(array)[index])
