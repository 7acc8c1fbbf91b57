"""The figures of the method, measured on this machine: `python -m benchmarks.accuracy.method` prints a table.

What a test asserts is measured here again in numbers, with the timings that tests do not hold. The
truths come from `benchmarks.reference.synthetic_twins` and from SciPy.
"""

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator

import jax
import jax.numpy as jnp
import numpy as np

import wallid
from benchmarks.reference.example_cases import saint_julien_case, validation_case
from benchmarks.reference.integrators import by_lsim
from benchmarks.reference.make_examples import slab_response
from benchmarks.speed.works.learn import eps_inf
from wallid.inference.weighted_least_squares import fit_weighted_least_squares
from wallid.reduction.modal_identification import learn_system

DAY = 86400.0
Row = tuple[str, str, str]


def seconds(work: Callable) -> float:
    """Wall clock of one call."""
    began = time.perf_counter()
    jax.block_until_ready(work())
    return time.perf_counter() - began


def exact_against_lsim(case: wallid.Case) -> Row:
    """Field and sensitivity of the validation case."""
    outputs = [wallid.models.Output(sensor.position) for sensor in case.sensors]
    nodal = wallid.models.finite_volume_model(case.wall, outputs, nodes=75, profile_degree=0)
    data = wallid.models.window_data(case)
    fo = wallid.case.scales(case).fourier_number(5.21e-7)
    want = by_lsim(nodal, *(np.asarray(part) for part in (data.time, data.inputs, data.initial)))(fo)
    u, theta = wallid.models.explicit(nodal.modal(), fo, data)
    worst = max(np.abs(u - want[0]).max(), np.abs(theta - want[1]).max())
    return "exact solver against `scipy.signal.lsim`, field and sensitivity", "1e-10", f"{worst:.1e}"


def orders_in_space() -> Iterator[Row]:
    """Observed orders over four refinements."""
    t = np.arange(0, 43201, 5.0)
    omega, alpha = 4 * np.pi / DAY, 5.21e-7
    wall = wallid.Wall(length=0.5, diffusivity_prior=alpha)
    face = np.stack([np.sin(omega * t), 0 * t], axis=1)
    places = {"on nodes": (0.1, 0.25, 0.4), "between nodes": (0.0137, 0.1113, 0.2719, 0.4877)}
    for name, points in places.items():
        want, _ = slab_response(np.array(points), t, length=0.5, diffusivity=alpha, harmonics=((omega, 0.0, 1.0),))
        errors = []
        for nodes in (21, 41, 81, 161, 321):
            system = wallid.models.finite_volume_model(
                wall, [wallid.models.Output(x) for x in points], nodes=nodes, profile_degree=0
            ).modal()
            u, _ = wallid.models.propagate(system, DAY * alpha / 0.25, 5 / DAY, face, jnp.zeros(1))
            errors.append(np.abs(u - want).max())
        found = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
        target = "2.0 ± 0.1" if name == "on nodes" else ">= 1.9"
        yield f"order in space, sensors {name}", target, ", ".join(f"{order:.2f}" for order in found)


def reduced_model(case: wallid.Case) -> Iterator[Row]:
    """Errors over 50 diffusivities, and what learning costs."""
    large, signals = (
        wallid.full_order_model(case),
        wallid.reduction.training_signals(case, wallid.Window(0, case.record.rows)),
    )
    first = seconds(lambda: learn_system(large, 5, signals).system)
    warm = float(np.median([seconds(lambda: learn_system(large, 5, signals).system) for _ in range(5)]))
    yield "learning, order 5, first call and warm", "10 s, 1 s", f"{first:.1f} s, {warm:.2f} s"
    targets = {
        ("learned face signal", ""): {5: (3e-4, 8e-3), 10: (5e-6, 2e-4)},
        ("face signal never learned", ", never learned"): {5: (3e-4, 1.3e-2), 10: (None, None)},
    }
    for order in (5, 10):
        errors = eps_inf(learn_system(large, order, signals).system)
        for (name, which), asked in targets.items():
            wanted = " and ".join("-" if target is None else f"{target:.1e}" for target in asked[order])
            found = f"{errors['u' + which]:.1e} and {errors['theta' + which]:.1e}"
            yield f"MIM {order}, {name}: eps_inf of u and theta", wanted, found


