"""Measured walls as cases; their records are not part of the project."""

from pathlib import Path

import numpy as np
import pandas as pd

import wallid
from wallid.case.options import Choices


def london(measured, **choices):
    """The London wall: 5 min, three days, two plates, no sensor inside."""
    table = pd.read_csv(measured / "london_wall" / "owall.csv")
    time = 300.0 * np.arange(len(table))
    record = wallid.Record(
        time,
        time,
        None,
        table[["T_int", "T_ext"]].to_numpy(),
        np.empty((len(table), 0)),
        (),
        regressors={"flux_left": table["Q_in"].to_numpy(), "flux_right": table["Q_out"].to_numpy()},
        boundary_noise_std=0.05,
        flux_gain_std=0.05,
    )
    wall = wallid.Wall(length=0.4, diffusivity_prior=5e-7, outside="right")
    return wallid.Case("london", Path("london.toml"), wall, (), record, Choices(initial_profile=1, **choices))
