"""Readings that no wall gives: spikes and stuck values, by what the column itself does elsewhere.

Both are meant for faults that anyone would see in a plot: where a column is restless, or quiet, nothing is
found. Effects that `diagnose` looks for (a drift, a sudden wetting, the sun) change slowly or last.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

_SPIKE_ROWS = 3  # a longer excursion is no spike,
_SPIKE_SECONDS = 1800.0  # nor one of several readings that lasts longer: the sun, or an open door
_SPIKE_LEAST = 1.0  # K
_SPIKE_USUAL = 20.0  # times the median change from reading to reading
_SPIKE_LARGE = 8.0  # times the change that only 5 % exceed
_SPIKE_FLANKS = 0.2  # of the jump: how far the readings about it may be apart
_FLANK = 3  # readings on either side; the highest and the lowest of the six may be spikes too
_NEIGHBOURS = 3.0  # usual steps: readings farther apart are no neighbours

_STUCK_LEAST = 12  # readings
_STUCK_RANGE = 0.5  # K: what a stretch as long must move by elsewhere,
_STUCK_RESOLUTIONS = 10.0  # and in steps of the column's resolution,
_STUCK_SHARE = 0.05  # in all but this share of such stretches
_STUCK_SCALES = 40  # runs that are looked at, longest first
_FREEZING = 0.5  # K about 0 degC: there a wet wall stands still


def spikes(seconds: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Which of a column's readings jump away and back to where they were, within three readings and half an hour.

    A jump must be larger than 1 K, 20 times the column's median change from reading to reading, and 8 times
    the change that only 5 % of its steps exceed. The readings next to it, and all but the highest and the
    lowest of the three on either side, must agree within a fifth of it: what a wall once had comes or goes
    more slowly.

    Arguments:
        seconds, values: of the readings there are, in order, (reading,).
    """
    found = np.zeros(len(values), bool)
    if len(values) < 8:
        return found
    change = np.abs(np.diff(values))
    least = max(_SPIKE_LEAST, _SPIKE_USUAL * float(np.median(change)), _SPIKE_LARGE * float(np.quantile(change, 0.95)))
    if change.max() <= least:
        return found
    step = float(np.median(np.diff(seconds)))
    values = np.pad(values, _FLANK, mode="reflect")
    seconds = np.pad(seconds, _FLANK, mode="reflect", reflect_type="odd")
    begins = np.flatnonzero(np.abs(np.diff(values)) > (1.0 - _SPIKE_FLANKS) * least) + 1
    for rows in range(1, _SPIKE_ROWS + 1):
        if rows > 1 and (rows - 1) * step > _SPIKE_SECONDS:
            break
        start = begins[(begins >= _FLANK) & (begins + rows + _FLANK <= len(values))]
        around = start[:, None] + np.r_[-_FLANK:0, rows : rows + _FLANK]
        flanks = np.sort(values[around], axis=1)[:, 1:-1]
        inside = values[start[:, None] + np.arange(rows)]
        level = np.median(flanks, axis=1)
        jump = np.abs(inside - level[:, None]).min(axis=1)
        beside = np.maximum(np.abs(values[start - 1] - level), np.abs(values[start + rows] - level))
        calm = np.maximum(np.ptp(flanks, axis=1), beside) <= _SPIKE_FLANKS * jump
        near = seconds[start + rows] - seconds[start - 1] <= (_NEIGHBOURS + rows - 1) * step
        for first in start[(jump > least) & calm & near] - _FLANK:
            found[first : first + rows] = True
    return found


def stuck(values: np.ndarray) -> np.ndarray:
    """Which of a column's readings only repeat the one before, where the column elsewhere always moves.

    A run of at least 12 equal readings is stuck if 95 % of the stretches of its length (a quarter of the rest
    at most) elsewhere in the column move by 0.5 K and ten times its resolution. Near 0 degC it may be ice.

    Arguments:
        values: the readings there are, in order, (reading,).
    """
    found = np.zeros(len(values), bool)
    if len(values) < 2 * _STUCK_LEAST:
        return found
    edges = np.flatnonzero(np.concatenate([[True], np.diff(values) != 0, [True]]))
    starts, lengths = edges[:-1], np.diff(edges)
    if lengths.max() < _STUCK_LEAST:
        return found
    changes = np.abs(np.diff(values))
    resolution = float(changes[changes > 0].min()) if (changes > 0).any() else 0.0
    least = max(_STUCK_RANGE, _STUCK_RESOLUTIONS * resolution)
    for run in np.argsort(-lengths, kind="stable")[:_STUCK_SCALES]:
        start, length = int(starts[run]), int(lengths[run])
        if length < _STUCK_LEAST:
            break
        others = len(values) - length
        span = min(length, max(others // 4, 1))
        if span < _STUCK_LEAST or not _moves(values, start, length, span, least):
            break  # a shorter run tells even less
        if abs(values[start]) > _FREEZING:
            found[start + 1 : start + length] = True
    return found


def _moves(values: np.ndarray, start: int, length: int, span: int, least: float) -> bool:
    """Whether almost all stretches of `span` readings outside a run move by more than `least`."""
    half = span // 2
    moves = maximum_filter1d(values, span) - minimum_filter1d(values, span)  # about each reading
    centres = np.arange(len(values))
    whole = (centres >= half) & (centres < len(values) - half)
    apart = (centres + half < start) | (centres - half >= start + length)
    chosen = moves[whole & apart]
    return len(chosen) > 0 and float(np.quantile(chosen, _STUCK_SHARE)) > least
