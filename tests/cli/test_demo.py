"""The demo in full: what it names, what it writes and what it reads."""

import json
import subprocess
import sys
from itertools import product
from pathlib import Path

import jsonschema
import pytest
from benchmarks.reference.example_cases import saint_julien_case
from browser import CHROMIUM, browser
from pages import check, drawings
from results import DIAGNOSIS, FIGURES, SCHEMA

import wallid

pytestmark = pytest.mark.slow
DRAWN = FIGURES | DIAGNOSIS | {"orders.png", "next.png"}  # the air was not logged: it has a panel in `next`


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    """The demo in a process of its own, that tells which files it opened and which solvers it went through."""
    out = tmp_path_factory.mktemp("demo")
    script = """
import sys
opened = []
sys.addaudithook(lambda event, args: opened.append(str(args[0])) if event == "open" else None)
from wallid.cli import app
import diffrax, optimistix
def told(module, name):
    solve = getattr(module, name)
    def through(*args, **kwargs):
        solution = solve(*args, **kwargs)
        opened.append(f"through {module.__name__}.{name}")
        return solution
    setattr(module, name, through)
told(optimistix, "least_squares")
told(diffrax, "diffeqsolve")
try:
    sys.argv = ["wallid", "demo", "--json", "--out", sys.argv[1]]
    app()
except SystemExit as end:
    print(*opened, sep="\\n", file=sys.stderr)
    sys.exit(end.code)
"""
    done = subprocess.run([sys.executable, "-c", script, str(out)], capture_output=True, text=True, check=False)
    return done, out


def test_demo_names_the_sun_and_ends_within_15_thousandths(demo):
    """The issue's figures: the effect hidden in the twin, and 1.5 % of the truth with it in."""
    done, _ = demo
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    jsonschema.validate(result, SCHEMA)
    assert result["verdict"] == "named"
    assert [(effect["name"], effect["target"]) for effect in result["effects"]] == [("solar_gain", "right")]
    assert result["effects"][0]["parameters"]["gain"]["value"] == pytest.approx(0.003, rel=0.05)
    assert result["diffusivity"]["value"] == pytest.approx(1.06e-6, rel=0.015)
    assert result["diffusivity_before"]["value"] == pytest.approx(1.06e-6, rel=0.15)
    assert result["case"] == "saint_julien"
    # of the run's window, not of the diagnosis
    assert result["iterations"] <= 10 and result["window"]["criterion"] == 1.0
    assert result["gap"]["held_out_after_K"] < result["gap"]["held_out_before_K"]
    assert set(result["seconds"]) == {"design", "learn", "orders", "estimate", "reliability", "diagnose"}


def test_demo_writes_figures_model_and_result(demo):
    done, out = demo
    assert {file.name for file in out.iterdir()} == DRAWN | {"model.npz", "report.html", "result.json"}
    assert json.loads((out / "result.json").read_text()) == json.loads(done.stdout)
    assert wallid.StateSpace.load(out / "model.npz").order == 10
    for name in DRAWN:
        assert (out / name).stat().st_size > 10_000
    page = check((out / "report.html").read_text("utf-8"))
    assert len(page.images) == len(DRAWN)
    assert "Diffusivity" in page.text and "convergence of the estimate" in page.text
    assert "criterion by start day: 109 rows" in page.text
    assert "Solar gain of the right face" in page.text and "wallid demo" in page.text


