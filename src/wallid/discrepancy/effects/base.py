"""What an effect is: something that may be missing from the plain model, which is back where its size is 0."""

from __future__ import annotations

import abc
import dataclasses
from collections.abc import Iterator
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from ..._internal.arrays import on_device
from .equation_terms import ForcingData, Terms
from .search_range import Search


@dataclasses.dataclass(frozen=True)
class Parameter:
    """One parameter of an effect.

    Args:
        name: as in result.json.
        unit: of `name`.
        scale: a typical size, by which the search is scaled.
        worth: the smallest size worth reporting; None for a parameter that only says where or when.
        least, most: bounds; None where there is none (or where it follows from the wall or the record).
    """

    name: str
    unit: str
    scale: float
    worth: float | None = None
    least: float | None = None
    most: float | None = None

    @property
    def is_size(self) -> bool:
        """Whether its neutral value 0 gives the plain model back."""
        return self.worth is not None


class AbstractEffect(eqx.Module):
    """An effect at its parameters' values; every parameter is a field of the same name.

    Class attributes: `name`, `parameters` (the first is the size, 0 where neutral), `linear` (whether the
    wall stays linear and its coefficients constant in time), `needs` (regressors).
    """

    name: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]]
    linear: ClassVar[bool] = True
    needs: ClassVar[tuple[str, ...]] = ()

    @property
    def target(self) -> str | int | None:
        """Which face, air or (as a number) inner sensor it is about; None for the wall as a whole."""
        return None

    @property
    def variant(self) -> str:
        """Which form of the effect, where it has several."""
        return ""

    @property
    def event(self) -> tuple[float, float] | None:
        """When it begins and how long it lasts, s, of what happens once; None of what lasts all the record."""
        return None

    @abc.abstractmethod
    def extend(self, terms: Terms, campaign: ForcingData) -> Terms:
        """The terms with this effect in."""

    def required(self) -> tuple[str, ...]:
        """The regressors that a record needs for this effect."""
        return self.needs

    def scan(self, search: Search) -> Iterator[dict[str, float]]:
        """The grid of places, times or temperatures on which the screen looks for the effect."""
        del search
        yield {}

    def bounds(self, parameter: Parameter, search: Search) -> tuple[float, float]:
        """Between which values a parameter is searched."""
        del search
        infinity = float("inf")
        return (
            -infinity if parameter.least is None else parameter.least,
            infinity if parameter.most is None else parameter.most,
        )

    def at(self, values: dict[str, Any]) -> AbstractEffect:
        """The same effect at other values of its parameters."""
        return dataclasses.replace(self, **values)


def not_below(value: Array, least: float) -> Array:
    """The value, or the bound where it lies beyond; its slope at the bound is that from within."""
    return jnp.where(value >= least, value, least)


def number(value: float = 0.0) -> Any:
    """A field for a parameter: an array, so that a new value is not compiled anew."""
    return eqx.field(converter=lambda given: jnp.asarray(on_device(given), dtype=float), default=value)
