"""A small case with a record of its own, for tests of the commands."""

import numpy as np
import pandas as pd

import wallid


def write_own(folder, rows=240, still=False, **changes):
    """A small case of its own: eight hourly days of a wall with its parts replaced."""
    rng = np.random.default_rng(3)
    hours = np.arange(rows)
    truth = wallid.load("saint_julien").record
    columns = {"time": pd.date_range("2020-03-01", periods=rows, freq="h").strftime("%Y-%m-%dT%H:%M:%S")}
    columns |= {"left": truth.faces[hours, 0], "right": truth.faces[hours, 1], "in": truth.sensors[hours, 1]}
    if still:
        columns |= {"left": np.full(rows, 15.0), "right": np.full(rows, 15.0), "in": 15 + rng.normal(0, 0.1, rows)}
    frame = pd.DataFrame(columns | changes.pop("columns", {}))
    frame.to_csv(folder / "record.csv", index=False)
    text = """
[wall]
length = 0.43
diffusivity_prior = 5e-7
[record]
file = "record.csv"
time = "time"
left = "left"
right = "right"
[[sensor]]
name = "in"
position = 0.23
noise_std = 0.1
"""
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    (folder / "case.toml").write_text(text)
    return folder / "case.toml"
