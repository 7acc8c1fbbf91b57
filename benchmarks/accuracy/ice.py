"""Every fortnight of two boreholes in a glacier.

`python -m benchmarks.accuracy.ice [--every 14] [--position-std 0.01]`

Ice is a known material, 1.1e-6 to 1.25e-6 m2/s at these temperatures. Faces at 0.5 and 1.5 m, a sensor at 1 m whose
offset may be 0.1 K, each of them within a centimetre or so of its depth. Under the winter's snow the temperatures
hardly vary: most windows from mid-January on can tell nothing, and should say so. Data: T. R. Gurung, ICIMOD, in
glenglat (CC BY 4.0), read from `WALLID_DATA`.
"""

import argparse
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

KNOWN = (1.1e-6, 1.25e-6)  # m2/s
BOREHOLES = ("borehole_247", "borehole_248")
DAYS, FIRST = 14, "2014-12-01"
POSITION_STD = 0.01  # m, of each of the three depths

CASE = """
[wall]
length = 1.0
diffusivity_prior = 1.1e-6
[record]
file = "{file}"
time = "time"
left = "T_0.5m"
right = "T_1.5m"
boundary_noise_std = 0.01
face_position_std = {position_std}
[[sensor]]
name = "T_1m"
position = 0.5
noise_std = 0.01
offset_std = 0.1
position_std = {position_std}
[choices]
window_days = 14
model = "lom"
"""


@dataclass(frozen=True)
class Fortnight:
    """What one window gave."""

    borehole: str
    start: str
    value: float
    low: float
    high: float
    informative: bool
    reason: str

    @property
    def meets(self) -> bool:
        """Whether the interval meets the known one."""
        return self.low <= KNOWN[1] and self.high >= KNOWN[0]

    @property
    def right(self) -> bool:
        """Whether it says nothing wrong."""
        return self.meets or not self.informative


def hourly(path: Path) -> pd.DataFrame:
    """The record from December on with a row each hour: a face's missing hour by a straight line."""
    table = pd.read_csv(path, index_col="time", parse_dates=True)[["T_0.5m", "T_1m", "T_1.5m"]]
    table = table[FIRST:].resample("h").mean()
    faces = ["T_0.5m", "T_1.5m"]
    table[faces] = table[faces].interpolate(limit=2)
    whole = table[faces].notna().all(axis=1)
    return table if whole.all() else table[: whole.idxmin() - pd.Timedelta(hours=1)]


def fortnights(
    data: Path, borehole: str, folder: Path, every: int = DAYS, position_std: float = POSITION_STD
) -> Iterator[Fortnight]:
    """Windows of 14 days from December on, `every` days apart."""
    import wallid

    hourly(data / "glacier_ice" / f"{borehole}.csv").to_csv(folder / f"{borehole}.csv")
    path = folder / f"{borehole}.toml"
    path.write_text(CASE.format(file=f"{borehole}.csv", position_std=position_std), encoding="utf-8")
    case = wallid.load(path)
    large = wallid.full_order_model(case)
    rows = case.record.rows_in_days(DAYS)
    for row in range(0, case.record.rows - rows + 1, case.record.rows_in_days(every)):
        fit = wallid.estimate(case, wallid.Window(row, rows), large)
        start = str(case.record.stamp(row))[:10]
        yield Fortnight(borehole, start, fit.value, *fit.interval_95, fit.reliable, fit.reason)


def line(found: Fortnight) -> str:
    """A row of the table."""
    said = "informative" if found.informative else "uninformative"
    return (
        f"| {found.borehole} | {found.start} | {found.value:.3g} | {found.low:.3g} to {found.high:.3g} | {said} | "
        f"{'yes' if found.meets else 'no'} |"
    )


if __name__ == "__main__":
    import tempfile

    import jax

    jax.config.update("jax_enable_x64", True)
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--every", type=int, default=DAYS, help="days between the windows' starts")
    parser.add_argument("--position-std", type=float, default=POSITION_STD, help="of each depth, m")
    given = parser.parse_args()
    data = Path(os.environ.get("WALLID_DATA", Path(__file__).parents[3] / "shared" / "data"))
    print("| borehole | 14 days from | diffusivity, m2/s | 95 % interval | says | meets 1.1e-6 to 1.25e-6 |")
    print("|---|---|---|---|---|---|")
    everything = []
    with tempfile.TemporaryDirectory() as folder:
        for borehole in BOREHOLES:
            for found in fortnights(data, borehole, Path(folder), given.every, given.position_std):
                everything.append(found)
                print(line(found), flush=True)
    narrow = sum(found.informative and found.meets and found.high < 1.5 * found.low for found in everything)
    print(
        f"\n{len(everything)} windows, {sum(f.informative for f in everything)} informative, {narrow} of them with an "
        f"upper end under 1.5 times the lower, {sum(not f.right for f in everything)} wrong"
    )
