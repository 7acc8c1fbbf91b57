"""Which records the benchmark makes, and what each of them could show at best.

Everything is drawn by seed. Seeds of `TUNING` are for finding thresholds, those of `SCORING` for the table;
no weather and no noise is in both.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import cholesky, solve_triangular
from scipy.signal import lfilter

from benchmarks.reference.analytic_slab import fluxes
from benchmarks.reference.simulator_with_effects import (
    DAY,
    EFFECTS,
    FINE_STEP,
    HOUR,
    MELTING_WIDTH,
    OUTSIDE,
    SOURCE_WIDTH,
    Hidden,
    Slab,
    Spec,
    clean,
    temperatures,
)

TUNING, SCORING = range(1, 1000), range(1001, 2000)
NOISES = ("white", "ar06", "ar09", "mixed")
# days, step in s, places of the sensors as fractions of the length: few, because each shape compiles anew
SHAPES = (
    (14.0, 600.0, (0.2, 0.5, 0.8)),
    (30.0, HOUR, (0.2, 0.5, 0.8)),
    (56.0, HOUR, (0.3, 0.7)),
    (21.0, 1800.0, (0.15, 0.4, 0.6, 0.85)),
)
_FAMILIES = ("nulls", "singles", "pairs", "outside")
# what a family's records are numbered by: a family, a kind within it, a record
_KINDS = 100
_RECORDS = 5000


def _stream(seed: int, family: str, kind: int, record: int) -> tuple[np.random.RandomState, int]:
    """Random numbers of one record, and the seed that is its weather's and its noise's alone."""
    if (seed not in TUNING and seed not in SCORING) or record >= _RECORDS or kind >= _KINDS:
        raise ValueError(f"seed {seed}, kind {kind}, record {record}: out of range")
    own = ((seed * len(_FAMILIES) + _FAMILIES.index(family)) * _KINDS + kind) * _RECORDS + record
    return np.random.RandomState([own, 7]), own


def _log(rng, low, high):
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _signed(rng, low, high):
    return float(rng.choice([-1.0, 1.0])) * _log(rng, low, high)


def campaign(rng: np.random.RandomState, own: int, noise: str | None = None) -> Spec:
    """A wall and its campaign, nothing hidden.

    **Arguments:** `rng`: draws everything; `own`: seed of weather and noise; `noise`: its kind, else drawn.
    """
    while True:
        length, diffusivity = round(_log(rng, 0.15, 0.5), 3), float(f"{_log(rng, 2e-7, 1.2e-6):.3g}")
        # slower walls say nothing in two weeks, faster ones nothing between two hourly rows
        if 1.5 * HOUR < (length / np.pi) ** 2 / diffusivity < 40 * HOUR:
            break
    days, step, places = SHAPES[rng.randint(len(SHAPES))]
    day, hour = rng.randint(365), int(rng.choice([0, rng.randint(24)]))
    start = np.datetime64("2023-01-01T00:00:00") + np.timedelta64(day, "D") + np.timedelta64(hour, "h")
    drawn = str(rng.choice(NOISES))
    return Spec(
        length=length,
        diffusivity=diffusivity,
        positions=tuple(round(length * (place + rng.uniform(-0.04, 0.04)), 3) for place in places),
        step=step,
        days=days,
        weather_seed=own,
        start=str(start),
        outdoor_mean=round(10.5 - 8.5 * np.cos(2 * np.pi * (day - 20) / 365) + 2 * rng.standard_normal(), 2),
        flutter=round(rng.uniform(0.15, 0.35), 3),
        outside=str(rng.choice(["left", "right"])),
        noise=noise or drawn,
        noise_std=round(_log(rng, 0.03, 0.1), 3),
        boundary_noise_std=round(_log(rng, 0.03, 0.1), 3),
        noise_seed=own,
        rounding=float(rng.choice([0.01, 0.0625], p=[0.7, 0.3])),
        position_std=float(rng.choice([0.001, 0.002, 0.003])),
        offset_std=float(rng.choice([0.0, 0.05, 0.1], p=[0.8, 0.1, 0.1])),
    )


def _between(rng, spec):
    """A place between the outermost sensors, m; nearer to a face a joint is a film by another name."""
    low, high = spec.positions[0], spec.positions[-1]
    return round(rng.uniform(low + 0.15 * (high - low), high - 0.15 * (high - low)), 4)


def hide(rng: np.random.RandomState, spec: Spec, name: str) -> Spec:
    """One more effect in a record, its size log-uniform from barely visible to strong."""
    side, sensor = str(rng.choice(["left", "right"])), str(rng.choice(spec.names))
    # K, what a rate of 1 K/s makes of a wall in the steady state, at its middle
    heating = spec.length**2 / (8 * spec.diffusivity)
    target, parameters = None, {}
    match name:
        case "sensor_position":
            target, parameters = sensor, {"shift": _signed(rng, 0.004, 0.05)}
            place = spec.positions[spec.names.index(sensor)] + parameters["shift"]
            if not 0.01 < place < spec.length - 0.01:
                parameters["shift"] *= -1
            place = spec.positions[spec.names.index(sensor)] + parameters["shift"]
            if not 0.01 < place < spec.length - 0.01:
                parameters["shift"] *= 0.3
        case "sensor_lag" | "face_lag":
            target = sensor if name == "sensor_lag" else side
            parameters = {"time_constant": _log(rng, 120.0, 5400.0)}
        case "sensor_offset" | "face_offset":
            target = sensor if name == "sensor_offset" else side
            parameters = {"offset": _signed(rng, 0.03, 0.8)}
        case "sensor_gain":
            target, parameters = sensor, {"gain": _signed(rng, 0.005, 0.15)}
        case "sensor_drift":
            target, parameters = sensor, {"rate": _signed(rng, 0.03, 1.0) / spec.days}
        case "clock_shift":
            parameters = {"delay": _signed(rng, 60.0, 3600.0)}
        case "face_depth":
            target, parameters = side, {"depth": _log(rng, 0.001, 0.03)}
        case "solar_gain":
            target, parameters = spec.outside, {"gain": _log(rng, 0.0003, 0.012)}
        case "surface_film":
            target, parameters = side, {"film_length": _log(rng, 0.003, 0.15)}
        case "layered_conductivity" | "layered_capacity":
            parameters = {"log_ratio": _signed(rng, 0.03, 1.2), "interface": _between(rng, spec)}
        case "contact_resistance":
            parameters = {"thickness": _log(rng, 0.002, 0.1), "place": _between(rng, spec)}
        case "temperature_dependent_conductivity" | "temperature_dependent_capacity":
            parameters = {"slope": _signed(rng, 0.0007, 0.03)}
        case "phase_change":
            spec = replace(spec, outdoor_mean=round(rng.uniform(-1.0, 3.0), 2))
            parameters = {"area": _log(rng, 0.3, 20.0), "temperature": 0.0}
        case "diffusivity_drift":
            parameters = {"rate": _signed(rng, 0.02, 0.8) / spec.days}
        case "wetting":
            parameters = {
                "jump": _signed(rng, 0.04, 0.8),
                "time_constant": _log(rng, 1.0, spec.days / 5) * DAY,
                "time": float(np.floor(rng.uniform(0.15, 0.6) * spec.days * 24) * HOUR),
            }
        case "heat_source":
            place = round(rng.uniform(0.2, 0.8) * spec.length, 4) if rng.uniform() < 0.5 else None
            begin, lasting = rng.randint(24), rng.randint(3, 9)
            hours = [int(begin), int((begin + lasting) % 24)] if rng.uniform() < 0.5 else None
            # a local source warms a quarter as much, one of some hours less by its part of the day
            share = (0.25 if place else 1.0) * (lasting / 24 if hours else 1.0)
            parameters = {"rate": _signed(rng, 0.03, 1.5) / heating / share, "place": place, "hours": hours}
        case "lateral_loss":
            target = str(rng.choice(["outdoor", "indoor"]))
            parameters = {"rate": _log(rng, 0.006, 0.5) / heating}
        case "air_flow":
            parameters = {"velocity": _signed(rng, 0.01, 2.0) * spec.diffusivity / spec.length}
        case "oscillating_diffusivity":
            parameters = {"amplitude": _log(rng, 0.03, 0.5)}
        case "corner":
            parameters = {"distance": round(spec.length * _log(rng, 0.4, 1.2), 4)}
        case "hysteresis":
            parameters = {"amplitude": _log(rng, 0.03, 0.5), "play": _log(rng, 0.3, 3.0)}
        case _:
            raise ValueError(f"unknown effect {name!r}")
    rounded = {key: float(f"{value:.4g}") if isinstance(value, float) else value for key, value in parameters.items()}
    return replace(spec, effects=(*spec.effects, Hidden(name, target, rounded)))


def nulls(noise: str, n: int, seed: int) -> list[Spec]:
    """Records in which nothing is hidden but errors of positions (and offsets) as stated."""
    kind = NOISES.index(noise)
    return [campaign(*_stream(seed, "nulls", kind, number), noise) for number in range(n)]


def singles(name: str, n: int, seed: int) -> list[Spec]:
    """Records with one hidden effect."""
    kind, specs = list(EFFECTS).index(name), []
    for number in range(n):
        rng, own = _stream(seed, "singles", kind, number)
        specs.append(hide(rng, campaign(rng, own), name))
    return specs


def pairs(n: int, seed: int) -> list[Spec]:
    """Records with two hidden effects of different names."""
    specs = []
    for number in range(n):
        rng, own = _stream(seed, "pairs", 0, number)
        first, second = (str(name) for name in rng.choice(list(EFFECTS), 2, replace=False))
        spec = hide(rng, hide(rng, campaign(rng, own), first), second)
        while len(places := [p.get("place") or p.get("interface") for _, _, p in spec.effects]) == 2:
            if None in places or abs(places[0] - places[1]) > 0.01:
                break
            spec = hide(rng, replace(spec, effects=spec.effects[:1]), second)
        specs.append(spec)
    return specs


def outside(n: int, seed: int) -> list[Spec]:
    """Records with an effect that the library does not hold, the three kinds in turn."""
    specs = []
    for number in range(n):
        rng, own = _stream(seed, "outside", 0, number)
        specs.append(hide(rng, campaign(rng, own), list(OUTSIDE)[number % len(OUTSIDE)]))
    return specs


# -------------------------------------------------------------------------- what a record could show at best

_SIZES = {
    "sensor_position": "shift", "sensor_lag": "time_constant", "sensor_offset": "offset", "sensor_gain": "gain",
    "sensor_drift": "rate", "clock_shift": "delay", "face_offset": "offset", "face_lag": "time_constant",
    "face_depth": "depth", "solar_gain": "gain", "surface_film": "film_length",
    "layered_conductivity": "log_ratio", "layered_capacity": "log_ratio", "contact_resistance": "thickness",
    "temperature_dependent_conductivity": "slope", "temperature_dependent_capacity": "slope",
    "phase_change": "area", "diffusivity_drift": "rate", "wetting": "jump", "heat_source": "rate",
    "lateral_loss": "rate", "air_flow": "velocity",
}  # fmt: skip
# these cannot be negative: where the best fit of one would be, it explains nothing
_POSITIVE = {
    "sensor_lag", "face_lag", "face_depth", "surface_film", "contact_resistance", "phase_change", "lateral_loss",
}  # fmt: skip
READINGS = 2100  # at most, after averaging neighbouring rows; the covariance is dense
MODES = 8  # of the initial profile
PROFILE_STD = 3.0  # K, prior of each
_CELLS = 64


class _Plain:
    """The plain wall at one diffusivity, and the derivatives of its readings to everything, from its field.

    With the field T(x, t) of the wall between the faces' readings, an effect's derivative solves the same
    equation between faces at zero, driven by what the effect adds to dT/dt (or to a face).
    """

    def __init__(self, spec: Spec, diffusivity: float, known: dict):
        self.spec, self.alpha = spec, diffusivity
        self.slab = slab = Slab(replace(spec, diffusivity=diffusivity, effects=()), _CELLS)
        drive, courses = known["drive"], known["courses"]
        self.step = min(spec.step, 1800.0)
        stride = round(self.step / FINE_STEP)
        first = known["rows"][0] % stride
        take = slice(first, known["rows"][-1] + 1, stride)
        self.zero = known["rows"][0] // stride
        self.time = drive["time"][take][self.zero :]
        self.drive = {name: column[take][self.zero :] for name, column in drive.items()}
        faces = np.array([courses["left"][take], courses["right"][take]])
        self.stride = round(spec.step / self.step)

        self.ends = np.concatenate([[0.0], slab.centres, [spec.length]])  # of the paths across the edges
        conductance = diffusivity / slab.path
        into = (conductance[1:] + conductance[:-1]) / slab.width
        self.root = np.sqrt(slab.width)
        coupling = -conductance[1:-1] / (self.root[1:] * self.root[:-1])
        matrix = np.diag(into) + np.diag(coupling, 1) + np.diag(coupling, -1)
        self.rate, self.modes = np.linalg.eigh(matrix)
        self.enter = np.zeros((slab.width.size, 2))
        self.enter[0, 0], self.enter[-1, 1] = conductance[0] / slab.width[0], conductance[-1] / slab.width[-1]
        positions = np.array(spec.positions)
        self.read = slab.reading(positions)
        reach = 0.5e-3
        self.slope = (slab.reading(positions + reach) - slab.reading(positions - reach)) / (2 * reach)

        state = self._march(faces.T @ self.enter.T, steady=True)[self.zero :]
        self.faces = faces[:, self.zero :]
        self.padded = np.hstack([self.faces[:1].T, (state @ self.modes.T) / self.root, self.faces[1:].T])
        self.flux = np.diff(self.padded, axis=1) / slab.path
        self.inside = self.padded[:, 1:-1]
        self.warming = diffusivity * np.diff(self.flux, axis=1) / slab.width
        self.edge = self.padded[:, :-1] + self.flux * np.append(slab.half, 0.0)  # temperature at each edge
        self.edge[:, 0], self.edge[:, -1] = self.faces
        self.readings = self.padded @ self.read.T
        self.changing = CubicSpline(self.time, self.readings)(self.time, 1)
        self.T0 = np.concatenate([self.faces.T, self.readings], axis=1)[:: self.stride].mean()

    def _march(self, source, steady=False):
        """The modes' course under what enters the cells, K/s, (time, cell), from rest or from the steady state."""
        drive = (source * self.root) @ self.modes
        decay = self.rate * self.step
        mean = -np.expm1(-decay) / decay
        new, old = self.step * (1 - mean) / decay, self.step * (mean - (1 - mean) / decay)
        old = self.step * mean - new
        pulse = np.zeros_like(drive)
        pulse[1:] = old * drive[:-1] + new * drive[1:]
        if steady:
            pulse[0] = drive[0] / self.rate
        for m in range(decay.size):
            pulse[:, m] = lfilter([1.0], [1.0, -np.exp(-decay[m])], pulse[:, m])
        return pulse

    def response(self, source=None, faces=None):
        """Readings at the rows, (row, sensor), of what enters the cells (K/s) and the faces (K, (time, 2))."""
        total = 0.0 if source is None else source
        direct = 0.0
        if faces is not None:
            total = total + faces @ self.enter.T
            direct = faces @ self.read[:, [0, -1]].T
        state = self._march(np.broadcast_to(total, self.inside.shape))
        return (direct + state @ ((self.read[:, 1:-1] / self.root) @ self.modes).T)[:: self.stride]

    def _divergence(self, extra):
        """What an additional flux through the edges, K, makes of dT/dt."""
        return self.alpha * np.diff(extra, axis=1) / self.slab.width

    def free(self):
        """Derivatives to the logarithm of the diffusivity and to the sine modes of the initial profile."""
        n = np.arange(1, MODES + 1)[:, None, None] * np.pi / self.spec.length
        fading = np.exp(-self.alpha * n**2 * self.time[None, :: self.stride, None])
        return [self.response(self.warming), *(np.sin(n * np.array(self.spec.positions)) * fading)]

    def derivative(self, name, target, p):
        """Of the readings at the rows, (row, sensor), to an effect's size at zero."""
        rows, here = slice(None, None, self.stride), np.zeros((self.spec.rows, len(self.spec.positions)))
        day = self.time[:, None] / DAY
        if name.startswith("sensor_"):
            number = self.spec.names.index(target)
            here[:, number] = {
                "sensor_position": lambda: self.padded @ self.slope[number],
                "sensor_lag": lambda: -self.changing[:, number],
                "sensor_offset": lambda: np.ones(self.time.size),
                "sensor_gain": lambda: self.readings[:, number] - self.T0,
                "sensor_drift": lambda: day[:, 0],
            }[name]()[rows]
            return here
        if target in ("left", "right"):
            number = 0 if target == "left" else -1
            inwards = self.flux[:, 0] if target == "left" else -self.flux[:, -1]
            courses = np.zeros((self.time.size, 2))
            courses[:, number] = {
                "face_offset": lambda: -np.ones(self.time.size),
                "face_lag": lambda: CubicSpline(self.time, self.faces[number])(self.time, 1),
                "face_depth": lambda: -inwards,
                "solar_gain": lambda: self.drive["irradiance"],
                "surface_film": lambda: inwards,
            }[name]()
            return self.response(faces=courses)
        x, warming = self.slab.centres, self.warming
        match name:
            case "clock_shift":
                return -self.changing[rows]
            case "layered_conductivity":
                return self.response(self._divergence(0.5 * _side(self.ends, p["interface"]) * self.flux))
            case "layered_capacity":
                return self.response(-0.5 * _side(self.slab.edges, p["interface"]) * warming)
            case "contact_resistance":
                # shared by the two edges beside it
                beyond = np.searchsorted(self.slab.edges, p["place"])
                low, high = self.slab.edges[beyond - 1 : beyond + 1]
                share = np.zeros(self.slab.edges.size)
                share[beyond] = (p["place"] - low) / (high - low)
                share[beyond - 1] = 1 - share[beyond]
                return self.response(self._divergence(-share * self.flux / self.slab.path))
            case "temperature_dependent_conductivity":
                return self.response(self._divergence((self.edge - self.T0) * self.flux))
            case "temperature_dependent_capacity":
                return self.response(-(self.inside - self.T0) * warming)
            case "phase_change":
                far = (self.inside - p["temperature"]) / MELTING_WIDTH
                return self.response(-np.exp(-0.5 * far**2) / MELTING_WIDTH / np.sqrt(2 * np.pi) * warming)
            case "diffusivity_drift":
                return self.response(day * warming)
            case "wetting":
                since = self.time[:, None] - p["time"]
                return self.response(
                    np.where(since < 0, 0.0, np.exp(-np.maximum(since, 0) / p["time_constant"])) * warming
                )
            case "heat_source":
                shape = np.ones(x.size)
                if p.get("place") is not None:
                    shape = np.exp(-0.5 * ((x - p["place"]) / (SOURCE_WIDTH * self.spec.length)) ** 2)
                gate = np.ones(self.time.size)
                if p.get("hours") is not None:
                    begin, end = p["hours"]
                    gate = ((self.drive["hour"] - begin) % 24 < (end - begin) % 24).astype(float)
                if "course" in p:
                    gate = self.drive[p["course"]]
                return self.response(np.outer(gate, shape))
            case "lateral_loss":
                return self.response(self.drive[f"air_{target}"][:, None] - self.inside)
            case "air_flow":
                return self.response(-(self.edge[:, 1:] - self.edge[:, :-1]) / self.slab.width)
        raise ValueError(f"unknown effect {name!r}")


