"""Writes the packaged examples from the truths in `benchmarks.reference.synthetic_twins`, the same bytes every time.

`python -m benchmarks.reference.make_examples` rewrites src/wallid/examples in place, with `--out DIR` elsewhere.
"""

import argparse
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from benchmarks.reference.synthetic_twins import (
    DAY,
    SLAB_DIFFUSIVITY,
    SLAB_INITIAL,
    SLAB_LENGTH,
    SLAB_OMEGA,
    SLAB_SENSORS,
    SLAB_STEP,
    TWIN_DIFFUSIVITY,
    TWIN_LENGTH,
    TWIN_SENSORS,
    TWIN_STEP,
    noise_free,
    observe,
    saint_julien,
    slab_response,
    solve_wall,
    validation,
    validation_truth,
    weather,
)

# What tests and other benchmarks use.
__all__ = [
    "learning_signals",
    "noise_free",
    "numerical_errors",
    "observe",
    "saint_julien",
    "slab_response",
    "solve_wall",
    "validation",
    "validation_truth",
    "weather",
    "write_examples",
]

EXAMPLES = Path(__file__).resolve().parents[2] / "src" / "wallid" / "examples"

# Chosen before any estimate was made, and kept.
TWIN_SEED = 2009
VALIDATION = {
    "validation": ((0.08,) * 5, 6),
    "validation_high_noise": ((0.94, 0.70, 0.46, 0.30, 0.13), 7),
}
LEARNING = (  # diffusivity (m2/s), column of the left face
    ("2.03e-7", "T_left_1"),
    ("5.21e-7", "T_left_1"),
    ("5.81e-7", "T_left_1"),
    ("5.21e-7", "T_left_2"),
)

PAPER = """\
# J. Berger, B. Kadoch: Estimation of the thermal properties of an historic building wall by combining
# Modal Identification Method and Optimal Experiment Design."""

TWIN_HEAD = f"""\
# SYNTHETIC. Nobody measured these numbers. They are a twin of the old stone house wall at Saint Julien de
# Crempse in
{PAPER}
# We do not have that record, so this one was computed, by benchmarks/reference/make_examples.py, with a solver that
# shares nothing with wallid. The true diffusivity is 1.06e-6 m2/s, the paper's result.
#
# From the paper: the wall's length, the sensors' places, 2670 hourly rows from January to April, the noise
# of 0.1 K, the position uncertainty of 2 cm, the prior diffusivity, the window of three days, the reduced
# model's order and the four diffusivities that it learns from.
# Chosen by us: the weather (random, seed {TWIN_SEED}), the house's heating, and the one effect that a plain
# model does not know: the outer face looks east, its sensor is shielded from the sun, and so the face is
# warmer than the reading, by 0.003 K for each W/m2 of irradiance. The sensors sit exactly where this file
# says.
# x = 0 is inside. The rows are in local standard time (UTC+1) and hold the instant's value.

description = "Synthetic twin of the Saint Julien de Crempse wall (nobody measured these temperatures)"
"""

TWIN_BODY = """
[wall]
length = 0.43
diffusivity_prior = 2.8e-7
conductivity = 1.75             # W/m/K, assumed; only thermal loads need it
outside = "right"

[record]
file = "record.csv"
time = "time"
left = "T_left"
right = "T_right"
irradiance = "irradiance"
boundary_noise_std = 0.1
"""

TWIN_CHOICES = """
[choices]
window_days = 3.0
order = 10
learning_diffusivities = [1e-7, 5e-7, 1e-6, 7e-6]
initial_profile = 2
"""

VALIDATION_HEAD = """\
# SYNTHETIC: the numerical validation case of
{paper}
# A slab of 0.5 m at 20 degC; over 24 h the left face follows 20 + 3 (1 - cos(2 pi t / 12 h)), the right face
# stays at 20 degC. The true diffusivity is 5.21e-7 m2/s.
#
# From the paper: all of the above, the five points, readings at each full hour, the prior diffusivity, the
# order, the 75 nodes, the four learning signals and faces without noise.
# Chosen by us: the truth is the analytic solution (benchmarks/reference/make_examples.py), not a numerical model's,
# and the noise is normal, with a fixed seed.
{noise}
#
# The record has a row every 30 s, as the paper's time step, so that the faces are known as well as there.

description = "{description}"
"""

