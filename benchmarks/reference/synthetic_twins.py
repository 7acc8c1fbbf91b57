"""Walls whose truth is known: an analytic slab, and a synthetic twin of the Saint Julien wall.

Nothing here comes from wallid, so that the package can be judged by it. SI units; temperatures in degC.

The errors of both, and how they were measured: `benchmarks.make_examples.numerical_errors`.
"""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import eigh_tridiagonal
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter
from scipy.special import expit

HOUR, DAY = 3600.0, 86400.0

TWIN_START = np.datetime64("2009-01-01T00:00:00")
TWIN_ROWS = 2670  # hourly
TWIN_LENGTH = 0.43  # m
TWIN_DIFFUSIVITY = 1.06e-6  # m2/s
TWIN_SENSORS = {"T1": 0.05, "T2": 0.23, "T3": 0.40}  # m from the inner face
TWIN_STEP = 150.0  # s, of the solver
TWIN_SPIN_UP = 21 * DAY  # s; the wall forgets with a time constant of 5 h
TWIN_LATITUDE, TWIN_LONGITUDE = 45.0, 0.4  # degrees north, degrees east

SLAB_LENGTH = 0.5  # m
SLAB_DIFFUSIVITY = 5.21e-7  # m2/s
SLAB_INITIAL = 20.0  # degC
SLAB_SENSORS = {"T1": 0.1, "T2": 0.15, "T3": 0.25, "T4": 0.3, "T5": 0.45}  # m
SLAB_STEP = 30.0  # s
SLAB_OMEGA = 2 * np.pi / (12 * HOUR)  # rad/s


def _random(seed: int, stream: int) -> np.random.RandomState:
    """Random numbers for one purpose; RandomState, because NumPy never changes the numbers it gives."""
    return np.random.RandomState([seed, stream])


# ---------------------------------------------------------------------------------- the analytic slab


def slab_response(x, t, *, length, diffusivity, initial=0.0, constant=0.0, harmonics=()):
    r"""Temperature of a homogeneous slab driven at its left face, and its derivative to the diffusivity.

    With $\xi = x/L$, $\lambda_n = \alpha (n \pi / L)^2$, $s_j = L \sqrt{i \omega_j / \alpha}$ and the face
    temperatures $T(0, t) = T_0 + c + \sum_j a_j \cos \omega_j t + b_j \sin \omega_j t$, $T(L, t) = T_0$:

    $$T = T_0 + c (1 - \xi)
      + \mathrm{Re} \sum_j (a_j - i b_j) e^{i \omega_j t} \sinh(s_j (1 - \xi)) / \sinh s_j
      - \sum_n \frac{2}{n \pi} \sin(n \pi \xi) e^{-\lambda_n t}
        \mathrm{Re} \Big[ c + \sum_j (a_j - i b_j) \frac{\lambda_n}{\lambda_n + i \omega_j} \Big]$$

    The periodic part is closed; the transient sum ends where $\lambda_n t > 40$ at the smallest positive
    time, so that what is left out is below $e^{-40}$ (4e-18) of the face's amplitude.

    **Arguments:**

    - `x`: positions, m, shape (sensor,), from 0 to `length`.
    - `t`: times, s, shape (time,), none negative. At t = 0 the initial state is returned, at the face too.
    - `length`: m. `diffusivity`: m2/s. `initial`: T_0, degC. `constant`: c, K.
    - `harmonics`: triples (omega in rad/s, a in K, b in K), omega above 0.

    **Returns:** temperature (degC) and its exact derivative to the diffusivity (K s/m2), each (time, sensor).

    **Raises:** `ValueError` for a negative time.

    Source: H. S. Carslaw, J. C. Jaeger, Conduction of Heat in Solids, 1959, section 3.6.
    """
    xi = np.atleast_1d(np.asarray(x, float))[None, :] / length
    t = np.atleast_1d(np.asarray(t, float))[:, None]
    if np.any(t < 0):
        raise ValueError(f"t must not be negative, got a smallest time of {t.min()} s")
    forcing = [(omega, a - 1j * b) for omega, a, b in harmonics]
    value = constant * (1 - xi) + np.zeros_like(t)
    slope = np.zeros_like(value)
    for omega, amplitude in forcing:
        shape, shape_slope = _periodic_shape(xi, length * np.sqrt(1j * omega / diffusivity), diffusivity)
        turning = amplitude * np.exp(1j * omega * t)
        value += (turning * shape).real
        slope += (turning * shape_slope).real

    later = t[:, 0] > 0
    if later.any():
        rate = diffusivity * (np.pi / length) ** 2
        last = int(np.ceil(np.sqrt(40 / (rate * t[later].min()))))
        for n in range(1, last + 1):
            eigenvalue = rate * n**2
            weight, weight_slope = constant, 0.0
            for omega, amplitude in forcing:
                weight += (amplitude * eigenvalue / (eigenvalue + 1j * omega)).real
                weight_slope += (amplitude * 1j * omega * eigenvalue / (eigenvalue + 1j * omega) ** 2).real
            mode = 2 / (n * np.pi) * np.sin(n * np.pi * xi) * np.exp(-eigenvalue * t)
            value -= weight * mode
            slope -= (weight_slope - weight * eigenvalue * t) * mode / diffusivity
    value[~later], slope[~later] = 0.0, 0.0
    return initial + value, slope


