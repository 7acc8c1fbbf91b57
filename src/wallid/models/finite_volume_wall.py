"""The full-order model (the paper's large original model): a wall as a state space, by finite volumes.

For a homogeneous wall this is the central difference of the paper: `A = tridiag(1, -2, 1)/dx^2`, and `B` with `1/dx^2`
in two corners, both boundary temperatures given. For a layered wall a node's capacity is the integral of the heat
capacity over its cell, and the resistance between two nodes the integral of `1/k` (the harmonic mean). Both are
relative to the wall's effective values, so that one effective diffusivity `L^2 / (R C)` scales the whole model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from .._internal.arrays import on_device
from ..case.wall_and_sensors import Wall
from .state_space import StateSpace, require_x64

_STENCIL = 4  # nodes of a cubic, so that interpolation between nodes adds no second-order error
_MIN_CELLS = 3  # in a layer, so that a cubic fits into each


@dataclass(frozen=True)
class Output:
    """An output of a model at one position.

    Args:
        position: m from the left face, faces included.
        kind: "temperature": u. "gradient": `du/dx*`, times `T_ref / L` in K/m. "flux":
            `-(k/k_eff) du/dx*` along +x, times `k_eff T_ref / L` in W/m2.
        name: for tables and figures.
    """

    position: float
    kind: Literal["temperature", "gradient", "flux"] = "temperature"
    name: str = ""


def grid(wall: Wall, nodes: int) -> np.ndarray:
    """The nodes x*, both faces included: a node at each interface of layers, uniform within a layer.

    The number of cells of a layer is proportional to its diffusion time's square root, `d / sqrt(alpha)`.

    Raises:
        ValueError: too few nodes for the layers.
    """
    layers = wall.relative_layers()
    cells = nodes - 1
    if cells < _MIN_CELLS * len(layers):
        raise ValueError(
            f"nodes: {nodes} for {len(layers)} layer(s); at least {_MIN_CELLS * len(layers) + 1} are needed"
        )
    thickness = np.array([layer[0] for layer in layers]) / wall.length
    share = thickness * np.sqrt([c / k for _, k, c in layers])
    spare = cells - _MIN_CELLS * len(layers)
    exact = spare * share / share.sum()
    count = np.floor(exact).astype(int)
    for layer in np.argsort(count - exact, kind="stable")[: spare - count.sum()]:
        count[layer] += 1
    edges = np.concatenate([[0.0], np.cumsum(thickness)])
    edges[-1] = 1.0
    pieces = [np.linspace(edges[i], edges[i + 1], count[i] + _MIN_CELLS + 1)[:-1] for i in range(len(layers))]
    return np.concatenate([*pieces, [1.0]])


def finite_volume_model(
    wall: Wall,
    outputs: Sequence[Output],
    *,
    nodes: int = 101,
    profile_degree: int = 2,
    film: tuple[float, float] = (0.0, 0.0),
    node_positions: np.ndarray | None = None,
) -> StateSpace:
    """The wall as a `StateSpace` whose inputs are its two boundary temperatures (left, right).

    `U' = Fo (A U + B Q)`, `Y = C U + D Q`, `U(0) = P a`, with the temperatures of the inner nodes as state and the
    coefficients `a` of the initial profile `sum_k a_k x*^k`.

    Args:
        outputs: temperatures, gradients and fluxes at any position; interpolated by cubics within a layer.
        nodes: their number, both faces included.
        profile_degree: of the initial profile's polynomial.
        film: conductivity over film coefficient at the left and the right face, m. Above 0 the input is the
            air temperature, and the face is a state: `k dT/dn = h (T_air - T_face)`, n outward.
        node_positions: x*, both faces included; None for those of `grid`.

    Returns:
        the model with its nodes' capacities; `modal()` of it has a diagonal A.

    Raises:
        ValueError: too few nodes, or an output outside the wall.
    """
    require_x64()
    node_positions, resistance, cell_capacity = wall_cells(wall, nodes, node_positions)
    edges, k, _ = _relative_properties(wall)
    rows = np.stack([_output_row(output, wall, node_positions, edges, k) for output in outputs])
    state, coupling, drive = _coupling_matrices(1.0 / resistance, (film[0] / wall.length, film[1] / wall.length))
    capacity, direct = cell_capacity[state], np.zeros((len(rows), 2))
    for side, face in enumerate((0, len(node_positions) - 1)):
        if film[side] <= 0.0:
            direct[:, side] = rows[:, face]
    return StateSpace(
        A=coupling / capacity[:, None],
        B=drive / capacity[:, None],
        C=rows[:, state],
        D=direct,
        P=np.vander(node_positions[state], profile_degree + 1, increasing=True),
        capacity=on_device(capacity),
        output_names=tuple(output.name for output in outputs),
    )


def _coupling_matrices(conductance: np.ndarray, film: tuple[float, float]) -> tuple[slice, np.ndarray, np.ndarray]:
    """The nodes that are states, their coupling, and the coupling to the inputs. A face behind a film is a state."""
    last = len(conductance)
    coupling = np.diag(conductance, 1) + np.diag(conductance, -1)
    coupling -= np.diag(coupling.sum(axis=1))
    drive = np.zeros((last + 1, 2))
    for side, (face, beside) in enumerate(((0, 1), (last, last - 1))):
        if film[side] > 0.0:
            drive[face, side] = 1.0 / film[side]
            coupling[face, face] -= 1.0 / film[side]
        else:
            drive[beside, side] = coupling[beside, face]
    state = slice(0 if film[0] > 0.0 else 1, last + 1 if film[1] > 0.0 else last)
    return state, coupling[state, state], drive[state]


def wall_cells(
    wall: Wall, nodes: int, node_positions: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions of all nodes, resistances between them, capacities of their cells; the sums over a wall are 1.

    Each is an integral over its cell, so interfaces of layers may be anywhere. The two faces have half cells.
    """
    node_positions = grid(wall, nodes) if node_positions is None else node_positions
    edges, k, c = _relative_properties(wall)
    cumulative_resistance = np.concatenate([[0.0], np.cumsum(np.diff(edges) / k)])
    cumulative_capacity = np.concatenate([[0.0], np.cumsum(np.diff(edges) * c)])
    bounds = np.concatenate([[0.0], 0.5 * (node_positions[1:] + node_positions[:-1]), [1.0]])
    resistance = np.diff(np.interp(node_positions, edges, cumulative_resistance))
    return node_positions, resistance, np.diff(np.interp(bounds, edges, cumulative_capacity))