INK = """
(() => {
  const light = ([r, g, b]) => [r, g, b].map(c => (c /= 255) <= 0.03928 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4)
    .reduce((sum, c, k) => sum + c * [0.2126, 0.7152, 0.0722][k], 0);
  const paper = light([0x14, 0x18, 0x1c]);
  return [...document.querySelectorAll("[id^=text_] path, [id^=text_] use")].map(one => getComputedStyle(one).fill)
    .filter(fill => fill.startsWith("rgb")).map(fill => fill.match(/[0-9]+/g).slice(0, 3).map(Number))
    .filter(fill => (light(fill) + 0.05) / (paper + 0.05) < 3).map(String);
})()
"""
"""The fills of letters that a dark page does not show well enough: a contrast below 3 to 1."""


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium to open the page in")
def test_a_browser_shows_the_page_on_every_screen_and_on_paper(demo, tmp_path):
    """The page of a run and of a diagnosis at once: no error, nothing fetched, nothing wider than the screen."""
    report = demo[1] / "report.html"
    with browser() as tab:
        tab.open(report, 400, False)
        for width, dark in product((400, 800, 1400), (False, True)):
            tab.resize(width, dark)
            assert tab.evaluate("document.querySelectorAll('figure').length") == len(DRAWN)
            assert tab.evaluate("document.documentElement.scrollWidth") <= width
            assert tab.evaluate("[...document.images].every(one => one.complete && one.naturalWidth > 0)")
            stops = "[...document.querySelectorAll('.scroll')].filter(one => one.tabIndex === 0)"
            wider = "[...document.querySelectorAll('.scroll')].filter(one => one.scrollWidth > one.clientWidth + 1)"
            assert tab.evaluate(f"{stops}.length === {wider}.length && {stops}.every(one => {wider}.includes(one))")
            assert tab.evaluate(f"{stops}.length") > 0 if width == 400 else tab.evaluate(f"{stops}.length") <= 3
        tab.evaluate("dispatchEvent(new Event('beforeprint'))")
        assert tab.evaluate("document.querySelectorAll('details[data-print]').length") == 4  # two of the appendix
        assert tab.evaluate("[...document.querySelectorAll('details[data-print]')].every(one => one.open)")
        assert tab.pdf().startswith(b"%PDF")
        for count, svg in enumerate(drawings(check(report.read_text("utf-8")))):
            (tmp_path / f"{count}.svg").write_text(svg, "utf-8")
            tab.open(tmp_path / f"{count}.svg", 800, dark=True)
            kept = {"0,0,0"} if '"fill: #000"' in svg else set()
            assert set(tab.evaluate(INK)) <= kept, "letters on a ground of their own alone may be dark"
        assert not tab.complaints
        assert all(one.startswith(("file:", "data:")) for one in tab.requests)


def test_the_twin_without_its_sun_is_adequate():
    """The issue's other half: nothing is named where nothing is missing."""
    case = wallid.load("saint_julien")
    found = wallid.diagnose(saint_julien_case(case, 2009, sun=0.0))
    assert found.verdict == "adequate", str(found)
    assert found.after.diffusivity == pytest.approx(1.06e-6, rel=0.015)
    assert found.interval_95[0] < 1.06e-6 < found.interval_95[1]


def test_demo_goes_through_optimistix_and_diffrax(demo):
    done, _ = demo
    for solver in ("optimistix.least_squares", "diffrax.diffeqsolve"):
        assert f"through {solver}" in done.stderr.splitlines()


def test_demo_reads_nothing_but_its_case(demo):
    done, _ = demo
    examples = Path(wallid.__file__).parent / "examples"
    read = {Path(name) for name in done.stderr.splitlines() if name.startswith(str(examples))}
    assert read == {examples / "saint_julien" / "case.toml", examples / "saint_julien" / "record.csv"}
    assert not [
        name for name in done.stderr.splitlines() if name.endswith((".csv", ".toml")) and "saint_julien" not in name
    ]


def test_demo_wholly_through_diffrax_gives_the_same_diffusivity():
    """The issue's figure: 1e-9."""
    case = wallid.load("saint_julien")
    window = wallid.design(case)
    rom = wallid.learn(case, window)
    fast = wallid.estimate(case, window, rom)
    # design, learning and estimate, each through diffeqsolve
    again = wallid.design(case, integrator="diffrax")
    assert again.best == window.best
    slow = wallid.estimate(case, again, wallid.learn(case, again, integrator="diffrax"), integrator="diffrax")
    assert slow.value == pytest.approx(fast.value, rel=1e-9)