def _periodic_shape(xi, s, diffusivity):
    """sinh(s (1 - xi)) / sinh(s) and its derivative to the diffusivity, ds/dalpha = -s / (2 alpha).

    Written with decaying exponentials only: sinh overflows at high frequencies.
    """
    top, bottom = np.exp(-s * xi) - np.exp(-s * (2 - xi)), 1 - np.exp(-2 * s)
    top_slope = -xi * np.exp(-s * xi) + (2 - xi) * np.exp(-s * (2 - xi))
    slope = (top_slope - top / bottom * 2 * np.exp(-2 * s)) / bottom
    return top / bottom, -slope * s / (2 * diffusivity)


def validation_truth(t, diffusivity=SLAB_DIFFUSIVITY):
    """The validation slab at its five points: T_left = 20 + 3 (1 - cos(2 pi t / 12 h)), T_right = 20 degC.

    **Arguments:** `t`: s, shape (time,); `diffusivity`: m2/s.

    **Returns:** temperature (degC) and derivative to the diffusivity (K s/m2), each (time, sensor).
    """
    return slab_response(
        list(SLAB_SENSORS.values()), t, length=SLAB_LENGTH, diffusivity=diffusivity,
        initial=SLAB_INITIAL, constant=3.0, harmonics=[(SLAB_OMEGA, -3.0, 0.0)],
    )  # fmt: skip


def validation(noise_std: Sequence[float], seed: int) -> dict:
    """Simulated readings of the validation slab over 24 h, a row every 30 s.

    **Arguments:** `noise_std`: K, one for each of the five points; `seed`: of the noise.

    **Returns:** `time` (s), the exact faces `T_left` and `T_right`, the readings `T1` to `T5` (degC; NaN but
    at full hours), and `truth` with `diffusivity` (m2/s), the noise-free `T1` to `T5` at every row and their
    derivatives `dT1` to `dT5` to the diffusivity (K s/m2). Not rounded.

    **Raises:** `ValueError` where `noise_std` has not five entries.
    """
    std = np.asarray(noise_std, float)
    if std.shape != (len(SLAB_SENSORS),):
        raise ValueError(f"noise_std must have {len(SLAB_SENSORS)} entries, got {noise_std!r}")
    time = np.arange(0.0, DAY + SLAB_STEP / 2, SLAB_STEP)
    clean, slope = validation_truth(time)
    hourly = time % HOUR == 0
    noise = std * _random(seed, 2).standard_normal((int(hourly.sum()), std.size))
    readings = np.full_like(clean, np.nan)
    readings[hourly] = clean[hourly] + noise
    left = SLAB_INITIAL + 3 * (1 - np.cos(SLAB_OMEGA * time))
    truth = {"diffusivity": SLAB_DIFFUSIVITY}
    truth |= dict(zip(SLAB_SENSORS, clean.T, strict=True))
    truth |= {f"d{name}": column for name, column in zip(SLAB_SENSORS, slope.T, strict=True)}
    record = {"time": time, "T_left": left, "T_right": np.full_like(time, SLAB_INITIAL)}
    return record | dict(zip(SLAB_SENSORS, readings.T, strict=True)) | {"truth": truth}


# -------------------------------------------------------------------------------- the finite-volume wall


def wall_mesh(length, cells):
    """Nodes from face to face (m), three times as dense at the faces as in the middle."""
    s = np.linspace(-1, 1, cells + 1)
    return length / 2 * (1 + np.tanh(1.2 * s) / np.tanh(1.2))


