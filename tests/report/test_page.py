"""The report: one page, nothing fetched, every figure with its alternative, every number there."""

import base64
import json
import re
from dataclasses import replace
from html import unescape
from importlib import resources
from io import BytesIO
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.colors import ListedColormap
from pages import check, drawings

import wallid
from wallid import plot, workflow
from wallid._internal.number_formats import format_number, format_quantity, format_text
from wallid.case.initial_profile import fit_profile
from wallid.case.record_check import check as check_record
from wallid.case.time_window import Window
from wallid.estimation.result_objects import Estimate
from wallid.models.window_inputs import full_order_model
from wallid.plot.house_style import DARK, KEEP_COLOUR
from wallid.reduction.modal_identification import LearnedModel
from wallid.report import captions, svg
from wallid.report import writer as report
from wallid.report.captions import alternative_text, figure_caption
from wallid.report.figures import STEMS, encode_figure
from wallid.report.page import answer, render_page
from wallid.report.settings import settings_tables
from wallid.report.svg import draw_figure
from wallid.report.tables import number_tables
from wallid.workflow import Run


@pytest.fixture(scope="module")
def run():
    """A run that has read its case and gone no further: nothing is compiled for it."""
    return Run(wallid.load("saint_julien"), seconds={"design": 1.25})


@pytest.fixture(scope="module")
def fit(run):
    """An estimate that nothing was computed for."""
    rows = 30
    predicted = np.tile(np.linspace(5.0, 9.0, rows)[:, None], (1, 3))
    return Estimate(
        value=1e-6, std=2.5e-8, interval_95=(0.9e-6, 1.1e-6), offsets={}, message="", reliable=True, reason="",
        iterations=0, evaluations=0, history={"diffusivity": np.array([2.8e-7, 1e-6])}, reduced_chi_square=1.0,
        predicted=predicted, residual=0.1 * predicted, covariance=np.eye(1), singular_values=np.ones(1),
        model_shift=0.0, profile=fit_profile(run.case, 10), model_description="", window=Window(10, rows),
    )  # fmt: skip


@pytest.fixture(scope="module")
def written(run, tmp_path_factory):
    folder = tmp_path_factory.mktemp("out")
    report.write_report(run, folder, "wallid design saint_julien")
    return folder / "report.html"


def test_a_page_is_whole_and_fetches_nothing(written):
    found = check(written.read_text("utf-8"))
    assert [image["alt"].split()[0] for image in found.images] == ["Section", "Temperatures"]
    assert "wallid design saint_julien" in found.text and "Synthetic twin" in found.text


def test_what_a_case_says_is_text_and_not_markup(run):
    """A name from a file goes through the template's escaping."""
    case = replace(run.case, name="<script>alert(1)</script>", description="a & b")
    text = render_page(Run(case), report.result_entries(Run(case)), [])
    assert "<script>alert" not in text and "&lt;script&gt;" in text and "a &amp; b" in text


def test_every_number_is_in_a_table():
    result = {
        "schema": 1,
        "diffusivity": {"value": 1.06e-6, "std": 1.2e-8, "interval_95": [1.04e-6, 1.08e-6], "unit": "m2/s"},
        "verdict": None,
        "effects": [{"name": "solar_gain", "target": "right", "parameters": {}, "gain": 790.0, "alternatives": []}],
        "gap": {"before_K": 0.3125, "held_out_after_K": None},
        "record": {"step_s": 600.0, "missing": {"T_s": 3}},
        "history": {"diffusivity": [2e-7, 1e-6], "cost": [50.0, 3.0]},
        "identifiability": {"parameters": ["a", "b"], "correlations": [[1.0, 0.25], [0.25, 1.0]]},
        "orders": [{"order": 2, "eps_inf_u": 0.5}, {"order": 4, "eps_inf_u": 0.01}],
        "plate_gains": {"flux_left": {"value": 0.05, "std": 0.01, "unit": "-"}},
        "iso_9869": {"flux_left": {"resistance": 0.4, "unit": "m2 K/W", "days": 3.0}},
        "loads": {"conductivity": 1.75},
    }
    found = {table.title: table for table in number_tables(result)}
    assert found["overview"].rows == [
        ("version of result.json's format", "1"),
        ("diffusivity", "(1.060 ± 0.012) × 10⁻⁶ m²/s (95 %: 1.040 × 10⁻⁶ to 1.080 × 10⁻⁶)"),
        ("verdict on missing effects", "not requested (wallid diagnose)"),
    ]
    assert ("solar gain of right gain (decrease of −2 log L)", "790") in found["identified effects"].rows
    gap = found["residual at the inner sensors (root mean square)"]
    assert gap.head == ("quantity", "value")
    assert gap.rows == [("plain model (K)", "0.3125"), ("on days left out of the fit, final model (K)", "–")]
    record = found["record"].rows
    assert record == [("step (s)", "600"), ("readings missing T s", "3")], "a column's name is no unit"
    steps = found["convergence of the estimate, step by step"]
    assert steps.head == ("diffusivity (m²/s)", "cost") and steps.rows == [("2 × 10⁻⁷", "50"), ("1 × 10⁻⁶", "3")]
    matrix = found["identifiability: correlations of the parameters"]
    assert matrix.head == ("", "a", "b") and matrix.rows == [("a", "1", "0.25"), ("b", "0.25", "1")]
    errors = found["error of the reduced-order model by order (dimensionless)"]
    assert errors.head[0] == "order" and errors.rows == [("2", "0.5"), ("4", "0.01")]
    assert found["calibration errors of the flux plates (relative)"].rows == [("flux left", "0.050 ± 0.010")]
    iso = found["average method (ISO 9869-1)"]
    assert iso.head == ("", "resistance (m² K/W)", "days") and iso.rows == [("flux left", "0.4", "3")]
    assert found["heat load through the inner face"].rows == [("conductivity (W/m/K)", "1.75")]


