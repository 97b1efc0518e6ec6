"""A parameter comes with the interval that the spread between poses allows it.

==========  ==========================================================================
Equation    cov = H^-1 M H^-1, H = gram, M = sum_p s_p s_p', s_p a pose's score at the
            fit; of this and of H^-1 the larger variance of each parameter;
            parameters by the delta method, of the logarithm where an error is a
            factor; 95 %: t quantile for poses - k freedoms; widened by what no reading
            can tell (a slip's time between two visits)
Source      Huber 1967, White 1980 (sandwich); Cameron & Miller 2015 (by cluster)
Valid       shapes inside their bounds, twenty poses or more
Ignores     that the name was chosen with the same poses; other forms of the laws
==========  ==========================================================================
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2
from scipy.stats import t as student

from stiffness.diagnosis.close_look import CloseLook
from stiffness.diagnosis.evidence import left_of, without
from stiffness.diagnosis.hypotheses.hypothesis import Hypothesis
from stiffness.diagnosis.member import Member
from stiffness.diagnosis.situation import Situation
from stiffness.diagnosis.split import Split

LEVEL = 0.95
SLIGHT = 0.01
"""Share of an interval that an estimate is nothing beside, and share of what is
physical from which on an interval is wide; chosen."""


@dataclass(frozen=True)
class Parameter:
    """A number with its interval, in SI; without ends where the data do not hold it."""

    estimate: float
    low: float
    high: float


def parameters_of(
    situation: Situation,
    springs: Sequence[int],
    look: CloseLook,
    split: Split,
) -> tuple[list[dict[str, Parameter]], list[float]]:
    """Return every member's parameters of the vocabulary with 95 % intervals.

    Returns:
        Parameters, and p-values of each member's coefficients being all zero, at its
        shape, while the others' coefficients and shapes adapt (Wald): a member that
        others could replace is not determined.
    """
    fit, found = look.fit, look.slopes
    gram = found.gram[1]
    fitted = np.concatenate([fit.springs, *fit.coefficients])
    fitted = np.pad(fitted, (0, len(gram) - len(fitted)))
    score = (found.score - found.own @ fitted)[~split.held_out]
    size = np.sqrt(np.maximum(np.diag(gram), 0.0))  # zero: counts, has no slope
    scale = np.where(size > 0.0, 1.0 / np.where(size > 0.0, size, 1.0), 0.0)
    inverse = np.linalg.pinv(gram * scale * scale[:, None], rcond=1e-10)
    white = score * scale
    poses = len(score)
    sandwich = inverse @ (white.T @ white) @ inverse * poses / max(1, poses - len(gram))
    grow = np.sqrt(
        np.maximum(np.diag(sandwich) / np.maximum(np.diag(inverse), 1e-300), 1.0)
    )
    cov = inverse * grow * grow[:, None] * scale * scale[:, None]
    quantile = float(student.ppf(0.5 + LEVEL / 2, max(2, poses - len(gram))))
    n = len(fit.springs)
    answers, zero = [], []
    at, shape_at = n, n + sum(len(c) for c in fit.coefficients)
    for member, coefficients in zip(fit.members, fit.coefficients, strict=True):
        index = np.concatenate(
            [
                np.arange(n),
                np.arange(at, at + len(coefficients)),
                np.arange(shape_at, shape_at + member.freedom),
            ]
        )
        own = np.arange(at, at + len(coefficients))
        others = np.delete(
            np.arange(len(cov)), np.arange(shape_at, shape_at + member.freedom)
        )
        zero.append(_of_zero(coefficients, gram[np.ix_(others, others)], own))
        at, shape_at = at + len(coefficients), shape_at + member.freedom
        answers.append(
            _of_member(
                situation,
                springs,
                member,
                (fit.springs, coefficients),
                cov[np.ix_(index, index)],
                quantile,
            )
        )
    return answers, zero


def _of_zero(coefficients: np.ndarray, gram: np.ndarray, own: np.ndarray) -> float:
    """Return the p-value of zero from a Gram matrix in which `own` are meant."""
    rest = np.delete(np.arange(len(gram)), own)
    left = left_of(gram, rest, without(gram, rest), own)
    return float(chi2.sf(coefficients @ left @ coefficients, len(own)))


def _of_member(situation, springs, member, fitted, cov, quantile):
    start = np.concatenate([*fitted, member.shape])
    n, m = len(fitted[0]), len(fitted[1])

    def parameters(theta: np.ndarray) -> dict[str, float]:
        compliance = situation.compliance.copy()
        compliance[list(springs)] += theta[:n]
        return dict(
            member.hypothesis.parameters(
                situation.with_compliance(compliance),
                member.where,
                theta[n + m :],
                theta[n : n + m],
            )
        )

    here = parameters(start)
    names = [k for k, v in here.items() if isinstance(v, int | float | np.floating)]
    sigma = np.sqrt(np.maximum(np.diag(cov), 0.0))
    slope = np.zeros((len(names), len(start)))
    for i, step in enumerate(1e-3 * sigma):
        if step <= 0:
            continue
        high, low = start.copy(), start.copy()
        high[i] += step
        low[i] -= step
        up, down = parameters(high), parameters(low)
        slope[:, i] = [(up[k] - down[k]) / (2 * step) for k in names]
    spread = np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", slope, cov, slope), 0.0))
    law, found = member.hypothesis, {}
    grain = law.grain(situation)
    for name, s in zip(names, spread, strict=True):
        value, half = float(here[name]), float(quantile * s + grain.get(name, 0.0))
        if name in law.logarithmic and value > 0.0:
            factor = float(np.exp(min(half / value, 50.0)))
            found[name] = Parameter(value, value / factor, value * factor)
        else:
            found[name] = Parameter(value, value - half, value + half)
    return found


def as_held(
    situation: Situation, member: Member, parameters: Mapping[str, Parameter]
) -> dict[str, Parameter]:
    """Return parameters without ends where the data do not hold them."""
    limits = member.hypothesis.limits_at(situation, member.where)
    return {
        name: p
        if is_held(limits.get(name), p.estimate, (p.high - p.low) / 2.0)
        else Parameter(p.estimate, -np.inf, np.inf)
        for name, p in parameters.items()
    }


def is_held(limits: tuple[float, float] | None, value: float, half: float) -> bool:
    """Return whether readings say more of a number than that it is physical."""
    if limits is None:
        return True
    low, high = limits
    if np.isfinite(high):
        faint = abs(value) < SLIGHT * half and half > SLIGHT * (high - low) / 2.0
        return half < (high - low) / 2.0 and not faint
    return not np.isfinite(low) or value - half > low


def beyond_limits(
    situation: Situation, member: Member, parameters: dict[str, Parameter]
) -> bool:
    """Return whether a parameter lies outside its physical limits, interval and all."""
    limits = member.hypothesis.limits_at(situation, member.where)
    for name, (low, high) in limits.items():
        found = parameters.get(name)
        if found is not None and (found.high < low or found.low > high):
            return True
    return False


def may_be_nothing(hypothesis: Hypothesis, parameters: Mapping[str, Parameter]) -> bool:
    """Return whether all that an effect could be holds zero, interval by interval.

    A stiffness whose interval holds zero may be without end.
    """
    sizes = [p for name, p in parameters.items() if name in hypothesis.sizes]
    return bool(sizes) and all(p.low <= 0.0 <= p.high for p in sizes)
