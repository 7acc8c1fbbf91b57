"""The lines of stages and steps on standard error."""

import pytest

from wallid.cli import progress
from wallid.cli.stage_lines import _RESULTS
from wallid.workflow import Run, _StageProgress


@pytest.fixture
def lines(monkeypatch):
    """A display without a bar, a clock that is set by hand, and the printed lines."""
    now, printed = [0.0], []
    monkeypatch.setattr(progress.clock, "monotonic", lambda: now[0])
    display = progress.ProgressDisplay(printed.append)
    return display, now, printed


def test_steps_have_lines_only_in_long_stages(lines):
    """A pipe shows where a long stage is, and is not flooded by its steps."""
    display, now, printed = lines
    for second in range(1, 31):
        now[0] = float(second)
        display.step(f"step {second}", second / 100)
    assert printed == ["  step 6", "  step 12", "  step 18", "  step 24", "  step 30"]
    display.line("stage done")
    now[0] = 40.0
    display.step("done", 1.0)
    assert printed[-1] == "stage done", "the end is no step"


def test_every_stage_has_a_key_result():
    stages = _StageProgress(Run(None), ["design"], 0, lambda text, share: None, lambda run, stage: None).durations
    assert set(_RESULTS) == set(stages)


def test_a_stage_that_fails_is_not_reported_as_done():
    run, finished = Run(None), []
    begin = _StageProgress(
        run, ["design", "learn"], 0, lambda text, share: None, lambda run, stage: finished.append(stage)
    )
    with begin("design", "design: the most informative days"):
        pass
    with pytest.raises(ValueError, match="no"), begin("learn", "learn"):
        raise ValueError("no")
    assert finished == ["design"] == list(run.seconds)
