"""A function mapped over many walls, windows or diffusivities, on one device or on all devices of all processes.

The items are the rows of a pytree's arrays. They are computed one after the other, all at once, or in chunks. With a
`jax.sharding.Mesh` each device computes its share, in one process or in all processes of a `jax.distributed` job, and
every process receives all results. The numbers are the same in each case.
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
    """Many pytrees of one structure (models, window data) as one pytree whose arrays have one row for each item.

    Raises:
        ValueError: no items, or items that differ in shapes or static fields.
    """
    if not items:
        raise ValueError("stack: no items")
    try:
        return jax.tree.map(lambda *rows: jnp.stack(rows), *items)
    except (ValueError, TypeError) as error:
        raise ValueError(
            f"stack: the items must differ in their numbers only, not in shapes or static fields ({error})"
        ) from error


def sweep(
    function: Callable[..., PyTree],
    items: PyTree,
    *shared: Any,
    way: Sweep = "map",
    chunk: int = 1,
    mesh: Mesh | None = None,
) -> PyTree:
    """`function(item, *shared)` for every row of `items`, the results stacked.

    Args:
        function: of one item and what all items share; traceable by JAX. The same object from call to call is
            compiled once for each shape.
        items: a pytree of arrays that have one length along their first axis.
        shared: pytrees that are the same for all items; static parts (solvers, flags) among them are allowed.
        way: "map" takes one chunk of items after the other, "vmap" all at once.
        chunk: number of items in a chunk of "map". Some tens are faster on a CPU where one item is small.
        mesh: devices to share the items among, along all axes of the mesh; None is the default device.

    Returns:
        the results, with the items along their first axis; with a mesh each process of the job holds all of them.

    Raises:
        ValueError: no items, lengths that differ, another `way`, or a chunk below 1.
    """
    lengths = {np.shape(leaf)[:1] for leaf in jax.tree.leaves(items)}
    if len(lengths) != 1 or lengths == {()} or lengths == {(0,)}:
        text = ", ".join(str(length) for length in sorted(lengths)) or "none"
        raise ValueError(f"sweep: items must be arrays with one common first axis of one row or more; found {text}")
    if way not in ("map", "vmap"):
        raise ValueError(f'sweep: way = {way!r}; it must be "map" or "vmap"')
    if chunk < 1:
        raise ValueError(f"sweep: chunk = {chunk}; it must be at least 1")
    if mesh is None:
        return _map_on_one_device(function, items, shared, way, chunk)
    return _map_on_mesh(function, items, shared, way, chunk, mesh)


@eqx.filter_jit
def _map_on_one_device(function: Callable, items: PyTree, shared: tuple, way: Sweep, chunk: int) -> PyTree:
    return map_rows(function, items, shared, way, chunk)


def map_rows(function: Callable, items: PyTree, shared: tuple, way: Sweep, chunk: int = 1) -> PyTree:
    """As `sweep` on one device, for use inside a compiled function."""
    each = partial(_call, function, shared)
    if way == "vmap":
        return jax.vmap(each)(items)
    if chunk == 1:
        return jax.lax.map(each, items)
    count = jax.tree.leaves(items)[0].shape[0]
    chunk = min(chunk, count)
    chunks = -(-count // chunk)
    # full chunks only: a smaller last one would be compiled again
    filled = repeat_last(items, chunks * chunk)
    in_chunks = jax.tree.map(lambda leaf: leaf.reshape(chunks, chunk, *leaf.shape[1:]), filled)
    results = jax.lax.map(jax.vmap(each), in_chunks)
    return jax.tree.map(lambda leaf: leaf.reshape(chunks * chunk, *leaf.shape[2:])[:count], results)


def _call(function: Callable, shared: tuple, item: PyTree) -> PyTree:
    return function(item, *shared)


def repeat_last(items: PyTree, length: int) -> PyTree:
    """The items with the last one repeated up to a length."""
    return jax.tree.map(
        lambda leaf: (
            jnp.concatenate([leaf, jnp.broadcast_to(leaf[-1:], (length - leaf.shape[0], *leaf.shape[1:]))])
            if length > leaf.shape[0]
            else leaf
        ),
        items,
    )


def _map_on_mesh(function: Callable, items: PyTree, shared: tuple, way: Sweep, chunk: int, mesh: Mesh) -> PyTree:
    count, devices = np.shape(jax.tree.leaves(items)[0])[0], mesh.size
    by_device, replicated = PartitionSpec(mesh.axis_names), PartitionSpec()
    # on the host, so that each process sends only the shards of its own devices
    filled = jax.tree.map(np.asarray, repeat_last(items, -(-count // devices) * devices))
    sharded = jax.device_put(filled, NamedSharding(mesh, by_device))
    arrays, static = eqx.partition(shared, lambda leaf: isinstance(leaf, jax.Array | np.ndarray))
    arrays = jax.device_put(jax.tree.map(np.asarray, arrays), NamedSharding(mesh, replicated))
    results = _map_shards(function, sharded, arrays, static, way, chunk, mesh, by_device)
    return jax.tree.map(lambda leaf: on_device(np.asarray(leaf)[:count]), results)


@eqx.filter_jit
def _map_shards(
    function: Callable,
    items: PyTree,
    arrays: PyTree,
    static: PyTree,
    way: Sweep,
    chunk: int,
    mesh: Mesh,
    by_device: PartitionSpec,
) -> PyTree:
    def map_shard(items: PyTree, arrays: PyTree) -> PyTree:
        shard = map_rows(function, items, eqx.combine(arrays, static), way, chunk)
        return jax.tree.map(lambda leaf: jax.lax.all_gather(leaf, mesh.axis_names, tiled=True), shard)

    replicated = PartitionSpec()
    # all_gather makes the result equal on every device, which JAX's check cannot infer
    run_shards = jax.shard_map(
        map_shard, mesh=mesh, in_specs=(by_device, replicated), out_specs=replicated, check_vma=False
    )
    return run_shards(items, arrays)
