"""Named parameters with values, units, priors and bounds, and the one place where they become a vector."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Float

from .._internal.arrays import index_array, on_device


@dataclass(frozen=True)
class Parameter:
    """One parameter of a model.

    Args:
        name: its kind with its target in brackets, such as "sensor_offset[T1]".
        unit: of the value; "" for a number.
        value: the initial value; a parameter that is not estimated keeps it.
        prior_std: standard deviation of its normal prior about 0, in `unit`. Infinite: no prior. 0: the parameter is
            known exactly and is not estimated.
        lower, upper: bounds of the search, in `unit`.
        scale: a typical size, in `unit`; None takes the prior standard deviation, or 1 without a prior.
    """

    name: str
    unit: str = ""
    value: float = 0.0
    prior_std: float = np.inf
    lower: float = -np.inf
    upper: float = np.inf
    scale: float | None = None


@cache
def kind_of(name: str) -> str:
    """The kind of a parameter: "sensor_offset" of "sensor_offset[T1]"."""
    return name.partition("[")[0]


def target_of(name: str) -> str:
    """The target of a parameter: "T1" of "sensor_offset[T1]"; "" where it has none."""
    return name.partition("[")[2].rpartition("]")[0]  # a column may have brackets in its name


class Parameters(eqx.Module):
    """All parameters of a model, addressed by name.

    A pytree. Values, priors, bounds and the mask of estimated parameters are arrays, so one compiled function serves
    every choice of them. Names and units are static.

    Args:
        values, prior_std, lower, upper, scale: as in `Parameter`, each in the parameter's own unit.
        estimated: the mask of the parameters that a fit may change.
        names, units: in the order of the arrays.
    """

    values: Float[Array, " param"] = eqx.field(converter=on_device)
    prior_std: Float[Array, " param"] = eqx.field(converter=on_device)
    lower: Float[Array, " param"] = eqx.field(converter=on_device)
    upper: Float[Array, " param"] = eqx.field(converter=on_device)
    scale: Float[Array, " param"] = eqx.field(converter=on_device)
    estimated: Bool[Array, " param"] = eqx.field(converter=on_device)
    names: tuple[str, ...] = eqx.field(static=True)
    units: tuple[str, ...] = eqx.field(static=True)

    @staticmethod
    def of(parameters: Iterable[Parameter]) -> Parameters:
        """The parameters in this order, each estimated unless its prior standard deviation is 0.

        Raises:
            ValueError: a name occurs twice; a value is outside its bounds; a prior standard deviation is negative.
        """
        parameters = tuple(parameters)
        names = tuple(parameter.name for parameter in parameters)
        for k, one in enumerate(parameters):
            if one.name in names[:k]:
                raise ValueError(f"Parameters: {one.name} occurs twice; names must be unique")
            if not one.lower <= one.value <= one.upper:
                raise ValueError(f"Parameters: {one.name} = {one.value:g} is outside {one.lower:g} to {one.upper:g}")
            if not one.prior_std >= 0:
                raise ValueError(f"Parameters: prior_std of {one.name} is {one.prior_std:g}; it must be 0 or above")
        prior_std = np.array([one.prior_std for one in parameters])
        typical = np.where(np.isfinite(prior_std) & (prior_std > 0), prior_std, 1.0)
        return Parameters(
            values=np.array([one.value for one in parameters], float),
            prior_std=prior_std,
            lower=np.array([one.lower for one in parameters], float),
            upper=np.array([one.upper for one in parameters], float),
            scale=np.array([one.scale or size for one, size in zip(parameters, typical, strict=True)], float),
            estimated=prior_std > 0,
            names=names,
            units=tuple(parameter.unit for parameter in parameters),
        )

    def within(self, name: str, lower: float, upper: float) -> Parameters:
        """The same parameters, one with other bounds and its value between them."""
        k = self.index(name)
        value = float(np.clip(float(self.values[k]), lower, upper))
        return eqx.tree_at(
            lambda p: (p.values, p.lower, p.upper),
            self,
            (self.values.at[k].set(value), self.lower.at[k].set(lower), self.upper.at[k].set(upper)),
        )

    def followed_by(self, others: Iterable[Parameter]) -> Parameters:
        """These parameters, then some others."""
        more = Parameters.of(others)
        arrays = ("values", "prior_std", "lower", "upper", "scale", "estimated")
        joined = {name: jnp.concatenate([getattr(self, name), getattr(more, name)]) for name in arrays}
        return Parameters(**joined, names=self.names + more.names, units=self.units + more.units)

    def __len__(self) -> int:
        return len(self.names)

    def __contains__(self, name: str) -> bool:
        return name in self.names

    def __getitem__(self, name: str) -> Array:
        return index_array(self.values, self.index(name))

    def index(self, name: str) -> int:
        """The index of a name in the arrays.

        Raises:
            KeyError: there is no parameter of this name; the message lists those of its kind.
        """
        try:
            return self.names.index(name)
        except ValueError:
            names = self.of_kind(kind_of(name)) or self.names
            raise KeyError(f"no parameter {name}; there are {', '.join(names)}") from None

    def indices(self, names: Iterable[str]) -> np.ndarray:
        """The indices of some names in the arrays."""
        known = {name: k for k, name in enumerate(self.names)}  # a method of a module takes 0.1 ms to call
        return np.array([known[name] if name in known else self.index(name) for name in names], int)

    def of_kind(self, *kinds: str) -> tuple[str, ...]:
        """The names of some kinds, in the order of the arrays."""
        return tuple(name for name in self.names if kind_of(name) in kinds)

    @property
    def estimated_names(self) -> tuple[str, ...]:
        """The names of the parameters that are estimated, in the order of the arrays."""
        return tuple(name for name, mask in zip(self.names, np.asarray(self.estimated), strict=True) if mask)

    def vector(self, names: Iterable[str]) -> Float[Array, " chosen"]:
        """The values of some parameters, in the order of the names."""
        return index_array(self.values, self.indices(names))

    def in_prior_std(self, names: Iterable[str]) -> np.ndarray:
        """The values of some parameters over their prior standard deviations."""
        indices = self.indices(names)
        return np.asarray(self.values)[indices] / np.asarray(self.prior_std)[indices]

    def with_values(self, values: Mapping[str, Any] | Float[Array, " param"]) -> Parameters:
        """The same parameters with other values: of some parameters by name, or of all in order."""
        if not isinstance(values, Mapping):
            new = values
        elif any(isinstance(value, Tracer) for value in (self.values, *values.values())):
            new = self.values.at[self.indices(values)].set(jnp.stack([jnp.asarray(v, float) for v in values.values()]))
        else:
            new = np.array(self.values)
            new[self.indices(values)] = list(values.values())
        return eqx.tree_at(lambda p: p.values, self, on_device(new))

    def with_known_values(self, values: Mapping[str, Any]) -> Parameters:
        """The same parameters with the values of those that are here; others of the mapping are left out."""
        return self.with_values({name: values[name] for name in self.names if name in values})

    def estimating(self, names: Iterable[str]) -> Parameters:
        """The same parameters, of which only these are estimated."""
        mask = np.zeros(len(self), bool)
        mask[self.indices(names)] = True
        return eqx.tree_at(lambda p: p.estimated, self, on_device(mask))

    def flatten(self) -> np.ndarray:
        """The values of the estimated parameters in the order of their names, for an optimizer."""
        return np.asarray(self.values)[np.asarray(self.estimated)]

    def unflatten(self, vector: np.ndarray) -> Parameters:
        """The same parameters with the values of `flatten` replaced."""
        values = np.array(self.values)
        values[np.asarray(self.estimated)] = vector
        return self.with_values(on_device(values))

    def to_dict(self) -> dict[str, float]:
        """Every value by its name."""
        return dict(zip(self.names, np.asarray(self.values).tolist(), strict=True))
