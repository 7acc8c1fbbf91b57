"""The diffusivities of many walls in one call: weighted least squares for each, distributed over cores and devices.

Each wall has its own model, record and start. Its standard error counts the stated noise of the readings only,
`std(ln alpha) = |(J^T J)^-1|^1/2`. Use it for a survey of many walls or for a study with many synthetic records; a
reliable interval of one wall is that of `estimate`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jax.sharding import Mesh
from jaxtyping import Array, Bool, Float, Int

from .._internal.result_object import ResultObject
from ..inference.weighted_least_squares import WeightedProblem, solve_weighted_problem, stack_jacobian
from ..models.batching import Sweep, sweep
from ..models.integration import ArrayLike
from ..models.recurrence.single_kernel import fits_single_kernel
from ..models.state_space import StateSpace, require_x64
from ..models.window_inputs import WindowData

if TYPE_CHECKING:
    from pandas import DataFrame

_MAX_ITERATIONS = 40  # about six are usual; a wall that needs more is marked as not converged
_WALLS_PER_CHUNK = 32  # they fit into the cache of a core; 1 where the entire search of a wall is one kernel


class WallEstimates(eqx.Module, ResultObject):
    """The estimates of many walls, each array `(wall,)`.

    Args:
        diffusivity: m2/s.
        relative_std: relative standard error by the stated noise of the readings, dimensionless; infinite for an
            uninformative record.
        reduced_chi_square: of the weighted residual.
        iterations: Gauss-Newton steps.
        converged: whether the stopping criteria were met.
    """

    diffusivity: Float[Array, " wall"]
    relative_std: Float[Array, " wall"]
    reduced_chi_square: Float[Array, " wall"]
    iterations: Int[Array, " wall"]
    converged: Bool[Array, " wall"]

    def to_frame(self) -> DataFrame:
        """One row for each wall, with the fields of this class as columns."""
        import pandas as pd

        return pd.DataFrame(self.to_dict()).rename_axis("wall")

    def _html_title(self) -> str:
        return str(self)

    def __str__(self) -> str:
        reliable = jnp.sum(self.converged & (self.relative_std < 1.0))
        count, median = self.diffusivity.shape[0], jnp.median(self.diffusivity)
        return f"{count} walls, {int(reliable)} estimated; median {median:.4g} m2/s"


def estimate_walls(
    systems: StateSpace,
    data: WindowData,
    fourier_per_alpha: Float[ArrayLike, " wall"],
    start: Float[ArrayLike, " wall"],
    *,
    eta: float = 1e-8,
    way: Sweep = "map",
    chunk: int | None = None,
    mesh: Mesh | None = None,
) -> WallEstimates:
    """Estimate the diffusivity of each of many walls by weighted least squares.

    Args:
        systems: full- or reduced-order models, stacked along a first axis by `wallid.models.stack`.
        data: the data of one window of each wall, stacked alike. Readings may be missing; the numbers of rows and
            sensors are the same for all walls.
        fourier_per_alpha: Fo for a diffusivity of 1 m2/s, `scales(case).fourier_number(1.0)`, `(wall,)`.
        start: initial diffusivities, m2/s, `(wall,)`.
        eta: stopping criterion on the relative change of the diffusivity.
        way, chunk, mesh: how the walls are distributed, as in `wallid.models.sweep`; None chooses a fast chunk.

    Returns:
        the estimate of each wall.

    Raises:
        ValueError: the numbers of walls differ.

    Source: Berger and Kadoch, Section 4.2.
    """
    require_x64()
    items = (systems, data, jnp.asarray(fourier_per_alpha, float), jnp.asarray(start, float))
    arrays, static = eqx.partition(items, eqx.is_array)
    if chunk is None:
        one = jax.tree.map(lambda leaf: leaf[0], systems)
        chunk = 1 if fits_single_kernel(one) else _WALLS_PER_CHUNK
    return WallEstimates(
        **sweep(_estimate_wall, arrays, static, jnp.asarray(eta, float), way=way, chunk=chunk, mesh=mesh)
    )


def _estimate_wall(arrays: tuple, static: tuple, eta: Float[Array, ""]) -> dict[str, Array]:
    """The fields of `WallEstimates` for one wall."""
    system, data, fourier_per_alpha, start = eqx.combine(arrays, static)
    problem = WeightedProblem(system, data, fourier_per_alpha, start, True, "propagator")
    solution = solve_weighted_problem(problem, eta, _MAX_ITERATIONS)
    jacobian = stack_jacobian(*solution.stats["jacobian"])
    # the offsets are projected out of the diffusivity's column
    column, offsets = jacobian[:, 0], jacobian[:, 1:].T
    if data.offsets:
        column = column - offsets.T @ jnp.linalg.solve(offsets @ offsets.T, offsets @ column)
    information = jnp.sum(column**2)
    readings, cost = jnp.sum(data.weight > 0), sum(jnp.sum(part**2) for part in solution.stats["residual"])
    return {
        "diffusivity": start * jnp.exp(solution.value[0]),
        "relative_std": 1.0 / jnp.sqrt(information),
        "reduced_chi_square": cost / jnp.maximum(readings - 1, 1),
        "iterations": solution.stats["trace"].count - 1,
        "converged": solution.result == optx.RESULTS.successful,
    }
