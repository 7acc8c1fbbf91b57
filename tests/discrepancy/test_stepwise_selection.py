"""The stepwise selection ends, and compares a fit with those of its own size."""

from dataclasses import dataclass
from types import SimpleNamespace

import pytest

from wallid.discrepancy.effects.faces import SurfaceFilm
from wallid.discrepancy.effects.plates import PlateResistance
from wallid.discrepancy.problem import EffectParameters
from wallid.discrepancy.selection import stepwise_selection
from wallid.discrepancy.selection.stepwise_selection import StepwiseSelection, _has_one_more, _is_special_case


@dataclass(frozen=True)
class Fit:
    active: tuple[str, ...]
    at_bound: tuple[str, ...] = ()


class Fits:
    problem = None
    trials = ()  # no single effect was tried before

    def __init__(self, p_value_of_plain=1.0):
        self.p_value_of_plain = p_value_of_plain

    def refit_with_estimated_noise(self, fit):
        return fit

    def without(self, fit, effect):
        return Fit(tuple(one for one in fit.active if one != effect))

    def residual_tests(self, fit):
        return SimpleNamespace(p_value=1.0 if fit.active else self.p_value_of_plain)


@pytest.fixture(autouse=True)
def what_is_negligible(monkeypatch):
    """The effects that are too small to be reported, by their names."""
    negligible = set[str]()
    monkeypatch.setattr(stepwise_selection, "reason_to_neglect", lambda fit, one: one if one in negligible else "")
    return negligible


def test_an_effect_that_was_removed_is_not_added_again():
    """The second effect is significant when it is added, and not any more with the noise estimated again."""
    added = []

    class Selection(StepwiseSelection):
        def _exchange(self, fit):
            return Fit(("gain", "plate_lag")) if len(fit.active) == 2 else fit

        def _add_one(self, fit, removed):
            if "face_lag" in removed:
                return fit
            added.append("face_lag")
            return Fit((*fit.active, "face_lag"))

        def _remove_one(self, fit):
            return Fit(("gain",)) if "plate_lag" in fit.active else fit

    found = Selection(Fits()).select_further(Fit(("gain",)), lambda share: None)
    assert found.active == ("gain",) and added == ["face_lag"]


def test_an_effect_that_was_exchanged_may_come_back_beside_the_other():
    class Selection(StepwiseSelection):
        def _exchange(self, fit):
            return Fit(("lag",)) if fit.active == ("offset",) else fit

        def _add_one(self, fit, removed):
            return fit if "offset" in removed or len(fit.active) > 1 else Fit((*fit.active, "offset"))

        def _remove_one(self, fit):
            return fit

    found = Selection(Fits()).select_further(Fit(("offset",)), lambda share: None)
    assert set(found.active) == {"lag", "offset"}


def test_rivals_have_as_many_effects_as_the_fit():
    base = Fit(("gain",))
    assert _has_one_more(Fit(("gain", "lag")), base)
    assert not _has_one_more(Fit(("gain", "lag", "offset")), base)
    assert not _has_one_more(Fit(("offset", "lag")), base) and not _has_one_more(base, base)


@pytest.mark.parametrize(
    ("p_value", "rival", "left"),
    [
        pytest.param(0.5, "", (), id="nothing shows it"),
        pytest.param(1e-4, "", ("offset",), id="the residual shows it"),
        pytest.param(0.5, "lag", ("offset",), id="what explains the record too would be reported"),
        pytest.param(0.5, "drift", (), id="what explains the record too is negligible"),
    ],
)
def test_a_negligible_effect_is_left_out_where_nothing_shows_it(what_is_negligible, monkeypatch, p_value, rival, left):
    what_is_negligible |= {"offset", "drift"}
    monkeypatch.setattr(stepwise_selection, "penalised_cost", lambda fit: 0.0)
    monkeypatch.setattr(stepwise_selection, "reason_for_refusal", lambda fit: "")
    selection = StepwiseSelection(Fits(p_value))
    selection.rivals = [Fit((rival,))] if rival else []
    assert selection._without_negligible(Fit(("offset",))).active == left


def test_beside_a_negligible_effect_the_others_have_to_be_significant(what_is_negligible):
    class Selection(StepwiseSelection):
        significant = True

        def _is_significant(self, fit, effect):
            return self.significant

    what_is_negligible.add("offset")
    selection = Selection(Fits())
    assert selection._without_negligible(Fit(("offset", "lag"))).active == ("lag",)
    selection.significant = False
    assert selection._without_negligible(Fit(("offset", "lag"))).active == ()
    assert selection._without_negligible(Fit(("lag", "drift"))).active == ("lag", "drift")


def test_a_rival_at_a_bound_is_not_excluded(monkeypatch):
    """It explains the record nearly as well inside; one whose size may be zero is excluded."""
    monkeypatch.setattr(stepwise_selection, "penalised_cost", lambda fit: fit.cost)
    monkeypatch.setattr(stepwise_selection, "reason_for_refusal", lambda fit: fit.reason)

    def rival(name, cost, at_bound=(), reason=""):
        return SimpleNamespace(active=(name,), cost=cost, at_bound=at_bound, reason=reason)

    selection = StepwiseSelection(Fits())
    inside, at_bound = rival("inside", 8.0), rival("at the bound", 8.0, ("place",), "at the bound")
    small, far = rival("small", 8.0, (), "may be zero"), rival("far", 9.5, ("place",), "at the bound")
    selection.rivals = [inside, at_bound, small, far]
    assert selection._close_rivals(SimpleNamespace(cost=0.0), Fit(())) == [inside, at_bound]


def test_a_resistance_of_a_plate_is_a_special_case_of_a_film_of_its_face():
    film, other = (EffectParameters(SurfaceFilm(side=side), (side,)) for side in ("left", "right"))
    plate = EffectParameters(PlateResistance(side="left"), ("resistance",))
    assert _is_special_case(Fit((plate,)), Fit(()), film)
    assert not _is_special_case(Fit((film,)), Fit(()), plate), "the film has the wider range"
    assert not _is_special_case(Fit((plate,)), Fit(()), other), "of the other face"
    assert not _is_special_case(Fit((plate,)), Fit((other,)), film), "beside another effect, of another size of model"
