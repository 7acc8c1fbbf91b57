"""Results for single effects: a fit that was tried, a named effect, a row of the ranked table."""

from __future__ import annotations

from dataclasses import dataclass, field

from ..._internal.number_formats import value_and_std
from ..cross_validation import EffectByWindow
from ..effect_fit import EffectFit
from ..problem import EffectParameters


@dataclass
class Trial:
    """A fit that was tried.

    Args:
        base: the fit to which effects were added.
        fit: the fit with them.
        expected_gain: the drop of `-2 log L` that the linear prediction gives.
        reason: why the fit was rejected; empty where it was not.
    """

    base: EffectFit
    fit: EffectFit
    expected_gain: float
    reason: str = ""

    @property
    def gain(self) -> float:
        """The drop of `-2 log L`."""
        return self.base.cost - self.fit.cost

    @property
    def added_effects(self) -> tuple[EffectParameters, ...]:
        """The effects of `fit` that `base` does not have."""
        return tuple(effect for effect in self.fit.active if effect not in self.base.active)


@dataclass(frozen=True, eq=False)
class NamedEffect:
    """An effect that the plain model misses.

    Args:
        effect_parameters: the effect and the names of its parameters.
        values: value and standard deviation of each parameter, by its name.
        expected_gain: drop of `-2 log L` by the linear prediction.
        gain: drop of `-2 log L` by the refit.
        p_value: of the gain, family-wise over the entire library.
        alternatives: rival effects, which this record cannot distinguish from it.
        windows: its size in each quarter of the record.
        without: the fit without this effect.
        exchanged: fits with another effect in its place.
    """

    effect_parameters: EffectParameters
    values: dict[str, tuple[float, float]]
    expected_gain: float
    gain: float
    p_value: float
    alternatives: tuple[EffectParameters, ...]
    windows: EffectByWindow
    without: EffectFit = field(repr=False)
    exchanged: tuple[EffectFit, ...] = field(repr=False)


@dataclass(frozen=True, eq=False)
class RankedEffect:
    """One row of the ranked table: an effect against the plain model.

    Args:
        effect_parameters: the effect and the names of its parameters.
        label: the effect and its target, as text.
        expected_gain: drop of `-2 log L` by the linear prediction.
        gain: drop of `-2 log L` by a refit; None where none was made.
        size: expected size, in `unit`.
        std: standard deviation of the size, in `unit`.
        unit: unit of the size.
        shift: relative change of the diffusivity with the effect in the model.
        rivals: labels of the effects with nearly the same derivative.
        reason: why the effect is in the model or not.
    """

    effect_parameters: EffectParameters
    label: str
    expected_gain: float
    gain: float | None
    size: float
    std: float
    unit: str
    shift: float
    rivals: tuple[str, ...]
    reason: str

    @property
    def size_text(self) -> str:
        """The size with its standard deviation, in a unit that a person uses."""
        return value_and_std(self.size, self.std, self.unit)

    def __str__(self) -> str:
        gain = "" if self.gain is None else f"{self.gain:.0f}"
        similar = f" (similar: {', '.join(self.rivals[:2])})" if self.rivals else ""
        numbers = f"{self.expected_gain:8.0f} {gain:>7}  {self.size_text:<28} {100 * self.shift:+6.1f} %"
        return f"{self.label:<36} {numbers}  {self.reason}{similar}"
