"""The diffusivities of many walls in one call: the paper's estimate for each, swept over cores and devices.

Each wall has a model, a record and a start of its own, and a standard error by its readings' noise as stated,
`std(ln alpha) = |(J^T J)^-1|^1/2`. It is a first look at a stock of walls, or a study of a design by ten thousand
synthetic records; the interval that can be believed is `estimate`'s, wall by wall.
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jax.sharding import Mesh
from jaxtyping import Array, Bool, Float, Int

from ..inference.weighted_least_squares import WeightedProblem, searched, stacked
from ..models.batching import Sweep, sweep
from ..models.integration import ArrayLike
from ..models.recurrence.single_kernel import is_small
from ..models.state_space import StateSpace, require_x64
from ..models.window_inputs import WindowData

_ITERATIONS = 40  # Gauss-Newton needs some six; a wall that takes more says so
_TOGETHER = 32  # walls: their numbers stay in a core's cache; one where a wall's whole search is one kernel


class WallEstimates(eqx.Module):
    """What a sweep over walls gives, a row a wall.

    Args:
        diffusivity: m2/s.
        relative_std: of it by the readings' noise as stated, 1; infinite where the record holds nothing.
        chi_square: reduced, of the weighted misfit.
        steps: Gauss-Newton steps taken.
        converged: whether the paper's criteria were met.
    """

    diffusivity: Float[Array, " wall"]
    relative_std: Float[Array, " wall"]
    chi_square: Float[Array, " wall"]
    steps: Int[Array, " wall"]
    converged: Bool[Array, " wall"]

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
    """The diffusivity of each of many walls, from models and records that differ in their numbers only.

    Args:
        systems, data: one large or reduced model, and one window's experiment, a wall: made by `stack`. Records may
            have missing readings; they all have the same number of rows and of sensors.
        fourier_per_alpha: Fo for a diffusivity of 1 m2/s, `scales(case).fourier(1.0)`.
        start: m2/s.
        eta: the stopping criterion on the relative change of the diffusivity.
        way, chunk, mesh: how the walls are gone through, see `sweep`; a chunk of None is what is fastest.

    Raises:
        ValueError: numbers of walls that differ.
    """
    require_x64()
    items = (systems, data, jnp.asarray(fourier_per_alpha, float), jnp.asarray(start, float))
    arrays, static = eqx.partition(items, eqx.is_array)
    if chunk is None:
        one = jax.tree.map(lambda leaf: leaf[0], systems)
        chunk = 1 if is_small(one) else _TOGETHER
    return WallEstimates(**sweep(_one, arrays, static, jnp.asarray(eta, float), way=way, chunk=chunk, mesh=mesh))


def _one(arrays: tuple, static: tuple, eta: Float[Array, ""]) -> dict[str, Array]:
    """The numbers of one wall, by the names that `Walls` gives them."""
    system, data, fourier_per_alpha, start = eqx.combine(arrays, static)
    problem = WeightedProblem(system, data, fourier_per_alpha, start, True, "propagator")
    solution = searched(problem, eta, _ITERATIONS)
    jacobian = stacked(*solution.stats["jacobian"])
    # offsets projected out: what is left of the diffusivity's column when it is cleared of theirs
    own, others = jacobian[:, 0], jacobian[:, 1:].T
    if data.offsets:
        own = own - others.T @ jnp.linalg.solve(others @ others.T, others @ own)
    information = jnp.sum(own**2)
    readings, cost = jnp.sum(data.weight > 0), sum(jnp.sum(part**2) for part in solution.stats["residual"])
    return {
        "diffusivity": start * jnp.exp(solution.value[0]),
        "relative_std": 1.0 / jnp.sqrt(information),
        "chi_square": cost / jnp.maximum(readings - 1, 1),
        "steps": solution.stats["trace"].count - 1,
        "converged": solution.result == optx.RESULTS.successful,
    }
