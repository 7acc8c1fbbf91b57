"""What each action makes of the next record: the readings that every explanation of a set then predicts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..problem import DiagnosisProblem
from .actions import Action
from .added_sensor import AddedSensor
from .confusable_sets import ConfusableSet
from .separation import Explanation, Separation

_SHARES = np.linspace(0.1, 0.9, 9)  # of the length, at which a sensor is tried
_LENGTHS = (1.5, 2.0, 3.0, 4.0, 6.0)  # of the record, in lengths of the present one
_LONG_ENOUGH = 0.9  # the probability from which a longer record is not tried
_LONGEST = 366.0  # days
_CLEAR_EXCESS = 60.0  # of a penalised cost, from which no refit changes that a rival is excluded


@dataclass(frozen=True, eq=False)
class Measurement:
    """The next record by one action.

    Args:
        action: what is changed; its probability is that by the derivatives.
        separations: how the rivals fall behind each effect of the set.
        length: of the record, in lengths of the present one.
        problem: makes the problem of the next record, with the same rows; None for that of the present one.
        sensor: the added sensor; None for none.
    """

    action: Action
    separations: tuple[Separation, ...] = field(repr=False)
    length: float = 1.0
    problem: Callable[[], DiagnosisProblem] | None = field(default=None, repr=False)
    sensor: AddedSensor | None = field(default=None, repr=False)


def repeated(confusable: ConfusableSet, explanations: Sequence[Explanation]) -> tuple[Separation, ...]:
    """A repeat of the present record."""
    return confusable.separations(explanations, confusable.fits[0].noise.whitening)
