"""What would make a record informative about the diffusivity: the expected interval of the next record.

With the readings linear in their parameters about a diffusivity, the standard error of ln(alpha) follows from the
whitened Jacobian with the rows of the priors. A record is informative where the 95 % interval has a ratio of at most
`largest_interval_factor`. The noise that the next record will show is not known exactly, so that is a probability. It
is averaged over the diffusivities that the present record leaves open.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ...experiment_design.campaign_plan.expected_intervals import chance_of_uninformative
from ...inference.likelihood import LOG_DIFFUSIVITY
from ..effect_fit import linearised_at
from ..result.findings import Findings
from .candidate_records import CandidateRecord
from .present_record import PresentRecord

_POINTS = 3  # diffusivities
_FARTHEST = 4.0  # factor of the prior diffusivity, beyond which none is taken


@dataclass(frozen=True, eq=False)
class OpenDiffusivities:
    """The plain model at the diffusivities that an uninformative record leaves open.

    Args:
        present: the record with the plain model at each of them.
        largest_ratio: of the ends of a 95 % interval that counts as informative.
        diffusivities: each of them, ascending, m2/s.
    """

    present: PresentRecord = field(repr=False)
    largest_ratio: float
    diffusivities: tuple[float, ...]

    def probability(self, candidate: CandidateRecord) -> float:
        """The probability that a record is informative."""
        index = self.present.fits[0].index(LOG_DIFFUSIVITY)
        stds = [one.std(index, candidate.length) for one in candidate.whitened_explanations]
        return 1.0 - chance_of_uninformative(np.array([stds]), self.diffusivities, self.largest_ratio)


def open_diffusivities(findings: Findings) -> OpenDiffusivities:
    """Three diffusivities from end to end of the 95 % interval, at most a factor of four from the prior."""
    problem, plain, (low, high) = findings.problem, findings.before, findings.interval_95
    prior, (lowest, highest) = problem.case.wall.diffusivity_prior, problem.diffusivity_bounds
    low, high = np.clip([low, high], max(prior / _FARTHEST, lowest), min(prior * _FARTHEST, highest))
    values = np.geomspace(low, high, _POINTS) / prior
    fits = tuple(
        linearised_at(problem, (), plain.parameters.with_values({LOG_DIFFUSIVITY: np.log(value)}), plain.noise)
        for value in values
    )
    largest = problem.case.choices.largest_interval_factor
    return OpenDiffusivities(PresentRecord(fits), largest, tuple((prior * values).tolist()))
