"""Derivatives that are left out along directions in which the arguments of a function do not change.

An amplitude of the initial profile changes neither the modes of a wall nor its inputs, and the position of a sensor
changes nothing inside the wall.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp


def without_idle_derivatives(function: Callable[..., Any]) -> Callable[..., Any]:
    """The same function of arrays, whose derivative along a zero direction is zero without computation.

    It serves forward derivatives along one direction after the other. Where directions are vectorised, all of them are
    computed.
    """
    wrapped = jax.custom_jvp(function)

    @wrapped.defjvp
    def derivative(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Any, Any]:
        value, along = jax.linearize(function, *primals)
        changes = [jnp.any(leaf != 0.0) for leaf in jax.tree.leaves(tangents) if leaf.dtype != jax.dtypes.float0]
        zeros = jax.tree.map(jnp.zeros_like, value)
        return value, jax.lax.cond(jnp.any(jnp.stack(changes)), along, lambda *_: zeros, *tangents)

    return wrapped
