"""Arrays outside of compiled functions, without a program for each of their shapes.

`jnp.asarray` of a NumPy array is a compiled program in JAX 0.10, and so is each operation on arrays by itself: 15 to 30
ms for every new shape.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.core import Tracer


def on_device(given: Any) -> Array:
    """`jnp.asarray`; of a NumPy array a copy, of a float an array without a weak type."""
    return jax.device_put(np.array(given)) if isinstance(given, np.ndarray | np.generic | float) else jnp.asarray(given)


def part_of(array: Array, place: Any) -> Array:
    """`array[place]`."""
    return array[place] if isinstance(array, Tracer) else on_device(np.asarray(array)[place])
