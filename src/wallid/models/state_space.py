"""The linear state-space model, the same class for full-order and reduced-order models.

With the time in units of `t_ref` and `Fo = t_ref alpha / L^2`:

    x' = (Fo A + A0) x + (Fo B + B0) q        x(0) = P a
    u  = C x + D q
    theta = du/dFo = C_theta x_theta
    x_theta' = (Fo A + A0) x_theta + A x + B q     x_theta(0) = 0

`q` are the inputs (of a wall: its two boundary temperatures), `a` the coefficients of the initial profile.
"""

from __future__ import annotations

import dataclasses
import json
from contextlib import nullcontext
from io import BufferedIOBase
from pathlib import Path
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, ScalarLike

from .._internal.arrays import index_array, on_device
from .._internal.html import html_table
from .._internal.result_object import ResultObject, plain_value

if TYPE_CHECKING:
    from pandas import DataFrame

_ARRAYS = ("A", "B", "C", "D", "P", "A0", "B0", "C_theta", "capacity")
_FILE_FORMAT = 1


def require_x64() -> None:
    """Refuse to compute in single precision.

    Raises:
        RuntimeError: `jax_enable_x64` is off.
    """
    if not jax.config.jax_enable_x64:  # pyright: ignore[reportAttributeAccessIssue]
        raise RuntimeError(
            "wallid needs float64, which is switched off in JAX. Put "
            "`jax.config.update('jax_enable_x64', True)` before the first computation, "
            "or set JAX_ENABLE_X64=1 in the environment."
        )