def test_sizes_by_window_are_a_table_and_their_agreement_a_number():
    windows = {"days": [1.0, 2.0], "size": [None, 3.0], "std": [None, 0.5], "p_value": None}
    effect = {"name": "sensor_lag", "target": "T1", "gain": 9.0, "windows": windows}
    found = {table.title: table for table in number_tables({"effects": [effect]})}
    assert ("sensor lag of T1 windows p-value", "–") in found["identified effects"].rows
    (sizes,) = (table for title, table in found.items() if "windows" in title)
    assert sizes.rows == [("1", "–", "–"), ("2", "3", "0.5")]


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (None, "–"),
        (True, "yes"),
        (3, "3"),
        (-0.5, "−0.5"),
        (86430.0, "86430"),
        (-2.5e-7, "−2.5 × 10⁻⁷"),
        ([], "none"),
        ({}, "none"),
        ([1.0, 2.0], "1, 2"),
    ],
)
def test_a_number_as_a_person_reads_it(value, said):
    assert format_number(value) == said


def test_a_value_has_no_digits_past_its_uncertainty():
    assert format_quantity({"value": -3.39e-7, "std": 0.00118, "unit": "m"}) == "0.0 ± 1.2 mm"
    assert format_quantity({"value": 1.10095e-6, "std": 2.57e-8, "unit": "m2/s"}) == "(1.101 ± 0.026) × 10⁻⁶ m²/s"


def test_prose_has_the_powers_and_units_of_a_person():
    told = "1.166e-06 +- 3e-09 m2/s at 0.4354 m2 K/W, 20 degC; m2_sensor and case-2e stay"
    assert format_text(told) == "1.166 × 10⁻⁶ ± 3 × 10⁻⁹ m²/s at 0.4354 m² K/W, 20 °C; m2_sensor and case-2e stay"


def drawing(run, drawn_by, stem="wall"):
    """A figure as the page holds it, after it has been drawn into a file as in every run."""
    made, ax = plot.figure()
    drawn_by(ax)
    made.savefig(BytesIO(), format="png")
    page_ = check(render_page(run, report.result_entries(run), [draw_figure(stem, made)]))
    return drawings(page_)[-1]


def test_no_tick_of_a_logarithmic_axis_stays_black(run):
    """Neither said nor left unsaid: matplotlib makes some ticks only while it draws, and writes no black."""

    def logarithmic(ax):
        ax.loglog([3e-7, 2e2], [1e-3, 4e5], "ko-")
        ax.set(title="title", xlabel="x", ylabel="y")
        ax.tick_params(which="minor", labelsize=5, labelbottom=True)

    svg = drawing(run, logarithmic)
    assert svg.count("stroke: var(--ink)") > 40


def test_letters_on_a_ground_of_their_own_keep_their_colour(run):
    def cells(ax):
        ax.pcolormesh([[0.1, 0.9]], cmap="cividis")
        ax.text(0.5, 0.5, "dark", color="white", gid=KEEP_COLOUR)
        ax.text(1.5, 0.5, "bright", color="black", gid=KEEP_COLOUR)

    svg = drawing(run, cells)
    assert svg.count('"fill: #ffffff"') == svg.count('"fill: #000"') == 1
    assert KEEP_COLOUR not in svg


