"""A wall with a hidden effect, simulated by means that share nothing with wallid.

Finite volumes on a graded mesh, faces at a much finer step than the record, noise on every sensor and both
faces, rounding last. Every effect goes into the partial differential equation or into the sensor itself.
Linear walls are taken apart into modes that are stepped exactly; the others go to LSODA.

The equation, with k and c relative to the base wall's conductivity and capacity, m(t) and q from the effects:

    c(x, T) dT/dt = m(t) alpha d/dx (k(x, T) dT/dx) + c ( q(x, t) + s (T_amb - T) - v dT/dx )

SI units; temperatures in degC; time in s from the record's first row. Effects, targets, parameters and signs
are those of the package's interface; what it leaves open is stated at `EFFECTS`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.integrate import odeint
from scipy.interpolate import CubicSpline
from scipy.linalg import eigh_tridiagonal
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter
from scipy.special import erfcx, expit

HOUR, DAY = 3600.0, 86400.0
FINE_STEP = 120.0  # s, of the faces' truth; records have rows at multiples of it
OVERHANG = 2.5 * HOUR  # s of weather after the last row, for clocks that are fast
COARSE_STEP = 600.0  # s, at which LSODA and the corner are read; the field is smooth between
CELLS = 120
MELTING_WIDTH = 0.5  # K, standard deviation of the phase change's Gaussian
SOURCE_WIDTH = 1 / 20  # of the length: standard deviation of a local heat source's Gaussian
SLOWEST = 1e-6  # K/s, at which the hysteresis turns smoothly from warming to cooling
OSCILLATION = 3 * DAY  # s, period of the oscillating diffusivity
LATITUDE = 45.0  # degrees north
SUN_ON_FACE = 0.009  # K m2/W, warming of the outer face

EFFECTS = {
    "sensor_position": "shift: true place minus stated, in place of the random position error",
    "sensor_lag": "time_constant tau: tau y' + y = T(x)",
    "sensor_offset": "offset: reading minus truth, in place of the random offset",
    "sensor_gain": "gain: T0 + (1 + gain) (T - T0), T0 the mean of all readings without noise",
    "sensor_drift": "rate K/day: none at the first row",
    "clock_shift": "delay: all inner sensors' row at t holds T(t - delay)",
    "face_offset": "offset: reading minus truth",
    "face_lag": "time_constant tau: tau r' + r = T_face",
    "face_depth": "depth: the reading is the wall's temperature so deep inside",
    "solar_gain": "gain: face = reading + gain x irradiance",
    "surface_film": "film_length: base conductivity over film coefficient, between reading and face",
    "layered_conductivity": "log_ratio, interface: k = exp(-log_ratio / 2) left of it, exp(+log_ratio / 2) right",
    "layered_capacity": "log_ratio, interface: as the conductivity",
    "contact_resistance": "thickness: resistance x base conductivity; place",
    "temperature_dependent_conductivity": "slope: k (1 + slope (T - T0))",
    "temperature_dependent_capacity": "slope: c (1 + slope (T - T0))",
    "phase_change": "area, temperature: c + area x normal density of 0.5 K standard deviation about temperature",
    "diffusivity_drift": "rate 1/day: conduction times 1 + rate t from the first row on",
    "wetting": "jump, time_constant, time (s): conduction times 1 + jump exp(-(t - time) / time_constant) from then",
    "heat_source": "rate K/s; place or None: rate exp(-((x - place) / (L / 20))^2 / 2); hours [from, to] or None",
    "lateral_loss": "rate s: + s (T_air - T)",
    "air_flow": "velocity v: - v dT/dx",
}
PLATE_EFFECTS = {
    "plate_gain": "gain: (1 + gain) q, in place of the random calibration error",
    "plate_offset": "offset W/m2: reading minus truth",
    "plate_lag": "time_constant tau: tau y' + y = q",
    "plate_resistance": "resistance m2 K/W: between the face's reading and the wall",
}
OUTSIDE = {
    "oscillating_diffusivity": "amplitude a: conduction times 1 + a sin(2 pi t / 3 d)",
    "corner": "distance m from the sensors to a lateral face at the temperature of an unlogged neighbour space",
    "hysteresis": "amplitude a, play K: k (1 + a s), s -> +1 after warming by some play, -1 after cooling",
}
_NONLINEAR = {
    "temperature_dependent_conductivity", "temperature_dependent_capacity", "phase_change", "diffusivity_drift",
    "wetting", "oscillating_diffusivity", "hysteresis",
}  # fmt: skip
_IN_THE_WALL = _NONLINEAR | {
    "layered_conductivity", "layered_capacity", "contact_resistance", "heat_source", "lateral_loss", "air_flow",
    "surface_film", "corner", "plate_resistance",
}  # fmt: skip
CAPACITY = 1.6e6  # J/m3/K, of every base wall


class Hidden(NamedTuple):
    """An effect that the record holds and the case does not tell.

    **Arguments:** `name`: of `EFFECTS` or `OUTSIDE`; `target`: None, "left", "right", "outdoor", "indoor" or
    a sensor's name; `parameters`: see there, SI units.
    """

    name: str
    target: str | None
    parameters: dict


@dataclass(frozen=True)
class Spec:
    """A wall and its campaign.

    **Arguments:**

    - `length`: m. `diffusivity`: of the base wall, k / (rho c), m2/s.
    - `positions`: of the inner sensors T1, T2, .., as stated, m.
    - `step`: s from row to row, a multiple of `FINE_STEP`. `days`: of the record.
    - `weather_seed`; `start`: of the record, ISO 8601; `outdoor_mean`: degC; `flutter`: K, standard deviation
      of what the faces do within some hours. `outside`: the outer face, "left" or "right".
    - `noise`: "white", "ar06" and "ar09" (AR(1) from row to row), or "mixed" (half the variance white, half
      AR(1) 0.9); `noise_std`, `boundary_noise_std`: K, of inner sensors and faces; `noise_seed`.
    - `rounding`: K, 0 for none.
    - `position_std`, `offset_std`: m, K, as stated; true ones are drawn with them unless `misplaced` is False.
    - `effects`: what is hidden.
    - `shaded`: s from the first row on which the outer face, and the irradiance on it, lie in the shade.
    - `heated`: s from the first row on which the inner face is heated, for how many s, and by how many W/m2; the
      wall's base conductivity is its diffusivity x `CAPACITY`.
    - `plates`: the faces with a heat flux plate, positive along +x; `flux_noise_std`: W/m2, of each; `flux_gain_std`:
      as stated, true ones are drawn with it unless `misplaced` is False.
    - `exchanged`: two sensors that have changed places since an earlier campaign with the same `noise_seed`: the
      errors of places stay, those of instruments go with them. `positions` are those of now.
    """

    length: float = 0.3
    diffusivity: float = 5e-7
    positions: tuple[float, ...] = (0.06, 0.15, 0.24)
    step: float = HOUR
    days: float = 30.0
    weather_seed: int = 0
    start: str = "2023-02-06T00:00:00"
    outdoor_mean: float = 6.0
    flutter: float = 0.25
    outside: str = "left"
    noise: str = "white"
    noise_std: float = 0.05
    boundary_noise_std: float = 0.05
    noise_seed: int = 0
    rounding: float = 0.01
    position_std: float = 0.002
    offset_std: float = 0.0
    misplaced: bool = True
    effects: tuple[Hidden, ...] = ()
    shaded: float | None = None
    heated: tuple[float, float, float] | None = None
    plates: tuple[str, ...] = ()
    flux_noise_std: float = 0.3
    flux_gain_std: float = 0.05
    exchanged: tuple[str, str] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "effects", tuple(Hidden(*effect) for effect in self.effects))
        if self.step % FINE_STEP:
            raise ValueError(f"step must be a multiple of {FINE_STEP} s, got {self.step}")
        for name, _, _ in self.effects:
            if name not in EFFECTS | PLATE_EFFECTS | OUTSIDE:
                raise ValueError(f"unknown effect {name!r}")
        inside = [effect.name for effect in self.effects if effect.name in _IN_THE_WALL]
        if "corner" in inside and (len(inside) > 1 or self.plates):
            raise ValueError(f"a corner goes with no plate and no other effect in the wall, got {inside}")
        if "hysteresis" in inside and self.plates:
            raise ValueError("no plate goes with hysteresis")

    @property
    def rows(self) -> int:
        return round(self.days * DAY / self.step)

    @property
    def conductivity(self) -> float:
        """Of the base wall, W/m/K."""
        return self.diffusivity * CAPACITY

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(f"T{number}" for number in range(1, len(self.positions) + 1))

    def of(self, name: str, target: str | None = None) -> list[dict]:
        """The parameters of every hidden effect of that name (and target)."""
        return [p for n, t, p in self.effects if n == name and (target is None or t == target)]


def _random(seed: int, stream: int) -> np.random.RandomState:
    """Random numbers for one purpose; RandomState, because NumPy never changes the numbers it gives."""
    return np.random.RandomState([seed, stream])


# ------------------------------------------------------------------------------------------- the weather


def _wandering(rng, knots, memory, smoothing):
    """An Ornstein-Uhlenbeck path on hourly knots, smoothed, with mean 0 and standard deviation 1.

    **Arguments:** `memory`: correlation time, h; `smoothing`: standard deviation of the Gaussian kernel, h.
    """
    path = lfilter([1.0], [1.0, -np.exp(-1 / memory)], rng.standard_normal(knots.size))
    path = gaussian_filter1d(path, smoothing)
    return CubicSpline(knots, (path - path.mean()) / path.std())


def _irradiance(t, day, hour, clearness, azimuth):
    """Irradiance (W/m2) on a vertical wall whose outward normal is `azimuth` rad east of south.

    Beam 1350 exp(-0.25 / sin h) x clearness x cos(incidence) while the sun is up, plus half the sky's diffuse
    light, softened by a Gaussian of 40 min: hills and trees soften the sunrise.
    """
    declination = np.radians(-23.44) * np.cos(2 * np.pi * (day + 10) / 365.25)
    angle = 2 * np.pi * (hour / 24 - 0.5)
    latitude = np.radians(LATITUDE)
    up = np.sin(latitude) * np.sin(declination) + np.cos(latitude) * np.cos(declination) * np.cos(angle)
    south = np.sin(latitude) * np.cos(declination) * np.cos(angle) - np.cos(latitude) * np.sin(declination)
    east = -np.cos(declination) * np.sin(angle)
    height = np.maximum(up, 1e-3)
    facing = np.maximum(south * np.cos(azimuth) + east * np.sin(azimuth), 0)
    beam = 1350 * np.exp(-0.25 / height) * clearness * facing
    sky = 0.5 * (90 + 110 * (1 - clearness)) * height * np.exp(-0.05 / height)
    return gaussian_filter1d(beam + sky, 2400.0 / (t[1] - t[0]))


def _rain(rng, t, end, main):
    """Rain, mm/h: small showers, and a main rain, from `main` on (s); for None from anywhere in one of two records.

    So that a heavy rain alone does not tell that the wall was wetted.
    """
    rain = np.zeros_like(t)
    count = 2 + rng.poisson(end / (6 * DAY))
    for begin, hours, rate in zip(
        np.floor(rng.uniform(0, end, count) / HOUR) * HOUR,
        rng.randint(1, 3, count),
        rng.uniform(0.2, 0.9, count),
        strict=True,
    ):
        rain[(t >= begin) & (t < begin + hours * HOUR)] = round(rate, 1)
    hours, rate = rng.randint(4, 8), round(rng.uniform(4.0, 8.0), 1)
    harmless = np.floor(rng.uniform(0.1, 0.9) * end / HOUR) * HOUR if rng.uniform() < 0.5 else None
    main = harmless if main is None else main
    if main is not None:
        rain[(t >= main) & (t < main + hours * HOUR)] = rate
    return rain


def weather(spec: Spec, spin_up: float) -> dict:
    """What drives a wall, from `spin_up` s before its first row to `OVERHANG` s after its last.

    Outdoor air: mean + 3 K of synoptic wandering + a slow trend + a day of 1 to 5 K amplitude, large under a
    clear sky. Indoor air: heated in the morning and in the evening. The faces follow their air softened by an
    hour or two, with the sun (outer) and a part of the other side (inner), and flutter on their own.

    **Returns:** `time` (s), `left` and `right` (face temperatures, degC), `irradiance` (W/m2, outer face),
    `air_outdoor`, `air_indoor` (degC), `rain` (mm/h), `heating` (0..1), `neighbour` (degC; never logged),
    `hour` (of the day, by the record's clock).
    """
    wet = spec.of("wetting")
    drive = _weather(
        spec.weather_seed, spec.days, spec.start, spec.outdoor_mean, spec.flutter, spec.outside, spin_up,
        wet[0]["time"] if wet else None,
    )  # fmt: skip
    inside = "right" if spec.outside == "left" else "left"
    if spec.shaded is not None:
        lost = np.where(drive["time"] >= spec.shaded, drive["irradiance"], 0.0)
        drive = drive | {
            spec.outside: drive[spec.outside] - SUN_ON_FACE * lost,
            "irradiance": drive["irradiance"] - lost,
        }
    if spec.heated is not None:
        drive = drive | {inside: drive[inside] + _heating(spec, drive["time"])}
    return drive


def _heating(spec: Spec, t):
    """What a heater makes of the inner face, K: a half space with a film of 8 W/m2/K before it."""
    start, lasting, power = spec.heated
    conductivity = spec.conductivity

    def since(start):
        b = 8.0 / conductivity * np.sqrt(spec.diffusivity * np.clip(t - start, 0, None))
        return power / 8.0 * (1 - erfcx(b))

    return since(start) - since(start + lasting)


@lru_cache(maxsize=4)
def _weather(seed, days, start, outdoor_mean, flutter_std, outside, spin_up, main_rain):
    rng = _random(seed, 0)
    end, longest = days * DAY, 40 * DAY
    knots = np.arange(-longest, end + DAY, HOUR)
    synoptic = _wandering(rng, knots, 60, 6)
    sky = _wandering(rng, knots, 30, 5)
    stay = _wandering(rng, knots, 72, 8)
    occupied = _wandering(rng, knots, 24, 6)
    own_outer, own_inner = _wandering(rng, knots, 2, 1.3), _wandering(rng, knots, 2, 1.3)
    slow_outer, slow_inner = _wandering(rng, knots, 20, 4), _wandering(rng, knots, 20, 4)
    beyond = _wandering(rng, knots, 40, 6)
    trend, azimuth, warm = rng.uniform(-3, 3), rng.uniform(-1.6, 1.6), rng.uniform(18, 21)

    t = np.arange(-round(spin_up / FINE_STEP), round((end + OVERHANG) / FINE_STEP) + 1) * FINE_STEP
    moment = np.datetime64(start)
    year_day = (moment.astype("datetime64[D]") - moment.astype("datetime64[Y]")).astype(int)
    first_hour = (moment - moment.astype("datetime64[D]")) / np.timedelta64(1, "s") / HOUR
    clock = t / HOUR + first_hour
    day, hour, phase = year_day + clock / 24, clock % 24, 2 * np.pi * clock / 24

    clearness = expit(2.5 * sky(t) - 0.3)
    swing = (1 + 4 * clearness) * (np.cos(phase - 2 * np.pi * 15.5 / 24) + 0.15 * np.cos(2 * phase - 1.0))
    outdoor = outdoor_mean + trend * (t / end - 0.5) + 3 * synoptic(t) + swing
    evening = np.exp(4 * (np.cos(phase - 2 * np.pi * 20 / 24) - 1))
    morning = np.exp(6 * (np.cos(phase - 2 * np.pi * 7.5 / 24) - 1))
    heating = np.clip(expit(2 * occupied(t)) * (evening + 0.6 * morning), 0, 1)
    indoor = warm - 1.5 + 0.7 * stay(t) + 0.1 * (synoptic(t) + 0.1 * swing) + 3.0 * heating

    sun = _irradiance(t, day, hour, clearness, azimuth)
    outer = gaussian_filter1d(outdoor, 1.5 * HOUR / FINE_STEP) + SUN_ON_FACE * sun - 0.8 * clearness
    outer = outer + 0.4 * slow_outer(t) + flutter_std * own_outer(t)
    inner = gaussian_filter1d(indoor, 1.0 * HOUR / FINE_STEP)
    inner = inner - 0.06 * gaussian_filter1d(indoor - outdoor, 6 * HOUR / FINE_STEP)
    inner = inner + 0.25 * slow_inner(t) + 0.6 * flutter_std * own_inner(t)
    neighbour = 0.5 * (indoor.mean() + gaussian_filter1d(outdoor, 8 * HOUR / FINE_STEP)) + 2.5 * beyond(t)
    left, right = (outer, inner) if outside == "left" else (inner, outer)
    drive = {
        "time": t, "left": left, "right": right, "irradiance": sun, "air_outdoor": outdoor, "air_indoor": indoor,
        "heating": heating, "rain": _rain(rng, t, end, main_rain), "neighbour": neighbour, "hour": hour,
    }  # fmt: skip
    for column in drive.values():
        column.setflags(write=False)
    return drive


# ---------------------------------------------------------------------------------------------- the wall


def _graded(low, high, cells):
    """Cell edges, m, three times as dense at both ends as in the middle."""
    s = np.linspace(-1, 1, cells + 1)
    return (low + high) / 2 + (high - low) / 2 * np.tanh(1.2 * s) / np.tanh(1.2)


class Slab:
    """Finite volumes of a wall whose interfaces and joints are cell edges.

    Cell i has the width w_i, the centre x_i, conductivity k_i and capacity c_i relative to the base wall's. Of
    an edge, `path` is the sum of the half cells' w / (2 k) on both sides (on one side at a face), `extra` the
    resistance times base conductivity of a joint or a film there, both in m.
    """

    def __init__(self, spec: Spec, cells: int = CELLS):
        layers = [(kind, p) for kind in ("layered_conductivity", "layered_capacity") for p in spec.of(kind)]
        joints = [(p["place"], p["thickness"]) for p in spec.of("contact_resistance")]
        breaks = sorted({p["interface"] for _, p in layers} | {place for place, _ in joints})
        ends = [0.0, *breaks, spec.length]
        parts = [_graded(low, high, max(16, round(cells * (high - low) / spec.length))) for low, high in pairwise(ends)]
        self.length, self.alpha = spec.length, spec.diffusivity
        self.edges = np.concatenate([parts[0], *(part[1:] for part in parts[1:])])
        self.width = np.diff(self.edges)
        self.centres = (self.edges[1:] + self.edges[:-1]) / 2
        self.piece = np.repeat(np.arange(len(parts)), [len(part) - 1 for part in parts])
        self.breaks = np.array(breaks)
        self.k, self.c = np.ones(self.width.size), np.ones(self.width.size)
        for kind, p in layers:
            step = np.exp(0.5 * p["log_ratio"] * np.sign(self.centres - p["interface"]))
            if kind == "layered_conductivity":
                self.k = self.k * step
            else:
                self.c = self.c * step
        self.half = self.width / (2 * self.k)
        self.path = np.concatenate([self.half[:1], self.half[1:] + self.half[:-1], self.half[-1:]])
        self.extra = np.zeros(self.edges.size)
        for place, thickness in joints:
            self.extra[np.argmin(np.abs(self.edges - place))] += thickness
        for side, edge in (("left", 0), ("right", -1)):
            self.extra[edge] += sum(p["film_length"] for p in spec.of("surface_film", side))
            self.extra[edge] += sum(spec.conductivity * p["resistance"] for p in spec.of("plate_resistance", side))

    @property
    def effective(self) -> float:
        """length^2 / (resistance x capacity) between the faces, m2/s; films are not the wall's."""
        resistance = (self.width / self.k).sum() + self.extra[1:-1].sum()
        return self.alpha * self.length**2 / (resistance * (self.width * self.c).sum())

    @property
    def relative_resistance(self) -> float:
        """Between the faces, over that of the base wall."""
        return ((self.width / self.k).sum() + self.extra[1:-1].sum()) / self.length

    def flux(self, padded, factor=1.0):
        """k dT/dx at the edges (K), from the temperatures of the left face, all cells and the right face.

        **Arguments:** `factor`: of the conductivity at each edge, of the half cells and not of joints and films.
        """
        return np.diff(padded, axis=-1) / (self.path / factor + self.extra)

    def advection(self, padded):
        """-dT/dx of each cell (K/m), from its temperatures at its own side of both edges."""
        drop = np.diff(padded) / (self.path + self.extra)
        return -(drop[1:] + drop[:-1]) * self.half / self.width

    def source_shape(self, place):
        """Of a heat source: 1 everywhere, or a Gaussian of 1 at its peak."""
        if place is None:
            return np.ones(self.width.size)
        return np.exp(-0.5 * ((self.centres - place) / (SOURCE_WIDTH * self.length)) ** 2)

    def reading(self, positions):
        """Weights of left face, cells and right face for temperatures at positions, (position, cell + 2).

        Cubics through the four nearest nodes on the same side of every interface; a face is a node where no
        film hides it.
        """
        nodes = np.concatenate([[0.0], self.centres, [self.length]])
        usable = np.concatenate([[self.extra[0] == 0], np.ones(self.width.size, bool), [self.extra[-1] == 0]])
        piece = np.concatenate([self.piece[:1], self.piece, self.piece[-1:]])
        weights = np.zeros((len(positions), nodes.size))
        for row, x in enumerate(positions):
            own = np.flatnonzero(usable & (piece == np.searchsorted(self.breaks, x)))
            near = own[np.argsort(np.abs(nodes[own] - x), kind="stable")[:4]]
            for node in near:
                others = nodes[near[near != node]]
                weights[row, node] = np.prod((x - others) / (nodes[node] - others))
        return weights

    def face_flux(self, sides):
        """The same weights for `-k dT/dx` at faces, k relative to the base wall's, K/m.

        What leaves the outermost cell: it converges with the square of the width, a slope of the field does not.
        """
        weights = np.zeros((len(sides), self.width.size + 2))
        for row, side in enumerate(sides):
            face, inside = (0, 1) if side == "left" else (-1, -2)
            conductance = 1 / (self.path[face] + self.extra[face])
            weights[row, [face, inside]] = np.array([1, -1]) * conductance * (1 if side == "left" else -1)
        return weights


def _relax(series, rate, step):
    """y' = rate (series - y), exact for a series that is linear from step to step, from y = series[0]."""
    a = rate * step
    mean = -np.expm1(-a) / a
    drive = np.concatenate([series[:1], (a * mean - 1 + mean) * series[:-1] + (1 - mean) * series[1:]])
    return lfilter([1.0], [1.0, -np.exp(-a)], drive)


def _inputs(spec: Spec, slab: Slab, drive: dict) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What enters the cells: weights (cell, input), series (input, time), K/s, and the rate of loss, 1/s.

    The first two series are the faces' temperatures; their weights are left to the caller.
    """
    weights, series, loss = [], [drive["left"], drive["right"]], 0.0
    for p in spec.of("heat_source"):
        weights.append(p["rate"] * slab.source_shape(p.get("place")))
        series.append(_gate(drive, p.get("hours")))
    for _, target, p in (effect for effect in spec.effects if effect.name == "lateral_loss"):
        weights.append(np.full(slab.width.size, p["rate"]))
        series.append(drive[f"air_{target}"])
        loss += p["rate"]
    shape = (slab.width.size, len(weights))
    return np.array(weights).T.reshape(shape), np.array(series), loss


def _gate(drive, hours):
    """1 within the hours of the day and 0 without, softened by 5 min; 1 throughout for None."""
    if hours is None:
        return np.ones_like(drive["time"])
    begin, end = hours
    on = (drive["hour"] - begin) % 24 < (end - begin) % 24
    return gaussian_filter1d(on.astype(float), 300.0 / FINE_STEP)


def _driven(spec: Spec, drive: dict) -> dict:
    """The drive with the sun on the face that a shielded sensor does not see."""
    for side in ("left", "right"):
        for p in spec.of("solar_gain", side):
            drive = drive | {side: drive[side] + p["gain"] * drive["irradiance"]}
    return drive


def temperatures(spec: Spec, drive: dict, positions: Sequence[float], *, reference=0.0, cells=CELLS, tolerance=1e-7):
    """The true temperature inside the wall at every time of the drive.

    Starts at the drive's first time from the steady state between its first faces.

    **Arguments:** `drive`: see `weather`, equal steps; `positions`: m; `reference`: T0 of the temperature
    dependences, degC; `cells`: number of cells; `tolerance`: relative, of LSODA.

    **Returns:** degC, shape (time, position); and after them, for each of the spec's plates, the flux, W/m2.
    """
    drive = _driven(spec, drive)
    if spec.of("hysteresis"):
        # turning points cost steps: half the cells and 1e-5 leave errors of 1 mK
        cells, tolerance = min(cells, CELLS // 2), max(tolerance, 1e-5)
    if spec.of("corner"):
        return _corner(spec, drive, positions, cells)
    if not any(effect.name in _NONLINEAR for effect in spec.effects):
        return _linear(spec, slab := Slab(spec, cells), drive, _instruments(spec, slab, positions))
    time, field, slab = adaptive(spec, drive, reference=reference, cells=cells, tolerance=tolerance)
    read = _instruments(spec, slab, positions)
    inside = CubicSpline(time, field @ read[:, 1:-1].T)(drive["time"])
    found = inside + np.outer(drive["left"], read[:, 0]) + np.outer(drive["right"], read[:, -1])
    slope, pace = sum(p["slope"] for p in spec.of("temperature_dependent_conductivity")), _pace(spec)
    for number, side in enumerate(spec.plates, start=len(positions)):
        factor = 1 + slope * (drive[side] - reference)
        found[:, number] *= factor * np.array([pace(t) for t in drive["time"]])
    return found


def _instruments(spec, slab, positions):
    """Weights of left face, cells and right face for the temperatures, degC, and the plates' fluxes, W/m2."""
    return np.concatenate([slab.reading(positions), spec.conductivity * slab.face_flux(spec.plates)])


def _linear(spec, slab, drive, read):
    """Modes of the wall, each stepped exactly between faces that are linear from time to time.

    With air flow the matrix is not symmetric, but as for every tridiagonal matrix whose opposite entries have
    one sign a diagonal scaling makes it so.
    """
    weights, series, loss = _inputs(spec, slab, drive)
    velocity = sum(p["velocity"] for p in spec.of("air_flow"))
    conductance = 1 / (slab.path + slab.extra)
    diffusion = slab.alpha / (slab.c * slab.width)
    wind = velocity * slab.half / slab.width
    from_left = (diffusion + wind) * conductance[:-1]
    from_right = (diffusion - wind) * conductance[1:]
    if np.any(from_left <= 0) or np.any(from_right <= 0):
        raise ValueError(f"air flow of {velocity} m/s: cells too wide for central differences")
    scale = np.exp(np.concatenate([[0.0], np.cumsum(0.5 * np.log(from_left[1:] / from_right[:-1]))]))
    rate, modes = eigh_tridiagonal(from_left + from_right + loss, -np.sqrt(from_left[1:] * from_right[:-1]))
    faces = np.zeros((slab.width.size, 2))
    faces[0, 0], faces[-1, 1] = from_left[0], from_right[-1]
    enter = modes.T @ (np.hstack([faces, weights]) / scale[:, None])
    leave = (read[:, 1:-1] * scale) @ modes
    out = np.outer(series[0], read[:, 0]) + np.outer(series[1], read[:, -1])
    step = drive["time"][1] - drive["time"][0]
    for m in range(rate.size):
        out += np.outer(_relax(enter[m] / rate[m] @ series, rate[m], step), leave[:, m])
    return out


def adaptive(spec: Spec, drive: dict, *, reference=0.0, cells=CELLS, tolerance=1e-7):
    """The whole field by LSODA with a banded Jacobian, faces by cubic splines.

    **Returns:** times (s, every `COARSE_STEP` and the drive's last), cell temperatures (degC, (time, cell)),
    and the slab. The hysteresis' state is left out.
    """
    slab = Slab(spec, cells)
    weights, series, loss = _inputs(spec, slab, drive)
    conductivity = sum(p["slope"] for p in spec.of("temperature_dependent_conductivity"))
    capacity = sum(p["slope"] for p in spec.of("temperature_dependent_capacity"))
    melting = [(p["area"] / MELTING_WIDTH / np.sqrt(2 * np.pi), p["temperature"]) for p in spec.of("phase_change")]
    velocity = sum(p["velocity"] for p in spec.of("air_flow"))
    loops = spec.of("hysteresis")
    pace = _pace(spec)
    start, step = drive["time"][0], drive["time"][1] - drive["time"][0]
    pieces = np.ascontiguousarray(CubicSpline(drive["time"], series, axis=1).c.transpose(1, 0, 2))
    bare = slab.extra[[0, -1]] == 0
    diffusion = slab.alpha / (slab.c * slab.width)
    padded = np.empty(slab.width.size + 2)

    def rates(T, state, t):
        index = min(max(int((t - start) / step), 0), len(pieces) - 1)
        s, piece = t - start - index * step, pieces[index]
        now = ((piece[0] * s + piece[1]) * s + piece[2]) * s + piece[3]
        padded[0], padded[1:-1], padded[-1] = now[0], T, now[1]
        factor = 1.0
        if conductivity or loops:
            # of an edge from both its sides; behind a film the reading says nothing of the face's temperature
            own = 1 + conductivity * (padded - reference)
            for loop, s_loop in zip(loops, state, strict=True):
                own[1:-1] += loop["amplitude"] * s_loop
                own[0] += loop["amplitude"] * s_loop[0]
                own[-1] += loop["amplitude"] * s_loop[-1]
            factor = (own[1:] + own[:-1]) / 2
            if not bare[0]:
                factor[0] = own[1]
            if not bare[1]:
                factor[-1] = own[-2]
        change = diffusion * np.diff(slab.flux(padded, factor)) * pace(t)
        if capacity or melting:
            heavy = 1 + capacity * (T - reference)
            for peak, temperature in melting:
                heavy = heavy + peak * np.exp(-0.5 * ((T - temperature) / MELTING_WIDTH) ** 2)
            change /= heavy
        if velocity:
            change += velocity * slab.advection(padded)
        if len(now) > 2:
            change += weights @ now[2:]
        return change - loss * T if loss else change

    if loops:
        (loop,) = loops

        def motion(y, t):
            T, s = y[::2], y[1::2]
            change = rates(T, [s], t)
            both = np.empty_like(y)
            both[::2], both[1::2] = change, (change - np.hypot(change, SLOWEST) * s) / loop["play"]
            return both

        band = 3
    else:

        def motion(y, t):
            return rates(y, (), t)

        band = 1

    out_step = max(1, round(COARSE_STEP / step))
    times = drive["time"][::out_step]
    if times[-1] < drive["time"][-1]:
        times = np.append(times, drive["time"][-1])
    left, right = drive["left"][0], drive["right"][0]
    T = left + (right - left) * slab.centres / slab.length
    y = np.stack([T, np.zeros_like(T)], axis=1).ravel() if loops else T
    # what bends at an instant is integrated in two parts
    bends = [t for t in {0.0, *(p["time"] for p in spec.of("wetting"))} if times[0] < t < times[-1]]
    field = [y[None]]
    for low, high in pairwise([times[0], *sorted(bends), times[-1]]):
        asked = times[(times > low) & (times <= high)]
        ends = np.concatenate([[low], asked, [high] if asked[-1] < high else []])
        found, info = odeint(
            motion, y, ends, ml=band, mu=band, rtol=tolerance, atol=10 * tolerance, hmax=HOUR / 2, mxstep=100000,
            full_output=True,
        )  # fmt: skip
        if info["message"] != "Integration successful.":
            raise RuntimeError(f"LSODA: {info['message']}")
        y = found[-1]
        field.append(found[1 : 1 + asked.size])
    field = np.concatenate(field)
    return times, field[:, ::2] if loops else field, slab


def _pace(spec: Spec) -> Callable[[float], float]:
    """The factor of conduction at a time."""
    drifts = [p["rate"] / DAY for p in spec.of("diffusivity_drift")]
    wet = [(p["jump"], p["time_constant"], p["time"]) for p in spec.of("wetting")]
    waves = [p["amplitude"] for p in spec.of("oscillating_diffusivity")]

    def pace(t):
        factor = 1.0
        for rate in drifts:
            factor *= 1 + rate * max(t, 0.0)
        for jump, memory, begin in wet:
            if t >= begin:
                factor *= 1 + jump * np.exp(-(t - begin) / memory)
        for amplitude in waves:
            factor *= 1 + amplitude * np.sin(2 * np.pi * t / OSCILLATION)
        return factor

    return pace


def _corner(spec, drive, positions, cells):
    """A rectangle: both faces along x as ever, a lateral face at the neighbour's temperature, no flux beyond.

    The sensors are `distance` from the lateral face, the far side three times as far. Modes are products of
    those along and across; each is stepped exactly, at the coarse step.
    """
    (p,) = spec.of("corner")
    stride = round(COARSE_STEP / (drive["time"][1] - drive["time"][0]))
    keep = np.arange(0, drive["time"].size, stride)
    if keep[-1] < drive["time"].size - 1:
        keep = np.append(keep, keep[-1] + stride)  # one step on, so that the last times are not extrapolated
    held = np.full(stride, drive["time"].size - 1)
    series = np.array([drive[name] for name in ("left", "right", "neighbour")])
    series = np.hstack([series, series[:, held]])[:, keep]
    slab = Slab(spec, cells // 2)
    along, modes = _modes(slab.width, slab.alpha, closed=False)
    edges = 3 * p["distance"] * (1 - np.cos(np.linspace(0, np.pi / 2, 25)))
    across, lateral = _modes(np.diff(edges), slab.alpha, closed=True)
    near = np.diff(edges)
    centre = (edges[1:] + edges[:-1]) / 2
    root, side_root = np.sqrt(slab.width), np.sqrt(near)
    enter_left = slab.alpha / slab.half[0] / root[0] * modes[0]
    enter_right = slab.alpha / slab.half[-1] / root[-1] * modes[-1]
    enter_side = 2 * slab.alpha / near[0] / side_root[0] * lateral[0]
    whole, whole_side = modes.T @ root, lateral.T @ side_root
    read = slab.reading(positions)
    leave = (read[:, 1:-1] / root) @ modes
    spot = np.zeros(near.size)
    close = np.argsort(np.abs(centre - p["distance"]))[:4]
    for node in close:
        others = centre[close[close != node]]
        spot[node] = np.prod((p["distance"] - others) / (centre[node] - others))
    leave_side = (spot / side_root) @ lateral
    out = np.outer(series[0], read[:, 0]) + np.outer(series[1], read[:, -1])
    for m, rate in enumerate(along):
        for n, side_rate in enumerate(across):
            enter = np.array([enter_left[m] * whole_side[n], enter_right[m] * whole_side[n], whole[m] * enter_side[n]])
            total = rate + side_rate
            course = _relax(enter / total @ series, total, COARSE_STEP)
            out += np.outer(course, leave[:, m] * leave_side[n])
    coarse = drive["time"][0] + np.arange(keep.size) * COARSE_STEP
    return CubicSpline(coarse, out)(drive["time"])


def _modes(width, alpha, *, closed):
    """Rates and modes of a homogeneous slab, made symmetric with the root of the widths."""
    conductance = 2 * alpha / (width[1:] + width[:-1])
    ends = 2 * alpha / width[[0, -1]]
    into = np.concatenate([ends[:1], conductance]) + np.concatenate([conductance, [0.0] if closed else ends[1:]])
    return eigh_tridiagonal(into / width, -conductance / np.sqrt(width[1:] * width[:-1]))


# -------------------------------------------------------------------------------------------- the sensors


def spin_up(spec: Spec) -> float:
    """Twelve of the wall's longest time constants, 4 to 30 d, in whole days, s."""
    resisted = 1 + sum(p["film_length"] for p in spec.of("surface_film")) / spec.length
    resisted += sum(p["thickness"] for p in spec.of("contact_resistance")) / spec.length
    resisted += sum(spec.conductivity * p["resistance"] for p in spec.of("plate_resistance")) / spec.length
    constant = (spec.length / np.pi) ** 2 / Slab(spec).effective * resisted
    return float(np.clip(np.ceil(12 * constant / DAY), 4, 30)) * DAY


def placed(spec: Spec) -> tuple[np.ndarray, np.ndarray]:
    """True positions (m) and true offsets (K) of the inner sensors."""
    count = len(spec.positions)
    rng = _random(spec.noise_seed, 2)
    errors, offsets = spec.position_std * rng.standard_normal(count), spec.offset_std * rng.standard_normal(count)
    if not spec.misplaced:
        errors, offsets = np.zeros(count), np.zeros(count)
    if spec.exchanged:
        one, other = (spec.names.index(name) for name in spec.exchanged)
        errors[[one, other]] = errors[[other, one]]
    for number, name in enumerate(spec.names):
        for p in spec.of("sensor_position", name):
            errors[number] = p["shift"]
        for p in spec.of("sensor_offset", name):
            offsets[number] = p["offset"]
    # however large an error is drawn, the sensor is in the wall
    return np.clip(np.array(spec.positions) + errors, 0.002, spec.length - 0.002), offsets


def calibrations(spec: Spec) -> np.ndarray:
    """True calibration error of each plate."""
    gains = spec.flux_gain_std * _random(spec.noise_seed, 4).standard_normal(len(spec.plates)) * spec.misplaced
    for number, side in enumerate(spec.plates):
        for p in spec.of("plate_gain", side):
            gains[number] = p["gain"]
    return gains


def noise_course(kind: str, rows: int, rng: np.random.RandomState) -> np.ndarray:
    """Stationary noise of variance 1."""
    if kind == "mixed":
        return np.sqrt(0.5) * (noise_course("white", rows, rng) + noise_course("ar09", rows, rng))
    draws = rng.standard_normal(rows)
    if kind == "white":
        return draws
    memory = {"ar06": 0.6, "ar09": 0.9}[kind]
    draws[1:] *= np.sqrt(1 - memory**2)
    return lfilter([1.0], [1.0, -memory], draws)


def clean(spec: Spec, *, cells=CELLS, tolerance=1e-7) -> dict:
    """Everything without noise, at the fine step.

    **Returns:** `drive`; `rows` (index of each row in the fine times); `left`, `right` and each sensor's
    reading at every fine time, `readings` (names in the record's order, (row, name)); `fluxes` (W/m2, (row, plate));
    `T0` (degC, mean of the readings); `diffusivity` (m2/s, the effective one as the interface defines it);
    `resistance` (m2 K/W, between the faces); `positions`, `offsets`, `gains`.
    """
    drive = weather(spec, spin_up(spec))
    time = drive["time"]
    first = round(-time[0] / FINE_STEP)
    rows = first + np.arange(spec.rows) * round(spec.step / FINE_STEP)
    positions, offsets = placed(spec)
    depths = [spec.length if side == "right" else 0.0 for side in ("left", "right")]
    for number, side in enumerate(("left", "right")):
        for p in spec.of("face_depth", side):
            depths[number] = spec.length - p["depth"] if side == "right" else p["depth"]
    points = [*positions, *depths]

    calm = tuple(effect for effect in spec.effects if not effect.name.startswith("temperature_dependent"))
    field = T0 = None
    if len(calm) < len(spec.effects):
        # T0 of the readings before the dependence is in; corrected below for what it does to their mean
        calm_spec = replace(spec, effects=calm, plates=())
        before = temperatures(calm_spec, drive, points, cells=cells, tolerance=tolerance)
        T0 = before[rows].mean()
    field = temperatures(spec, drive, points, reference=T0 or 0.0, cells=cells, tolerance=tolerance)

    readings = {}
    for number, side in enumerate(("left", "right")):
        course = field[:, len(positions) + number] if spec.of("face_depth", side) else drive[side]
        for p in spec.of("face_lag", side):
            course = _relax(course, 1 / p["time_constant"], FINE_STEP)
        readings[side] = course + sum(p["offset"] for p in spec.of("face_offset", side))
    for number, name in enumerate(spec.names):
        course = field[:, number]
        for p in spec.of("sensor_lag", name):
            course = _relax(course, 1 / p["time_constant"], FINE_STEP)
        for p in spec.of("clock_shift"):
            course = CubicSpline(time, course)(np.minimum(time - p["delay"], time[-1]))
        readings[name] = course
    mean = np.mean([course[rows] for course in readings.values()])
    for number, name in enumerate(spec.names):
        for p in spec.of("sensor_gain", name):
            readings[name] = mean + (1 + p["gain"]) * (readings[name] - mean)
        for p in spec.of("sensor_drift", name):
            readings[name] = readings[name] + p["rate"] * time / DAY
        readings[name] = readings[name] + offsets[number]
    final = np.mean([course[rows] for course in readings.values()])
    fluxes, gains = np.zeros((len(rows), len(spec.plates))), calibrations(spec)
    for number, side in enumerate(spec.plates):
        course = field[:, len(points) + number]
        for p in spec.of("plate_lag", side):
            course = _relax(course, 1 / p["time_constant"], FINE_STEP)
        fluxes[:, number] = (1 + gains[number]) * course[rows]
        fluxes[:, number] += sum(p["offset"] for p in spec.of("plate_offset", side))
    effective = Slab(spec).effective
    resistance = spec.length / spec.conductivity * Slab(spec).relative_resistance
    for p in spec.of("temperature_dependent_conductivity"):
        effective *= 1 + p["slope"] * (final - T0)
        resistance /= 1 + p["slope"] * (final - T0)
    for p in spec.of("temperature_dependent_capacity"):
        effective /= 1 + p["slope"] * (final - T0)
    return {
        "drive": drive, "rows": rows, "T0": final, "diffusivity": effective, "positions": positions,
        "offsets": offsets, "courses": readings, "fluxes": fluxes, "gains": gains,
        "resistance": resistance,
        "readings": np.stack([course[rows] for course in readings.values()], axis=1),
    }  # fmt: skip


def simulate(spec: Spec, noise: int | None = None) -> dict:
    """A record with its hidden effects, noise and rounding.

    **Arguments:** `noise`: another seed of the noise than `noise_seed`, which then draws the places alone.

    **Returns:** `time` (datetime64, s), `T_left`, `T_right`, `T1`, .. (degC), `flux_left`, .. (W/m2, plates),
    `irradiance` (W/m2, outer face),
    `air_outdoor`, `air_indoor` (degC), `rain` (mm/h), `heating` (0..1), each (row,); and `truth` with
    `diffusivity` (m2/s; with layers or a joint length^2 / (R C), with a drift at the first row, with
    temperature dependence at T0, without phase change and wetting), `resistance`, `T0`, `positions`, `offsets`, the
    noise-free columns under `readings`, and `effects`.
    """
    exact = clean(spec)
    rng = _random(spec.noise_seed if noise is None else noise, 1)
    columns = ("T_left", "T_right", *spec.names)
    stds = [spec.boundary_noise_std] * 2 + [spec.noise_std] * len(spec.names)
    record = {"time": np.datetime64(spec.start, "s") + (np.arange(spec.rows) * spec.step).astype("timedelta64[s]")}
    for number, (name, std) in enumerate(zip(columns, stds, strict=True)):
        values = exact["readings"][:, number] + std * noise_course(spec.noise, spec.rows, rng)
        record[name] = np.round(values / spec.rounding) * spec.rounding if spec.rounding else values
    for name in ("irradiance", "air_outdoor", "air_indoor", "rain", "heating"):
        record[name] = exact["drive"][name][exact["rows"]].copy()
    for number, side in enumerate(spec.plates):  # after all others, whose numbers are those without a plate
        noise_of_plate = spec.flux_noise_std * noise_course(spec.noise, spec.rows, rng)
        record[f"flux_{side}"] = np.round(exact["fluxes"][:, number] + noise_of_plate, 3)
    truth = {name: exact[name] for name in ("diffusivity", "resistance", "T0", "positions", "offsets")}
    truth["readings"] = dict(zip(columns, exact["readings"].T, strict=True))
    truth["fluxes"], truth["effects"] = exact["fluxes"], spec.effects
    return record | {"truth": truth}


def write_case(spec: Spec, folder: str | Path, noise: int | None = None) -> dict:
    """case.toml and record.csv of a simulated record; they tell what a user would know, not the effect.

    **Arguments:** `noise`: see `simulate`.

    The prior diffusivity is off by a random factor of 0.5 to 2.

    **Returns:** what `simulate` returns.
    """
    record = simulate(spec, noise)
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    factor = 2.0 ** _random(spec.noise_seed, 3).uniform(-1, 1)
    regressors = ("irradiance", "air_outdoor", "air_indoor", "rain", "heating")
    plates = tuple(f"flux_{side}" for side in spec.plates)
    lines = [
        "[wall]",
        f"length = {spec.length!r}",
        f"diffusivity_prior = {record['truth']['diffusivity'] * factor:.2e}",
        f'outside = "{spec.outside}"',
        "",
        "[record]",
        'file = "record.csv"',
        'time = "time"',
        'left = "T_left"',
        'right = "T_right"',
        *(f'{name} = "{name}"' for name in (*regressors, *plates)),
        f"boundary_noise_std = {spec.boundary_noise_std!r}",
    ]
    if plates:
        lines += [f"flux_noise_std = {spec.flux_noise_std!r}", f"flux_gain_std = {spec.flux_gain_std!r}"]
    for name, position in zip(spec.names, spec.positions, strict=True):
        lines += [
            "",
            "[[sensor]]",
            f'name = "{name}"',
            f"position = {position!r}",
            f"position_std = {spec.position_std!r}",
            f"noise_std = {spec.noise_std!r}",
            f"offset_std = {spec.offset_std!r}",
        ]
    (folder / "case.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    names = ("T_left", "T_right", *spec.names, *regressors, *plates)
    table = np.stack([record[name] for name in names], axis=1)
    with open(folder / "record.csv", "w", encoding="utf-8", newline="\n") as file:
        file.write(",".join(("time", *names)) + "\n")
        for stamp, row in zip(record["time"].astype(str), table, strict=True):
            file.write(",".join([stamp, *(f"{value:.4f}" for value in row)]) + "\n")
    return record
