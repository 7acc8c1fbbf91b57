"""One function over many walls, windows or diffusivities: on one device, or on every device of every process.

A sweep's items are the rows of a pytree's arrays. They go one after the other, all at once, or in chunks; with a
`jax.sharding.Mesh` each device takes its share, in one process or in all of a `jax.distributed` job, and every process
gets the whole answer. The numbers are the same in each way.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import PyTree

from .._internal.arrays import on_device

Sweep = Literal["map", "vmap"]
"""One item after the other (faster on a CPU), or all at once."""


def stack(items: Sequence[Any]) -> Any:
    """Many pytrees of one shape (models, experiments) as one whose arrays have a row an item.

    Raises:
        ValueError: none, or such as differ in more than their numbers (shapes, sensors with an offset).
    """
    if not items:
        raise ValueError("stack: no items")
    try:
        return jax.tree.map(lambda *rows: jnp.stack(rows), *items)
    except (ValueError, TypeError) as error:
        raise ValueError(f"stack: the items differ in more than their numbers ({error})") from error


def sweep(
    function: Callable[..., PyTree],
    items: PyTree,
    *shared: Any,
    way: Sweep = "map",
    chunk: int = 1,
    mesh: Mesh | None = None,
) -> PyTree:
    """`function(item, *shared)` for every row of `items`, its answers stacked.

    Args:
        function: of one item and what all items share; traceable by JAX. The same object from call to call is
            compiled once for each shape.
        items: a pytree of arrays that have one length along their first axis.
        shared: pytrees that are the same for all items; static parts (solvers, flags) among them are allowed.
        way: "map" takes one chunk of items after the other, "vmap" all at once.
        chunk: how many items "map" takes at once; some tens use a CPU's vector units where one item is small.
        mesh: devices to share the items among, along all axes of the mesh; None is the default device.

    Returns:
        The answers with a first axis of the items; with a mesh each process of the job holds all of them.

    Raises:
        ValueError: no items, lengths that differ, an unknown way, a chunk under 1.
    """
    lengths = {np.shape(leaf)[:1] for leaf in jax.tree.leaves(items)}
    if len(lengths) != 1 or lengths == {()} or lengths == {(0,)}:
        found = ", ".join(str(length) for length in sorted(lengths)) or "none"
        raise ValueError(f"sweep: items must be arrays with one common first axis of one row or more; found {found}")
    if way not in ("map", "vmap"):
        raise ValueError(f'sweep: way = {way!r}; it must be "map" or "vmap"')
    if chunk < 1:
        raise ValueError(f"sweep: chunk = {chunk}; it must be at least 1")
    if mesh is None:
        return _on_one(function, items, shared, way, chunk)
    return _on_mesh(function, items, shared, way, chunk, mesh)


@eqx.filter_jit
def _on_one(function: Callable, items: PyTree, shared: tuple, way: Sweep, chunk: int) -> PyTree:
    return rows(function, items, shared, way, chunk)


def rows(function: Callable, items: PyTree, shared: tuple, way: Sweep, chunk: int = 1) -> PyTree:
    """The sweep itself, for use inside a compiled function."""
    each = partial(_call, function, shared)
    if way == "vmap":
        return jax.vmap(each)(items)
    if chunk == 1:
        return jax.lax.map(each, items)
    count = jax.tree.leaves(items)[0].shape[0]
    chunk = min(chunk, count)
    whole = -(-count // chunk)
    # whole chunks only: a rest of its own would be compiled again
    in_chunks = jax.tree.map(lambda leaf: leaf.reshape(whole, chunk, *leaf.shape[1:]), padded(items, whole * chunk))
    answers = jax.lax.map(jax.vmap(each), in_chunks)
    return jax.tree.map(lambda leaf: leaf.reshape(whole * chunk, *leaf.shape[2:])[:count], answers)


def _call(function: Callable, shared: tuple, item: PyTree) -> PyTree:
    return function(item, *shared)


def padded(items: PyTree, length: int) -> PyTree:
    """The items with the last one repeated up to a length."""
    return jax.tree.map(
        lambda leaf: (
            jnp.concatenate([leaf, jnp.broadcast_to(leaf[-1:], (length - leaf.shape[0], *leaf.shape[1:]))])
            if length > leaf.shape[0]
            else leaf
        ),
        items,
    )


def _on_mesh(function: Callable, items: PyTree, shared: tuple, way: Sweep, chunk: int, mesh: Mesh) -> PyTree:
    count, devices = np.shape(jax.tree.leaves(items)[0])[0], mesh.size
    by_device, everywhere = PartitionSpec(mesh.axis_names), PartitionSpec()
    # on the host, so that each process sends its own devices what is theirs
    whole = jax.tree.map(np.asarray, padded(items, -(-count // devices) * devices))
    spread = jax.device_put(whole, NamedSharding(mesh, by_device))
    arrays, static = eqx.partition(shared, lambda leaf: isinstance(leaf, jax.Array | np.ndarray))
    arrays = jax.device_put(jax.tree.map(np.asarray, arrays), NamedSharding(mesh, everywhere))
    answers = _sharded(function, spread, arrays, static, way, chunk, mesh, by_device)
    return jax.tree.map(lambda leaf: on_device(np.asarray(leaf)[:count]), answers)


@eqx.filter_jit
def _sharded(
    function: Callable,
    items: PyTree,
    arrays: PyTree,
    static: PyTree,
    way: Sweep,
    chunk: int,
    mesh: Mesh,
    by_device: PartitionSpec,
) -> PyTree:
    def share(items: PyTree, arrays: PyTree) -> PyTree:
        own = rows(function, items, eqx.combine(arrays, static), way, chunk)
        return jax.tree.map(lambda leaf: jax.lax.all_gather(leaf, mesh.axis_names, tiled=True), own)

    everywhere = PartitionSpec()
    # that a gathered answer is the same on every device is not seen by JAX's check
    spread = jax.shard_map(share, mesh=mesh, in_specs=(by_device, everywhere), out_specs=everywhere, check_vma=False)
    return spread(items, arrays)
