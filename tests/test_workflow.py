"""What a run says of its result at the top, whatever its stages found."""

from types import SimpleNamespace

import numpy as np

import wallid
from wallid.workflow import Run


def estimated(case, reason=""):
    """A run whose estimate found this, and nothing else."""
    return Run(case, fit=SimpleNamespace(reason=reason))  # pyright: ignore[reportArgumentType]


def daily(tmp_path, speed):
    """Two weeks of a face with a cycle of 24 hours, by a clock that runs so many times as fast."""
    time = 1800.0 * np.arange(672)
    wave = 10 + 6 * np.sin(2 * np.pi * speed * time / 86400) + 0.05 * np.random.default_rng(1).standard_normal(672)
    lines = [f"{t:.0f},{a:.3f},20.0,{(a + 20) / 2:.3f}" for t, a in zip(time, wave, strict=True)]
    (tmp_path / "record.csv").write_text("\n".join(["time,left,right,T1", *lines]) + "\n", "utf-8")
    (tmp_path / "case.toml").write_text(
        '[wall]\nlength = 0.3\ndiffusivity_prior = 7e-7\n[record]\nfile = "record.csv"\ntime = "time"\n'
        'left = "left"\nright = "right"\n[[sensor]]\nname = "T1"\nposition = 0.15\nposition_std = 0.002\n'
        "noise_std = 0.05\n",
        "utf-8",
    )
    return wallid.load(tmp_path)


def test_times_that_run_too_slowly_are_said_although_the_model_fits(tmp_path):
    """A diffusivity in other units of time fits as well: only the day's cycle shows the mistake."""
    wrong = estimated(daily(tmp_path, 2.0))
    assert "12 hours" in wrong.unreliable_reason and "step" in wrong.unreliable_reason
    assert [mixup.kind for mixup in wrong.visible_mixups] == ["clock"]


def test_a_sound_record_keeps_the_reason_of_its_estimate(tmp_path):
    case = daily(tmp_path, 1.0)
    assert not estimated(case).unreliable_reason
    assert estimated(case, "too little varies").unreliable_reason == "too little varies"
    assert not Run(case).visible_mixups, "without an estimate there is nothing to rely on"
