"""NumPy and JAX arrays outside compiled functions, converted and indexed without compilation.

In JAX 0.10 `jnp.asarray` of a NumPy array, and every operation on an array outside `jit`, compiles a program for each
new shape. This takes 15 to 30 ms. A transfer with `jax.device_put` compiles nothing.
"""

from __future__ import annotations

from types import ModuleType
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.core import Tracer


def on_device(value: Any) -> Array:
    """`jnp.asarray(value)`; a NumPy array is copied, and a float becomes an array that is not weakly typed."""
    return jax.device_put(np.array(value)) if isinstance(value, np.ndarray | np.generic | float) else jnp.asarray(value)


def is_traced(*values: Any) -> bool:
    """Whether one of the values is traced by JAX, so that a derivative or a compiled function may depend on it."""
    return any(isinstance(value, Tracer) for value in values)


def numpy_for(*values: Any) -> ModuleType:
    """`jax.numpy` where one of the values is traced, else `numpy`, which compiles nothing."""
    return jnp if is_traced(*values) else np


def known_value(value: Any) -> float | None:
    """A number as a float; None for one that is traced and not known while the function is traced.

    Where a function is differentiated and neither compiled nor vectorised, its arguments' values are known.
    """
    try:
        return float(jax.lax.stop_gradient(value) if is_traced(value) else value)
    except jax.errors.ConcretizationTypeError:
        return None


def powers(values: Any, count: int) -> Any:
    """The powers 0 to `count - 1` of the values, `(value, power)`."""
    if is_traced(values):
        return jnp.stack([values**k for k in range(count)], axis=-1)
    return np.vander(values, count, increasing=True)


def index_array(array: Array, index: Any) -> Array:
    """`array[index]`, outside compiled functions by NumPy."""
    return array[index] if isinstance(array, Tracer) else on_device(np.asarray(array)[index])