def test_names_on_the_wall_are_read_on_its_own_colour(run):
    svg = drawing(run, lambda ax: plot.wall(run.case, ax=ax))
    assert svg.count('"fill: #000"') == len(run.case.sensors), "each sensor's name, black on sand"


def test_the_dark_page_has_colours_of_its_own(run):
    """Every colour of the figures is a variable of the style sheet: one value on white, one on the dark page."""

    def lines(ax):
        for k, colour in enumerate(DARK):
            ax.plot([0, 1], [k, k + 1], color=colour)

    svg = drawing(run, lines)
    sheet, _, drawn = svg.partition("</style>")
    light, _, dark = sheet.partition("@media screen and (prefers-color-scheme:dark)")
    dark, _, paper = dark.partition("@media print")
    for colour, other in DARK.items():
        name = re.search(rf"--(mark\d):{colour};?", light)[1]
        assert f"--{name}:{other}" in dark and f"--{name}:{colour}" in paper
        assert f"stroke: var(--{name})" in drawn and colour.lower() not in drawn


def test_marks_on_a_ground_of_their_own_keep_their_colour(run):
    """Sensors and the errors of their positions stand on sand on every page."""
    svg = drawing(run, lambda ax: plot.wall(run.case, ax=ax)).partition("</style>")[2]
    for s in range(len(run.case.sensors)):
        colour = plot.sensor_colour(s)
        assert f"fill: {colour.lower()}" in svg.lower(), "the mark"
        assert f"stroke: {colour.lower()}" in svg.lower(), "the error bar"


def test_pixels_have_the_colours_of_the_dark_page_too(run):
    """A thousand dots are an image; the dark page shows a second one, in its colour."""
    svg = drawing(run, lambda ax: ax.plot(np.arange(1000), np.sin(np.arange(1000.0)), "o", color=plot.BLUE))
    sheet, _, drawn = svg.partition("</style>")
    assert ".on-dark{display:none}" in sheet and ".on-light{display:none}.on-dark{display:inline}" in sheet
    found = {}
    for which, encoded in re.findall(
        r'<image class="on-(light|dark)" xlink:href="data:image/png;base64,\s*([^"]+)"', drawn
    ):
        pixels = mpl.image.imread(BytesIO(base64.b64decode(encoded)), format="png")
        (found[which],) = {tuple(pixel[:3]) for pixel in np.round(255 * pixels[pixels[..., 3] == 1.0]).astype(int)}
    shown = {which: "#{:02X}{:02X}{:02X}".format(*colour) for which, colour in found.items()}
    assert shown == {"light": plot.BLUE, "dark": DARK[plot.BLUE]}
    assert drawn.count(' id="image') <= 1, "an id occurs once"


def test_a_map_keeps_its_colours(run):
    """Red and blue mean warm and cold in its colour bar, whatever the page."""
    svg = drawing(run, lambda ax: ax.pcolormesh([[0.0, 1.0]], cmap=ListedColormap([plot.RED, plot.BLUE])))
    assert "<image" in svg and "<image class" not in svg


def test_a_light_grey_band_lets_the_page_through(run):
    svg = drawing(run, lambda ax: ax.fill_between([0, 1], [0, 0], [1, 1], color="0.85", lw=0))
    assert "fill: var(--ink); fill-opacity: 0.15" in svg


def test_the_first_lines_name_the_quantity_and_whether_the_model_fits(run, fit):
    """A stranger reads what the number is, and from which sizes it is told that something is missing."""
    found = Run(run.case, fit=fit)
    result = report.result_entries(found) | {"reliability": {"rms_K": 0.2, "noise_K": 0.1}}
    text = render_page(found, result, [])
    first = text[text.index("<main") : text.index("<nav")]
    assert "Diffusivity" in first and "(1.000 ± 0.025) × 10⁻⁶ m²/s" in first and "e-0" not in first
    assert (
        "residual is 0.2 K. The stated sensor noise explains only 0.1 K" in unescape(first)
        and "wallid diagnose" in first
    )
    result["reliability"]["rms_K"] = 0.11
    assert "The stated sensor noise of 0.1 K explains it" in answer(found, result)


