"""The search for the effects that the plain model misses in a record."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from .._internal.blas_threads import one_blas_thread
from .._internal.progress import Progress, part_of, shown_progress
from ..case.case_definition import Case
from ..case.mixups import visible_mixups
from ..estimation.materials import implausible
from ..estimation.unknown_heat import UnknownHeat
from ..records.weather_year import WeatherYear
from .compilation import compile_together
from .cross_validation import cross_validate
from .effect_fit import EffectFit
from .heterogeneity.heterogeneity import compare_walls
from .mixups.mixup_search import MixupFit, best_mixup, copied_sensor, is_rather_a_lag, wrong_length_unit
from .next_measurement.search import what_to_measure
from .problem import diagnosis_problem
from .result.diagnosis_result import Diagnosis
from .screening import screen, screening_of
from .selection.acceptance import RIVAL, gain_by_chance, penalised_cost
from .selection.candidate_fits import CandidateFits, plain_model_of
from .selection.score_test import CandidateScores
from .selection.stepwise_selection import StepwiseSelection
from .unexplained_heat import UnexplainedHeat


@one_blas_thread
def diagnose(case: Case, *, progress: Progress | None = None) -> Diagnosis:
    """Find the physical effects that the plain model misses in the record of a case.

    The plain model is fitted, every effect of the library is ranked by a score test, the best candidates are added
    and fitted (stepwise selection), and both models are compared on days held out. Where something is missing, mix-ups
    of columns, places, units and clocks are tried too; one that explains the record as well as the effects do is named
    before them, and the search is repeated with the readings corrected. At last the measurement is sought that would
    answer what the record leaves open.

    Where the case has a section of stones and mortar, the wall is taken in one dimension, and what the section changes
    in the readings is part of a plain model. The search is made in it and in a homogeneous wall, and the effect
    `heterogeneity` is named where the record shows the section. Mix-ups and the next measurement are not sought then.

    Args:
        case: the case; its window is the entire record, or `[choices] diagnose_days`.
        progress: called as `progress(text, share)` with the step that begins and the completed share, 0 to 1;
            None for a bar in a notebook, and nothing elsewhere.

    Returns:
        The verdict, the named effects with their sizes, and the diffusivity with them in the model.

    Raises:
        InputError: no inner sensor and no plate has a reading; the weather file that `[plan]` states cannot be read.
        RuntimeError: 64-bit floats are switched off.

    Example:
        >>> diagnosis = wallid.diagnose(wallid.load("case.toml"))
        >>> print(diagnosis.verdict, diagnosis.sentence)
    """
    weather = _weather_of_plan(case)  # before the search: an error must not come after it
    with shown_progress(progress) as report:
        plain = _fit_plain_model(case, report)
        if plain.fits.problem.has_pattern:
            return _search_in_section(plain, report)
        mixup = _complete_mixup(plain, report)
        found = _search(plain, report) if mixup is None else _search_corrected(plain, mixup, report)
        if mixup is None and found.verdict != "adequate" and (equal := _equal_mixup(found, report)) is not None:
            found = _search_corrected(plain, equal, report)
        text = "diagnose: what to measure next"
        prescriptions = what_to_measure(found, lambda share: report(text, 0.96 + 0.03 * share), weather)
        course = _unknown_heat(found, report)
    others = (one for one in visible_mixups(case) if one.kind in ("flux_sign", "clock"))
    return replace(found, mixups=(*found.mixups, *others), prescriptions=prescriptions, unknown_heat=course)


def _weather_of_plan(case: Case) -> WeatherYear | None:
    """The weather of a typical year, for the next measurement; None where none is stated or none will be sought."""
    has_pattern = case.section is not None and not case.section.is_homogeneous
    if case.plan is None or has_pattern:
        return None
    return case.planned_campaign.read_weather()


def _search_in_section(plain: _PlainModel, progress: Progress) -> Diagnosis:
    """The search where the case has a section: in its model and in the homogeneous wall, which are then compared."""
    with_section = _search(plain, part_of(progress, 0.0, 0.6))
    fits, fit = plain_model_of(plain.fits.problem.without_pattern())
    homogeneous = _search(_PlainModel(fits, fit, fits.score_candidates(fit)), part_of(progress, 0.5, 0.98))
    prices = _price_of_effects(with_section), _price_of_effects(homogeneous)
    heterogeneity = compare_walls(with_section.final, homogeneous.final, prices)
    if heterogeneity.is_contradicted:
        found = replace(homogeneous, heterogeneity=heterogeneity, other_wall=with_section)
    else:
        found = replace(with_section, heterogeneity=heterogeneity, other_wall=homogeneous)
    if found.shows_heterogeneity:
        found = replace(found, gap=replace(found.gap, before=found.estimate_before.gap, held_out_before=None))
    return replace(found, unknown_heat=_unknown_heat(found, progress))


def _price_of_effects(found: Diagnosis) -> float:
    """The gain in -2 log L that chance alone gives to the effects that a search has named."""
    return gain_by_chance(found.scores.threshold, len(found.effects))


def _unknown_heat(found: Diagnosis, progress: Progress) -> UnknownHeat | None:
    """The course of the heat that would explain what no known effect does; None where nothing is left."""
    if found.verdict != "unnamed":
        return None
    progress("diagnose: the course of what is left", 0.99)
    heat = found.unexplained or UnexplainedHeat(found.final)
    return None if heat.disturbance is None else heat.course()


class _PlainModel(NamedTuple):
    """The plain model fitted to a case, with the score test of the library."""

    fits: CandidateFits
    fit: EffectFit
    scores: CandidateScores

    @property
    def explains_the_record(self) -> bool:
        """Whether the residual shows nothing, and the diffusivity is that of a material."""
        screening = screening_of(self.fits, self.fit, self.scores)
        prior = self.fits.problem.case.wall.diffusivity_prior
        return not screening.missing and not implausible(self.fit.diffusivity, prior)


def _fit_plain_model(case: Case, progress: Progress) -> _PlainModel:
    """Fit the plain model to a case."""
    progress("diagnose: compiling the models", 0.0)
    problem = diagnosis_problem(case)
    compile_together(problem)
    progress("diagnose: fitting the plain model", 0.3)
    fits, plain = plain_model_of(problem)
    return _PlainModel(fits, plain, fits.score_candidates(plain))


def _complete_mixup(plain: _PlainModel, progress: Progress) -> MixupFit | None:
    """The mix-up with whose correction the plain model leaves nothing: no effect can then be much better."""
    copies = copied_sensor(plain.fit)
    if copies is not None:
        return copies
    if plain.explains_the_record:
        return None
    progress("diagnose: trying mix-ups of columns, units and clocks", 0.4)
    best = best_mixup(plain.fit, plain.fit.noise)
    if best is not None and not is_rather_a_lag(plain.fit, best) and not screen(best.case).missing:
        return best
    return wrong_length_unit(plain.fit)  # another diffusivity, but the readings are explained no better


def _equal_mixup(found: Diagnosis, progress: Progress) -> MixupFit | None:
    """The mix-up that explains the record as well as the effects do, or better, although it leaves something."""
    progress("diagnose: comparing with mix-ups", 0.95)
    of_effects = penalised_cost(found.after) - found.problem.bins.nonempty
    return best_mixup(found.before, found.after.noise, of_effects + RIVAL)


def _search_corrected(plain: _PlainModel, mixup: MixupFit, progress: Progress) -> Diagnosis:
    """The search in the readings without a mix-up; the rms before it is that of the readings as they were stated."""
    found = _search(_fit_plain_model(mixup.case, progress), progress)
    before = plain.fits.plain_estimate(plain.fit)
    gap = replace(found.gap, before=before.gap, held_out_before=None)
    return replace(found, gap=gap, uncorrected=before, mixups=(mixup.mixup,))


def _search(plain_model: _PlainModel, progress: Progress) -> Diagnosis:
    """The search for effects in a case as it is stated."""
    fits, plain, scores = plain_model
    problem = fits.problem
    selection = StepwiseSelection(fits)
    progress("diagnose: ranking all effects and pairs", 0.5)
    plain_estimate = fits.plain_estimate(plain)
    chosen = selection.select_first(
        plain, scores, lambda share: progress("diagnose: fitting the best candidates", 0.55 + 0.15 * share)
    )
    best = selection.select_further(chosen, lambda share: progress("diagnose: stepwise selection", 0.7 + 0.15 * share))
    best = best if best.active else plain  # with the noise of the plain model
    progress("diagnose: comparing rival effects", 0.85)
    effects, p_value_of_one_more = selection.named_effects(best), selection.p_value_of_one_more(best)
    progress("diagnose: cross-validation", 0.9)
    if best.active:  # both with the noise of the final model
        plain = fits.plain_model_with_noise_of(best)
    found = Diagnosis(
        problem=problem,
        plain=plain_estimate,
        before=plain,
        after=best,
        effects=effects,
        scores=scores,
        trials=tuple(fits.trials),
        gap=cross_validate(plain, best),
        residual_tests_before=fits.residual_tests(plain),
        residual_tests_after=fits.residual_tests(best),
        p_value_of_one_more=p_value_of_one_more,
        rivals=tuple(selection.rivals),
    )
    if found.incomplete:
        return found
    progress("diagnose: heat that no effect explains", 0.94)
    return replace(found, unexplained=UnexplainedHeat(found.final, fits.model_error_allowance(best)))
