"""Who draws: here, by a second process, or here after all; the drawings are the same."""

import os
import subprocess
import sys
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import active_children

import pytest
from threadpoolctl import threadpool_info

import wallid
from wallid import figures, report
from wallid._artist import Artist, artist
from wallid._drawing import render
from wallid.figures import of_stages
from wallid.workflow import Run

FORMATS = ("png", "svg")


@pytest.fixture(scope="module")
def run():
    """A run with two figures, wall and record."""
    return Run(wallid.load("saint_julien"))


@pytest.fixture(scope="module")
def here(run):
    return Artist(FORMATS).finish(run)


class Helper(Executor):
    """A second process that is none: what it does with each figure by turns."""

    def __init__(self, *does):
        self.does, self.asked = list(does), []

    def submit(self, function, stem, made, formats):
        self.asked.append(stem)
        does, future = self.does.pop(0), Future()
        if does == "refuses":
            raise BrokenProcessPool
        if does != "waits":
            future.set_running_or_notify_cancel()
        if does == "dies":
            future.set_exception(BrokenProcessPool())
        if does == "draws":
            future.set_result(function(stem, made, formats))
        return future


def same(drawn, here):
    return [(one.stem, one.files, one.source) for one in drawn] == [(one.stem, one.files, one.source) for one in here]


def test_a_second_process_draws_the_same_bytes(run, here, monkeypatch):
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    with artist(FORMATS, helped=True) as drawing:
        drawing.begin(run)
        for sketch in drawing._begun:
            sketch.helped.result(timeout=120)
        drawn = drawing.finish(run)
    assert [one.stem for one in drawn] == [stem for stem, _ in of_stages(run)] == ["wall", "record"]
    assert all(set(one.files) == set(FORMATS) for one in drawn)
    assert same(drawn, here)


@pytest.mark.parametrize(
    "does", [("draws", "draws"), ("draws", "waits"), ("waits", "waits"), ("draws", "dies"), ("refuses", "refuses")]
)
def test_what_the_helper_has_not_drawn_is_drawn_here(run, here, does):
    """Each figure is asked for once, and comes in its place."""
    helper = Helper(*does)
    drawing = Artist(FORMATS, helper)
    drawing.begin(run)
    assert same(drawing.finish(run), here)
    assert helper.asked == ["wall", "record"]


def test_without_a_beginning_the_helper_is_asked_at_the_end(run, here):
    helper = Helper("draws", "waits")
    assert same(Artist(FORMATS, helper).finish(run), here)
    assert helper.asked == ["wall", "record"]


@pytest.mark.parametrize(("cores", "helped"), [(1, True), (None, True), (8, False)])
def test_no_process_is_started_where_it_is_of_no_use(run, here, monkeypatch, cores, helped):
    monkeypatch.setattr(os, "cpu_count", lambda: cores)
    with artist(FORMATS, helped=helped) as drawing:
        assert drawing._helper is None
        drawing.begin(run)
        assert same(drawing.finish(run), here)


def test_no_process_is_started_before_there_is_something_to_draw(monkeypatch):
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    before = active_children()
    with artist(FORMATS, helped=True):
        assert active_children() == before


def test_a_mistake_in_drawing_is_not_hidden(run):
    """Only a process that died is done without; what a figure itself raises is said."""
    failed = Future()
    failed.set_running_or_notify_cancel()
    failed.set_exception(ValueError("a figure's own"))

    class Failing(Executor):
        def submit(self, *given):
            return failed

    with pytest.raises(ValueError, match="a figure's own"):
        Artist(FORMATS, Failing()).finish(run)


def test_a_mistake_in_putting_figures_together_is_not_hidden(run, monkeypatch):
    def failing(run):
        raise ValueError("a figure's own")

    monkeypatch.setattr(figures, "of_stages", failing)
    drawing = Artist(FORMATS, Helper())
    with pytest.raises(ValueError, match="a figure's own"):
        drawing.begin(run)
    with pytest.raises(ValueError, match="a figure's own"):
        drawing.finish(run)


def test_beside_a_helper_lapack_leaves_it_a_core(monkeypatch):
    def threads():
        return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}

    before = threads()
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    with artist(FORMATS, helped=True):
        assert threads() == {1}
    assert threads() == before


def test_a_report_is_written_from_what_an_artist_began(run, here, tmp_path):
    """Its formats are the artist's."""
    drawing = Artist(FORMATS, Helper("draws", "draws"))
    drawing.begin(run)
    written = report.write(run, tmp_path, artist=drawing)
    assert {path.name for path in written} >= {"wall.png", "wall.svg", "record.png", "record.svg", "report.html"}
    assert (tmp_path / "wall.png").read_bytes() == here[0].files["png"]


def test_a_figure_can_be_sent(run):
    """What is sent is far less work than what it saves, and comes back whole."""
    import pickle

    for stem, made in of_stages(run):
        copy = pickle.loads(pickle.dumps(made))
        assert render(stem, copy, FORMATS) == render(stem, made, FORMATS)


def test_what_is_imported_and_what_is_left_at_the_end_is_not_searched():
    program = """
import atexit, gc
atexit.register(lambda: print(gc.get_freeze_count()))  # runs after what is registered later
from wallid._collector import leave_what_stays
leave_what_stays()
print(gc.get_freeze_count())
left = [[] for _ in range(10_000)]
"""
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    imported, whole = map(int, ended.stdout.split())
    assert imported > 100_000 and whole > imported + 5_000
