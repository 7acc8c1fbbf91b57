"""Detection of outliers: spikes and stuck readings, relative to the usual variation of the same column.

Only faults that are obvious in a plot are detected. In a column that varies strongly, or hardly at all, nothing is
detected. The effects of `diagnose` (drift, wetting, sun) change slowly or last longer, and are not detected.
"""

from __future__ import annotations

import numpy as np
import scipy

_SPIKE_ROWS = 3  # readings in a spike at most
_SPIKE_SECONDS = 1800.0  # duration of a spike of several readings at most; sun or an open door last longer
_SPIKE_MIN_JUMP = 1.0  # K
_SPIKE_MEDIANS = 20.0  # the smallest jump, in median changes from reading to reading
_SPIKE_QUANTILES = 8.0  # the smallest jump, in 95 % quantiles of these changes
_SPIKE_FLANK_RANGE = 0.2  # of the jump: the largest distance of the readings around it from a line
_SPIKE_FRACTION = 0.1  # of the readings: more isolated ones are normal for the column
_FLANK = 3  # readings on each side; two of the six may be spikes too
_NEIGHBOURS = 3.0  # typical steps: readings farther apart are not neighbours

_STUCK_ROWS = 12  # readings in a stuck run at least
_STUCK_RANGE = 0.5  # K: the smallest range of intervals of the same length elsewhere
_STUCK_RESOLUTIONS = 20.0  # the same, in steps of the column's resolution
_STUCK_FRACTION = 0.05  # of these intervals may have a smaller range
_STUCK_RUNS = 40  # runs that are checked, the longest first
_FREEZING = 0.5  # K around 0 degC, where latent heat holds the temperature of a wet wall


