"""A homogeneous slab between two faces that are straight lines between rows, by its sine series: no part of wallid.

    T(x, t) = left (1 - x/L) + right x/L + sum_n b_n(t) sin(n pi x/L)
    b_n' = -lambda_n b_n - 2/(n pi) (left' - (-1)^n right'),      lambda_n = alpha (n pi / L)^2

exact in time for faces that are straight lines between rows (H. S. Carslaw, J. C. Jaeger, Conduction of Heat in
Solids, 1959, 3.3 and 3.5).
"""

import numpy as np
from scipy.integrate import simpson
from scipy.interpolate import PchipInterpolator
from scipy.signal import lfilter

MODES = 80


def _courses(faces: np.ndarray, step: float, rate: np.ndarray) -> np.ndarray:
    """b_n at the rows, from rest at the faces' first values, `(mode, time)`."""
    n = np.arange(1, len(rate) + 1)
    slope = np.diff(faces, axis=0, prepend=faces[:1]) / step
    drive = -2.0 / (n[:, None] * np.pi) * (slope[:, 0] - (-1.0) ** n[:, None] * slope[:, 1])
    decay = np.exp(-rate * step)
    gain = -np.expm1(-rate * step) / rate
    return np.stack([lfilter([g], [1.0, -e], d) for g, e, d in zip(gain, decay, drive, strict=True)])


def temperatures(faces: np.ndarray, step: float, places: np.ndarray, diffusivity: float) -> np.ndarray:
    """Temperatures at places (over L, 1) at the rows, `(time, place)`; `diffusivity` over L^2, 1/s."""
    n = np.arange(1, MODES + 1)
    b = _courses(faces, step, diffusivity * (n * np.pi) ** 2)
    steady = faces[:, :1] * (1 - places) + faces[:, 1:] * places
    return steady + b.T @ np.sin(np.pi * np.outer(n, places))


def fluxes(faces: np.ndarray, step: float, diffusivity: float) -> np.ndarray:
    """`-dT/d(x/L)` at both faces at the rows, `(time, 2)`; `diffusivity` over L^2, 1/s.

    The series converges slowly at a face; the modes beyond `MODES` follow the faces at once:
    `b_n = -2/(n pi) (left' - (-1)^n right') / lambda_n`, whose sums are those of `1/n^2`.
    """
    n = np.arange(1, MODES + 1)
    b = _courses(faces, step, diffusivity * (n * np.pi) ** 2)
    slope = np.diff(faces, axis=0, prepend=faces[:1]) / step
    rest = np.pi**2 / 6 - np.sum(1.0 / n**2), -(np.pi**2) / 12 - np.sum((-1.0) ** n / n**2)
    tail = 2.0 / (np.pi**2 * diffusivity)
    inner = n * np.pi * b.T
    change = faces[:, 0] - faces[:, 1]
    left = change - inner.sum(axis=1) + tail * (slope[:, 0] * rest[0] - slope[:, 1] * rest[1])
    right = change - (inner * (-1.0) ** n).sum(axis=1) + tail * (slope[:, 0] * rest[1] - slope[:, 1] * rest[0])
    return np.stack([left, right], axis=1)


def random_process(count: int, step: float, memory: float, rng: np.random.Generator) -> np.ndarray:
    """An Ornstein-Uhlenbeck process of variance 1 at equal times.

    Args:
        step: between them, s. memory: its time constant, h.
    """
    keep = np.exp(-step / 3600.0 / memory)
    draws = rng.standard_normal(count)
    draws[0] /= np.sqrt(1.0 - keep**2)
    return lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], draws)


def driven_modes(rate: np.ndarray, drive: np.ndarray, step: float) -> np.ndarray:
    """`b' = -rate b + drive` of each mode from rest, for a drive that is straight lines between rows: exact.

    Args:
        rate: 1/s, `(mode,)`. drive: at the rows, `(mode, time)`. step: between rows, s.
    """
    z = rate * step
    at_end = (z + np.expm1(-z)) / (rate * z)  # of the value at the end of a row, and at its start
    at_start = (-np.expm1(-z) - z * np.exp(-z)) / (rate * z)
    each = zip(drive, at_end, at_start, z, strict=True)
    return np.stack([lfilter([e, a], [1.0, -np.exp(-one)], own) for own, e, a, one in each])


def heated(heat: np.ndarray, step: float, profile: np.ndarray, diffusivity: float, places: np.ndarray) -> tuple:
    """The change of temperatures and of `-dT/d(x/L)` at both faces by heat released inside, faces held.

        b_n' = -lambda_n b_n + p_n g,      p_n = 2 int p(x) sin(n pi x) dx

    exact for a `g` that is straight lines between rows. Modes beyond `MODES` follow the heat at once.

    Args:
        heat: g at the rows, K/s, `(time,)`, from rest at the first row.
        profile: p at equal distances from x = 0 to L, `(point,)`: the temperature's rate is `g p(x)`.
        diffusivity: over L^2, 1/s. places: over L.

    Returns:
        `(time, place)` and `(time, 2)`.
    """
    n = np.arange(1, MODES + 1)
    x = np.linspace(0.0, 1.0, len(profile))
    p_n = 2.0 * simpson(profile * np.sin(np.pi * np.outer(n, x)), x=x)
    rate = diffusivity * (n * np.pi) ** 2
    b = driven_modes(rate, p_n[:, None] * heat, step)
    steady = np.array([-simpson((1.0 - x) * profile, x=x), simpson(x * profile, x=x)]) / diffusivity
    of_modes = np.stack([-n * np.pi, -n * np.pi * (-1.0) ** n], axis=1)
    tail = steady - (p_n / rate) @ of_modes
    return b.T @ np.sin(np.pi * np.outer(n, places)), b.T @ of_modes + heat[:, None] * tail


def refined(faces: np.ndarray, parts: int, rows: np.ndarray | None = None) -> np.ndarray:
    """Faces as monotone cubics between their rows, in `parts` steps a row from the first to the last; by SciPy.

    Args:
        faces: `(time, 2)`.
        rows: at which they are; None for 0, 1, 2, ..
    """
    rows = np.arange(len(faces)) if rows is None else rows
    fine = np.arange((rows[-1] - rows[0]) * parts + 1) / parts + rows[0]
    return PchipInterpolator(rows, faces)(fine)


def weather(rows: int, step: float, rng: np.random.Generator, hours: tuple[float, ...] = (8.0,)) -> np.ndarray:
    """Faces of a wall between a heated room and some weather, degC, `(time, 2)`: left indoors.

    Args:
        hours: time constants over which white noise is smoothed, one after the other. With two of them the slopes do
            not jump, so that hourly rows nearly determine what is between.
    """
    days = np.arange(rows) * step / 86400.0
    poles = np.exp(-step / (3600.0 * np.array(hours)))
    slow = lfilter([1.0], np.poly(poles), rng.standard_normal((2, rows)), axis=1) * np.sqrt(_variance_gain(poles))
    phase = rng.uniform(-0.1, 0.1)
    right = 6.0 + 3.0 * np.sin(2 * np.pi * (days - 0.4 + phase)) + 1.0 * slow[0]
    left = 19.0 + 0.8 * np.sin(2 * np.pi * (days - 0.3)) + 0.4 * slow[1]
    return np.stack([left, right], axis=1)


def _variance_gain(poles: np.ndarray) -> float:
    """One over the variance of white noise after these one or two first-order filters."""
    first, second = (*poles, 0.0)[:2]
    return (1 - first**2) * (1 - second**2) * (1 - first * second) / (1 + first * second)