def layer_nodes(wall: Wall, node_positions: np.ndarray) -> np.ndarray:
    """The indices of the nodes at the edges of the layers, both faces included."""
    edges, _, _ = _relative_properties(wall)
    return np.abs(node_positions - edges[:, None]).argmin(axis=1)


def _relative_properties(wall: Wall) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The layers' edges x*, conductivities and capacities over the wall's effective ones."""
    layers = wall.relative_layers()
    edges = np.concatenate([[0.0], np.cumsum([layer[0] for layer in layers])]) / wall.length
    edges[-1] = 1.0
    return edges, np.array([k for _, k, _ in layers]), np.array([c for _, _, c in layers])


def _output_row(
    output: Output, wall: Wall, node_positions: np.ndarray, edges: np.ndarray, k: np.ndarray
) -> Float[np.ndarray, " node"]:
    """The weights of all nodes, both faces included, for one output."""
    x = output.position / wall.length
    if not 0.0 <= x <= 1.0:
        raise ValueError(f"output {output.name!r}: position {output.position} m is outside the wall of {wall.length} m")
    layer = int(np.clip(np.searchsorted(edges, x, side="left") - 1, 0, len(k) - 1))
    inside = np.flatnonzero((node_positions >= edges[layer] - 1e-12) & (node_positions <= edges[layer + 1] + 1e-12))
    first = np.searchsorted(node_positions[inside], x) - _STENCIL // 2
    first = int(np.clip(first, 0, len(inside) - _STENCIL))
    stencil = inside[first : first + _STENCIL]
    weights = lagrange_weights(node_positions[stencil], x, int(output.kind != "temperature"))
    if output.kind == "flux":
        weights = -k[layer] * weights
    row = np.zeros(len(node_positions))
    row[stencil] = weights
    return row


def lagrange_weights(nodes: np.ndarray, x: float, derivative: int) -> Float[np.ndarray, " node"]:
    """Weights `w` with `sum_i w_i p(nodes_i) = p(x)` (or `p'(x)`) for polynomials of degree < len(nodes).

    From the moments about x, `sum_i w_i ((nodes_i - x)/h)^p = delta_{p, derivative} / h^derivative`.
    """
    h = nodes[1] - nodes[0]
    moments = np.vander((nodes - x) / h, len(nodes), increasing=True).T
    return np.linalg.solve(moments, np.eye(len(nodes))[derivative]) / h**derivative