NOISE_WORDS = {
    "validation": (
        "# The noise, 0.08 K, is about the size of the residuals that the paper reports.",
        "Numerical validation slab (synthetic), noise 0.08 K",
    ),
    "validation_high_noise": (
        "# The noise, 0.94 to 0.13 K, has the standard deviations that the paper's table gives for the\n"
        "# points; its residuals (about 0.08 K) are far smaller, and the example `validation` has those.",
        "Numerical validation slab (synthetic), noise as in the paper's table",
    ),
}

VALIDATION_BODY = """
[wall]
length = 0.5
diffusivity_prior = 2.1e-7

[record]
file = "record.csv"
time = "time"
left = "T_left"
right = "T_right"
boundary_noise_std = 0.001      # the faces are exact; a small number stands for none
"""

VALIDATION_CHOICES = """
[choices]
window_days = 1.0
order = 5
nodes = 75
initial_profile = 0
initial_coefficients = [20.0]   # known: the whole slab starts at 20 degC
"""


def learning_signals() -> dict:
    """The faces of the paper's learning step: `time` (s), `T_left_1`, `T_left_2`, `T_right` (degC), 24 h."""
    time = np.arange(0.0, DAY + SLAB_STEP / 2, SLAB_STEP)
    return {
        "time": time,
        "T_left_1": SLAB_INITIAL + 5 * np.sin(2 * np.pi * time / DAY),
        "T_left_2": SLAB_INITIAL + 20 * np.sin(6 * np.pi * time / DAY),
        "T_right": np.full_like(time, SLAB_INITIAL),
    }


def _number(value: float, decimals: int) -> str:
    """A fixed number of decimals, empty where missing, and never "-0.000"."""
    return "" if np.isnan(value) else f"{round(float(value), decimals) + 0.0:.{decimals}f}"


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(text.encode("utf-8"))  # bytes: the same line ends on every system


def _write_csv(path: Path, time: list[str], columns: dict, decimals: dict) -> None:
    """One row a time; `decimals` by column, far above round-off so that LAPACK's last digits do not show."""
    texts = [[_number(value, decimals[name]) for value in column] for name, column in columns.items()]
    rows = [",".join(("time", *columns)), *(",".join(row) for row in zip(time, *texts, strict=True))]
    _write(path, "\n".join(rows) + "\n")


def _sensors(positions: dict, noise_std, position_std: float) -> str:
    entries = [
        f'\n[[sensor]]\nname = "{name}"\nposition = {position}\nposition_std = {position_std}\nnoise_std = {std}\n'
        for (name, position), std in zip(positions.items(), noise_std, strict=True)
    ]
    return "".join(entries)


def _learning() -> str:
    head = '\n[learning]\nfile = "learning.csv"\ntime = "time"\ninitial_coefficients = [20.0]\n'
    entries = [
        f'\n[[learning.signal]]\ndiffusivity = {diffusivity}\nleft = "{left}"\nright = "T_right"\n'
        for diffusivity, left in LEARNING
    ]
    return head + "".join(entries)


def _write_twin(folder: Path) -> None:
    record = saint_julien(TWIN_SEED)
    names = ("T_left", "T_right", *TWIN_SENSORS, "irradiance")
    decimals = dict.fromkeys(names, 3) | {"irradiance": 1}
    times = [str(time) for time in record["time"]]
    _write_csv(folder / "record.csv", times, {name: record[name] for name in names}, decimals)
    sensors = _sensors(TWIN_SENSORS, [0.1] * len(TWIN_SENSORS), 0.02)
    _write(folder / "case.toml", TWIN_HEAD + TWIN_BODY + sensors + TWIN_CHOICES)


def _write_validation(folder: Path, noise_std, seed: int) -> None:
    record = validation(noise_std, seed)
    times = [f"{time:.0f}" for time in record["time"]]
    names = ("T_left", "T_right", *SLAB_SENSORS)
    _write_csv(folder / "record.csv", times, {name: record[name] for name in names}, dict.fromkeys(names, 5))
    learning = learning_signals()
    del learning["time"]
    _write_csv(folder / "learning.csv", times, learning, dict.fromkeys(learning, 5))
    noise, description = NOISE_WORDS[folder.name]
    head = VALIDATION_HEAD.format(paper=PAPER, noise=noise, description=description)
    sensors = _sensors(SLAB_SENSORS, noise_std, 0.0)
    _write(folder / "case.toml", head + VALIDATION_BODY + sensors + _learning() + VALIDATION_CHOICES)


