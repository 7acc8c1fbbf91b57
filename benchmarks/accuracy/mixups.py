"""How often `wallid.diagnose` names what was mixed up: `python -m benchmarks.accuracy.mixups` prints the table.

Walls and weather are those of the discrepancy benchmark, of nulls; the mistake is then made in the loaded case, as a
person would make it. What counts is the first mix-up that the diagnosis names: its kind and its columns.
"""

import argparse
import tempfile
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmarks.accuracy.discrepancy.scenarios import NOISES, nulls
from benchmarks.reference.simulator_with_effects import FINE_STEP, spin_up, temperatures, weather, write_case

Answer = tuple[str, frozenset[str]]
CONDUCTIVITY, PLATE_NOISE = 0.8, 1.0  # W/(m K), W/m2


def faces(case, rng):
    return _with(case, faces=case.record.faces[:, ::-1]), {("faces", frozenset()), ("mirrored", frozenset())}


def mirrored(case, rng):
    sensors = tuple(replace(one, position=case.wall.length - one.position) for one in case.sensors)
    return replace(case, sensors=sensors), {("faces", frozenset()), ("mirrored", frozenset())}


def order(case, rng):
    names = frozenset(case.record.names)
    right = {("order", names)} | ({("exchanged", names)} if len(names) == 2 else set())
    if len(names) == 3:  # the one in the middle stays
        right.add(("exchanged", frozenset(case.record.names[::2])))
    return _with(case, sensors=case.record.sensors[:, ::-1]), right


def exchanged(case, rng):
    one, other = rng.choice(len(case.sensors), 2, replace=False)
    sensors = case.record.sensors.copy()
    sensors[:, [one, other]] = sensors[:, [other, one]]
    names = frozenset(case.record.names[k] for k in (one, other))
    right = {("exchanged", names)}
    if len(case.sensors) == 2 or (len(case.sensors) == 3 and abs(one - other) == 2):
        right.add(("order", frozenset(case.record.names)))
    return _with(case, sensors=sensors), right


def copy(case, rng):
    one, other = rng.choice(len(case.sensors), 2, replace=False)
    sensors = case.record.sensors.copy()
    sensors[:, one] = sensors[:, other]
    return _with(case, sensors=sensors), {("copy", frozenset(case.record.names[k] for k in (one, other)))}


def unit(case, rng):
    return _changed_column(case, rng, lambda values: 32 + 1.8 * values, "unit")


def clock(case, rng):
    rows = round(3600.0 * int(rng.choice([-2, -1, 1, 2])) / case.record.step)
    return _changed_column(case, rng, lambda values: _rolled(values, rows), "clock")