def solve_wall(time, left, right, *, length, diffusivity, sensors, cells=240):
    """Temperature at the sensors of a homogeneous wall between two given face temperatures.

    Finite volumes around the nodes x_i of `wall_mesh`, with gaps h_i and volumes w_i = (h_i + h_i-1) / 2,

        w_i dT_i/dt = alpha ((T_i+1 - T_i) / h_i - (T_i - T_i-1) / h_i-1),

    made symmetric with sqrt(w) and taken apart into modes. Each mode is stepped exactly for face temperatures
    that are linear between the given times, so that between such faces only the mesh makes an error. Starts
    from the linear profile between the first two face temperatures; reads between nodes with a cubic spline.

    **Arguments:** `time`: s, equal steps, shape (time,); `left`, `right`: degC, shape (time,); `length`: m;
    `diffusivity`: m2/s; `sensors`: positions, m, shape (sensor,); `cells`: number of cells.

    **Returns:** temperature, degC, shape (time, sensor).
    """
    nodes = wall_mesh(length, cells)
    step = time[1] - time[0]
    gap = np.diff(nodes)
    volume = np.sqrt((gap[1:] + gap[:-1]) / 2)
    eigenvalue, modes = eigh_tridiagonal(
        diffusivity * (1 / gap[1:] + 1 / gap[:-1]) / volume**2,
        -diffusivity / gap[1:-1] / (volume[1:] * volume[:-1]),
    )
    in_left = diffusivity / gap[0] / volume[0] * modes[0]
    in_right = diffusivity / gap[-1] / volume[-1] * modes[-1]
    start = left[0] + (right[0] - left[0]) * nodes[1:-1] / length
    z_start = modes.T @ (volume * start)
    read = CubicSpline(nodes, np.eye(nodes.size))(sensors)
    read_modes = (read[:, 1:-1] / volume) @ modes

    a = eigenvalue * step
    mean = -np.expm1(-a) / a
    w_new = step * (1 - mean) / a
    w_old = step * mean - w_new
    out = np.outer(left, read[:, 0]) + np.outer(right, read[:, -1])
    for m in range(eigenvalue.size):
        source = in_left[m] * left + in_right[m] * right
        drive = np.concatenate([z_start[m : m + 1], w_old[m] * source[:-1] + w_new[m] * source[1:]])
        out += np.outer(lfilter([1.0], [1.0, -np.exp(-a[m])], drive), read_modes[:, m])
    return out


# ------------------------------------------------------------------------------ the Saint Julien twin


def _wandering(rng, knots, memory, smoothing):
    """An Ornstein-Uhlenbeck path on hourly knots, smoothed, with mean 0 and standard deviation 1.

    **Arguments:** `memory`: correlation time, h; `smoothing`: standard deviation of the Gaussian kernel, h.
    """
    path = lfilter([1.0], [1.0, -np.exp(-1 / memory)], rng.standard_normal(knots.size))
    path = gaussian_filter1d(path, smoothing)
    return CubicSpline(knots, (path - path.mean()) / path.std())


def east_irradiance(t, clearness):
    """Irradiance (W/m2) on a vertical wall that faces east, at clock time t (s, UTC+1, from 1 January).

    Beam 1350 exp(-0.25 / sin h) x clearness x cos(incidence) while the sun is up, plus half the sky's
    diffuse light. Averaged over about an hour and a half (a Gaussian of 40 min): hills and trees soften
    the sunrise, and straight lines between hourly rows could not follow a sharp one.

    **Arguments:** `t`: equal steps, shape (time,); `clearness`: 0 (overcast) to 1 (clear), shape (time,).
    """
    solar = t - (15 - TWIN_LONGITUDE) * 240.0
    declination = np.radians(-23.44) * np.cos(2 * np.pi * (t / DAY + 10) / 365.25)
    hour_angle = 2 * np.pi * (solar / DAY % 1 - 0.5)
    latitude = np.radians(TWIN_LATITUDE)
    height = np.sin(latitude) * np.sin(declination)
    height = height + np.cos(latitude) * np.cos(declination) * np.cos(hour_angle)
    height = np.maximum(height, 1e-3)  # below the horizon: the beam's exp(-250) and the sky's 0.1 % vanish
    facing = np.maximum(-np.cos(declination) * np.sin(hour_angle), 0)
    beam = 1350 * np.exp(-0.25 / height) * clearness * facing
    sky = 0.5 * (90 + 110 * (1 - clearness)) * height * np.exp(-0.05 / height)
    return gaussian_filter1d(beam + sky, 2400.0 / (t[1] - t[0]))


