"""Readings that no wall gives: spikes and stuck values, by what the column itself does elsewhere.

Both are meant for faults that anyone would see in a plot: where a column is restless, or quiet, nothing is
found. Effects that `diagnose` looks for (a drift, a sudden wetting, the sun) change slowly or last.
"""

from __future__ import annotations

import numpy as np
import scipy

_SPIKE_ROWS = 3  # a longer excursion is no spike,
_SPIKE_SECONDS = 1800.0  # nor one of several readings that lasts longer: the sun, or an open door
_SPIKE_LEAST = 1.0  # K
_SPIKE_USUAL = 20.0  # times the median change from reading to reading
_SPIKE_LARGE = 8.0  # times the change that only 5 % exceed
_SPIKE_FLANKS = 0.2  # of the jump: how far the readings about it may be apart
_SPIKE_SHARE = 0.1  # of the readings: more lone ones are what the column does
_FLANK = 3  # readings on either side; two of the six may be spikes too
_NEIGHBOURS = 3.0  # usual steps: readings farther apart are no neighbours

_STUCK_LEAST = 12  # readings
_STUCK_RANGE = 0.5  # K: what a stretch as long must move by elsewhere,
_STUCK_RESOLUTIONS = 20.0  # and in steps of the column's resolution,
_STUCK_SHARE = 0.05  # in all but this share of such stretches
_STUCK_SCALES = 40  # runs that are looked at, longest first
_FREEZING = 0.5  # K about 0 degC: there a wet wall stands still


def spikes(seconds: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Which of a column's readings jump away and back to where they were, within three readings and half an hour.

    A jump must be larger than 1 K, 20 times the column's median change from reading to reading, and 8 times
    the change that only 5 % of its steps (lone spikes apart) exceed. The readings next to it, and four of the six
    on either side (at the column's ends all of them), must lie on one line within a fifth of it: what a wall once
    had comes or goes more slowly.

    Args:
        seconds, values: of the readings there are, in order, (reading,).
    """
    found = np.zeros(len(values), bool)
    if len(values) < 8:
        return found
    change = np.abs(np.diff(values))
    usual = _SPIKE_USUAL * float(np.median(change))
    least = max(_SPIKE_LEAST, usual, _SPIKE_LARGE * float(np.quantile(_but_lone(values, change, usual), 0.95)))
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
        sides = [values[start[:, None] + side] for side in (np.arange(-_FLANK, 0), rows + np.arange(_FLANK))]
        left, right = (np.median(side, axis=1)[:, None] for side in sides)
        # the line through what is usual on either side, and how far the readings are from it
        line = left + (right - left) * (np.arange(-_FLANK, rows + _FLANK) + 2) / (rows + 3)
        off = np.abs(values[start[:, None] + np.arange(-_FLANK, rows + _FLANK)] - line)
        jump = off[:, _FLANK : _FLANK + rows].min(axis=1)
        beside = np.maximum(off[:, _FLANK - 1], off[:, _FLANK + rows])
        flanks = np.sort(np.delete(off, np.s_[_FLANK : _FLANK + rows], axis=1), axis=1)
        edge = (start < 2 * _FLANK) | (start + rows + 2 * _FLANK > len(values))  # there half of them are mirrored
        flanks = np.where(edge, flanks[:, -1], flanks[:, -3])
        calm = np.maximum(flanks, beside) <= _SPIKE_FLANKS * jump
        near = seconds[start + rows] - seconds[start - 1] <= (_NEIGHBOURS + rows - 1) * step
        for first in start[(jump > least) & calm & near] - _FLANK:
            found[first : first + rows] = True
    return found


def _but_lone(values: np.ndarray, change: np.ndarray, usual: float) -> np.ndarray:
    """The changes from reading to reading without those to and from a lone reading that is far off.

    A few dozen spikes would else be what is usual; where a tenth of the readings is off, that is.
    """
    before, after = change[:-1], change[1:]
    back = np.abs(values[2:] - values[:-2]) <= _SPIKE_FLANKS * np.minimum(before, after)
    lone = back & (np.minimum(before, after) > usual)
    if lone.mean() > _SPIKE_SHARE:
        return change
    return np.delete(change, np.concatenate([np.flatnonzero(lone), np.flatnonzero(lone) + 1]))


def stuck(values: np.ndarray) -> np.ndarray:
    """Which of a column's readings only repeat the one before, where the column elsewhere always moves.

    A run of at least 12 equal readings is stuck if 95 % of the stretches of its length (a quarter of the rest
    at most) elsewhere in the column move by 0.5 K and 20 times its resolution, and so do the readings just
    before and after it: a quiet sensor is quiet for longer. Near 0 degC it may be ice.

    Args:
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
        sides = (values[max(0, start - length) : start], values[start + length : start + 2 * length])
        lively = all(np.ptp(side) > least for side in sides if len(side) >= _STUCK_LEAST)
        if lively and abs(values[start]) > _FREEZING:
            found[start + 1 : start + length] = True
    return found


def _moves(values: np.ndarray, start: int, length: int, span: int, least: float) -> bool:
    """Whether almost all stretches of `span` readings outside a run move by more than `least`."""
    half = span // 2
    largest, smallest = (f(values, span) for f in (scipy.ndimage.maximum_filter1d, scipy.ndimage.minimum_filter1d))
    moves = largest - smallest  # about each reading
    centres = np.arange(len(values))
    whole = (centres >= half) & (centres < len(values) - half)
    apart = (centres + half < start) | (centres - half >= start + length)
    chosen = moves[whole & apart]
    return len(chosen) > 0 and float(np.quantile(chosen, _STUCK_SHARE)) > least