def _side(edges, place):
    """-1 left and +1 right of a place, the mean between each two edges."""
    return np.clip((edges[1:] + edges[:-1] - 2 * place) / np.diff(edges), -1, 1)


def _rivals(spec: Spec, plain: _Plain):
    """Every effect with its targets; places, times, temperatures and hours on coarse grids."""
    for name in spec.names:
        for kind in ("position", "lag", "offset", "gain", "drift"):
            yield f"sensor_{kind}", name, {}
    yield "clock_shift", None, {}
    for side in ("left", "right"):
        for kind in ("face_offset", "face_lag", "face_depth", "surface_film", "solar_gain"):
            yield kind, side, {}
    for place in np.linspace(spec.positions[0], spec.positions[-1], 9)[1:-1]:
        yield "layered_conductivity", None, {"interface": place}
        yield "layered_capacity", None, {"interface": place}
        yield "contact_resistance", None, {"place": place}
    yield "temperature_dependent_conductivity", None, {}
    yield "temperature_dependent_capacity", None, {}
    levels = list(np.quantile(plain.inside, [0.1, 0.5, 0.9]))
    if plain.inside.min() < 0 < plain.inside.max():
        levels.append(0.0)
    for level in levels:
        yield "phase_change", None, {"temperature": level}
    yield "diffusivity_drift", None, {}
    for memory in (1.0, 4.0):
        for part in np.arange(8) / 8:
            yield "wetting", None, {"time": part * spec.days * DAY, "time_constant": min(memory, spec.days / 5) * DAY}
    for place in (None, *np.linspace(0.15, 0.85, 5) * spec.length):
        yield "heat_source", None, {"place": place}
    for place in (None, *np.array([0.25, 0.5, 0.75]) * spec.length):
        for begin in range(0, 24, 3):
            yield "heat_source", None, {"place": place, "hours": [begin, begin + 3]}
    yield "heat_source", None, {"course": "heating"}
    for air in ("outdoor", "indoor"):
        yield "lateral_loss", air, {}
    yield "air_flow", None, {}


