"""Whether `wallid run` says so where its number cannot be relied on: `python -m benchmarks.accuracy.sure_and_wrong`.

- `eight`: eight mistakes and effects with which a run once gave a wrong diffusivity with a small interval and status 0.
- `clear`: records with one hidden effect whose squared signal-to-noise is 400 or more.
- `nulls`: records with nothing hidden.
- `contrast`: a wall whose second half conducts 30 % less.
- `shared`: two weeks of hours with 0.03 K of noise that all channels have in common and 0.006 K of their own, by `run`
  and by `diagnose`: nothing is missing.

Walls, weather and effects are those of the discrepancy benchmark (a simulator that shares nothing with wallid). A word
is a reason in the run's verdict, which is status 1, or an advice; where the diffusivity is wrong by more than its
interval and nothing was said, the run was sure and wrong. Each record's outcome goes to a log of JSON lines, so that a
long run goes on where it ended.
"""

import argparse
import json
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.ndimage import uniform_filter1d

from benchmarks.accuracy.discrepancy.scenarios import NOISES, identifiability, nulls, singles
from benchmarks.reference.simulator_with_effects import EFFECTS, Hidden, Spec, write_case

SEED = 1031  # of the scoring seeds; fixed before the first record was tried
CLEAR = 400.0
BASE = Spec(length=0.3, diffusivity=8e-7, positions=(0.06, 0.15, 0.24), days=14.0, weather_seed=SEED, noise_seed=SEED)


def _with(case, **changes):
    return replace(case, record=replace(case.record, **changes))


def _scaled(case, factor):
    sensors = tuple(
        replace(one, position=factor * one.position, position_std=factor * one.position_std) for one in case.sensors
    )
    return replace(case, wall=replace(case.wall, length=factor * case.wall.length), sensors=sensors)


def _gain(case):
    readings = case.record.sensors.copy()
    readings[:, 1] = readings[:, 1].mean() + 0.8 * (readings[:, 1] - readings[:, 1].mean())
    return _with(case, sensors=readings)


def _hour_late(case):
    readings = case.record.sensors.copy()
    late = round(3600.0 / case.record.step)
    readings[late:, 0] = readings[:-late, 0].copy()
    return _with(case, sensors=readings)


def _smoothed_face(case):
    faces = case.record.faces.copy()
    faces[:, 0] = uniform_filter1d(faces[:, 0], round(4 * 3600.0 / case.record.step), mode="nearest")
    return _with(case, faces=faces)


def _exchanged(case):
    return _with(case, sensors=case.record.sensors[:, [1, 0, 2]])


def _half_step(case):
    time = case.record.time / 2.0
    return _with(case, time=time, stamps=time)


EIGHT: dict[str, tuple[Spec, Callable]] = {
    "gain 0.8": (BASE, _gain),
    "half the wall conducts 30 % less": (
        replace(BASE, effects=(Hidden("layered_conductivity", None, {"log_ratio": np.log(0.7), "interface": 0.15}),)),
        lambda case: case,
    ),
    "a column an hour late": (BASE, _hour_late),
    "a face smoothed over four hours": (BASE, _smoothed_face),
    "two sensors exchanged": (BASE, _exchanged),
    "the sun on a shielded face": (
        replace(BASE, effects=(Hidden("solar_gain", "left", {"gain": 0.004}),)),
        lambda case: case,
    ),
    "lengths in feet": (BASE, lambda case: _scaled(case, 1 / 0.3048)),
    "times that run twice as fast": (BASE, _half_step),
}


def contrast(number: int) -> Spec:
    """A wall of 30 % contrast in weather of its own."""
    effect = Hidden("layered_conductivity", None, {"log_ratio": float(np.log(0.7)), "interface": 0.15})
    return replace(BASE, weather_seed=SEED + number, noise_seed=SEED + number, effects=(effect,))