class StateSpace(eqx.Module, ResultObject):
    """A linear model whose rate scales with the Fourier number.

        x' = (Fo A + A0) x + (Fo B + B0) q,   u = C x + D q,   x(0) = P a

    Args:
        A: state matrix, the part that scales with Fo, 1; `(node, node)`, or `(node,)` where it is diagonal.
        B: input matrix, the part that scales with Fo, 1, `(node, input)`.
        C: output matrix, `(output, node)`.
        D: direct term from the inputs to the outputs, `(output, input)`.
        P: the initial state for a unit of each coefficient of the initial profile, `(node, param)`.
        A0, B0: the parts that do not scale with Fo, with the shapes of A and B; None for zero.
        C_theta: output matrix of the sensitivity state; None for C, which gives the exact derivative.
        capacity: weights `m > 0` that make `diag(m) A` symmetric, `(node,)`; None where there are none.
        output_names: one name for each output, or none.
        driven: for each input, whether the model includes its effect. A reduced-order model does not include an input
            that was constant in all training signals.

    Raises:
        RuntimeError: 64-bit floats are switched off.
        ValueError: a shape that does not fit the others.
    """

    A: Float[Array, "node node"] | Float[Array, " node"] = eqx.field(converter=on_device)
    B: Float[Array, "node input"] = eqx.field(converter=on_device)
    C: Float[Array, "output node"] = eqx.field(converter=on_device)
    D: Float[Array, "output input"] = eqx.field(converter=on_device)
    P: Float[Array, "node param"] = eqx.field(converter=on_device)
    A0: Float[Array, "node node"] | Float[Array, " node"] | None = None
    B0: Float[Array, "node input"] | None = None
    C_theta: Float[Array, "output node"] | None = None
    capacity: Float[Array, " node"] | None = None
    output_names: tuple[str, ...] = eqx.field(static=True, default=())
    driven: tuple[bool, ...] = eqx.field(static=True, default=(True, True))

    def __check_init__(self) -> None:
        require_x64()
        nodes, inputs = self.B.shape
        expected = {
            "A": {(nodes, nodes), (nodes,)},
            "C": {(self.C.shape[0], nodes)},
            "D": {(self.C.shape[0], inputs)},
            "P": {(nodes, self.P.shape[-1])},
            "A0": {self.A.shape},
            "B0": {self.B.shape},
            "C_theta": {self.C.shape},
            "capacity": {(nodes,)},
        }
        for name, shapes in expected.items():
            value = getattr(self, name)
            if value is not None and value.shape not in shapes:
                allowed = " or ".join(str(shape) for shape in sorted(shapes, key=len))
                raise ValueError(f"StateSpace: {name} has shape {value.shape}; with this B it must be {allowed}")
        for name, count in (("output_names", self.C.shape[0]), ("driven", inputs)):
            length = len(getattr(self, name))
            if length != count and not (name == "output_names" and length == 0):
                raise ValueError(f"StateSpace: {name} has {length} entries; it must have {count}")

    @property
    def order(self) -> int:
        """The number of states."""
        return self.B.shape[0]

    @property
    def is_diagonal(self) -> bool:
        """Whether A is diagonal, so that each state is a mode."""
        return self.A.ndim == 1

    @property
    def is_symmetrisable(self) -> bool:
        """Whether `modal` can diagonalise this model."""
        return self.is_diagonal or (self.capacity is not None and self.A0 is None)

    @property
    def theta_outputs(self) -> Float[Array, "output node"]:
        """The output matrix of the sensitivity state: C_theta, or C where C_theta is None."""
        return self.C if self.C_theta is None else self.C_theta

    def apply(self, x: Float[Array, " node"]) -> Float[Array, " node"]:
        """`A x`."""
        return jnp.multiply(self.A, x) if self.is_diagonal else jnp.matmul(self.A, x)

    def rate(self, x: Float[Array, " node"], q: Float[Array, " input"], fourier: ScalarLike) -> Float[Array, " node"]:
        """`x' = (Fo A + A0) x + (Fo B + B0) q`, per unit of t_ref."""
        rate = jnp.multiply(fourier, self.apply(x) + self.B @ q)
        if self.A0 is not None:
            rate = rate + (self.A0 * x if self.is_diagonal else self.A0 @ x)
        if self.B0 is not None:
            rate = rate + self.B0 @ q
        return rate

    @eqx.filter_jit
    def static_gain(self) -> Float[Array, "output input"]:
        """The outputs in a steady state for a unit of each input, `D - C A^-1 B`.

        Raises:
            ValueError: A0 or B0 is not None, so the gain depends on Fo.
        """
        if self.A0 is not None or self.B0 is not None:
            raise ValueError("static_gain: A0 or B0 is set, so the steady state depends on the diffusivity")
        A_inverse_B = jnp.divide(self.B, self.A[:, None]) if self.is_diagonal else jnp.linalg.solve(self.A, self.B)
        return jnp.subtract(self.D, jnp.matmul(self.C, A_inverse_B))

    def modal(self) -> StateSpace:
        """The same model in modal coordinates: `A` is diagonal, the outputs are equal to round-off.

        With `M = diag(capacity)` and the eigenvalues `f` of `M^1/2 A M^-1/2 = Q diag(f) Q^T`, the state is
        `Q^T M^1/2 x`.

        Raises:
            ValueError: the model cannot be symmetrised.
        """
        if self.is_diagonal:
            return self
        if not self.is_symmetrisable or self.capacity is None:
            raise ValueError(
                "modal: the model cannot be symmetrised, because `capacity` is None or `A0` is not; `simulate` "
                "accepts it without modes"
            )
        return _to_modes(self, self.capacity)

    def select(self, outputs: list[int]) -> StateSpace:
        """The same model with only the outputs at these indices, in this order."""
        rows = np.asarray(outputs)
        return dataclasses.replace(
            self,
            C=index_array(self.C, rows),
            D=index_array(self.D, rows),
            C_theta=None if self.C_theta is None else index_array(self.C_theta, rows),
            output_names=tuple(self.output_names[row] for row in outputs) if self.output_names else (),
        )

    def save(self, path: str | Path | BufferedIOBase) -> None:
        """Write the model in NumPy's npz format, which NumPy alone can read.

        Args:
            path: of the file, or a file that is open for writing bytes.
        """
        arrays: dict[str, Any] = {
            name: np.asarray(value) for name in _ARRAYS if (value := getattr(self, name)) is not None
        }
        header = {"format": _FILE_FORMAT, "output_names": self.output_names, "driven": self.driven}
        with Path(path).open("wb") if isinstance(path, str | Path) else nullcontext(path) as file:
            np.savez(file, header=np.array(json.dumps(header)), **arrays)

    @staticmethod
    def load(path: str | Path) -> StateSpace:
        """Read a model that `save` wrote.

        Raises:
            ValueError: the file is not such a model, or it has a format that this version cannot read.
        """
        try:
            with np.load(path, allow_pickle=False) as file:
                header = json.loads(str(file["header"]))
                arrays: dict[str, Any] = {name: on_device(file[name]) for name in file.files if name in _ARRAYS}
        except (KeyError, ValueError, OSError) as error:
            raise ValueError(f"{path}: not a model saved by wallid ({error})") from error
        if header.get("format") != _FILE_FORMAT:
            raise ValueError(f"{path}: model format {header.get('format')}; this version reads {_FILE_FORMAT} only")
        return StateSpace(
            **arrays, output_names=tuple(header["output_names"]), driven=tuple(map(bool, header["driven"]))
        )

    def to_dict(self) -> dict[str, Any]:
        """The matrices as lists, the names of the outputs, and which inputs are driven."""
        arrays = {name: getattr(self, name) for name in _ARRAYS if getattr(self, name) is not None}
        return plain_value(arrays | {"output_names": self.output_names, "driven": self.driven})

    def to_frame(self) -> DataFrame:
        """One row for each state: its rate per unit of Fo (of a mode its eigenvalue, else the diagonal of A), B and C.

        The columns of B are named by the input, those of C by the output.
        """
        import pandas as pd

        rates = self.A if self.is_diagonal else jnp.diagonal(self.A)
        outputs = self.output_names or tuple(f"output {k + 1}" for k in range(self.C.shape[0]))
        columns = {"rate": np.asarray(rates)}
        columns |= {f"B of input {k + 1}": np.asarray(self.B[:, k]) for k in range(self.B.shape[1])}
        columns |= {f"C of {name}": np.asarray(row) for name, row in zip(outputs, self.C, strict=True)}
        return pd.DataFrame(columns).rename_axis("mode" if self.is_diagonal else "node")

    def _repr_html_(self) -> str:
        stacked = self.B.ndim > 2  # many models in one, by `stack`
        rows = [
            ("models", str(self.B.shape[0]) if stacked else "1", "", ""),
            ("states", str(self.B.shape[-2]), "", ""),
            ("inputs", str(self.B.shape[-1]), f"{sum(self.driven)} driven", ""),
            ("outputs", str(self.C.shape[-2]), ", ".join(self.output_names), ""),
            ("coefficients of the initial profile", str(self.P.shape[-1]), "", ""),
        ]
        return html_table("State space: x' = (Fo A + A0) x + (Fo B + B0) q, u = C x + D q", rows)

    def __str__(self) -> str:
        kind = "modes" if self.is_diagonal else "nodes"
        driven = sum(self.driven)
        names = ", ".join(self.output_names) or str(self.C.shape[0])
        return (
            f"StateSpace of {self.order} {kind}, {driven} of {len(self.driven)} inputs driven, "
            f"{self.P.shape[1]} profile coefficients; outputs: {names}"
        )


