"""A next record with an instrument of another kind: a heat flux plate, or the first temperature sensor inside.

The model of such a record has other readings, so it is compiled anew. One more sensor beside others is not
(`added_sensor`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from ..._internal.arrays import on_device
from ...case.planned_campaign import TYPICAL_SENSOR
from ...case.wall_and_sensors import SIDES, Side
from ...experiment_design.campaign_plan.typical_case import conductivity_of
from ...models.flux_plates import fluxes_of
from ..effect_fit import EffectFit
from ..model_with_effects import linearise
from ..problem import DiagnosisProblem, diagnosis_problem
from ..selection.stepwise_selection import added_effect
from .candidate_records import SHARES, CandidateRecord, with_profile_of
from .changed_records import ChangedRecord
from .present_record import PresentRecord
from .refits import same_effects
from .separation import Explanation


class _RecordWithInstrument(ChangedRecord):
    """A record with one more instrument, whose errors are estimated beside the parameters of the present record."""

    def _explanation(self, fit: EffectFit, present: Explanation) -> Explanation:
        problem, effects = self.problem, same_effects(self, fit)
        parameters = self.next_parameters(fit).estimating(problem.estimated_names(effects))
        names, linear = parameters.estimated_names, problem.is_linear(effects)
        predicted, slopes = linearise(problem.model, problem.bins, parameters, names, linear=linear)
        mask = np.asarray(parameters.estimated)
        values, prior_std = (np.asarray(part)[mask] for part in (parameters.values, parameters.prior_std))
        return Explanation(names, problem.binned(predicted), slopes.T, values, prior_std, present.penalty)


class RecordWithPlate(_RecordWithInstrument):
    """A record with a heat flux plate on a face.

    Args:
        present: the present one.
        face: without a plate so far.
    """

    kind = "flux_plate"

    def __init__(self, present: PresentRecord, face: Side):
        super().__init__(present)
        self.face = face

    def parameters(self) -> dict[str, Any]:
        """The face."""
        return {"face": self.face}

    @cached_property
    def problem(self) -> DiagnosisProblem:
        """The present record with a column of the plate, whose readings are not used.

        Without a plate so far, the conductivity is that of the case or a typical one.
        """
        present = self.present.problem
        case, record = present.case, present.case.record
        plates = {**record.regressors, f"flux_{self.face}": np.zeros(record.rows)}
        record = replace(record, regressors=plates)
        problem = with_profile_of(diagnosis_problem(replace(case, record=record)), present)
        reference = present.model.reference_conductivity
        if not fluxes_of(case):
            reference = on_device(conductivity_of(case.wall, self.present.diffusivity))
        return replace(problem, model=replace(problem.model, reference_conductivity=reference))

    @cached_property
    def further(self) -> tuple[Explanation, ...]:
        """What the resistance of the plate and its contact predicts: the readings by a film that is as small."""
        *fits, base = self.present.fits
        pairs = zip(fits, self.explanations[:-1], strict=True)
        return tuple(one for fit, one in pairs if self._has_small_film(fit, base))

    def _has_small_film(self, fit: EffectFit, base: EffectFit) -> bool:
        """Whether the effect that a fit adds to a base is a film on the face that may be a plate's resistance."""
        film, parameters = added_effect(fit, base), self.problem.parameters
        if film.effect.target != self.face:
            return False
        sizes = [one.names[0] for one in self.problem.library if one.effect.is_special_case_of(film.effect)]
        largest = np.asarray(parameters.upper)[parameters.indices(sizes)]
        resistance = float(fit.parameters[film.names[0]]) / float(self.problem.model.reference_conductivity)
        return bool(np.any(resistance <= largest))


class RecordWithFirstSensor(_RecordWithInstrument):
    """A record of plates with a temperature sensor inside the wall.

    Args:
        present: the present one, without a sensor inside.
        position: of the sensor, m from the left face.
    """

    kind = "sensor"

    def __init__(self, present: PresentRecord, position: float):
        super().__init__(present)
        self.position = position

    def parameters(self) -> dict[str, Any]:
        """The position, m."""
        return {"position": self.position}

    @cached_property
    def problem(self) -> DiagnosisProblem:
        """The present record with a column of the sensor, whose readings are not used."""
        present = self.present.problem
        record = replace(
            present.case.record, sensors=present.case.record.faces.mean(axis=1, keepdims=True), names=("new 1",)
        )
        sensor = replace(TYPICAL_SENSOR, name="new 1", position=self.position)
        problem = diagnosis_problem(replace(present.case, record=record, sensors=(sensor,)))
        return with_profile_of(problem, present)


def records_with_instrument(present: PresentRecord) -> Iterator[CandidateRecord]:
    """A record with a first plate on the inner face, or a second one on the other; or with the first sensor inside.

    The sensor is tried at each of nine places.
    """
    case, plates = present.problem.case, fluxes_of(present.problem.case)
    yield from (
        RecordWithPlate(present, face) for face in SIDES if (face not in plates if plates else face == case.wall.inside)
    )
    if not case.sensors:
        yield from (RecordWithFirstSensor(present, share * case.wall.length) for share in SHARES.tolist())