def clear(count: int) -> Iterator[Spec]:
    """Records with one effect that is clear, the effects in turn."""
    drawn = [singles(name, 4 * count // len(EFFECTS) + 8, SEED) for name in EFFECTS]
    found = 0
    for specs in zip(*drawn, strict=True):
        for spec in specs:
            if found < count and identifiability(spec)["free"] >= CLEAR:
                found += 1
                yield spec


def outcome(spec: Spec, change: Callable = lambda case: case) -> dict:
    """The value, the interval and the words of a run, and the truth."""
    import wallid
    from wallid import workflow

    with tempfile.TemporaryDirectory() as folder:
        truth = write_case(spec, folder)["truth"]["diffusivity"]
        case = wallid.load(folder)
    case = change(replace(case, choices=replace(case.choices, model="lom")))
    result = workflow.run(case, stages=("design", "estimate", "screening"))
    low, high = result.fit.interval_95
    return {
        "truth": truth, "value": result.fit.value, "low": low, "high": high,
        "word": result.unreliable_reason, "of_window": result.fit.reason, "advice": list(result.fit.advice),
    }  # fmt: skip


def shared(number: int) -> dict:
    """What a run and a diagnosis say of a record whose noise is common to all channels."""
    import wallid

    spec = replace(BASE, weather_seed=SEED + number, noise_seed=SEED + number, position_std=0.001)
    quiet = replace(spec, noise_std=0.006, boundary_noise_std=0.006, rounding=0.0)

    def with_common(case):
        common = 0.03 * np.random.RandomState([SEED, number, 4]).standard_normal((case.record.rows, 1))
        faces, sensors = case.record.faces + common, case.record.sensors + common
        noise = float(np.hypot(0.03, 0.006))
        stated = tuple(replace(sensor, noise_std=noise) for sensor in case.sensors)
        return replace(_with(case, faces=faces, sensors=sensors, boundary_noise_std=noise), sensors=stated)

    line = outcome(quiet, with_common)
    with tempfile.TemporaryDirectory() as folder:
        write_case(quiet, folder)
        found = wallid.diagnose(with_common(wallid.load(folder)))
    low, high = found.to_dict()["diffusivity"]["interval_95"]
    return line | {"verdict": found.verdict, "diagnosed_low": low, "diagnosed_high": high}


def jobs(families: list[str], counts: dict[str, int]) -> Iterator[tuple[str, Callable[[], dict]]]:
    """A key and the work of each record."""
    if "eight" in families:
        for name, (spec, change) in EIGHT.items():
            yield f"eight/{name}", lambda spec=spec, change=change: outcome(spec, change)
    if "contrast" in families:
        for k in range(counts["contrast"]):
            yield f"contrast/{k}", lambda k=k: outcome(contrast(k))
    if "shared" in families:
        for k in range(counts["shared"]):
            yield f"shared/{k}", lambda k=k: shared(k)
    if "nulls" in families:
        for k in range(counts["nulls"]):
            noise = NOISES[k % len(NOISES)]
            yield f"nulls/{k}", lambda noise=noise, k=k: outcome(nulls(noise, k + 1, SEED)[k])
    if "clear" in families:
        for k, spec in enumerate(clear(counts["clear"])):
            yield f"clear/{k}", lambda spec=spec: outcome(spec) | {"effect": spec.effects[0].name}


def table(lines: list[dict]) -> Iterator[str]:
    """The rates of each family, and a line for each of the eight."""
    for line in lines:
        if line["key"].startswith("eight/"):
            said = line["word"] or "; ".join(line["advice"]) or "nothing"
            yield f"{line['key'][6:]}: {'status 1' if line['word'] else 'status 0'}, {said[:160]}"
    yield "| records | count | a word, status 1 | interval holds the truth | sure and wrong |"
    yield "|---|---|---|---|---|"
    for family in ("contrast", "clear", "nulls", "shared"):
        own = [line for line in lines if line["key"].startswith(f"{family}/")]
        if own:
            inside = [line["low"] <= line["truth"] <= line["high"] for line in own]
            words = [bool(line["word"]) for line in own]
            sure = sum(not word and not held for word, held in zip(words, inside, strict=True))
            yield f"| {family} | {len(own)} | {sum(words)} | {sum(inside)} | {sure} |"
    if own := [line for line in lines if "verdict" in line]:
        verdicts = Counter(line["verdict"] for line in own)
        held = sum(line["diagnosed_low"] <= line["truth"] <= line["diagnosed_high"] for line in own)
        yield f"shared noise by diagnose: {dict(verdicts)}, {held} of {len(own)} intervals hold the truth"


def main() -> None:
    """Run and print; see the module."""
    import jax
    from threadpoolctl import threadpool_limits

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    families = ["eight", "contrast", "shared", "nulls", "clear"]
    parser.add_argument("--family", nargs="+", choices=families, default=families)
    parser.add_argument("--contrast", type=int, default=80)
    parser.add_argument("--shared", type=int, default=20)
    parser.add_argument("--clear", type=int, default=200)
    parser.add_argument("--nulls", type=int, default=400)
    parser.add_argument("--log", type=Path, default=Path("wallid-out") / "sure-and-wrong.jsonl")
    given = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    threadpool_limits(limits=1, user_api="blas")
    given.log.parent.mkdir(parents=True, exist_ok=True)
    lines = [json.loads(text) for text in given.log.read_text("utf-8").splitlines()] if given.log.exists() else []
    done = {line["key"] for line in lines}
    counts = {"contrast": given.contrast, "shared": given.shared, "nulls": given.nulls, "clear": given.clear}
    with open(given.log, "a", encoding="utf-8") as file:
        for key, work in jobs(given.family, counts):
            if key not in done:
                lines.append({"key": key} | work())
                file.write(json.dumps(lines[-1]) + "\n")
                file.flush()
    for text in table(lines):
        print(text)


if __name__ == "__main__":
    main()