def averaged(rows: np.ndarray, many: int) -> np.ndarray:
    """Means of `many` rows, sensor after sensor, (sensor x mean,)."""
    whole = rows[: len(rows) // many * many]
    return whole.reshape(-1, many, rows.shape[1]).mean(axis=1).T.ravel()


def _spectrum(kind: str, turn: np.ndarray) -> np.ndarray:
    """Power of noise of variance 1 at rad per row."""
    if kind == "mixed":
        return 0.5 * _spectrum("white", turn) + 0.5 * _spectrum("ar09", turn)
    memory = {"white": 0.0, "ar06": 0.6, "ar09": 0.9}[kind]
    return (1 - memory**2) / np.abs(1 - memory * np.exp(-1j * turn)) ** 2


def noise_covariance(spec: Spec, diffusivity: float, many: int) -> np.ndarray:
    """Of the readings' means over `many` rows, K^2 (W/m2 of a plate): their own noise, and the faces' through the wall.

    Stationary, from spectra: a face's noise, linear from row to row, goes through the slab's frequency response
    sinh(q (L - x)) / sinh(q L), q = sqrt(i omega / alpha); what it did before the first row is in the initial
    profile. A plate's response to a face is that of the sine series. Rounding of temperatures adds its variance, white.
    """
    count = spec.rows // many
    size = 2 ** int(np.ceil(np.log2(4 * spec.rows)))
    turn = 2 * np.pi * np.fft.fftfreq(size)
    turn[0] = 1e-9
    x = np.array(spec.positions)[:, None]
    response = np.zeros((2, len(spec.positions) + len(spec.plates), size), complex)
    for alias in range(-2, 3):
        omega = (turn + 2 * np.pi * alias) / spec.step
        q = np.sqrt(1j * omega / diffusivity)
        hold = np.sinc((turn + 2 * np.pi * alias) / (2 * np.pi)) ** 2
        for side, far in enumerate((x, spec.length - x)):
            decay = np.exp(-q * far) - np.exp(-q * (2 * spec.length - far))
            response[side, : len(x)] += hold * decay / (1 - np.exp(-2 * q * spec.length))
    for side, pulse in enumerate(np.eye(2) if spec.plates else ()):
        faces = np.zeros((size, 2))
        faces[1] = pulse
        flux = spec.conductivity / spec.length * fluxes(faces, spec.step, diffusivity / spec.length**2)
        one_row_later = np.fft.fft(flux[:, [("left", "right").index(plate) for plate in spec.plates]].T, axis=1)
        response[side, len(x) :] = one_row_later * np.exp(1j * turn)
    coloured, rounding = _spectrum(spec.noise, turn), spec.rounding**2 / 12
    at_face = spec.boundary_noise_std**2 * coloured + rounding
    at_reading = [spec.noise_std**2 * coloured + rounding] * len(spec.positions)
    at_reading += [spec.flux_noise_std**2 * coloured] * len(spec.plates)
    mean = np.abs(np.exp(1j * np.outer(np.arange(many), turn)).mean(axis=0)) ** 2
    lag = (np.arange(count)[:, None] - np.arange(count)) * many
    readings = len(at_reading)
    covariance = np.empty((readings * count, readings * count))
    for a in range(readings):
        for b in range(a + 1):
            power = (response[:, a] * response[:, b].conj()).sum(axis=0) * at_face + (a == b) * at_reading[a]
            block = np.fft.ifft(power * mean).real[lag]
            covariance[a * count : (a + 1) * count, b * count : (b + 1) * count] = block
            covariance[b * count : (b + 1) * count, a * count : (a + 1) * count] = block.T
    return covariance


class _Judge:
    """Whitened projections at the plain model's best fit to a record without noise."""

    def __init__(self, spec: Spec):
        spec = replace(spec, misplaced=False)
        self.spec, self.known = spec, clean(spec)
        self.many = int(np.ceil(spec.rows * len(spec.positions) / READINGS))
        self.data = self.known["readings"][:, 2:]
        start = self.known["diffusivity"]
        self.factor = cholesky(noise_covariance(spec, start, self.many), lower=True)
        alpha = start
        for _ in range(4):
            plain = _Plain(spec, alpha, self.known)
            free, gap = self._free(plain), self.white(self.data - self._fine(alpha))
            step = float(np.clip(np.linalg.lstsq(free, gap, rcond=None)[0][0], -0.7, 0.7))
            alpha *= np.exp(step)
            if abs(step) < 0.003:
                break
        self.plain, self.shift = plain, float(np.log(alpha / start))
        self.gap, self.basis = gap, np.linalg.qr(free)[0]
        self._columns = {}

    def _fine(self, alpha):
        """The plain model's readings between the record's faces, at the fine step."""
        drive = self.known["drive"] | {side: self.known["courses"][side] for side in ("left", "right")}
        wall = replace(self.spec, diffusivity=alpha, effects=())
        return temperatures(wall, drive, self.spec.positions)[self.known["rows"]]

    def white(self, rows):
        """Whitened means, with zeros for the priors."""
        means = solve_triangular(self.factor, averaged(rows, self.many), lower=True, check_finite=False)
        return np.concatenate([means, np.zeros(MODES + 2 * len(self.spec.positions))])

    def _free(self, plain):
        """Diffusivity, initial profile, positions and offsets, with a row for each prior."""
        sensors = len(self.spec.positions)
        columns = [self.white(column) for column in plain.free()]
        stds = [np.inf] + [PROFILE_STD] * MODES
        for kind, std in (("sensor_position", self.spec.position_std), ("sensor_offset", self.spec.offset_std)):
            for name in self.spec.names if std > 0 else ():
                columns.append(self.white(plain.derivative(kind, name, {})))
                stds.append(std)
        columns = np.array(columns).T
        first = len(columns) - MODES - 2 * sensors
        for number, std in enumerate(stds[1:], start=1):
            columns[first + number - 1, number] = 1 / std
        return columns

    def column(self, name, target, parameters):
        """An effect's whitened derivative."""
        key = (name, target, repr(sorted((k, v) for k, v in parameters.items() if k != _SIZES[name])))
        if key not in self._columns:
            self._columns[key] = self.white(self.plain.derivative(name, target, parameters))
        return self._columns[key]

    def judge(self, signals: Sequence[np.ndarray], own: Hidden, partners: Sequence[Hidden]) -> dict:
        """Squared signal-to-noise of signals: the smallest, without and with each rival projected out."""
        basis = self.basis
        if partners:
            extra = np.array([self.column(*partner) for partner in partners]).T
            basis = np.linalg.qr(np.hstack([basis, extra]))[0]
        rest = np.array([signal - basis @ (basis.T @ signal) for signal in signals])
        free = (rest**2).sum(axis=1)
        taken = {(own.name, own.target), *((partner.name, partner.target) for partner in partners)}
        names, columns = [], []
        for name, target, parameters in _rivals(self.spec, self.plain):
            if (name, target) not in taken:
                names.append((name, target))
                columns.append(self.column(name, target, parameters))
        columns = np.array(columns).T
        columns = columns - basis @ (basis.T @ columns)
        inner = rest @ columns
        # what the free parameters explain but for rounding is no rival
        norms = np.maximum((columns**2).sum(axis=0), 1e-12 * free.max() + 1e-300)
        positive = np.array([name in _POSITIVE for name, _ in names])
        drop = np.where(positive & (inner < 0), 0.0, inner**2 / norms)
        left = free[:, None] - drop
        signal, rival = np.unravel_index(np.argmin(left), left.shape)
        return {
            "free": float(free.min()),
            "rivals": float(max(left[signal, rival], 0.0)),
            "rival": list(names[rival]),
        }


def identifiability(spec: Spec) -> dict:
    """What a record could show of its hidden effects, whatever the method, by the benchmark's own projections.

    The squared signal-to-noise, with the true covariance of the noise (faces' through the wall), of what the
    effect adds to the inner readings, linear about the plain model's best fit. Projected out: diffusivity,
    eight sine modes of the initial profile, positions and offsets with their priors; then also each rival.
    Of the exact signal and the linear one the smaller counts, so that a record is not called clear because
    the effect's curvature alone tells it from a rival. In a pair every effect is judged with the other one's
    derivative projected out.

    **Returns:** `free`, and `rivals` (the smallest over all rivals); `rival` ([name, target]); `each` (the same
    keys with `name` and `target`, one for every hidden effect; `free` and `rivals` above are the smallest);
    `diffusivity_shift` (logarithm of the plain model's best over the true diffusivity).
    """
    if not spec.effects:
        return {"free": 0.0, "rivals": 0.0, "rival": None, "each": [], "diffusivity_shift": 0.0}
    judge = _Judge(spec)
    each = []
    for effect in spec.effects:
        partners = [other for other in spec.effects if other is not effect and other.name in EFFECTS]
        exact = judge.gap
        if len(spec.effects) > 1:
            exact = _Judge(replace(spec, effects=(effect,))).gap
        signals = [exact]
        if effect.name in EFFECTS:
            signals.append(judge.column(*effect) * effect.parameters[_SIZES[effect.name]])
        each.append({"name": effect.name, "target": effect.target} | judge.judge(signals, effect, partners))
    worst = min(each, key=lambda one: one["rivals"])
    return {
        "free": min(one["free"] for one in each),
        "rivals": worst["rivals"],
        "rival": worst["rival"],
        "each": each,
        "diffusivity_shift": judge.shift,
    }