def test_answer_certainty_and_next_step_are_in_the_first_box(run, fit):
    """What a person reads without scrolling, before any figure."""
    found = Run(run.case, fit=fit)
    text = unescape(render_page(found, report.result_entries(found), []))
    box = text[text.index('<section class="answer') : text.index("</section>")]
    assert "(1.000 ± 0.025) × 10⁻⁶ m²/s" in box and "95 %: 0.900 × 10⁻⁶ to 1.100 × 10⁻⁶" in box
    assert "<strong>Next:</strong> Use the value; <code>wallid diagnose</code> tests" in box and "`" not in box
    assert "With the stated conductivity" not in box and "With the stated conductivity" in text
    unknown = replace(run.case, wall=replace(run.case.wall, conductivity=None, heat_capacity=None))
    found = Run(unknown, fit=fit)
    text = render_page(found, report.result_entries(found), [])
    assert "Materials with such a diffusivity" in text and "With the stated" not in text


@pytest.mark.filterwarnings("ignore:Glyph")  # no font has every sign
def test_names_with_any_characters_give_well_formed_files(run, fit, tmp_path):
    """Control characters, half of a surrogate pair, markup, a formula and an emoji in the names of columns."""
    names = ("T\x07", "\ud83d", "<&>--$\\frac$\U0001f525")
    sensors = tuple(replace(one, name=name) for one, name in zip(run.case.sensors, names, strict=True))
    record = replace(run.case.record, names=names)
    case = replace(run.case, name="a\x1b $x$ \udfff", sensors=sensors, record=record)
    history = {name: np.array([1e-6, 1e-7]) for name in ("diffusivity", "gamma_1", "gamma_2")}
    found = Run(case, fit=replace(fit, history=history), check=check_record(case))
    for path in report.write_report(found, tmp_path, "wallid run x", formats=("svg", "png", "pdf")):
        if path.suffix == ".svg":
            ElementTree.fromstring(path.read_bytes())
    text = (tmp_path / "report.html").read_text("utf-8")
    for drawn in drawings(check(text)):
        ElementTree.fromstring(drawn)
    assert not re.search("[\x00-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff]", text)
    assert "T\ufffd" in text and "&lt;&amp;&gt;--" in text and "\U0001f525" in text
    numbers = json.loads((tmp_path / "result.json").read_text("utf-8"))
    assert set(names) <= set(numbers["record"]["missing"]), "the names of the record, for programs"


def test_settings_are_shown_as_used(run):
    found = {table.title: table for table in settings_tables(run.case)}
    assert ("length (m)", "0.43") in found["[wall]"].rows and ("boundary_noise_std (K)", "0.1") in found[
        "[record]"
    ].rows
    assert found["[[sensor]]"].rows[0] == ("T1", "0.05", "0.02", "0.1", "0")
    assert ("noise", "estimated") in found["[choices]"].rows


def test_only_what_is_shown_is_told(run, fit):
    """The window is shaded where there is one; a check's yellow is another."""
    assert "shaded" not in alternative_text("record", run) and "band" not in figure_caption("record", run)
    found = Run(run.case, fit=fit)
    assert "shaded" in alternative_text("record", found) and "yellow band" in figure_caption("record", found)
    checked = Run(run.case, check=check_record(run.case))
    assert "Orange: interpolated face temperatures" in figure_caption("record", checked)
    learned = LearnedModel(full_order_model(run.case), (1e-4, 2e-3), (1e-3, 2e-2), 1.0, 1)
    assert "order 99: 1.0 × 10⁻³ (temperature), 2.0 × 10⁻² (sensitivity)" in alternative_text(
        "orders", Run(run.case, orders=[learned])
    )


def test_orders_tried_on_the_way_are_told(run, monkeypatch):
    """What "auto" goes through is an error against order that costs nothing more."""
    tried = LearnedModel(full_order_model(run.case), (1e-4, 2e-3), (1e-3, 2e-2), 1.0, 1)

    def learn(case, window, *, integrator, on_try, progress):
        on_try(tried)
        return tried

    monkeypatch.setattr(workflow, "learn", learn)
    found = workflow.run(run.case, stages=("learn",), window=Window(0, 72))
    assert found.orders == [tried]
    assert report.result_entries(found)["orders"] == [
        {"order": 99, "eps_inf_u": 1e-3, "eps_inf_theta": 2e-2, "eps_2_u": 1e-4, "eps_2_theta": 2e-3}
    ]