def write_examples(out: Path = EXAMPLES) -> None:
    """Writes every example into its folder under `out`."""
    _write_twin(out / "saint_julien")
    for name, (noise_std, seed) in VALIDATION.items():
        _write_validation(out / name, noise_std, seed)


def numerical_errors(seed: int = 2009, days: float = 10.0) -> dict:
    """Largest differences (K) between independent ways to the same truth.

    Measured with the defaults: `slab` 1.5e-5 K (the finite volumes' own error, 480 cells and 10 s);
    `slab_slope` 5e-9; `twin_refined` 9e-5 K; `twin_bdf` 8e-5 K. With a quarter of width and step the twin
    moves by 1.1e-4 K from what the examples hold, nearly all at T3 and from the time step: a tenth of the
    last digit written.

    **Arguments:** `seed`: of the twin's weather; `days`: how long the BDF run is.

    **Returns:** `slab` (analytic against finite volumes), `slab_slope` (derivative against a central
    difference, over its largest value), `twin_refined` (half the cells' width, half the step), `twin_bdf`.
    """
    t = np.arange(0.0, DAY + 5, 10.0)
    left = SLAB_INITIAL + 3 * (1 - np.cos(SLAB_OMEGA * t))
    points = list(SLAB_SENSORS.values())
    numeric = solve_wall(
        t, left, np.full_like(t, SLAB_INITIAL),
        length=SLAB_LENGTH, diffusivity=SLAB_DIFFUSIVITY, sensors=points, cells=480,
    )  # fmt: skip
    exact, slope = validation_truth(t)
    small = 1e-4 * SLAB_DIFFUSIVITY
    above, below = (validation_truth(t, SLAB_DIFFUSIVITY + sign * small)[0] for sign in (1, -1))
    slope_error = np.abs((above - below) / (2 * small) - slope).max() / np.abs(slope).max()

    wall = {"length": TWIN_LENGTH, "diffusivity": TWIN_DIFFUSIVITY, "sensors": list(TWIN_SENSORS.values())}
    coarse, fine = weather(seed), weather(seed, step=TWIN_STEP / 2)
    runs = [
        solve_wall(w["time"], w["T_left"], w["T_right"] + 0.003 * w["irradiance"], cells=cells, **wall)
        for w, cells in ((coarse, 240), (fine, 480))
    ]
    span = coarse["time"] <= coarse["time"][0] + days * DAY
    return {
        "slab": np.abs(numeric - exact).max(),
        "slab_slope": slope_error,
        "twin_refined": np.abs(runs[0] - runs[1][::2]).max(),
        "twin_bdf": np.abs(runs[0][span] - _solve_bdf(coarse, span, **wall)).max(),
    }


def _solve_bdf(drive, span, *, length, diffusivity, sensors, nodes=301):
    """The twin once more: nodes at equal distances, SciPy's BDF, cubic splines through the faces."""
    t, x = drive["time"][span], np.linspace(0, length, nodes)
    left = CubicSpline(t, drive["T_left"][span])
    right = CubicSpline(t, (drive["T_right"] + 0.003 * drive["irradiance"])[span])
    speed = diffusivity / (x[1] - x[0]) ** 2
    matrix = speed * (np.eye(nodes - 2, k=1) + np.eye(nodes - 2, k=-1) - 2 * np.eye(nodes - 2))

    def rate(s, inner):
        full = np.concatenate([[left(s)], inner, [right(s)]])
        return speed * (full[2:] - 2 * full[1:-1] + full[:-2])

    start = left(t[0]) + (right(t[0]) - left(t[0])) * x[1:-1] / length
    run = solve_ivp(
        rate, (t[0], t[-1]), start, method="BDF", t_eval=t, jac=matrix, rtol=1e-8, atol=1e-8, max_step=600.0
    )
    profile = np.vstack([left(t), run.y, right(t)])
    return CubicSpline(x, profile)(sensors).T


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Write the packaged examples.")
    parser.add_argument("--out", type=Path, default=EXAMPLES, help="folder (default: src/wallid/examples)")
    write_examples(parser.parse_args().out)