@jax.custom_jvp
def symmetric_modes(
    matrix: Float[Array, "node node"],
) -> tuple[Float[Array, " node"], Float[Array, "node node"]]:
    """Eigenvalues and eigenvectors of a symmetric matrix, with a derivative that is finite.

    `dQ = Q W`, `W_ij = (Q^T dS Q)_ij / (f_j - f_i)`. What a model gives depends on a pair of modes by
    `W_ij (g(f_j) - g(f_i))`, which has a limit for equal eigenvalues; `W_ij` has none. A difference below the rounding
    of the eigenvalues is taken as that rounding, so that a pair of equal modes adds nothing, where JAX's own rule
    gives NaN. In a wall only modes that change from node to node can be so close, in layers far from each other.

    Source: M. B. Giles, An extended collection of matrix derivative results, Oxford NA-08/01, Section 3.1.
    """
    f, Q = jnp.linalg.eigh(matrix)
    return f, Q


@symmetric_modes.defjvp
def _symmetric_modes_jvp(primals: tuple[Array], tangents: tuple[Array]) -> tuple[tuple, tuple]:
    f, Q = symmetric_modes(*primals)
    change = Q.T @ (0.5 * (tangents[0] + tangents[0].T)) @ Q
    gap = f - f[:, None]
    rounding = f.shape[0] * jnp.finfo(f.dtype).eps * jnp.max(jnp.abs(f))
    gap = jnp.where(jnp.abs(gap) < rounding, jnp.where(gap < 0.0, -rounding, rounding), gap)
    turn = jnp.where(jnp.eye(f.shape[0], dtype=bool), 0.0, change / gap)
    return (f, Q), (jnp.diagonal(change), Q @ turn)


@eqx.filter_jit
def _to_modes(system: StateSpace, capacity: Float[Array, " node"]) -> StateSpace:
    root = jnp.sqrt(capacity)
    f, Q = symmetric_modes(root[:, None] * system.A / root)
    to_modes = Q.T * root
    from_modes = Q / root[:, None]
    return StateSpace(
        A=f,
        B=to_modes @ system.B,
        C=system.C @ from_modes,
        D=system.D,
        P=to_modes @ system.P,
        B0=None if system.B0 is None else to_modes @ system.B0,
        C_theta=None if system.C_theta is None else system.C_theta @ from_modes,
        output_names=system.output_names,
        driven=system.driven,
    )
