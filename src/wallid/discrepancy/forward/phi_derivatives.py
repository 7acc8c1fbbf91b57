"""The phi-functions with derivatives by an identity: a far shorter program than the derivative of their series."""

from __future__ import annotations

from functools import partial
from itertools import pairwise

import jax
from jaxtyping import Array, Float

from ...models.exponential_solver import phi_functions


@partial(jax.custom_jvp, nondiff_argnums=(1,))
def phi_functions_by_identity(z: Float[Array, "*shape"], highest: int) -> tuple[Float[Array, "*shape"], ...]:
    """`phi_functions`, with the derivatives under the integral sign::

        phi_k(z) = int_0^1 e^((1-s) z) s^(k-1)/(k-1)! ds,      phi_k'(z) = phi_k(z) - k phi_{k+1}(z)

    For large `|z|` the two terms differ by `1/z` of either, so the derivative by `ln |z|` has the error of `|z|`
    roundings, some 1e-13 in a wall.

    Source: Hochbruck and Ostermann (2010), Section 2.1, for the integral.
    """
    return phi_functions(z, highest)


@phi_functions_by_identity.defjvp
def _phi_functions_jvp(highest: int, primals: tuple[Array], tangents: tuple[Array]) -> tuple[tuple, tuple]:
    (z,), (change,) = primals, tangents
    exponential, *phis = phi_functions(z, highest + 1)
    slopes = (phi - k * after for k, (phi, after) in enumerate(pairwise(phis), start=1))
    return (exponential, *phis[:-1]), (exponential * change, *(slope * change for slope in slopes))
