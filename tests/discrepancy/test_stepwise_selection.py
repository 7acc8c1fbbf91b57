"""The stepwise selection ends, and compares a fit with those of its own size."""

from dataclasses import dataclass

from wallid.discrepancy.selection.stepwise_selection import StepwiseSelection, _has_one_more


@dataclass(frozen=True)
class Fit:
    active: tuple[str, ...]


class Fits:
    problem = None
    trials = ()  # no single effect was tried before

    def refit_with_estimated_noise(self, fit):
        return fit


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