def test_another_commands_report_is_kept_and_linked(run, tmp_path):
    """A diagnosis beside a run: both pages are there, and each names the other."""
    report.write_report(run, tmp_path, "wallid run saint_julien")
    first = json.loads((tmp_path / "result.json").read_text("utf-8"))
    written = report.write_report(run, tmp_path, "wallid diagnose saint_julien")
    assert {"report-run.html", "result-run.json"} <= {path.name for path in written}
    assert json.loads((tmp_path / "result-run.json").read_text("utf-8")) == first
    pages = {name: check((tmp_path / name).read_text("utf-8")) for name in ("report.html", "report-run.html")}
    assert "report-run.html" in pages["report.html"].links and "report.html" in pages["report-run.html"].links
    # again: the same command takes its own place, and what was kept stays
    report.write_report(run, tmp_path, "wallid diagnose saint_julien")
    again = check((tmp_path / "report.html").read_text("utf-8"))
    assert "report-run.html" in again.links and not (tmp_path / "report-diagnose.html").exists()
    report.write_report(run, tmp_path, "wallid run saint_julien")
    names = {path.name for path in tmp_path.iterdir()}
    assert "report-diagnose.html" in names and "report-run.html" not in names


def test_one_folder_holds_the_files_of_several_commands(run, tmp_path):
    """Nothing of another command is lost; figures of one name that differ are both there."""
    out = tmp_path / "out"
    report.write_report(run, out, "wallid run saint_julien", formats=("png", "pdf"))
    (out / "model.npz").write_bytes(b"of the run")
    entries = json.loads((out / "result.json").read_text("utf-8"))
    (out / "result.json").write_text(json.dumps(entries | {"files": [*entries["files"], "model.npz"]}), "utf-8")
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    (out / "mine.txt").write_text("notes")
    shorter = replace(run, case=replace(run.case, record=run.case.record.window(0, 400)))
    report.write_report(shorter, out, "wallid diagnose saint_julien")
    after = {path.name: path.read_bytes() for path in out.iterdir()}
    for name, content in before.items():
        if name not in ("report.html", "result.json"):
            kept = f"{name.partition('.')[0]}-run.{name.partition('.')[2]}"
            assert content in (after.get(name), after.get(kept)), name
    assert {"report-run.html", "result-run.json", "mine.txt", "record-run.png"} <= set(after)
    report.write_report(shorter, out, "wallid diagnose saint_julien")
    assert set(after) == {path.name for path in out.iterdir()}, "the same command replaces its own files only"
    report.write_report(shorter, out, "wallid run saint_julien")
    names = {path.name for path in out.iterdir()}
    assert "model.npz" not in names and "record.pdf" not in names, "a command's own files of an earlier run go"
    assert {"report-diagnose.html", "mine.txt"} <= names


def test_every_order_of_commands_keeps_the_last_report_of_each(run, tmp_path):
    """Each command's page is there after any other, and each page links to all others that are kept."""
    order = ("run", "diagnose", "run", "estimate", "check", "design", "diagnose")
    for done, name in enumerate(order, start=1):
        report.write_report(run, tmp_path, f"wallid {name} saint_julien")
        last = {one: json.loads((tmp_path / f).read_text("utf-8")) for one, f in _results(tmp_path).items()}
        assert set(last) == set(order[:done]), f"after {order[:done]}"
        assert all(entries["command"] == f"wallid {one} saint_julien" for one, entries in last.items())
        links = check((tmp_path / "report.html").read_text("utf-8")).links
        for other in set(order[:done]) - {name}:
            assert f"report-{other}.html" in links, other
            assert "report.html" in check((tmp_path / f"report-{other}.html").read_text("utf-8")).links


def _results(folder):
    """The file with the numbers of each command in a folder."""
    kept = {path.stem.removeprefix("result-"): path.name for path in folder.glob("result-*.json")}
    last = json.loads((folder / "result.json").read_text("utf-8"))["command"].split()[1]
    return kept | {last: "result.json"}


def test_every_figure_has_its_caption_and_its_place_on_the_page():
    assert set(captions._CAPTIONS) == set(STEMS)
    template = resources.files("wallid.report").joinpath("templates/report.html").read_text("utf-8")
    assert {stem for stem in STEMS if f'show_figure("{stem}")' in template} == set(STEMS)


