"""A set is worth what it explains, less its size, and what it predicts of unseen poses.

==========  ==========================================================================
Equation    log evidence = gain / 2 - k ln(poses) / 2 + log prior, the larger of without
            and with other forms of the laws; a larger set earns its place where fewer
            than 2.3 % of random signs of the poses' gains add up to as much
Source      as `sets`; sign flips: Fisher 1935, "The Design of Experiments", section 21
Valid       poses that gain independently
Ignores     that folds of poses share what was fitted to the others
==========  ==========================================================================
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.stats import norm

from stiffness.diagnosis.case import Case
from stiffness.diagnosis.close_look import close_look
from stiffness.diagnosis.intervals import Parameter, may_be_nothing, parameters_of
from stiffness.diagnosis.leftover import other_forms
from stiffness.diagnosis.member import Member, SetFit
from stiffness.diagnosis.sets import log_prior

MARGIN = 2.0
"""Standard errors by which a term must improve the prediction of poses left out."""
COMPARED = 2000
"""Signs that a gain is compared with, its own among them; chosen: 45 are the margin."""


@dataclass(frozen=True)
class Scored:
    """A set of members, fitted and judged.

    Attributes:
        fit: Coefficients and gain.
        log_evidence: With the prior of its size; with other forms of the laws where
            these are worth their number.
        predicted: Gain on each pose by fits that did not see it.
        parameters: Of each member.
        zero: p-value of each member's being nothing while the others adapt.
    """

    fit: SetFit
    log_evidence: float
    predicted: Float[np.ndarray, " poses"]
    parameters: tuple[dict[str, Parameter], ...]
    zero: tuple[float, ...]

    @property
    def names(self) -> frozenset[tuple[str, str]]:
        """Effects and places."""
        return frozenset(m.name for m in self.fit.members)

    @property
    def vain(self) -> bool:
        """Whether a member may be nothing, by the intervals of all its sizes."""
        laws = (member.hypothesis for member in self.fit.members)
        return any(map(may_be_nothing, laws, self.parameters))


def score(case: Case, members: Sequence[Member]) -> Scored:
    """Fit a set and judge it.

    Args:
        case: What may be looked at.
        members: The set.
    """
    forms = other_forms(case, members)
    look = close_look(
        case.data, case.situation, case.nominal, members, forms, case.split
    )
    fit = look.fit
    prior = log_prior(len(members), len(case.library.candidates))
    prior += sum(member.hypothesis.log_prior for member in members)
    evidence = max(
        0.5 * gain - 0.5 * freedom * np.log(case.poses)
        for gain, freedom in (
            (fit.gain, fit.freedom),
            (look.gain, fit.freedom + look.forms),
        )
    )
    parameters, zero = parameters_of(case.situation, case.springs, look, case.split)
    predicted = look.predicted
    return Scored(fit, evidence + prior, predicted, tuple(parameters), tuple(zero))


def is_clear(gain: Float[np.ndarray, " poses"]) -> bool:
    """Return whether poses gain by more than chance.

    Poses that gain nothing at all say nothing.
    """
    gain = gain[gain != 0.0]
    error = np.std(gain, ddof=1) / np.sqrt(len(gain)) if len(gain) > 1 else 0.0
    return bool(np.sum(gain) > MARGIN * error * len(gain))


def earns(before: Scored, after: Scored, seed: int) -> bool:
    """Return whether a larger set predicts unseen poses clearly better.

    By random signs of the poses' gains: a few poses may gain more than all others.
    """
    if after.log_evidence <= before.log_evidence:
        return False
    gain = after.predicted - before.predicted
    gain = gain[gain != 0.0]
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], (COMPARED, len(gain)))
    signs[0] = 1.0  # as it was: one of those that could have been
    sums = signs @ gain
    slack = 1e-9 * np.sum(np.abs(gain))
    return bool(np.mean(sums >= sums[0] - slack) < norm.sf(MARGIN))
