"""Faces that are known every minute."""

import numpy as np
from scipy.signal import lfilter

MINUTES = 60  # of an hour


def face(rng, gust, days=20):
    """A face every minute, degC: a daily cycle, smooth weather with 8 and 2 hours, and gusts of 15 minutes."""
    count = days * 24 * MINUTES
    poles = np.exp(-1 / 60 / np.array([8.0, 2.0]))
    smooth = lfilter([1.0], np.poly(poles), rng.standard_normal(count + 3000))[3000:]
    memory = np.exp(-1 / 15)
    rough = lfilter([np.sqrt(1 - memory**2)], [1.0, -memory], rng.standard_normal(count))
    return 8 + 3 * np.sin(2 * np.pi * np.arange(count) / 1440) + smooth / smooth.std() + gust * rough
