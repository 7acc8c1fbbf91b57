"""Signals at chosen moments of a command: one line, status 130, nothing half-written; and readers that stop reading.

`python -m benchmarks.stress.interrupts` sends them at moments spread over a whole run.
"""

import json
import os
import signal
import subprocess
import sys
import time

import pytest

pytestmark = pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="no POSIX signals")

NOTHING = "wallid: interrupted; nothing was written\n"
BEGINNING = """
import os, signal, sys, threading, time
def send(number=signal.SIGINT, pause=30.0):
    os.kill(os.getpid(), number)
    time.sleep(pause)
"""
END = """
from wallid.cli import command
command()
"""
AT_IMPORT = """
class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == "{module}":
            send(signal.{number})
sys.meta_path.insert(0, Finder())
"""
IN_DESIGN = """
from wallid import workflow
workflow.design = lambda *args, **options: send(signal.{number})
"""
IN_COMPILER = """
import jax
from wallid import workflow
def design(*args, **options):
    threading.Timer(2.0, send).start()
    def long(x):
        for k in range(20_000):
            x = x @ x + k
        return x
    jax.jit(long).lower(jax.numpy.ones((2, 2))).compile()
    time.sleep(30.0)
workflow.design = design
"""
IN_FIGURES = """
from matplotlib.figure import Figure
Figure.savefig = lambda *args, **options: send()
"""
AT_THE_FIRST_CALL = """
from pathlib import Path
original = {function}
def interrupted(*args):
    if not sent:
        sent.append(args)
        send(pause=0.5)
    return original(*args)
sent, {function} = [], interrupted
"""
IN_TEMPORARY_FILES = AT_THE_FIRST_CALL.format(function="Path.write_bytes")
WHILE_FILES_MOVE = AT_THE_FIRST_CALL.format(function="os.replace")
AFTER_THE_FILES = """
from wallid.cli import execution
execution.print_output = lambda *args, **options: send()
"""
WITHOUT_MASKS = """
del signal.pthread_sigmask
"""


def start(script, *words, prepare=None, **streams):
    """A process with the script between the beginning and the end."""

    def default_signals():
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_DFL)
        if prepare is not None:
            prepare()

    streams = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE} | streams
    line = [sys.executable, "-c", BEGINNING + script + END, *map(str, words)]
    return subprocess.Popen(line, text=True, start_new_session=True, preexec_fn=default_signals, **streams)


@pytest.fixture
def interrupted(tmp_path):
    """Status, standard output and standard error of a command with a script before it."""

    def call(script, *words, **options):
        process = start(script, *words, "--out", tmp_path / "new" / "out", **options)
        began = time.monotonic()
        output, errors = process.communicate(timeout=120)
        return process.returncode, output, errors, time.monotonic() - began

    return call


@pytest.mark.parametrize(
    ("script", "command"),
    [
        (AT_IMPORT.format(module="numpy", number="SIGINT"), "design"),
        (AT_IMPORT.format(module="jax", number="SIGTERM"), "design"),
        (AT_IMPORT.format(module="wallid.workflow", number="SIGHUP"), "design"),
        (WITHOUT_MASKS + AT_IMPORT.format(module="pandas", number="SIGINT"), "design"),
        (IN_DESIGN.format(number="SIGINT"), "design"),
        (IN_DESIGN.format(number="SIGHUP"), "design"),
        (IN_FIGURES, "check"),
        (IN_TEMPORARY_FILES, "check"),
    ],
    ids=["numpy", "jax", "wallid", "no-masks", "design", "hangup", "figures", "temporary-files"],
)
def test_a_signal_ends_the_command_with_one_line_and_nothing_written(interrupted, tmp_path, script, command):
    status, output, errors, seconds = interrupted(script, command, "validation", "--quiet")
    assert (status, output, errors) == (130, "", NOTHING)
    assert seconds < 29.0, "the pause after the signal was not waited for"
    assert not list(tmp_path.iterdir())


