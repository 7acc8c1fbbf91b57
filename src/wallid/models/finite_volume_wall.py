"""The full-order model (the paper's large original model): a wall as a state space, by finite volumes.

For a homogeneous wall this is the central difference of the paper: `A = tridiag(1, -2, 1)/dx^2`, and `B` with `1/dx^2`
in two corners, both boundary temperatures given. For a layered wall a node's capacity is the integral of the heat
capacity over its cell, and the resistance between two nodes the integral of `1/k` (the harmonic mean). Both are
relative to the wall's effective values, so that one effective diffusivity `L^2 / (R C)` scales the whole model.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._internal.arrays import is_traced, known_value, numpy_for, on_device, powers
from ..case.wall_and_sensors import Wall
from .state_space import StateSpace, require_x64

ArrayLike = Array | np.ndarray
Number = float | Array

_STENCIL = 4  # nodes of a cubic, so that interpolation between nodes adds no second-order error
_MIN_CELLS = 3  # in a layer, so that a cubic fits into each


@dataclass(frozen=True)
class Output:
    """An output of a model at one position.

    Args:
        position: m from the left face, faces included; JAX may trace it.
        kind: "temperature": u. "gradient": `du/dx*`, times `T_ref / L` in K/m. "flux":
            `-(k/k_eff) du/dx*` along +x, times `k_eff T_ref / L` in W/m2.
        name: for tables and figures.
        height: of a section in two dimensions, m from its bottom; None for the mean over its height.
    """

    position: Number
    kind: Literal["temperature", "gradient", "flux"] = "temperature"
    name: str = ""
    height: float | None = None


@dataclass(frozen=True)
class HeatProfile:
    """Where heat is released in a wall: the same power per volume everywhere, or decaying from a face.

        p(x*) = 1,      or exp(-x*/depth) / (depth (1 - exp(-1/depth))), x* from that face

    Args:
        place: "wall", "left" or "right".
        depth: over the length, 1; of a face.
    """

    place: Literal["wall", "left", "right"]
    depth: float = 1.0

    def released_up_to(self, x: Any) -> Any:
        """The share of the heat that is released between x* = 0 and x."""
        if self.place == "wall":
            return x
        xp = numpy_for(x)
        from_face = xp.expm1(-(x if self.place == "left" else 1.0 - x) / self.depth) / math.expm1(-1.0 / self.depth)
        return from_face if self.place == "left" else 1.0 - from_face


def layer_cells(wall: Wall, nodes: int) -> tuple[int, ...]:
    """The number of cells of each layer, in proportion to its diffusion time's square root, `d / sqrt(alpha)`.

    Args:
        wall: with layers whose values are known.
        nodes: their number in the whole wall, both faces included.

    Raises:
        ValueError: too few nodes for the layers, or values that JAX traces in a compiled or vectorised function.
    """
    layers = wall.relative_layers()
    cells = nodes - 1
    if cells < _MIN_CELLS * len(layers):
        raise ValueError(
            f"nodes: {nodes} for {len(layers)} layer(s); at least {_MIN_CELLS * len(layers) + 1} are needed"
        )
    if len(layers) == 1:
        return (cells,)
    length = known_value(wall.length)
    known = np.array([[known_value(value) for value in layer] for layer in layers], float)  # NaN where unknown
    if length is None or np.isnan(known).any():
        raise ValueError(
            "cells: the layers' values are traced, and the number of cells of each layer follows from their values; "
            f"give `cells=wallid.models.layer_cells(wall, {nodes})` with the wall of known values"
        )
    share = known[:, 0] / length * np.sqrt(known[:, 2] / known[:, 1])
    spare = cells - _MIN_CELLS * len(layers)
    exact = spare * share / share.sum()
    count = np.floor(exact).astype(int)
    for layer in np.argsort(count - exact, kind="stable")[: spare - count.sum()]:
        count[layer] += 1
    return tuple(int(one) + _MIN_CELLS for one in count)


def grid(wall: Wall, nodes: int, cells: Sequence[int] | None = None) -> Float[ArrayLike, " node"]:
    """The nodes x*, both faces included: a node at each interface of layers, uniform within a layer.

    Args:
        wall: the wall.
        nodes: their number, both faces included.
        cells: the number of cells of each layer; None for those of `layer_cells`.

    Raises:
        ValueError: too few nodes for the layers, or `cells` that do not fit the layers and the nodes.
    """
    cells = layer_cells(wall, nodes) if cells is None else cells
    layers = max(1, len(wall.layers))
    if len(cells) != layers or sum(cells) != nodes - 1 or min(cells) < _MIN_CELLS:
        raise ValueError(
            f"cells: {tuple(cells)}; it must have a number of at least {_MIN_CELLS} for each of {layers} layer(s), "
            f"with the sum {nodes - 1} (nodes - 1)"
        )
    edges = _edges(wall)
    xp = numpy_for(edges)
    pieces = [xp.linspace(edges[i], edges[i + 1], count + 1)[:-1] for i, count in enumerate(cells)]
    return xp.concatenate([*pieces, xp.ones(1)])


def finite_volume_model(
    wall: Wall,
    outputs: Sequence[Output],
    *,
    nodes: int = 101,
    profile_degree: int = 2,
    film: tuple[Number, Number] = (0.0, 0.0),
    node_positions: Float[ArrayLike, " node"] | None = None,
    cells: Sequence[int] | None = None,
    heat: Sequence[HeatProfile] = (),
) -> StateSpace:
    """The wall as a `StateSpace` whose inputs are its two boundary temperatures (left, right).

    `U' = Fo (A U + B Q)`, `Y = C U + D Q`, `U(0) = P a`, with the temperatures of the inner nodes as state and the
    coefficients `a` of the initial profile `sum_k a_k x*^k`. JAX may trace the values of the wall, the positions of the
    outputs and the films.

    Args:
        wall: the wall.
        outputs: temperatures, gradients and fluxes at any position; interpolated by cubics within a layer.
        nodes: their number, both faces included.
        profile_degree: of the initial profile's polynomial.
        film: conductivity over film coefficient at the left and the right face, m. Above 0 the input is the
            air temperature, and the face is a state: `k dT/dn = h (T_air - T_face)`, n outward.
        node_positions: x*, both faces included; None for those of `grid`.
        cells: the number of cells of each layer; None for those of `layer_cells`, which needs the layers' values.
        heat: each is one more input, which does not scale with Fo: heat with this profile. A unit raises the wall's
            mean temperature by 1 per t_ref at its mean capacity, before any heat leaves.

    Returns:
        the model with its nodes' capacities; `modal()` of it has a diagonal A.

    Raises:
        ValueError: too few nodes, cells that do not fit, or an output outside the wall.
    """
    require_x64()
    positions = grid(wall, nodes, cells) if node_positions is None else node_positions
    _, resistance, cell_capacity = wall_cells(wall, nodes, positions)
    edges, k, _ = _relative_properties(wall)
    each = [_output_row(output, wall, positions, edges, k) for output in outputs]
    rows = numpy_for(*each).stack(each)
    # a traced film is one: its size is not known, and without it there is one state less
    has_film = tuple(is_traced(one) or bool(one > 0.0) for one in film)
    state, coupling, drive = _coupling_matrices(1.0 / resistance, [one / wall.length for one in film], has_film)
    capacity = cell_capacity[state]
    direct = rows[:, [0, -1]] * np.where(has_film, 0.0, 1.0)
    model = StateSpace(
        A=coupling / capacity[:, None],
        B=drive / capacity[:, None],
        C=rows[:, state],
        D=direct,
        P=powers(positions[state], profile_degree + 1),
        capacity=on_device(capacity),
        output_names=tuple(output.name for output in outputs),
    )
    return with_heat_inputs(model, _heat_of_cells(positions, heat)[state] / capacity[:, None]) if heat else model


def with_heat_inputs(model: StateSpace, heat: Float[ArrayLike, "node place"]) -> StateSpace:
    """The model with inputs of heat after its own, which do not scale with Fo.

    Args:
        model: the model.
        heat: what a unit of each adds to the rates of the states, per t_ref.
    """
    no_heat = ((0, 0), (0, heat.shape[1]))
    return replace(
        model,
        B=jnp.pad(model.B, no_heat),
        D=jnp.pad(model.D, no_heat),
        B0=jnp.pad(on_device(heat), ((0, 0), (model.B.shape[1], 0))),
        driven=model.driven + (True,) * heat.shape[1],
    )


def _heat_of_cells(node_positions: Any, profiles: Sequence[HeatProfile]) -> Any:
    """The share of each profile's heat that is released in each node's cell, `(node, profile)`."""
    xp = numpy_for(node_positions)
    bounds = xp.concatenate([np.zeros(1), 0.5 * (node_positions[1:] + node_positions[:-1]), np.ones(1)])
    return xp.stack([xp.diff(profile.released_up_to(bounds)) for profile in profiles], axis=1)


def _coupling_matrices(
    conductance: Float[ArrayLike, " cell"], film: Sequence[Number], has_film: tuple[bool, ...]
) -> tuple[slice, Any, Any]:
    """The nodes that are states, their coupling, and the coupling to the inputs. A face behind a film is a state."""
    xp, last = numpy_for(conductance, *film), len(conductance)
    unit = np.eye(last + 1)
    coupling = xp.diag(conductance, 1) + xp.diag(conductance, -1)
    coupling = coupling - xp.diag(coupling.sum(axis=1))
    drive = []
    for side, (face, beside) in enumerate(((0, 1), (last, last - 1))):
        if has_film[side]:
            coefficient = 1.0 / film[side] * unit[face]
            drive.append(coefficient)
            coupling = coupling - xp.diag(coefficient)
        else:
            drive.append(coupling[beside, face] * unit[beside])
    state = slice(0 if has_film[0] else 1, last + 1 if has_film[1] else last)
    return state, coupling[state, state], xp.stack(drive, axis=1)[state]


def wall_cells(wall: Wall, nodes: int, node_positions: Float[ArrayLike, " node"] | None = None) -> tuple[Any, Any, Any]:
    """Positions of all nodes, resistances between them, capacities of their cells; the sums over a wall are 1.

    Each is an integral over its cell, so interfaces of layers may be anywhere. The two faces have half cells.
    """
    node_positions = grid(wall, nodes) if node_positions is None else node_positions
    edges, k, c = _relative_properties(wall)
    xp, zero, one = numpy_for(node_positions, edges, k, c), np.zeros(1), np.ones(1)
    cumulative_resistance = xp.concatenate([zero, xp.cumsum(xp.diff(edges) / k)])
    cumulative_capacity = xp.concatenate([zero, xp.cumsum(xp.diff(edges) * c)])
    bounds = xp.concatenate([zero, 0.5 * (node_positions[1:] + node_positions[:-1]), one])
    resistance = xp.diff(xp.interp(node_positions, edges, cumulative_resistance))
    return node_positions, resistance, xp.diff(xp.interp(bounds, edges, cumulative_capacity))


def layer_nodes(wall: Wall, node_positions: np.ndarray) -> np.ndarray:
    """The indices of the nodes at the edges of the layers, both faces included."""
    edges, _, _ = _relative_properties(wall)
    return np.abs(node_positions - edges[:, None]).argmin(axis=1)


def _edges(wall: Wall) -> Any:
    """The layers' edges x*, from 0 to 1; a constant where there is one layer."""
    thickness = [layer.thickness for layer in wall.layers[:-1]]
    xp = numpy_for(wall.length, *thickness)
    if not thickness:
        return np.array([0.0, 1.0])
    return xp.concatenate([np.zeros(1), xp.cumsum(xp.array(thickness)) / wall.length, np.ones(1)])


