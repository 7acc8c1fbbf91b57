"""The interface of an effect: a change of the equations that vanishes where its size is 0."""

from __future__ import annotations

import abc
import dataclasses
from collections.abc import Iterator, Sequence
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from ..._internal.arrays import on_device
from .equation_terms import ForcingData, Terms
from .search_range import SearchRange


@dataclasses.dataclass(frozen=True)
class Parameter:
    """One parameter of an effect.

    Args:
        name: as in result.json.
        unit: unit of the value.
        scale: typical magnitude.
        smallest_reported: smallest size that is reported; None for a position, time or temperature.
        lower: lower bound; None where there is none, or where it follows from the wall or the record.
        upper: upper bound; None likewise.
    """

    name: str
    unit: str
    scale: float
    smallest_reported: float | None = None
    lower: float | None = None
    upper: float | None = None

    @property
    def is_size(self) -> bool:
        """Whether it is the size, which is 0 in the plain model."""
        return self.smallest_reported is not None


class AbstractEffect(eqx.Module):
    """An effect at some values of its parameters; each parameter is a field of the same name.

    Class attributes: `name`; `variant`, the form of the effect where it has several; `parameters`, of which the first
    is the size, 0 in the plain model; `linear`, whether the wall remains linear with coefficients constant in time;
    `needs`, the regressors that the record must have; `special_case_of`, an effect that gives the same readings on the
    same target in a wider range: this one is named where both explain a record alike.
    """

    name: ClassVar[str]
    variant: ClassVar[str] = ""
    parameters: ClassVar[tuple[Parameter, ...]]
    linear: ClassVar[bool] = True
    needs: ClassVar[tuple[str, ...]] = ()
    special_case_of: ClassVar[str] = ""

    @property
    def target(self) -> str | int | None:
        """The face, the air, or the index of the inner sensor; None for the entire wall."""
        return None

    def is_special_case_of(self, other: AbstractEffect) -> bool:
        """Whether it gives the same readings as another effect, in a narrower range of that one's size."""
        return (self.special_case_of, self.target) == (other.name, other.target)

    def target_name(self, sensors: Sequence[str]) -> str | None:
        """The target as in result.json, from the names of the inner sensors."""
        return sensors[self.target] if isinstance(self.target, int) else self.target

    def parameter_names(self, sensors: Sequence[str]) -> tuple[str, ...]:
        """Its parameters among all of a model: "effect.KIND[TARGET].PARAMETER", the form in the brackets too."""
        brackets = ", ".join(part for part in (self.target_name(sensors), self.variant) if part)
        effect = f"effect.{self.name}[{brackets}]" if brackets else f"effect.{self.name}"
        return tuple(f"{effect}.{parameter.name}" for parameter in self.parameters)

    @property
    def event(self) -> tuple[float, float] | None:
        """Start and duration of a single event, s; None for an effect that acts during the entire record."""
        return None

    @abc.abstractmethod
    def apply(self, terms: Terms, forcing: ForcingData) -> Terms:
        """The terms with this effect added."""

    def required_regressors(self) -> tuple[str, ...]:
        """The regressors that the record must have for this effect."""
        return self.needs

    def scan(self, search_range: SearchRange) -> Iterator[dict[str, float]]:
        """The grid of positions, times or temperatures at which the score test evaluates the effect."""
        del search_range
        yield {}

    def bounds(self, parameter: Parameter, search_range: SearchRange) -> tuple[float, float]:
        """Lower and upper bound of a parameter."""
        del search_range
        infinity = float("inf")
        return (
            -infinity if parameter.lower is None else parameter.lower,
            infinity if parameter.upper is None else parameter.upper,
        )

    def at(self, values: dict[str, Any]) -> AbstractEffect:
        """The effect at other values of its parameters."""
        return dataclasses.replace(self, **values)


def lower_bounded(value: Array, least: float) -> Array:
    """The larger of a value and a bound; at the bound its derivative is that of the value."""
    return jnp.where(value >= least, value, least)


def parameter_field(value: float = 0.0) -> Any:
    """A dataclass field for a parameter: an array, so that a new value needs no new compilation."""
    return eqx.field(converter=lambda number: jnp.asarray(on_device(number), dtype=float), default=value)
