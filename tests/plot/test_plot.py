"""The figures as a person sees them: on plain Axes, nothing else set, each is complete and inside its figure."""

import inspect
import re
from dataclasses import replace
from importlib import resources
from itertools import pairwise
from unittest.mock import Mock

import matplotlib.pyplot as plt
import numpy as np
import pytest
from axes import check_complete
from legend_overlap import lines_in_legend
from matplotlib.colors import to_rgb
from matplotlib.dates import date2num
from own_case import write_own

import wallid
from wallid import plot
from wallid.case.initial_profile import fit_profile
from wallid.case.time_window import Window
from wallid.case.wall_and_sensors import Layer
from wallid.estimation.heat_flux import ThermalProperties
from wallid.estimation.prediction import HeatLoads, Prediction
from wallid.estimation.result_objects import Estimate
from wallid.experiment_design.sampling_step import SamplingComparison
from wallid.experiment_design.window_lengths import LengthComparison
from wallid.experiment_design.window_selection import Design
from wallid.plot import house_style as _style
from wallid.plot.legends import shortened

LONG = "north_facade_inner_thermocouple_3b"
MARKS = {name: getattr(plot, name) for name in ("BLUE", "ORANGE", "GREEN", "PURPLE", "SKY", "RED", "GREY")}

# Machado, Oliveira and Fernandes, A physiologically-based model for simulation of color vision deficiency, IEEE
# Transactions on Visualization and Computer Graphics 15 (2009) 1291, table 1 at full severity; on linear RGB
MACHADO = {
    "normal": np.eye(3),
    "protanopia": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "tritanopia": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.303900],
    ],
}


def _linear(colour):
    rgb = np.array(to_rgb(colour))
    return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)


