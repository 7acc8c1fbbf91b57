"""Layers and films as parameters, and what a record cannot tell apart, against finite elements through SciPy."""

import json
from dataclasses import replace
from itertools import combinations, pairwise
from pathlib import Path

import numpy as np
import pytest
from benchmarks.reference.analytic_slab import weather
from numpy.testing import assert_allclose
from scipy.linalg import eigh
from scipy.signal import lsim

import wallid
from wallid.case.options import Choices
from wallid.inference.identifiability import collinearity_index
from wallid.models.finite_volume_wall import finite_volume_model
from wallid.models.wall_parameters import FILM_STD, LAYER_STD
from wallid.report import writer as report
from wallid.workflow import Run

LENGTH, STEP, ROWS, BEFORE = 0.3, 3600.0, 96, 240
LAYERS = ((0.12, 1.5, 1.8e6), (0.18, 0.25, 1.1e6))  # thickness, conductivity, capacity
PLACES = (0.04, 0.1, 0.16, 0.24)
ELEMENTS = 120


def elements(layers, count=ELEMENTS):
    """Linear finite elements of a layered wall: mass, stiffness, and the nodes."""
    edges = np.concatenate([[0.0], np.cumsum([layer[0] for layer in layers])])
    x = np.concatenate([np.linspace(a, b, count // len(layers) + 1)[:-1] for a, b in pairwise(edges)])
    x = np.append(x, edges[-1])
    M, K = np.zeros((2, len(x), len(x)))
    for i, h in enumerate(np.diff(x)):
        _, k, c = layers[np.searchsorted(edges, x[i] + 0.5 * h) - 1]
        here = slice(i, i + 2)
        M[here, here] += c * h / 6 * np.array([[2, 1], [1, 2]])
        K[here, here] += k / h * np.array([[1, -1], [-1, 1]])
    return M, K, x


def readings(layers, faces, places, film=(0.0, 0.0)):
    """Temperatures at places, from a steady state, by `lsim`; `film` is 1/h (m2 K/W) at each face, 0 for none."""
    M, K, x = elements(layers)
    drive, inner = np.zeros((len(x), 2)), np.ones(len(x), bool)
    for side, node in ((0, 0), (1, -1)):
        if film[side]:
            K[node, node] += 1 / film[side]
            drive[node, side] = 1 / film[side]
        else:
            inner[node] = False
    given = [node for side, node in ((0, 0), (1, len(x) - 1)) if not film[side]]
    sides = [side for side in (0, 1) if not film[side]]
    Mi = M[np.ix_(inner, inner)]
    A = -np.linalg.solve(Mi, K[np.ix_(inner, inner)])
    # with faces given, their coupling by stiffness; that of mass, by their slopes, is folded in
    B = np.linalg.solve(Mi, drive[inner])
    W = np.zeros((int(inner.sum()), 2))
    for node, side in zip(given, sides, strict=True):
        B[:, side] -= np.linalg.solve(Mi, K[inner, node])
        W[:, side] -= np.linalg.solve(Mi, M[inner, node])
    # state z = T - W q: z' = A z + (A W + B) q
    t = STEP * np.arange(len(faces))
    start = -np.linalg.solve(A, B @ faces[0]) - W @ faces[0]
    z = lsim((A, A @ W + B, np.eye(len(A)), np.zeros((len(A), 2))), faces, t, X0=start, interp=True)[1]
    T = np.zeros((len(faces), len(x)))
    T[:, inner] = z + faces @ W.T
    for node, side in zip(given, sides, strict=True):
        T[:, node] = faces[:, side]
    return np.stack([[np.interp(place, x, row) for place in places] for row in T])


def effective(layers):
    resistance = sum(d / k for d, k, _ in layers)
    capacity = sum(d * c for d, _, c in layers)
    return LENGTH**2 / (resistance * capacity), LENGTH / resistance


def case_of(layers, stated, *, film=(0.0, 0.0), places=PLACES, seed=1, noise=0.02, **choices):
    faces = weather(BEFORE + ROWS, STEP, np.random.default_rng(seed))
    inner = readings(layers, faces, places, film)[-ROWS:]
    rng = np.random.default_rng([seed, 5])
    time, names = STEP * np.arange(ROWS), tuple(f"T{s}" for s in range(len(places)))
    record = wallid.Record(
        time, time, None, faces[-ROWS:], inner + noise * rng.standard_normal(inner.shape), names,
        boundary_noise_std=0.002,
    )  # fmt: skip
    sensors = tuple(
        wallid.Sensor(name, place, noise_std=max(noise, 0.02)) for name, place in zip(names, places, strict=True)
    )
    wall = wallid.Wall(LENGTH, outside="right", layers=tuple(wallid.Layer(*layer) for layer in stated))
    chosen = Choices(model="lom", nodes=61, noise="stated", **choices)
    return wallid.Case("layers", Path("case.toml"), wall, sensors, record, chosen)


def near(found, truth, sigmas=4.0):
    assert abs(np.log(found.value / truth)) < sigmas * found.std / found.value, (found, truth)


def test_a_film_in_the_large_model():
    """A face behind a film, against the finite elements."""
    faces = weather(BEFORE + ROWS, STEP, np.random.default_rng(3))
    k, c = 0.8, 1.5e6
    film = (0.13, 0.0)
    want = readings([(LENGTH, k, c)], faces, (0.0, 0.1, 0.25), film)
    wall = wallid.Wall(LENGTH, k / c)
    outputs = [wallid.models.Output(x) for x in (0.0, 0.1, 0.25)]
    system = finite_volume_model(wall, outputs, nodes=101, profile_degree=1, film=(k * film[0], 0.0)).modal()
    at_rest = want[0]
    slope = (at_rest[2] - at_rest[0]) / 0.25
    fourier = wallid.case.Scales.of(wall).fourier_number(k / c)
    u, _ = wallid.models.propagate(system, fourier, STEP / 86400, faces, np.array([at_rest[0], slope * LENGTH]))
    assert_allclose(u, want, atol=2e-3)


WRONG = (LAYERS[0], (0.18, 0.5, 1.1e6))  # the second layer twice as conductive as it is
FILM = 0.13  # m2 K/W between the left air and its face


@pytest.fixture(scope="module")
def case():
    """The left column is the air's, and the second layer is stated wrong."""
    return case_of(LAYERS, WRONG, film=(FILM, 0.0), free=("layers", "film_left"))


@pytest.fixture(scope="module")
def found(case):
    return wallid.estimate(case)


def test_each_layers_diffusivity_and_a_film(case, found):
    assert found.reliable and found.reduced_chi_square < 1.5
    near(found.wall_parameters["layer 1"], 1.5 / 1.8e6)
    near(found.wall_parameters["layer 2"], 0.25 / 1.1e6)
    alpha, k = effective(LAYERS)
    near(found.wall_parameters["film_left"], k * FILM)
    assert all(one.std < 0.1 * one.value for one in found.wall_parameters.values())
    assert abs(np.log(found.value / alpha)) < 4 * found.std / found.value
    told = report.result_entries(Run(case, fit=found))
    assert told["structure"]["film_left"]["unit"] == "m" and told["structure"]["layer 2"]["unit"] == "m2/s"
    assert told["identifiability"]["sentence"] in str(found)
    json.dumps(told)


def sensitivity():
    """By ln(alpha), the second layer and the film, over the noise, the free initial profile projected out."""
    faces = weather(BEFORE + ROWS, STEP, np.random.default_rng(1))
    alpha, k = effective(LAYERS)

    def changed(diffusivity=1.0, layer=1.0, film=1.0):
        """Layers and film with one of the three parameters changed and the other two as they are."""
        layers = [LAYERS[0], (LAYERS[1][0], LAYERS[1][1] * layer, LAYERS[1][2])]
        now, conductivity = effective(layers)
        slower = now / (alpha * diffusivity)
        return [(d, k_i, c * slower) for d, k_i, c in layers], k * FILM * film / conductivity

    def field(**change):
        layers, film = changed(**change)
        return readings(layers, faces, PLACES, (film, 0.0))[-ROWS:]

    names = (("diffusivity", 1.0), ("layer", LAYER_STD), ("film", FILM_STD))
    h = 0.01
    columns = [
        std * (field(**{name: np.exp(h)}) - field(**{name: np.exp(-h)})).T.ravel() / (2 * h * 0.02)
        for name, std in names
    ]
    M, K, x = elements(LAYERS)
    K[0, 0] += 1 / FILM
    rate, shape = eigh(K[:-1, :-1], M[:-1, :-1] / M.sum())
    t, inner = STEP * np.arange(ROWS), field()
    span = np.ptp(np.concatenate([faces[-ROWS:].ravel(), inner.ravel()]))
    waves = [
        span
        / (n + 1)
        / 0.02
        * np.outer(np.interp(PLACES, x, np.append(shape[:, n], 0)), np.exp(-rate[n] / M.sum() * t))
        for n in range(8)
    ]
    Z = np.concatenate([np.array([wave.ravel() for wave in waves]).T, np.eye(8)])
    S = np.concatenate([np.array(columns).T, np.zeros((8, 3))])
    return S - Z @ np.linalg.lstsq(Z, S, rcond=None)[0]


@pytest.mark.usefixtures("faces_known_between_rows")
def test_the_collinearity_index_is_that_of_differences():
    """Against sensitivities by differences of the finite elements, at the true wall, without noise."""
    exact = case_of(LAYERS, LAYERS, film=(FILM, 0.0), noise=0.0, free=("layers", "film_left"))
    found = wallid.estimate(exact).identifiability  # with 2 mK of the faces' noise, a hundredth of the covariance
    S = sensitivity()
    assert_allclose(found.singular_values, np.linalg.svd(S, compute_uv=False), rtol=0.02)
    for subset, index in found.collinearity.items():
        assert index == pytest.approx(collinearity_index(S[:, list(subset)]), rel=0.02)
    assert len(found.collinearity) == 4 and found.overall_collinearity == max(found.collinearity.values())


def test_collinearity_of_known_matrices():
    """gamma = 1/sqrt(1 - |cos|) of two columns; 1 of orthogonal ones, whatever their size."""
    for angle in (0.05, 0.3, 1.2):
        S = np.array([[3.0, 0.2 * np.cos(angle)], [0.0, 0.2 * np.sin(angle)]])
        assert collinearity_index(S) == pytest.approx(1 / np.sqrt(1 - np.cos(angle)))
    assert collinearity_index(np.diag([1.0, 50.0, 1e-3])) == pytest.approx(1.0)
    assert np.isinf(collinearity_index(np.ones((3, 2)))) and np.isinf(collinearity_index(np.zeros((3, 2))))


def test_what_cannot_be_told_is_said(found):
    """The smallest subsets that are collinear are named, and no larger one that holds them."""
    J = np.random.default_rng(0).standard_normal((50, 3))
    J[:, 2] = J[:, 0] + 0.01 * J[:, 1]
    index = {pair: collinearity_index(J[:, list(pair)]) for pair in [*combinations(range(3), 2), (0, 1, 2)]}
    names = ("the diffusivity", "the offset of T1", "the film of the left face")
    left = np.array([np.nan, 0.99, 0.2])
    close = replace(found.identifiability, names=names, collinearity=index, posterior_prior_ratio=left)
    assert close.collinear_subsets == [(0, 2)]
    assert "the diffusivity and the film of the left face cannot be distinguished by the readings alone" in str(close)
    assert "for the offset of T1 the record adds hardly any information to the prior" in str(close)


def test_what_cannot_be_free_is_named():
    case = case_of(LAYERS, LAYERS, noise=0.0)
    with pytest.raises(wallid.InputError, match="free"):
        replace(case, choices=replace(case.choices, free=("moisture",)))
    plain = replace(case.wall, layers=(), diffusivity_prior=1e-6)
    with pytest.raises(wallid.InputError, match="layers"):
        replace(case, wall=plain, choices=replace(case.choices, free=("layers",)))
    loose = replace(case, choices=replace(case.choices, free=("film_right",)))
    with pytest.raises(wallid.InputError, match="weights"):
        wallid.estimate(loose, weights="none")
    with pytest.raises(wallid.InputError, match="all-windows"):
        wallid.campaign(loose)