def _relative_properties(wall: Wall) -> tuple[Any, Any, Any]:
    """The layers' edges x*, conductivities and capacities over the wall's effective ones."""
    k, c = ([layer[column] for layer in wall.relative_layers()] for column in (1, 2))
    return _edges(wall), numpy_for(*k).array(k), numpy_for(*c).array(c)


def _output_row(output: Output, wall: Wall, node_positions: Any, edges: Any, k: Any) -> Float[ArrayLike, " node"]:
    """The weights of all nodes, both faces included, for one output."""
    x = output.position / wall.length
    known = known_value(x)
    if known is not None and not 0.0 <= known <= 1.0:
        raise ValueError(f"output {output.name!r}: position {output.position} m is outside the wall of {wall.length} m")
    xp = numpy_for(x, node_positions, edges, k)
    node_positions, edges, k = (xp.asarray(one) for one in (node_positions, edges, k))
    layer = xp.clip(xp.searchsorted(edges, x, side="left") - 1, 0, len(k) - 1)
    begin = xp.searchsorted(node_positions, edges[layer] - 1e-12, side="left")
    end = xp.searchsorted(node_positions, edges[layer + 1] + 1e-12, side="right")
    first = xp.clip(xp.searchsorted(node_positions, x) - _STENCIL // 2, begin, end - _STENCIL)
    stencil = first + np.arange(_STENCIL)
    weights = lagrange_weights(node_positions[stencil], x, int(output.kind != "temperature"))
    if output.kind == "flux":
        weights = -k[layer] * weights
    return weights @ (stencil[:, None] == np.arange(len(node_positions)))


def lagrange_weights(nodes: Float[ArrayLike, " node"], x: Number, derivative: int) -> Float[ArrayLike, " node"]:
    """Weights `w` with `sum_i w_i p(nodes_i) = p(x)` (or `p'(x)`) for polynomials of degree < len(nodes).

    From the moments about x, `sum_i w_i ((nodes_i - x)/h)^p = delta_{p, derivative} / h^derivative`.
    """
    h = nodes[1] - nodes[0]
    moments = powers((nodes - x) / h, len(nodes)).T
    return numpy_for(moments).linalg.solve(moments, np.eye(len(nodes))[derivative]) / h**derivative
