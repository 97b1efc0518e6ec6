"""Evaluation of a model: marginal likelihood, held-out gain, parameter intervals.

A set is looked at closely once: fit, prediction and intervals together.

A parameter comes with the interval that the spread between poses allows it.

==========  ==========================================================================
Equation    cov = H^-1 M H^-1, H = gram, M = sum_p s_p s_p', s_p a pose's score at the
            fit; of this and of H^-1 the larger variance of each parameter;
            parameters by the delta method, of the logarithm where an error is a
            factor; 95 %: t quantile for poses - k freedoms; widened by what no reading
            can tell (a slip's time between two visits); of many numbers M' instead of
            H^-1 M H^-1: (P - 1) / P sum_p d_p d_p', d_p = (H - H_p)^-1 s_p
Source      Huber 1967, White 1980 (sandwich); Cameron & Miller 2015 (by cluster); Bell
            & McCaffrey 2002 (the jackknife)
Valid       shapes inside their bounds, twenty poses or more
Ignores     that the name was chosen with the same poses; other forms of the laws
==========  ==========================================================================

A set is worth what it explains, less its size, and what it predicts of unseen poses.

==========  ==========================================================================
Equation    log evidence = gain / 2 - k ln(poses) / 2 + log prior, the larger of without
            and with other forms of the laws; a larger set earns its place where fewer
            than 2.3 % of random signs of the poses' gains add up to as much
Source      as `sets`; sign flips: Fisher 1935, "The Design of Experiments", section 21
Valid       poses that gain independently
Ignores     that folds of poses share what was fitted to the others
==========  ==========================================================================
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.special import gammaln
from scipy.stats import chi2, norm
from scipy.stats import t as student

from stiffness.diagnosis.model_fit import (
    ModelFit,
    ModelTerm,
    SelectionProblem,
    fit_of,
    gain_left_out,
    other_forms,
    shape_columns,
    training,
)
from stiffness.diagnosis.sufficient_statistics import (
    PerPoseScores,
    SufficientStatistics,
    per_pose_scores,
)
from stiffness.effects.base import Hypothesis
from stiffness.effects.jacobian import EffectJacobian
from stiffness.experiment.static_state import StaticState
from stiffness.regression.elimination import projection_coefficients, schur_complement
from stiffness.regression.intervals import Parameter
from stiffness.regression.splits import Split
from stiffness.regression.testing import MARGIN

# --- Fit and prediction together ------------------------------------------------------


@dataclass(frozen=True)
class ModelEvaluation:
    """What poses say of nominal springs, members, their shapes' slopes, other forms.

    Attributes:
        fit: Members fitted together with the nominal springs.
        forms: How many other forms of the members' laws there are.
        gain: Whitened square explained by members and these together.
        predicted: Gain on each pose by fits that did not see it; with the other forms
            where these help, for poses that span little make them go astray.
        slopes: The same of springs, members and a little more of each shape.
    """

    fit: ModelFit
    forms: int
    gain: float
    predicted: Float[np.ndarray, " poses"]
    slopes: PerPoseScores


def evaluate_model(
    data: SufficientStatistics,
    situation: StaticState,
    nominal: Sequence[EffectJacobian],
    members: Sequence[ModelTerm],
    forms: Sequence[EffectJacobian],
    split: Split,
) -> ModelEvaluation:
    """Look at members closely, in one pass over the readings.

    Args:
        data: The readings.
        situation: Where the arm stood.
        nominal: Columns of the springs.
        members: The set.
        forms: Other accepted forms of the members' laws; they may help to predict.
        split: Which poses may be looked at.
    """
    own = [m.jacobian(situation) for m in members]
    steps = [
        s
        for m, one in zip(members, own, strict=True)
        for s in shape_columns(situation, m, np.eye(one.columns))
    ]
    every = per_pose_scores(data, [*nominal, *own, *forms, *steps], training(split))
    kinds = (nominal, own, forms, steps)
    ends = np.cumsum([0, *(sum(s.columns for s in kind) for kind in kinds)])
    first, with_forms = np.arange(ends[2]), np.arange(ends[3])
    known = _some(every, first)
    score = known.score[~split.held_out].sum(axis=0)
    fit = fit_of(members, own, known.gram[1], score)
    wider = _some(every, with_forms)
    asked = wider.score[~split.held_out].sum(axis=0)
    gain = fit_of((), [*own, *forms], wider.gram[1], asked).gain
    predicted = max(
        (gain_left_out(_some(every, some), split) for some in (first, with_forms)),
        key=np.sum,
    )
    weight = [
        part
        for member, part in zip(members, fit.coefficients, strict=True)
        for _ in range(member.degrees_of_freedom)
    ]
    mix = np.zeros((ends[4], len(first) + len(weight)))
    mix[first, first] = 1.0
    at = ends[3]
    for column, part in enumerate(weight, start=len(first)):
        mix[at : at + len(part), column] = part
        at += len(part)
    count = sum(s.columns for s in forms)
    return ModelEvaluation(fit, count, gain, predicted, every.mixed(mix))


def _some(every: PerPoseScores, columns: Int[np.ndarray, " some"]) -> PerPoseScores:
    inner = np.ix_(columns, columns)
    gram = every.gram[:, inner[0], inner[1]]
    own = every.own[:, inner[0], inner[1]]
    return PerPoseScores(gram, own, every.score[:, columns])


# --- Intervals of parameters ----------------------------------------------------------

LEVEL = 0.95
SLIGHT = 0.01
"""Share of an interval that an estimate is nothing beside, and share of what is
physical from which on an interval is wide; chosen."""


def parameters_of(
    situation: StaticState,
    springs: Sequence[int],
    look: ModelEvaluation,
    split: Split,
    many: bool = False,
) -> tuple[list[dict[str, Parameter]], list[float]]:
    """Return every member's parameters of the vocabulary with 95 % intervals.

    Args:
        situation: Where the arm stood.
        springs: Axes whose compliance is nominal.
        look: The fitted set.
        split: Which poses may be looked at.
        many: Whether the set's numbers are not few beside the poses: the spread between
            poses is then that of fits which leave one out.

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
    if many:
        own = found.own[~split.held_out] * scale * scale[:, None]
        sandwich, free = jackknife_covariance(own, white), poses - 1
    else:
        free = poses - len(gram)
        sandwich = inverse @ (white.T @ white) @ inverse * poses / max(1, free)
    grow = np.sqrt(
        np.maximum(np.diag(sandwich) / np.maximum(np.diag(inverse), 1e-300), 1.0)
    )
    cov = inverse * grow * grow[:, None] * scale * scale[:, None]
    quantile = float(student.ppf(0.5 + LEVEL / 2, max(2, free)))
    n = len(fit.springs)
    answers, zero = [], []
    at, shape_at = n, n + sum(len(c) for c in fit.coefficients)
    for member, coefficients in zip(fit.members, fit.coefficients, strict=True):
        index = np.concatenate(
            [
                np.arange(n),
                np.arange(at, at + len(coefficients)),
                np.arange(shape_at, shape_at + member.degrees_of_freedom),
            ]
        )
        own = np.arange(at, at + len(coefficients))
        others = np.delete(
            np.arange(len(cov)),
            np.arange(shape_at, shape_at + member.degrees_of_freedom),
        )
        zero.append(_of_zero(coefficients, gram[np.ix_(others, others)], own))
        at, shape_at = at + len(coefficients), shape_at + member.degrees_of_freedom
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


