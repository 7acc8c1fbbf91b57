"""The report: one page, nothing fetched, every figure with its alternative, every number there."""

import shutil
import subprocess
from dataclasses import replace
from importlib import resources
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
import pytest
from pages import check

import wallid
from wallid import plot, report
from wallid.captions import CAPTIONS
from wallid.estimated import Estimate
from wallid.experiment import Window, fit_profile
from wallid.figures import STEMS, save
from wallid.page import number, page, tables
from wallid.workflow import Run


@pytest.fixture(scope="module")
def run():
    """A run that has read its case and gone no further: nothing is compiled for it."""
    return Run(wallid.load("saint_julien"), seconds={"design": 1.25})


@pytest.fixture(scope="module")
def written(run, tmp_path_factory):
    folder = tmp_path_factory.mktemp("out")
    report.write(run, folder, "wallid design saint_julien")
    return folder / "report.html"


def test_a_page_is_whole_and_fetches_nothing(written):
    found = check(written.read_text("utf-8"))
    assert [image["alt"].split()[0] for image in found.images] == ["Section", "Temperatures"]
    assert "wallid design saint_julien" in found.text and "Synthetic twin" in found.text


def test_what_a_case_says_is_text_and_not_markup(run):
    """A name from a file goes through the template's escaping."""
    case = replace(run.case, name="<script>alert(1)</script>", description="a & b")
    text = page(Run(case), report.result(Run(case)), [])
    assert "<script>" not in text and "&lt;script&gt;" in text and "a &amp; b" in text


def test_every_number_is_in_a_table():
    result = {
        "case": "wall",
        "diffusivity": {"value": 1.06e-6, "std": 1.2e-8, "interval_95": [1.04e-6, 1.08e-6], "unit": "m2/s"},
        "effects": [{"name": "solar_gain", "target": "right", "parameters": {}, "gain": 790.0, "alternatives": []}],
        "gap": {"before_K": 0.3125, "held_out_after_K": None},
        "record": {"step_s": 600.0, "missing": {"T_s": 3}},
    }
    found = dict(tables(result))
    assert found["overview"] == [("case", "wall")]
    assert found["diffusivity"] == [("", "1.06 × 10⁻⁶ ± 1.2 × 10⁻⁸ (95 %: 1.04 × 10⁻⁶ to 1.08 × 10⁻⁶) m²/s")]
    assert ("solar_gain gain", "790") in found["effects"]
    assert found["gap"] == [("before (K)", "0.3125"), ("held out after (K)", "–")]
    assert found["record"] == [("step (s)", "600"), ("missing T s", "3")], "a column's name is no unit"


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (None, "–"),
        (True, "yes"),
        (3, "3"),
        (-0.5, "−0.5"),
        (-2.5e-7, "−2.5 × 10⁻⁷"),
        ([], "none"),
        ([1.0, 2.0], "1, 2"),
    ],
)
def test_a_number_as_a_person_reads_it(value, said):
    assert number(value) == said


def test_every_figure_has_its_caption_and_its_place_on_the_page():
    assert set(CAPTIONS) == set(STEMS)
    template = resources.files("wallid").joinpath("templates/report.html").read_text("utf-8")
    assert {stem for stem in STEMS if f'picture("{stem}")' in template} == set(STEMS)


def test_the_wall_is_drawn_to_scale(run):
    """Faces at both ends and each sensor at its place, crowded ones a line apart."""
    sensors = tuple(replace(s, position=x) for s, x in zip(run.case.sensors, (0.05, 0.06, 0.4), strict=True))
    _, ax = plot.figure(height=1.6)
    plot.wall(ax, replace(run.case, sensors=sensors))
    places = np.array([line.get_xydata()[0] for line in ax.lines if line.get_marker() in ("o", "^", "s")])
    np.testing.assert_allclose(places[:, 0], [5.0, 6.0, 40.0])
    assert places[0, 1] != places[1, 1] and places[0, 1] == places[2, 1]
    assert [text.get_text() for text in ax.texts][-5:-3] == ["left face (inside)", "right face (outside)"]
    assert mpl.rcParams["savefig.dpi"] == "figure", "no setting of the reader's is changed"