def validation_estimates(case: wallid.Case) -> Iterator[Row]:
    """50 noise seeds, 50 starts, iterations."""
    large, rom = wallid.full_order_model(case), wallid.learn(case, wallid.Window(0, case.record.rows))
    per_alpha, prior = jnp.asarray(wallid.case.scales(case).fourier_number(1.0)), jnp.asarray(2.1e-7)
    rows = []
    for seed in range(50):
        data = wallid.models.window_data(validation_case(case, seed))
        fits = [fit_weighted_least_squares(s, data, per_alpha, prior, jnp.asarray(1e-12)) for s in (rom.system, large)]
        rows.append([(float(fit.parameters[0]), 1 / np.linalg.norm(fit.jacobian)) for fit in fits])
    found = np.array(rows)
    apart = np.abs(np.expm1(found[:, 0, 0] - found[:, 1, 0])).max()
    pulls = (found[:, :, 0] + np.log(2.1e-7 / 5.21e-7)) / found[:, :, 1]
    yield "validation, 50 noise seeds: MIM 5 against LOM", "0.3 %", f"{apart:.3%} at most"
    means = ", ".join(f"{pull:+.2f}" for pull in pulls.mean(axis=0))
    yield "the same, mean error in standard errors (MIM, LOM)", "within 3/sqrt(50) = 0.42", means
    data = wallid.models.window_data(case)
    eta, values = jnp.asarray(1e-14), []
    for start in np.geomspace(1e-8, 1e-5, 50):
        fit = fit_weighted_least_squares(rom.system, data, per_alpha, jnp.asarray(start), eta)
        values.append(start * float(jnp.exp(fit.parameters[0])))
    yield "the same from 50 starts, 1e-8 to 1e-5: spread", "1e-8", f"{np.ptp(values) / np.mean(values):.1e}"
    yield "steps until one is under 1e-8, validation", "<= 10", steps(wallid.estimate(case, None, rom, eta=1e-14))


def steps(fit: wallid.Estimate) -> str:
    """Gauss-Newton steps until the relative change of alpha is under 1e-8."""
    return str(int(np.flatnonzero(fit.history["gamma_2"] < 1e-8)[0]))


def case_study() -> Iterator[Row]:
    """Orders against the large model, the demo's estimate, and the twin without sun."""
    case = wallid.load("saint_julien")
    window = wallid.design(case)
    large = wallid.estimate(case, window, wallid.full_order_model(case))
    roms = {order: wallid.learn(case, window, order) for order in range(7, 21)}
    apart = {order: wallid.estimate(case, window, rom).value / large.value - 1 for order, rom in roms.items()}
    worst = max(apart, key=lambda order: abs(apart[order]))
    yield "case study, MIM orders 7 to 20 against LOM", "0.5 %", f"{abs(apart[worst]):.4%} at most (order {worst})"
    fit = wallid.estimate(case, window, roms[10], eta=1e-14)
    yield "steps until one is under 1e-8, demo", "<= 10", steps(fit)
    yield "demo, sun unmodelled: error of the estimate", "15 %", f"{fit.value / 1.06e-6 - 1:+.1%}"
    errors = []
    for noise_seed in range(20):
        calm = saint_julien_case(case, 2009, sun=0.0, noise_seed=noise_seed)
        errors.append(wallid.estimate(calm, wallid.design(calm), wallid.full_order_model(calm)).value / 1.06e-6 - 1)
    yield (
        "the same twin without sun, 20 noise seeds: mean, largest",
        "1 %, 4 %",
        (f"{np.mean(errors):+.2%}, {np.abs(errors).max():.1%}"),
    )


def demo() -> Row:
    """Wall clock of `wallid demo` in a fresh process."""
    with tempfile.TemporaryDirectory() as out:
        command = [sys.executable, "-m", "wallid", "demo", "--quiet", "--out", out]
        taken = [seconds(lambda: subprocess.run(command, check=True)) for _ in range(3)]
    return "`wallid demo`, fresh process, wall clock", "60 s", f"{np.median(taken):.0f} s"


def main() -> None:
    """Print every row as it is measured."""
    jax.config.update("jax_enable_x64", True)
    case = wallid.load("validation")
    print("| what | wanted | measured |\n|---|---|---|")

    def rows() -> Iterator[Row]:
        yield exact_against_lsim(case)
        yield from orders_in_space()
        yield from reduced_model(case)
        yield from validation_estimates(case)
        yield from case_study()
        yield demo()

    for row in rows():
        print(f"| {' | '.join(row)} |", flush=True)


if __name__ == "__main__":
    main()