def jackknife_covariance(
    own: Float[np.ndarray, "poses columns columns"],
    score: Float[np.ndarray, "poses columns"],
) -> Float[np.ndarray, "columns columns"]:
    """Return the covariance of a fit from how it moves as one pose is left out.

    Args:
        own: Gram matrix of each pose.
        score: Of each pose, at the fit.
    """
    whole, poses = own.sum(axis=0), len(own)
    moved = [
        np.linalg.pinv(whole - one, rcond=1e-10, hermitian=True) @ asked
        for one, asked in zip(own, score, strict=True)
    ]
    return (poses - 1) / poses * np.asarray(moved).T @ np.asarray(moved)


def _of_zero(coefficients: np.ndarray, gram: np.ndarray, own: np.ndarray) -> float:
    """Return the p-value of zero from a Gram matrix in which `own` are meant."""
    rest = np.delete(np.arange(len(gram)), own)
    left = schur_complement(gram, rest, projection_coefficients(gram, rest), own)
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
    situation: StaticState, member: ModelTerm, parameters: Mapping[str, Parameter]
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
    situation: StaticState, member: ModelTerm, parameters: dict[str, Parameter]
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
    sizes = [p for name, p in parameters.items() if name in hypothesis.magnitudes]
    return bool(sizes) and all(p.low <= 0.0 <= p.high for p in sizes)