@pytest.mark.skipif(shutil.which("chromium") is None, reason="no chromium to open the page in")
def test_a_browser_opens_it_without_an_error(written):
    """Headless, without a network to fall back on."""
    command = ["chromium", "--headless=new", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr", "--dump-dom"]
    done = subprocess.run([*command, written.as_uri()], capture_output=True, text=True, timeout=300, check=True)
    assert "CONSOLE" not in done.stderr
    assert done.stdout.count("<figure") == 2


def test_figures_come_in_the_formats_asked_for(run, tmp_path):
    """Beside the page, the same bytes each time; another format's files of an earlier run go."""
    report.write(run, tmp_path, formats=report.parse_formats("png"))
    written = [path.name for path in report.write(run, tmp_path, formats=report.parse_formats("SVG, pdf,svg"))]
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
    report.write(run, tmp_path, formats=("svg",))
    assert (tmp_path / "record.svg").read_text("utf-8") == first
    assert not (tmp_path / "record.pdf").exists()


@pytest.mark.parametrize("wrong", ["", "jpg", "png,gif"])
def test_an_unknown_format_is_refused(wrong):
    with pytest.raises(wallid.InputError, match=r"--format .*png, svg or pdf"):
        report.parse_formats(wrong)


def test_many_readings_do_not_swell_a_drawing(tmp_path):
    """A week of a row a minute: thousands of marks are held as pixels, a line of as many stays a line."""
    made, ax = plot.figure()
    x = np.linspace(0.0, 7.0, 10_080)
    ax.plot(x, np.sin(x), ".", label="measured")
    ax.plot(x[:200], np.cos(x[:200]), "o")
    save(made, tmp_path / "week.svg")
    text = (tmp_path / "week.svg").read_text("utf-8")
    assert len(text) < 200_000 and text.count("<image") == 1 and text.count("<use") > 200


def test_a_page_stays_under_3_mb_whatever_it_shows(run):
    """Lines of thousands of points, each allowed by itself."""
    rng, figures = np.random.default_rng(0), []
    for stem in ("wall", "record"):
        made, ax = plot.figure()
        for _ in range(6):
            ax.plot(np.cumsum(rng.normal(size=19_000)))
        figures.append((stem, made))
    text = page(run, report.result(run), figures)
    assert 100_000 < len(check(text).text.encode()) < 3e6


def test_a_readings_interval_is_its_noise_and_what_the_diffusivity_leaves_open(run):
    """By hand: 1.96 times the root of 0.1^2 + (theta std / value)^2, shaded about prediction and zero."""
    case, rows = run.case, 30
    predicted = np.tile(np.linspace(5.0, 9.0, rows)[:, None], (1, 3))
    theta = np.tile([0.0, 3.0, 4.0], (rows, 1))
    fit = Estimate(
        value=1e-6, std=2.5e-8, interval_95=(0.9e-6, 1.1e-6), offsets={}, result="", reliable=True, reason="",
        iterations=0, evaluations=0, history={}, reduced_chi_square=1.0, predicted=predicted,
        residual=0.1 * predicted, covariance=np.eye(1), singular_values=np.ones(1), model_shift=0.0,
        profile=fit_profile(case, 10), model="", window=Window(10, rows),
    )  # fmt: skip
    half = plot.reading_interval(case, fit, theta)
    np.testing.assert_allclose(half[0], 1.959964 * np.array([0.1, 0.125, np.sqrt(0.02)]), rtol=1e-6)
    _, axes = plot.figure(1, 2)
    plot.measured_against_simulated(axes[0], case, fit, theta)
    plot.residual(axes[1], case, fit, theta)
    for ax, middle in ((axes[0], predicted[:, 1]), (axes[1], np.zeros(rows))):
        assert len(ax.collections) == 3
        edges = ax.collections[1].get_paths()[0].get_extents()
        assert edges.y0 == pytest.approx(middle.min() - half[0, 1]) and edges.y1 == pytest.approx(
            middle.max() + half[0, 1]
        )