def find_spikes(seconds: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Detect spikes: at most three readings, within half an hour, that jump away from their neighbours.

    A jump must exceed 1 K, 20 times the column's median change from reading to reading, and 8 times the 95 % quantile
    of these changes (without isolated readings). The neighbouring readings, and four of the six readings around the
    spike (all six at the ends of the column), must lie within a fifth of the jump from a straight line. A real change
    of temperature has a slower onset or decay.

    Args:
        seconds: times of the readings, increasing, (reading,).
        values: the readings, (reading,).

    Returns:
        Which readings are spikes, (reading,).
    """
    is_spike = np.zeros(len(values), bool)
    if len(values) < 8:
        return is_spike
    change = np.abs(np.diff(values))
    threshold = _SPIKE_MEDIANS * float(np.median(change))
    quantile = float(np.quantile(_changes_without_isolated(values, change, threshold), 0.95))
    min_jump = max(_SPIKE_MIN_JUMP, threshold, _SPIKE_QUANTILES * quantile)
    if change.max() <= min_jump:
        return is_spike
    step = float(np.median(np.diff(seconds)))
    values = np.pad(values, _FLANK, mode="reflect")
    seconds = np.pad(seconds, _FLANK, mode="reflect", reflect_type="odd")
    begins = np.flatnonzero(np.abs(np.diff(values)) > (1.0 - _SPIKE_FLANK_RANGE) * min_jump) + 1
    for rows in range(1, _SPIKE_ROWS + 1):
        if rows > 1 and (rows - 1) * step > _SPIKE_SECONDS:
            break
        start = begins[(begins >= _FLANK) & (begins + rows + _FLANK <= len(values))]
        flank_values = [values[start[:, None] + side] for side in (np.arange(-_FLANK, 0), rows + np.arange(_FLANK))]
        left, right = (np.median(side, axis=1)[:, None] for side in flank_values)
        # the line through the medians of both sides, and the distances of the readings from it
        line = left + (right - left) * (np.arange(-_FLANK, rows + _FLANK) + 2) / (rows + 3)
        distance = np.abs(values[start[:, None] + np.arange(-_FLANK, rows + _FLANK)] - line)
        jump = distance[:, _FLANK : _FLANK + rows].min(axis=1)
        beside = np.maximum(distance[:, _FLANK - 1], distance[:, _FLANK + rows])
        flanks = np.sort(np.delete(distance, np.s_[_FLANK : _FLANK + rows], axis=1), axis=1)
        edge = (start < 2 * _FLANK) | (start + rows + 2 * _FLANK > len(values))  # half of these readings are mirrored
        flanks = np.where(edge, flanks[:, -1], flanks[:, -3])
        smooth = np.maximum(flanks, beside) <= _SPIKE_FLANK_RANGE * jump
        near = seconds[start + rows] - seconds[start - 1] <= (_NEIGHBOURS + rows - 1) * step
        for first in start[(jump > min_jump) & smooth & near] - _FLANK:
            is_spike[first : first + rows] = True
    return is_spike


def _changes_without_isolated(values: np.ndarray, change: np.ndarray, threshold: float) -> np.ndarray:
    """The changes from reading to reading without those to and from isolated outliers.

    Otherwise some dozens of spikes would raise the quantile. Above a tenth of the readings they are normal and remain.
    """
    before, after = change[:-1], change[1:]
    back = np.abs(values[2:] - values[:-2]) <= _SPIKE_FLANK_RANGE * np.minimum(before, after)
    isolated = back & (np.minimum(before, after) > threshold)
    if isolated.mean() > _SPIKE_FRACTION:
        return change
    return np.delete(change, np.concatenate([np.flatnonzero(isolated), np.flatnonzero(isolated) + 1]))


def find_stuck_readings(values: np.ndarray) -> np.ndarray:
    """Detect stuck readings: they repeat the reading before, in a column that elsewhere always varies.

    A run of at least 12 equal readings is stuck if 95 % of the intervals of its length elsewhere in the column (of a
    quarter of the other readings at most) have a range above 0.5 K and above 20 times the column's resolution, and so
    do the readings directly before and after the run. Runs near 0 degC are kept: the cause may be freezing.

    Args:
        values: the readings in order, (reading,).

    Returns:
        Which readings are stuck, (reading,); the first of each run is not.
    """
    is_stuck = np.zeros(len(values), bool)
    if len(values) < 2 * _STUCK_ROWS:
        return is_stuck
    edges = np.flatnonzero(np.concatenate([[True], np.diff(values) != 0, [True]]))
    starts, lengths = edges[:-1], np.diff(edges)
    if lengths.max() < _STUCK_ROWS:
        return is_stuck
    changes = np.abs(np.diff(values))
    resolution = float(changes[changes > 0].min()) if (changes > 0).any() else 0.0
    min_range = max(_STUCK_RANGE, _STUCK_RESOLUTIONS * resolution)
    for run in np.argsort(-lengths, kind="stable")[:_STUCK_RUNS]:
        start, length = int(starts[run]), int(lengths[run])
        if length < _STUCK_ROWS:
            break
        others = len(values) - length
        span = min(length, max(others // 4, 1))
        if span < _STUCK_ROWS or not _varies_elsewhere(values, start, length, span, min_range):
            break  # shorter runs are even less significant
        sides = (values[max(0, start - length) : start], values[start + length : start + 2 * length])
        varies = all(np.ptp(side) > min_range for side in sides if len(side) >= _STUCK_ROWS)
        if varies and abs(values[start]) > _FREEZING:
            is_stuck[start + 1 : start + length] = True
    return is_stuck


def _varies_elsewhere(values: np.ndarray, start: int, length: int, span: int, min_range: float) -> bool:
    """Whether 95 % of the intervals of `span` readings outside a run have a range above `min_range`."""
    half = span // 2
    largest, smallest = (f(values, span) for f in (scipy.ndimage.maximum_filter1d, scipy.ndimage.minimum_filter1d))
    ranges = largest - smallest  # around each reading
    centres = np.arange(len(values))
    complete = (centres >= half) & (centres < len(values) - half)
    outside = (centres + half < start) | (centres - half >= start + length)
    selected = ranges[complete & outside]
    return len(selected) > 0 and float(np.quantile(selected, _STUCK_FRACTION)) > min_range
