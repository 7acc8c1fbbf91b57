"""Two capacities and three resistances with process noise: the likelihood and its maximum against statsmodels."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from benchmarks.reference.two_node_wall import START, TRUE, StatsmodelsWall, fitted, log_likelihood, simulated
from numpy.testing import assert_allclose


def test_likelihood_and_estimate_of_a_wall_of_two_nodes():
    faces, y = simulated(400)
    theirs = StatsmodelsWall(y, faces)
    value = jax.jit(log_likelihood)
    for theta in (TRUE, START):
        assert float(value(jnp.asarray(theta), faces, y)) == pytest.approx(theirs.loglike(np.asarray(theta)), rel=1e-6)
    fit = theirs.fit(disp=False, maxiter=500, method="bfgs", gtol=1e-8)
    ours = fitted(faces, y)()
    assert -ours.fun == pytest.approx(fit.llf, rel=1e-6)
    assert_allclose(ours.x, fit.params, atol=1e-4)