def clock_from_a_row_on(case, rng):
    start, rows = rng.randint(case.record.rows // 4, 3 * case.record.rows // 4), round(3600.0 / case.record.step)

    def late(values):
        return np.concatenate([values[:start], _rolled(values, rows)[start:]])

    return _changed_column(case, rng, late, "clock")


def cm(case, rng):
    return _scaled(case, 100.0)


def mm(case, rng):
    return _scaled(case, 1000.0)


def inches(case, rng):
    return _scaled(case, 1 / 0.0254)


def feet(case, rng):
    return _scaled(case, 1 / 0.3048)


def step(case, rng):
    """Times at half or twice their speed: the day has 12 or 48 hours."""
    record, factor = case.record, float(rng.choice([0.5, 2.0]))
    stamps = record.stamps[0] + (record.stamps - record.stamps[0]) * factor
    return _with(case, time=record.time * factor, stamps=stamps), {("clock", frozenset())}


def flux_sign(case, rng):
    """A plate on one face that was wired or placed the other way round."""
    key = str(rng.choice(["flux_left", "flux_right"]))
    fluxes = case.record.regressors | {key: -case.record.regressors[key]}
    return _with(case, regressors=fluxes), {("flux_sign", frozenset([key]))}


MISTAKES: dict[str, Callable] = {
    one.__name__: one
    for one in (
        faces,
        mirrored,
        order,
        exchanged,
        copy,
        unit,
        clock,
        clock_from_a_row_on,
        cm,
        mm,
        inches,
        feet,
        step,
        flux_sign,
    )
}


def _with(case, **changes):
    return replace(case, record=replace(case.record, **changes))


def _rolled(values, rows):
    """A column whose value at each row is that of some rows before."""
    return np.interp(np.arange(len(values)) - rows, np.arange(len(values)), values)


def _changed_column(case, rng, change, kind):
    """One column changed, a face or a sensor."""
    count, k = len(case.sensors), int(rng.randint(2 + len(case.sensors)))
    if k < count:
        sensors = case.record.sensors.copy()
        sensors[:, k] = change(sensors[:, k])
        return _with(case, sensors=sensors), {(kind, frozenset([case.record.names[k]]))}
    both = case.record.faces.copy()
    both[:, k - count] = change(both[:, k - count])
    return _with(case, faces=both), {(kind, frozenset([("left face", "right face")[k - count]]))}


def with_plates(case, spec, rng):
    """The case with a heat flux plate on each face, from the gradient in the last millimetre of the true wall."""
    drive, near = weather(spec, spin_up(spec)), 1e-3
    inside = temperatures(spec, drive, [near, spec.length - near])
    rows = round(-drive["time"][0] / FINE_STEP) + np.arange(spec.rows) * round(spec.step / FINE_STEP)
    gradients = {"flux_left": drive["left"] - inside[:, 0], "flux_right": inside[:, 1] - drive["right"]}
    fluxes = {
        key: CONDUCTIVITY * gradient[rows] / near + PLATE_NOISE * rng.standard_normal(spec.rows)
        for key, gradient in gradients.items()
    }
    return _with(case, regressors=case.record.regressors | fluxes)


def _scaled(case, factor):
    wall = replace(case.wall, length=factor * case.wall.length)
    sensors = tuple(
        replace(one, position=factor * one.position, position_std=factor * one.position_std) for one in case.sensors
    )
    return replace(case, wall=wall, sensors=sensors), {("length_unit", frozenset())}


def one(name: str, number: int, seed: int) -> tuple[bool, str]:
    """Whether the first mix-up named is the right one, and what was said."""
    import wallid

    spec = nulls(NOISES[number % len(NOISES)], number + 1, seed)[number]
    with tempfile.TemporaryDirectory() as folder:
        write_case(spec, folder)
        case = wallid.load(folder)
    rng = np.random.RandomState([seed, number, list(MISTAKES).index(name)])
    if name == "flux_sign":
        case = with_plates(case, spec, rng)
    wrong, right = MISTAKES[name](case, rng)
    found = wallid.diagnose(wrong)
    said = [(mixup.kind, frozenset(mixup.targets)) for mixup in found.mixups]
    right_kinds = {kind for kind, targets in right if not targets}
    hit = bool(said) and (said[0] in right or said[0][0] in right_kinds)
    first = found.mixups[0].words if found.mixups else found.sentence
    return hit, f"{found.verdict}: {first}"


def main() -> None:
    """Print a line for each record, then the rates."""
    import jax

    jax.config.update("jax_enable_x64", True)
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--walls", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1027)
    parser.add_argument("--kinds", nargs="+", choices=list(MISTAKES), default=list(MISTAKES))
    given = parser.parse_args()
    rates = {}
    for name in given.kinds:
        hits = []
        for number in range(given.walls):
            hit, said = one(name, number, given.seed)
            hits.append(hit)
            print(f"{name:20} {number:3} {'right' if hit else 'WRONG'}  {said[:150]}", flush=True)
        rates[name] = sum(hits)
    for name, hits in rates.items():
        print(f"| {name.replace('_', ' ')} | {hits} of {given.walls} |")


if __name__ == "__main__":
    main()
