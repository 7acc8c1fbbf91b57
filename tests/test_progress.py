"""Progress: one convention, `progress(text, share)`; a bar in a notebook for long work, and nothing elsewhere."""

import sys
import types
from dataclasses import replace
from time import sleep

import nbformat
import pytest
from nbclient import NotebookClient

import wallid
from wallid import workflow
from wallid._internal import progress as module
from wallid._internal.progress import part_of, shown_progress


@pytest.fixture(scope="module")
def case():
    case = wallid.load("saint_julien")
    part = case.record.window(0, 10 * 24)
    return replace(case, record=part, choices=replace(case.choices, nodes=31, order=3))


def check(calls):
    """Shares grow from 0 to 1, each call has a text, and "done" is the last one and no other."""
    texts, shares = zip(*calls, strict=True)
    assert all(texts) and [text for text in texts if text == "done"] == ["done"] and texts[-1] == "done"
    assert list(shares) == sorted(shares) and shares[0] == 0.0 and shares[-1] == 1.0


@pytest.mark.slow
def test_all_long_functions_report_in_the_same_way(case):
    window = wallid.Window(0, 72)
    long = {
        "learn": lambda report: wallid.learn(case, window, progress=report),
        "auto": lambda report: wallid.learn(case, window, "auto", progress=report),
        "design": lambda report: wallid.design(case, progress=report),
        "estimate": lambda report: wallid.estimate(case, window, progress=report),
        "places": lambda report: wallid.place_sensors(case, window, candidates=(0.1, 0.2), count=2, progress=report),
        "run": lambda report: workflow.run(case, stages=("design", "learn", "estimate"), progress=report),
    }
    texts = {}
    for name, function in long.items():
        calls = []
        function(lambda text, share: calls.append((text, share)))  # noqa: B023
        check(calls)
        texts[name] = " ".join(text for text, _ in calls)
    assert "searching 3 modes" in texts["learn"] and "searching 4 modes" in texts["auto"]
    assert "searching 3 modes" in texts["estimate"] and "generalised least squares" in texts["estimate"]
    assert "generalised least squares" in texts["run"]


def test_a_part_is_scaled_and_has_no_end_of_its_own():
    calls = []
    part = part_of(lambda text, share: calls.append((text, share)), 0.2, 0.6)
    part("half", 0.5)
    part("done", 1.0)
    assert calls == [("half", pytest.approx(0.4))]


@pytest.fixture
def notebook(monkeypatch):
    """As if in a Jupyter kernel; the HTML that was displayed, in order, each with the id of its display."""
    displayed = []

    class Shell:
        pass

    Shell.__name__ = "ZMQInteractiveShell"

    class Handle:
        def __init__(self):
            self.number = len(displayed)

        def update(self, html):
            displayed.append((self.number, html))

    def display(html, display_id):
        assert display_id is True
        handle = Handle()
        handle.update(html)
        return handle

    package, show = types.ModuleType("IPython"), types.ModuleType("IPython.display")
    package.get_ipython = Shell
    show.HTML, show.display = str, display
    monkeypatch.setitem(sys.modules, "IPython", package)
    monkeypatch.setitem(sys.modules, "IPython.display", show)
    monkeypatch.setattr(module, "_FIRST_SHOWN", 0.02)
    monkeypatch.setattr(module, "_INTERVAL", 0.02)
    return displayed


def wait_for(condition):
    for _ in range(500):
        if condition():
            return
        sleep(0.01)
    raise AssertionError("nothing was displayed")


def test_long_work_has_one_bar_in_a_notebook_and_leaves_nothing(notebook):
    with shown_progress(None) as report:
        report("compiling <models>", 0.25)
        with shown_progress(None) as inner:  # work within has no bar of its own
            inner("inner", 0.9)
            wait_for(lambda: notebook)
    assert {number for number, _ in notebook} == {0}
    assert 'value="0.250"' in notebook[0][1] and "compiling &lt;models&gt; (0 s)" in notebook[0][1]
    assert not any("inner" in html for _, html in notebook)
    assert notebook[-1][1] == ""


def test_short_work_and_work_with_a_callable_have_no_bar(notebook, monkeypatch):
    with shown_progress(lambda text, share: None) as report:
        report("given", 0.0)
        with shown_progress(None) as inner:
            inner("inner", 0.5)
            sleep(0.05)
    monkeypatch.setattr(module, "_FIRST_SHOWN", 60.0)
    with shown_progress(None) as report:
        report("short", 0.0)
    assert notebook == []


def test_a_failure_takes_the_bar_away(notebook):
    calls = []
    with pytest.raises(ZeroDivisionError), shown_progress(None) as report:
        report("dividing", 0.5)
        wait_for(lambda: notebook)
        raise ZeroDivisionError
    assert notebook[-1][1] == ""
    with pytest.raises(ZeroDivisionError), shown_progress(lambda *call: calls.append(call)):
        raise ZeroDivisionError
    assert calls == []  # what failed is not done


def test_a_kernel_shows_the_bar():
    """The kernel's own messages: the bar is displayed while the cell works, and empty after it."""
    shown = []

    class Watched(NotebookClient):
        def process_message(self, msg, cell, cell_index):
            if msg["msg_type"] in ("display_data", "update_display_data"):
                shown.append(msg["content"]["data"].get("text/html"))
            return super().process_message(msg, cell, cell_index)

    cell = """
from time import sleep
from wallid._internal.progress import shown_progress
with shown_progress(None) as report:
    report("working", 0.5)
    sleep(3.5)
"""
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell)])
    Watched(notebook, timeout=120).execute()
    assert any("<progress" in html and "working" in html for html in shown)
    assert shown[-1] == ""


def test_nothing_is_shown_outside_a_notebook(capfd):
    with shown_progress(None) as report:
        report("working", 0.5)
        sleep(0.6)
    assert capfd.readouterr() == ("", "")