def weather(seed: int, *, step: float = TWIN_STEP) -> dict:
    """What drives the twin, from three weeks before its first row to its last, as smooth functions of time.

    Outer face (shielded sensor): season + 2.3 K of synoptic wandering + a day of 1 to 5 K amplitude, large
    under a clear sky, + 0.25 K within the day. Inner face: an old house, heated now and then, mornings and
    evenings.

    **Arguments:** `seed`: of the weather; `step`: s, between the times at which the functions are read.

    **Returns:** `time` (s from the first row), `T_left` and `T_right` (degC; right without the sun),
    `irradiance` (W/m2, on the outer face).
    """
    rng = _random(seed, 0)
    end = (TWIN_ROWS - 1) * HOUR
    knots = np.arange(-TWIN_SPIN_UP, end + HOUR / 2, HOUR)
    synoptic = _wandering(rng, knots, 60, 6)
    sky = _wandering(rng, knots, 30, 5)
    flutter = _wandering(rng, knots, 2, 1.5)
    stay = _wandering(rng, knots, 72, 8)
    occupied = _wandering(rng, knots, 24, 6)

    t = np.arange(-TWIN_SPIN_UP, end + step / 2, step)
    day, phase = t / DAY, 2 * np.pi * t / DAY
    clearness = expit(2.5 * sky(t) - 0.9 + day / 60)
    swing = (1 + 4 * clearness) * (np.cos(phase - 2 * np.pi * 15.5 / 24) + 0.15 * np.cos(2 * phase - 1.0))
    season = 11.5 - 9.2 * np.cos(2 * np.pi * (day - 17) / 365.25)
    outer = season + 2.3 * synoptic(t) + swing + 0.25 * flutter(t)

    evening = np.exp(4 * (np.cos(phase - 2 * np.pi * 20 / 24) - 1))
    morning = np.exp(6 * (np.cos(phase - 2 * np.pi * 8.5 / 24) - 1))
    heating = 2 * expit(2 * occupied(t)) * (evening + 0.5 * morning)
    inner = 11.8 + 4.8 * expit((day - 58) / 10) + 0.5 * stay(t) + 0.25 * synoptic(t) + 0.9 * heating
    return {"time": t, "T_left": inner, "T_right": outer, "irradiance": east_irradiance(t, clearness)}


@lru_cache(maxsize=32)
def noise_free(seed: int, sun: float = 0.003) -> dict:
    """The twin's hourly truth; kept, so that many noise seeds on one weather solve the wall once.

    True outer face = T_right + sun x irradiance: the shielded sensor on it does not see the sun.

    **Arguments:** `seed`: of the weather; `sun`: K m2/W.

    **Returns:** `diffusivity` (m2/s), `sun`, `irradiance` (W/m2), the readings without noise `T_left`,
    `T_right`, `T1`, `T2`, `T3` and the true `outer_face` (degC). The arrays are read-only.
    """
    drive = weather(seed)
    outer_face = drive["T_right"] + sun * drive["irradiance"]
    sensors = solve_wall(
        drive["time"], drive["T_left"], outer_face,
        length=TWIN_LENGTH, diffusivity=TWIN_DIFFUSIVITY, sensors=list(TWIN_SENSORS.values()),
    )  # fmt: skip
    columns = {name: drive[name] for name in ("irradiance", "T_left", "T_right")} | {"outer_face": outer_face}
    columns |= dict(zip(TWIN_SENSORS, sensors.T, strict=True))
    hourly = slice(round(TWIN_SPIN_UP / TWIN_STEP), None, round(HOUR / TWIN_STEP))
    columns = {name: column[hourly].copy() for name, column in columns.items()}
    for column in columns.values():
        column.setflags(write=False)
    return {"diffusivity": TWIN_DIFFUSIVITY, "sun": sun} | columns


def observe(truth: dict, noise: float, noise_seed: int) -> dict:
    """The readings: white normal noise of `noise` K, independent on both faces and every sensor."""
    rng = _random(noise_seed, 1)
    names = ("T_left", "T_right", *TWIN_SENSORS)
    return {name: truth[name] + noise * rng.standard_normal(truth[name].size) for name in names}


def saint_julien(seed: int, *, sun: float = 0.003, noise: float = 0.1, noise_seed: int | None = None) -> dict:
    """A synthetic twin of the Saint Julien wall's record: 2670 hourly rows from 1 January 2009.

    **Arguments:** `seed`: of the weather; `sun`: outer face above its sensor for each W/m2, K m2/W;
    `noise`: K; `noise_seed`: of the noise alone, by default `seed` (which starts a stream of its own).

    **Returns:** `time` (datetime64), `T_left`, `T_right`, `T1`, `T2`, `T3` (degC), `irradiance` (W/m2, at the
    row's instant), and `truth` (see `noise_free`). Not rounded.
    """
    truth = noise_free(seed, sun)
    record = {"time": TWIN_START + np.arange(TWIN_ROWS) * np.timedelta64(1, "h")}
    record |= observe(truth, noise, seed if noise_seed is None else noise_seed)
    return record | {"irradiance": truth["irradiance"].copy(), "truth": dict(truth)}