def test_the_compiler_does_not_delay_the_end(interrupted, tmp_path):
    """Python's own handler would wait until XLA returns, and there it may end with a traceback or a crash."""
    status, output, errors, seconds = interrupted(IN_COMPILER, "design", "validation", "--json")
    assert (status, output, errors) == (130, "", NOTHING)
    assert seconds < 29.0 and not list(tmp_path.iterdir())


@pytest.mark.parametrize("script", [WHILE_FILES_MOVE, AFTER_THE_FILES], ids=["move", "after"])
def test_a_signal_while_the_files_get_their_names_waits_for_the_last(interrupted, tmp_path, script):
    status, output, errors, _ = interrupted(script, "check", "validation", "--json")
    out = tmp_path / "new" / "out"
    assert (status, output) == (130, "")
    assert errors == f"wallid: interrupted after all files were written to {out}\n"
    assert {path.name for path in out.iterdir()} == set(json.loads((out / "result.json").read_text("utf-8"))["files"])


def test_an_ignored_signal_stays_ignored(interrupted):
    """`nohup wallid run ...`."""
    script = "send = lambda number, pause=0: os.kill(os.getpid(), number)\n"
    script += AT_IMPORT.format(module="jax", number="SIGHUP")
    status, _, errors, _ = interrupted(
        script, "check", "validation", "--json", prepare=lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN)
    )
    assert status == 0 and errors == ""


def in_terminal(script, *words, until):
    """Start a process in a terminal of its own, and press Ctrl-C at a text; its status and all that was shown."""
    fcntl, pty, termios = (pytest.importorskip(name) for name in ("fcntl", "pty", "termios"))
    keyboard, terminal = pty.openpty()
    process = start(
        script,
        *words,
        prepare=lambda: fcntl.ioctl(terminal, termios.TIOCSCTTY, 0),
        **dict.fromkeys(("stdin", "stdout", "stderr"), terminal),
    )
    os.close(terminal)
    shown, pressed = b"", False
    while True:
        try:
            part = os.read(keyboard, 4096)
        except OSError:  # the process has ended
            break
        if not part:
            break
        shown += part
        if until in shown and not pressed:
            os.write(keyboard, b"\x03")
            pressed = True
    os.close(keyboard)
    return process.wait(30), shown.decode()


def test_control_c_at_a_question_writes_nothing(tmp_path):
    from benchmarks.stress.fuzz import plain_record

    (tmp_path / "record.csv").write_text(plain_record(), "utf-8")
    status, shown = in_terminal("", "new", tmp_path / "record.csv", until=b"ength")
    assert status == 130 and NOTHING.strip() in shown.splitlines(), "the rest of the question may come after it"
    assert [path.name for path in tmp_path.iterdir()] == ["record.csv"]


def test_control_c_removes_the_progress_bar(tmp_path):
    """A hidden cursor or half a bar would stay on the terminal."""
    script = IN_DESIGN.format(number="SIGUSR1").replace("send(", "time.sleep(30.0) or send(")
    status, shown = in_terminal(script, "design", "validation", "--out", tmp_path / "out", until=b"informative days")
    assert status == 130 and shown.endswith("\x1b[?25h" + NOTHING.replace("\n", "\r\n"))
    assert "record       2881 rows" in shown and not list(tmp_path.iterdir())


@pytest.mark.parametrize(("stream", "other"), [("stdout", "stderr"), ("stderr", "stdout")])
def test_a_reader_that_stops_reading_is_no_error(tmp_path, stream, other):
    """`wallid check validation | head -1`: the files are written, and nothing complains."""
    read, write = os.pipe()
    os.close(read)
    process = start("", "check", "validation", "--out", tmp_path / "out", **{stream: write})
    os.close(write)
    rest = dict(zip(("stdout", "stderr"), process.communicate(timeout=120), strict=True))[other]
    assert process.returncode == 0 and "Broken" not in rest and "Traceback" not in rest
    assert (tmp_path / "out" / "result.json").exists()