def _lab(linear):
    """CIE 1976 L*a*b* under D65, by the standard's definition."""
    to_xyz = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    x = to_xyz @ np.clip(linear, 0, 1) / [0.9505, 1.0, 1.0890]
    f = np.where(x > (6 / 29) ** 3, np.cbrt(x), x / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def _contrast(one, other):
    dark, light = sorted(float(_linear(tint) @ [0.2126, 0.7152, 0.0722]) for tint in (one, other))
    return (light + 0.05) / (dark + 0.05)


def test_lines_and_marks_stand_out_on_white_and_on_the_dark_page():
    """WCAG 2.2, 1.4.11: 3:1 on white; on the dark page, which has its own colours, 4.5:1 as for text."""
    template = resources.files("wallid.report").joinpath("templates/head.html").read_text("utf-8")
    white, dark = re.findall(r"--paper: (#\w{6})", template)
    assert _style.contrast("black", "white") == pytest.approx(21.0)
    for name, tint in MARKS.items():
        assert _style.contrast(tint, white) == pytest.approx(_contrast(tint, white))
        assert _contrast(tint, white) >= 3.0, name
        assert _contrast(_style.DARK[tint], dark) >= 4.5, name


@pytest.mark.parametrize("page", ["light", "dark"])
@pytest.mark.parametrize("vision", MACHADO)
def test_every_kind_of_colour_vision_tells_the_colours_apart(vision, page):
    """By 19 units of L*a*b*; what is just seen is some 2.3 (Mahy, Van Eycken and Oosterlinck, 1994)."""
    shown = {name: tint if page == "light" else _style.DARK[tint] for name, tint in MARKS.items()}
    seen = {name: _lab(np.asarray(MACHADO[vision]) @ _linear(tint)) for name, tint in shown.items()}
    for name, one in seen.items():
        for other, two in seen.items():
            assert name == other or np.linalg.norm(one - two) > 19.0, (name, other)


def test_two_dozen_sensors_differ_in_line_and_mark():
    for look in (_style.line_style, _style.marker_style):
        assert len({tuple(look(sensor).values()) for sensor in range(24)}) == 24
        looks = [tuple(look(sensor).values()) for sensor in range(24)]
        # next to each other in both signs
        assert all(one[0] != two[0] and one[1] != two[1] for one, two in pairwise(looks))
    assert not {*_style.FACE_COLOURS} & {*plot.SENSOR_COLOURS}


def test_a_long_name_keeps_both_its_ends():
    assert shortened("T1") == "T1"
    assert len(shortened(LONG)) == 18 and shortened(LONG)[:5] == "north" and shortened(LONG)[-2:] == "3b"
    assert shortened(LONG) != shortened(LONG.replace("3b", "4b"))


@pytest.fixture(scope="module")
def case():
    return wallid.load("saint_julien")


def _with_sensors(case, count):
    """The case with so many sensors, the third of a long name, and layers, two of them thin."""
    names = [f"P{k + 1}" if k != 2 else LONG for k in range(count)]
    share = np.arange(1, count + 1) / (count + 1)
    sensors = tuple(
        replace(case.sensors[0], name=name, position=case.wall.length * x) for name, x in zip(names, share, strict=True)
    )
    left, right = case.record.faces.T
    values = left[:, None] * (1 - share) + right[:, None] * share
    layers = (Layer(0.015, 0.7, 1.4e6), Layer(case.wall.length - 0.027, 1.2, 1.6e6), Layer(0.012, 0.3, 1.1e6))
    return replace(
        case,
        sensors=sensors,
        record=replace(case.record, sensors=values, names=tuple(names)),
        wall=replace(case.wall, layers=layers),
    )


def _fit(case):
    window = Window(168, 72)
    predicted = case.record.sensors[168:240]
    history = {"diffusivity": np.array([3e-7, 9e-7, 1e-6, 1e-6]), "gamma_1": np.array([0, 1, 0.1, 1e-8])}
    return Estimate(
        value=1e-6, std=2.5e-8, interval_95=(0.9e-6, 1.1e-6), offsets={}, message="", reliable=True, reason="",
        iterations=2, evaluations=3, history=history | {"gamma_2": np.array([0, 1, 0.2, 1e-6])}, rounds=1,
        reduced_chi_square=1.0, predicted=predicted, residual=0.1 * np.sin(predicted), covariance=np.eye(1),
        singular_values=np.ones(1), model_shift=0.0, profile=fit_profile(case, 10), model_description="", window=window,
    )  # fmt: skip


def _reliability(case):
    days, measured = np.asarray(case.record.time) / 86400.0, case.record.sensors
    rng = np.random.default_rng(1)
    noise = rng.normal(0.0, 0.1, measured.shape)
    sigma = rng.uniform(0.1, 0.4, measured.shape)
    return Prediction(days, case.record.names, measured, measured + 5 * noise, measured + noise, sigma, 0.1, None)


DESIGN = Design(
    rows=72, starts=24 * np.arange(20), diffusivities=(2e-7, 5e-7, 1e-6, 2e-6),
    information=np.random.default_rng(0).uniform(0.1, 1.0, (4, 20)), best=Window(24, 72), restart=True, step=3600.0,
    labels=("", ""),
)  # fmt: skip
LENGTHS = LengthComparison(np.array([1.0, 2.0, 3.0]), np.array([0.2, 0.6, 1.0]), np.array([4e-4, np.nan, 5e-4]))
SAMPLING = SamplingComparison(
    steps=np.array([900.0, 3600.0, 7200.0]), rows=np.array([400, 100, 50]), std=np.array([0.01, 0.02, 0.03]),
    interpolation_bias=np.array([0.0, 0.0, 0.002]), record_step=3600.0, diffusivity=1e-6, labels=("", ""),
)  # fmt: skip

DRAWN = {
    "wall": lambda ax, case: plot.wall(case, ax=ax),
    "record": lambda ax, case: plot.record(case, Window(168, 72), ax=ax),
    "coverage": lambda ax, case: plot.data_availability(case, ax=ax),
    "theta": lambda ax, case: plot.sensitivity(case, np.arange(40.0), case.record.sensors[:40], ax=ax),
    "criterion": lambda ax, case: plot.criterion(DESIGN, ax=ax),
    "compromise": lambda ax, case: plot.window_lengths(LENGTHS, ax=ax),
    "sampling": lambda ax, case: plot.sampling_steps(SAMPLING, ax=ax),
    "convergence": lambda ax, case: plot.convergence(_fit(case), axes=(ax, plt.subplots()[1])),
    "stopping criteria": lambda ax, case: plot.convergence(_fit(case), axes=(plt.subplots()[1], ax)),
    "measured against simulated": lambda ax, case: plot.measured_against_simulated(case, _fit(case), ax=ax),
    "residual": lambda ax, case: plot.residual(case, _fit(case), ax=ax),
    "profile": lambda ax, case: plot.initial_profile(case, Window(168, 72), ax=ax),
    "last week": lambda ax, case: plot.last_week(_reliability(case), 2, ax=ax),
    "density": lambda ax, case: plot.residual_density(_reliability(case), 2, ax=ax),
    "uncertainty": lambda ax, case: plot.measurement_uncertainty(_reliability(case), ax=ax),
}


@pytest.fixture
def ax():
    """As a reader's notebook has them: matplotlib's own style and size."""
    with plt.rc_context(plt.rcParamsDefault):
        yield plt.subplots()[1]
    plt.close("all")


@pytest.mark.parametrize("count", [3, 8, 24])
@pytest.mark.parametrize("name", DRAWN)
def test_a_figure_on_plain_axes_is_complete(ax, case, name, count):
    DRAWN[name](ax, case if count == 3 else _with_sensors(case, count))
    check_complete(ax)
    legend, frame = ax.get_legend().get_window_extent(), ax.get_window_extent()
    label = ax.xaxis.label.get_window_extent()
    assert not legend.overlaps(label), "the legend hides the label"
    assert frame.width > 0.6 * ax.get_figure().bbox.width and frame.height > 0.35 * ax.get_figure().bbox.height


@pytest.mark.parametrize("name", ["flux", "loads"])
def test_a_figure_of_one_curve_is_complete(ax, case, name):
    factors = np.array([0.8, 0.9, 1.0, 1.1, 1.2])
    loads = HeatLoads(np.sin(np.arange(len(case.record.time))), factors, 1e6 * factors, 1.0)
    prediction = replace(_reliability(case), loads=loads)
    plot.heat_load(loads, ax=ax) if name == "loads" else plot.inner_face_flux(prediction, ax=ax)
    check_complete(ax, legend=False)


def test_curves_keep_clear_of_their_legend(ax, case):
    """Room is made for as many rows as there are, by what they measure."""
    plot.record(_with_sensors(case, 8), ax=ax)
    ax.get_figure().canvas.draw()
    legend = ax.get_legend().get_window_extent()
    highest = max(ax.transData.transform((0.0, np.nanmax(line.get_ydata())))[1] for line in ax.lines)
    assert highest <= legend.y0 + 1.0


@pytest.mark.parametrize("count", [3, 8])
@pytest.mark.parametrize("name", DRAWN)
def test_no_line_runs_through_a_legend(ax, case, name, count):
    DRAWN[name](ax, case if count == 3 else _with_sensors(case, count))
    assert not lines_in_legend(ax)


def test_the_start_of_the_gls_fit_is_not_named_on_a_curve(ax, case):
    """A convergence that falls to the right, where a legend at the lower right would lie on it."""
    history = {"diffusivity": np.concatenate([np.full(60, 3e-5), np.full(40, 2e-6)])}
    gammas = {name: np.full(100, 1e-3) for name in ("gamma_1", "gamma_2")}
    other = plt.subplots()[1]
    plot.convergence(replace(_fit(case), history=history | gammas, iterations=60), axes=(ax, other))
    assert ax.get_legend() is not None and not lines_in_legend(ax) and not lines_in_legend(other)


def test_a_constant_uncertainty_is_not_named_on_its_line(ax, case):
    """A vertical line at the left, where a legend above the curves would lie."""
    whole = _reliability(case)
    plot.measurement_uncertainty(replace(whole, sigma=np.full(whole.sigma.shape, 0.08)), ax=ax)
    assert len(ax.lines) == 3 and not lines_in_legend(ax)
    check_complete(ax)


def test_a_prediction_without_heat_loads_is_refused(case):
    with pytest.raises(ValueError, match="state the conductivity"):
        plot.inner_face_flux(_reliability(case))


def _drawing_functions():
    """The functions of the package that draw a panel."""
    functions = [getattr(plot, name) for name in plot.__all__ if inspect.isfunction(getattr(plot, name))]
    return [function for function in functions if function.__annotations__.get("return") == "Axes"]


def test_every_panel_takes_its_axes_by_name_or_makes_its_own():
    functions = {function.__name__: inspect.signature(function).parameters for function in _drawing_functions()}
    helpers = {"colour_limit", "figure", "flux_interval", "reading_interval", "regressor_quantities", "residual_scale",
               "sensor_colour", "shared_colour_bar", "shared_legend", "style"}  # fmt: skip
    others = {name for name in plot.__all__ if inspect.isfunction(getattr(plot, name))} - set(functions)
    assert others == helpers | {"convergence"}
    for name, parameters in functions.items():
        assert parameters["ax"].kind is inspect.Parameter.KEYWORD_ONLY and parameters["ax"].default is None, name


@pytest.mark.parametrize("name", [name for name in DRAWN if name not in ("convergence", "stopping criteria")])
def test_a_panel_is_returned(ax, case, name):
    """The given Axes, or those of a new figure in the style of the package; pyplot knows it, so a notebook shows it."""
    assert DRAWN[name](ax, case) is ax
    made = DRAWN[name](None, case)
    assert made is not ax and made.get_figure().number in plt.get_fignums()
    assert not made.spines["top"].get_visible() and ax.spines["top"].get_visible()


def test_the_two_panels_of_a_convergence_are_returned(ax, case):
    other = plt.subplots()[1]
    assert plot.convergence(_fit(case), axes=(ax, other)) == (ax, other)
    made = plot.convergence(_fit(case))
    assert len(made) == 2 and made[0].get_figure() is made[1].get_figure()
    with pytest.raises(ValueError, match="axes: 1 were given; two are needed"):
        plot.convergence(_fit(case), axes=[ax])


def test_each_sensor_looks_the_same_in_every_figure(case):
    """By colour and a second sign, lines or marks."""
    many = _with_sensors(case, 8)
    for name in ("record", "theta", "measured against simulated", "residual"):
        _, ax = plt.subplots()
        DRAWN[name](ax, many)
        lines = {line.get_label().split(" at ")[0]: line for line in ax.lines}
        for s, sensor in enumerate(many.sensors):
            line = lines[shortened(sensor.name)]
            assert line.get_color() == plot.sensor_colour(s), name
            own = plt.Line2D([], [], **_style.line_style(s))
            assert line.get_linestyle() == own.get_linestyle(), name
        plt.close("all")


def test_the_wall_says_what_each_layer_is_made_of(ax, case):
    many = _with_sensors(case, 8)
    plot.wall(many, ax=ax)
    ax.get_figure().canvas.draw()
    told = [text.get_text() for text in ax.get_legend().get_texts()]
    assert told[0] == "1: 1.5 cm, 0.7 W/m/K, 1.4 MJ/m³/K, 5 × 10⁻⁷ m²/s"
    assert told[-1] == "sensors, ± 1 standard deviation of the position"
    begin, thin = 0.0, 0
    for count, layer in enumerate(many.wall.layers):
        (number,) = [text for text in ax.texts if text.get_text() == str(count + 1)]
        left, right = ax.transData.transform([(100 * begin, 0), (100 * (begin + layer.thickness), 0)])[:, 0]
        extent = number.get_window_extent()
        faces = ax.transData.transform([(0.0, 0), (100 * many.wall.length, 0)])[:, 0]
        assert faces[0] < extent.x0 and extent.x1 < faces[1]
        inside = left <= extent.x0 and extent.x1 <= right
        assert inside or number.arrow_patch is not None
        thin += not inside
        begin += layer.thickness
    assert thin == 2


def test_a_masked_reading_of_a_plate_is_seen(ax, tmp_path):
    """The file's column has another name than the case's key."""
    heat = np.round(np.sin(np.arange(240) / 5.0), 3).astype(object)
    heat[30] = "door open"
    right = 'right = "right"'
    case = wallid.load(write_own(tmp_path, columns={"q_in": heat}, **{right: f'{right}\nflux_right = "q_in"'}))
    plot.data_availability(case, ax=ax)
    (mark,) = [line for line in ax.lines if line.get_marker() == "|" and len(line.get_xdata())]
    np.testing.assert_allclose(mark.get_xdata(), date2num(case.record.stamps[30]))
    assert set(mark.get_ydata()) == {3}


def test_single_missing_readings_are_seen(ax, case):
    """Two cells without a reading in months, and a face's that was interpolated: as wide as a line."""
    values, fill = case.record.sensors.copy(), np.zeros((case.record.rows, 2))
    values[[900, 1500], 0], fill[500, 0] = np.nan, 0.1
    plot.data_availability(replace(case, record=replace(case.record, sensors=values, fill_std=fill)), ax=ax)
    days = date2num(case.record.stamps)
    marks = [line for line in ax.lines if line.get_marker() == "|" and len(line.get_xdata())]
    (mark,) = marks
    np.testing.assert_allclose(mark.get_xdata(), days[[900, 1500]])
    assert set(mark.get_ydata()) == {2} and mark.get_color() == "#000000"
    told = [text.get_text() for text in ax.get_legend().get_texts()]
    assert told == ["readings", "interpolated", "single reading missing or masked"]
    widths = [np.ptp(path.vertices[:, 0]) for bars in ax.collections for path in bars.get_paths()]
    assert min(widths) * ax.get_window_extent().width / (days[-1] - days[0]) > 1.0


def test_simulated_flux_is_seen_over_the_measured(ax, case):
    """A thin dark line on bright dots; they differ in colour, and one is a line, the other are dots."""
    faces = replace(case.record, regressors={"flux_left": np.sin(np.arange(case.record.rows))})
    fit = _fit(case)
    fit = replace(
        fit,
        predicted=np.column_stack([fit.predicted, faces.regressors["flux_left"][168:240]]),
        residual=np.zeros((72, 4)),
        thermal=Mock(spec=ThermalProperties, plate_gains={"left": (0.0, 0.1)}, conductivity=Mock(value=1.0, std=0.05)),
    )
    plot.measured_flux(replace(case, record=faces), fit, 0, ax=ax)
    lines = {line.get_label(): line for line in ax.lines}
    assert ax.lines.index(lines["simulated"]) > ax.lines.index(lines["measured"])
    assert lines["measured"].get_linestyle() == "None" and lines["measured"].get_marker() == "o"
    assert lines["simulated"].get_linestyle() == "-" and lines["simulated"].get_marker() == "None"
    assert lines["measured"].get_markersize() > 3 * lines["simulated"].get_linewidth()
    assert lines["simulated"].get_color() != lines["measured"].get_color()
    check_complete(ax)


def test_only_lengths_that_were_timed_have_a_cost(ax):
    plot.window_lengths(LENGTHS, ax=ax)
    (cost,) = [other for other in ax.get_figure().axes if other is not ax]
    np.testing.assert_allclose(cost.lines[0].get_xdata(), [1.0, 3.0])
    assert "nan" not in str(LENGTHS)


@pytest.mark.parametrize(
    ("name", "label"),
    [
        ("criterion", "relative criterion (-)"),
        ("compromise", "relative criterion (-)"),
        ("stopping criteria", "relative change (-)"),
        ("sampling", "error of the diffusivity (%)"),
    ],
)
def test_an_ordinate_names_its_quantity_and_unit(ax, case, name, label):
    DRAWN[name](ax, case)
    assert ax.get_ylabel() == label


def test_an_estimate_that_begins_at_its_minimum_is_drawn_as_one_that_stands(ax, case):
    """Not as a climb of 1e-12 over an offset that nobody reads."""
    fit = _fit(case)
    history = fit.history | {"diffusivity": fit.value * (1 + 1e-12 * np.arange(len(fit.history["diffusivity"])))}
    plot.convergence(replace(fit, history=history), axes=(ax, plt.subplots()[1]))
    ax.get_figure().canvas.draw()
    low, high = ax.get_ylim()
    assert high - low > 1e-3 * fit.value and low < fit.value < high
    assert len({label.get_text() for label in ax.get_yticklabels()}) > 2