# --- Exhaustive search ----------------------------------------------------------------

PRIOR_OF_SIZE = (0.4, 0.35, 0.2, 0.05)
"""Prior of none, one, two or three effects; chosen: few causes, each as likely."""
ONE_MORE = 0.25
"""Prior of each further effect; chosen: as three are to two."""


def log_prior(size: int, candidates: int) -> float:
    """Return the prior of one set of a size: the size's prior over the sets' number."""
    if size > candidates:
        return -np.inf
    ways = gammaln(candidates + 1) - gammaln(size + 1) - gammaln(candidates - size + 1)
    small = min(size, len(PRIOR_OF_SIZE) - 1)
    of_size = np.log(PRIOR_OF_SIZE[small]) + (size - small) * np.log(ONE_MORE)
    return float(of_size - ways)


# --- Score of a model -----------------------------------------------------------------

COMPARED = 2000
"""Signs that a gain is compared with, its own among them; chosen: 45 are the margin."""


@dataclass(frozen=True)
class EvaluatedModel:
    """A set of members, fitted and judged.

    Attributes:
        fit: Coefficients and gain.
        log_evidence: With the prior of its size; with other forms of the laws where
            these are worth their number.
        predicted: Gain on each pose by fits that did not see it.
        parameters: Of each member.
        zero: p-value of each member's being nothing while the others adapt.
    """

    fit: ModelFit
    log_evidence: float
    predicted: Float[np.ndarray, " poses"]
    parameters: tuple[dict[str, Parameter], ...]
    zero: tuple[float, ...]

    @property
    def names(self) -> frozenset[tuple[str, str]]:
        """Effects and places."""
        return frozenset(m.name for m in self.fit.members)

    @property
    def insignificant(self) -> bool:
        """Whether a member may be nothing, by the intervals of all its sizes."""
        laws = (member.hypothesis for member in self.fit.members)
        return any(map(may_be_nothing, laws, self.parameters))


def evaluate(case: SelectionProblem, members: Sequence[ModelTerm]) -> EvaluatedModel:
    """Fit a set and judge it.

    Args:
        case: What may be looked at.
        members: The set.
    """
    forms = other_forms(case, members)
    look = evaluate_model(
        case.data, case.situation, case.nominal, members, forms, case.split
    )
    fit = look.fit
    prior = log_prior(len(members), len(case.library.candidates))
    prior += sum(member.hypothesis.log_prior for member in members)
    evidence = max(
        0.5 * gain - 0.5 * freedom * np.log(case.poses)
        for gain, freedom in (
            (fit.gain, fit.degrees_of_freedom),
            (look.gain, fit.degrees_of_freedom + look.forms),
        )
    )
    parameters, zero = parameters_of(case.situation, case.springs, look, case.split)
    predicted = look.predicted
    return EvaluatedModel(
        fit, evidence + prior, predicted, tuple(parameters), tuple(zero)
    )


def improves_prediction(
    before: EvaluatedModel, after: EvaluatedModel, seed: int
) -> bool:
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