def test_the_wall_is_drawn_to_scale(run):
    """Faces at both ends and each sensor at its place, crowded ones a line apart."""
    sensors = tuple(replace(s, position=x) for s, x in zip(run.case.sensors, (0.05, 0.06, 0.4), strict=True))
    _, ax = plot.figure(height=1.6)
    plot.wall(replace(run.case, sensors=sensors), ax=ax)
    places = np.array([line.get_xydata()[0] for line in ax.lines if line.get_marker() in ("o", "^", "s")])
    np.testing.assert_allclose(places[:, 0], [5.0, 6.0, 40.0])
    assert places[0, 1] != places[1, 1] and places[0, 1] == places[2, 1]
    assert [text.get_text() for text in ax.texts][-5:-3] == ["left face (inside)", "right face (outside)"]
    assert mpl.rcParams["savefig.dpi"] == "figure", "no setting of the reader's is changed"


def test_figures_come_in_the_formats_asked_for(run, tmp_path):
    """Beside the page, the same bytes each time; another format's files of an earlier run go."""
    report.write_report(run, tmp_path, formats=report.parse_formats("png"))
    written = [path.name for path in report.write_report(run, tmp_path, formats=report.parse_formats("SVG, pdf,svg"))]
    assert (
        {path.name for path in tmp_path.iterdir()}
        == set(written)
        == {
            *(f"{stem}.{kind}" for stem in ("wall", "record") for kind in ("svg", "pdf")),
            "report.html",
            "result.json",
        }
    )
    assert (tmp_path / "record.pdf").read_bytes().startswith(b"%PDF")
    first = (tmp_path / "record.svg").read_text("utf-8")
    root = ElementTree.fromstring(first)
    assert root.tag.endswith("svg") and "temperature" in first
    report.write_report(run, tmp_path, formats=("svg",))
    assert (tmp_path / "record.svg").read_text("utf-8") == first
    assert not (tmp_path / "record.pdf").exists()


@pytest.mark.parametrize("wrong", ["", "jpg", "png,gif"])
def test_an_unknown_format_is_refused(wrong):
    with pytest.raises(wallid.InputError, match=r"--format .*png, svg or pdf"):
        report.parse_formats(wrong)


def test_many_readings_do_not_swell_a_drawing():
    """A week of a row a minute: thousands of marks are held as pixels, a line of as many stays a line."""
    made, ax = plot.figure()
    x = np.linspace(0.0, 7.0, 10_080)
    ax.plot(x, np.sin(x), ".", label="measured")
    ax.plot(x[:200], np.cos(x[:200]), "o")
    text = encode_figure(made, "svg", salt="week").decode()
    assert len(text) < 200_000 and text.count("<image") == 1 and text.count("<use") > 200


def test_a_page_stays_under_3_mb_whatever_it_shows(run):
    """Lines of thousands of points, each allowed by itself."""
    rng, figures = np.random.default_rng(0), []
    for stem in ("wall", "record"):
        made, ax = plot.figure()
        for _ in range(6):
            ax.plot(np.cumsum(rng.normal(size=19_000)))
        figures.append(draw_figure(stem, made))
    text = render_page(run, report.result_entries(run), figures)
    assert 100_000 < len(check(text).text.encode()) < 3e6


def test_pixels_are_taken_only_where_they_are_smaller(run, monkeypatch):
    """A page that is too large may hold lines whose pixels need more bytes than their points."""
    made, ax = plot.figure()
    ax.plot(np.cumsum(np.random.default_rng(0).normal(size=300)), color=plot.BLUE)
    drawn = draw_figure("record", made)
    monkeypatch.setattr(svg, "_MOST_BYTES", 1000)
    (uri,) = svg.data_uris([drawn])
    assert len(uri) <= len(drawn.data_uri)


def test_a_readings_interval_is_its_noise_and_what_the_diffusivity_leaves_open(run, fit):
    """By hand: 1.96 times the root of 0.1^2 + (theta std / value)^2, shaded about prediction and zero."""
    case, rows, predicted = run.case, fit.window.rows, fit.predicted
    theta = np.tile([0.0, 3.0, 4.0], (rows, 1))
    half = plot.reading_interval(case, fit, theta)
    np.testing.assert_allclose(half[0], 1.959964 * np.array([0.1, 0.125, np.sqrt(0.02)]), rtol=1e-6)
    _, axes = plot.figure(1, 2)
    plot.measured_against_simulated(case, fit, theta, ax=axes[0])
    plot.residual(case, fit, theta, ax=axes[1])
    for ax, middle in ((axes[0], predicted[:, 1]), (axes[1], np.zeros(rows))):
        assert len(ax.collections) == 3
        edges = ax.collections[1].get_paths()[0].get_extents()
        assert edges.y0 == pytest.approx(middle.min() - half[0, 1]) and edges.y1 == pytest.approx(
            middle.max() + half[0, 1]
        )
