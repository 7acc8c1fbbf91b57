"""The actions after which a diagnosis may name the right effect, with their effort."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from ..._internal.number_formats import date_of
from ..problem import EffectParameters

ActionKind = Literal["sensor", "flux_plate", "column", "longer", "season", "shade", "swap", "heating"]
EFFORTS: Mapping[str, float] = {
    "column": 1.0,
    "longer": 1.0,
    "swap": 1.5,
    "shade": 2.0,
    "heating": 2.0,
    "season": 2.0,
    "flux_plate": 2.0,
    "sensor": 3.0,
}
"""The default effort of each action, relative to that of logging one more column."""
HELPFUL = 0.5
"""The probability from which an action is proposed."""
_MOST_SHOWN = 5
_PROBABILITY_PER_EFFORT = 0.05  # by which an action must be more probable for each unit of effort


@dataclass(frozen=True)
class Action:
    """A change of the next record, and the probability that its diagnosis is right.

    Args:
        kind: of the action.
        parameters: of the action, as in result.json.
        days: length of the record that it needs, days.
        effort: relative to that of logging one more column.
        probability: that the true effect is named in the next record, and no other is an alternative.
    """

    kind: ActionKind
    parameters: dict[str, Any]
    days: float
    effort: float
    probability: float

    def to_dict(self) -> dict[str, Any]:
        """The entry of result.json."""
        numbers = {"days": self.days, "probability": self.probability, "effort": self.effort}
        return {"kind": self.kind, **self.parameters, **numbers}

    @property
    def words(self) -> str:
        """What to do, in words."""
        match self.kind:
            case "sensor":
                return f"put one more temperature sensor {self.parameters['position']:.3g} m from the left face"
            case "flux_plate":
                return f"put a heat flux plate on the {self.parameters['face']} face"
            case "column":
                return f"log the {_words_of(self.parameters['column'])}"
            case "longer":
                return f"record {self.days:.3g} days in the same way"
            case "shade":
                return f"shade the {self.parameters['face']} face during the second half of the record"
            case "season":
                return f"repeat the record from about {date_of(self.parameters['start'])} on"
            case "swap":
                return f"exchange the sensors {' and '.join(self.parameters['sensors'])}, and record again"
            case "heating":
                power, hours = self.parameters["power"], self.parameters["hours"]
                return f"heat the inner face once with {power:.0f} W/m2 for {hours:.0f} h"

    @property
    def short_words(self) -> str:
        """What to do, in a few words."""
        match self.kind:
            case "sensor":
                return f"sensor at {100 * self.parameters['position']:.3g} cm"
            case "flux_plate":
                return f"plate on the {self.parameters['face']} face"
            case "column":
                return f"log {self.parameters['column'].replace('_', ' ')}"
            case "longer":
                return f"{self.days:.3g} days"
            case "shade":
                return f"shade the {self.parameters['face']} face"
            case "season":
                return f"from {date_of(self.parameters['start'])} on"
            case "swap":
                return f"exchange {' and '.join(self.parameters['sensors'])}"
            case "heating":
                return f"heat for {self.parameters['hours']:.0f} h"


_COLUMN_WORDS = {
    "irradiance": "irradiance on the outer face",
    "air_outdoor": "outdoor air temperature",
    "air_indoor": "indoor air temperature",
}


def _words_of(column: str) -> str:
    return _COLUMN_WORDS.get(column, column)


@dataclass(frozen=True, eq=False)
class Prescription:
    """What to measure so that the next diagnosis answers one question.

    Args:
        separate: the effects that the record cannot distinguish, or that it could not be tested for; empty where the
            record is uninformative.
        labels: of these effects.
        now: probability that a repeat of this record would name the right one alone (or be informative).
        actions: those that help, the best first.
        tried: the kinds of action that were tried.
        curve: positions (m) and probabilities of one more sensor; empty where none was tried.
        column: that the effects need; empty where they could be tested for.
        refused: where no action is probable enough, the most probable of the best of each kind, if it is better than
            a repeat.
    """

    separate: tuple[EffectParameters, ...]
    labels: tuple[str, ...]
    now: float
    actions: tuple[Action, ...]
    tried: tuple[ActionKind, ...]
    curve: tuple[tuple[float, float], ...] = field(default=(), repr=False)
    column: str = ""
    refused: Action | None = field(default=None, repr=False)

    @property
    def question(self) -> str:
        """What the record leaves open, as the beginning of a sentence."""
        if self.column:
            return f"To test for {_list_of(self.labels)}"
        if not self.separate:
            return "To determine the diffusivity"
        return f"To distinguish {self.labels[0]} from {_list_of(self.labels[1:])}"

    @property
    def sentence(self) -> str:
        """What to measure next, with the probability that the next diagnosis is then right."""
        if not self.actions and self.now >= HELPFUL:
            return (
                f"{self.question}, a mere repeat of this record is as good as all that was tried: the next diagnosis "
                f"is then right with probability {self.now:.2f}."
            )
        event = "an effect of typical size is then named" if self.column else "the next diagnosis is then right"
        if not self.actions and self.column:
            text = f"{self.question}, logging the {_words_of(self.column)} is probably not enough"
            return f"{text}: {event} with probability {0.0 if self.refused is None else self.refused.probability:.2f}."
        if not self.actions:
            tried = _list_of([_KIND_WORDS[kind] for kind in self.tried])
            text, best = f"{self.question}, nothing that was tried is probably enough: {tried}", self.refused
            return f"{text}. The best of them: {best.words} ({best.probability:.2f})." if best else f"{text}."
        best, *others = self.actions
        text = f"{self.question}, {best.words}: {event} with probability {best.probability:.2f}"
        if not self.column:
            text += f", after a mere repeat of this record with {self.now:.2f}"
        if others:
            text += f". Or {_list_of([f'{one.words} ({one.probability:.2f})' for one in others])}"
        if self.curve and max(probability for _, probability in self.curve) < HELPFUL:
            text += ". No further temperature sensor is probably enough"
        return f"{text}."

    @property
    def step(self) -> str:
        """The best action in a few words; empty where there is none."""
        if not self.actions:
            return ""
        best = self.actions[0]
        event = "an effect of typical size is named" if self.column else "right"
        return f"{self.question}, {best.words} ({event} with probability {best.probability:.2f})"

    def to_dict(self, target_of: Callable[[EffectParameters], str | None]) -> dict[str, Any]:
        """The entry of result.json.

        Args:
            target_of: the target of an effect as in result.json.
        """
        separate = [{"name": one.effect.name, "target": target_of(one)} for one in self.separate]
        return {"separate": separate, "now": self.now, "actions": [action.to_dict() for action in self.actions]}


_KIND_WORDS: Mapping[ActionKind, str] = {
    "sensor": "a further temperature sensor",
    "flux_plate": "a heat flux plate",
    "column": "logging the column",
    "longer": "a record of up to six times the length",
    "season": "another season",
    "shade": "shading the outer face",
    "swap": "exchanging two sensors",
    "heating": "heating the inner face",
}


def _list_of(texts: Sequence[str]) -> str:
    """Texts as a list with "or"."""
    return texts[0] if len(texts) == 1 else f"{', '.join(texts[:-1])} or {texts[-1]}"


def best_actions(actions: Sequence[Action], now: float) -> tuple[Action, ...]:
    """The actions that help more than a mere repeat of the record, by probability and effort, the best first.

    At most five.
    """
    helpful = [action for action in actions if action.probability >= HELPFUL and action.probability > now]
    return tuple(sorted(helpful, key=score, reverse=True)[:_MOST_SHOWN])


def not_probable_enough(actions: Sequence[Action], now: float) -> Action | None:
    """The most probable action, where none is probable enough and it is better than a repeat; else None."""
    best = best_of(actions) if actions else None
    return best if best is not None and now < best.probability < HELPFUL else None


def best_of(actions: Sequence[Action]) -> Action:
    """The best action that is probable enough, by probability and effort; the most probable one where none is."""
    probable = [action for action in actions if action.probability >= HELPFUL]
    return max(probable, key=score) if probable else max(actions, key=lambda action: action.probability)


def score(action: Action) -> float:
    """The probability of an action less the price of its effort."""
    return action.probability - _PROBABILITY_PER_EFFORT * action.effort
