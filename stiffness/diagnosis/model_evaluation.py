"""Evaluation of a model: fit of coefficients, and intervals of parameters.

==========  ==========================================================================
Equation    cov = (P - 1) / P sum_p d_p d_p', d_p = (H - H_p)^-1 s_p, H = gram, H_p and
            s_p a pose's own gram and score at the fit; of this and of H^-1 the larger
            variance of each parameter; parameters by the delta method, of the logarithm
            where an error is a factor; 95 %: t quantile for P - 1 degrees of freedom;
            widened by how far the fit beside other forms of the laws is from it, and by
            what no reading can determine (a slip's time between two visits)
Source      jackknife by clusters: Bell & McCaffrey 2002; Cameron & Miller 2015
Valid       shapes inside their bounds, twenty poses or more
Ignores     that the name was chosen with the same poses
==========  ==========================================================================
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int
from scipy.stats import f as fisher
from scipy.stats import t as student

from bench.shared.settings import SETTINGS, Interval
from stiffness.diagnosis.model_fit import (
    LAW_ACCURACY,
    ModelFit,
    ModelTerm,
    SelectionProblem,
    fit_of,
    shape_columns,
    training,
    with_priors,
)
from stiffness.diagnosis.sufficient_statistics import (
    PerPoseScores,
    normal_equations_of,
    per_pose_scores,
)
from stiffness.effects.jacobian import EffectJacobian, added
from stiffness.experiment.static_state import StaticState
from stiffness.regression.intervals import (
    FittedParameters,
    jackknife_covariance,
    quotient_interval,
)
from stiffness.regression.normal_equations import unit_scale
from stiffness.regression.splits import Split
from stiffness.regression.testing import joint_statistic

# --- Fit and prediction together ------------------------------------------------------


@dataclass(frozen=True)
class ModelEvaluation:
    """What poses say of nominal springs, members, and their shapes' slopes.

    Attributes:
        fit: Members fitted together with the nominal springs.
        slopes: Statistics of each pose of springs, members, a little more of each
            shape, other forms of the members' laws, constants that these assume, and
            columns beside.
        forms: Columns of each member's other forms.
        assumed: Columns of constants that each member's law assumes.
        unselected: Columns of each term that may be there too; the last.
        unselected_squares: Mean square of each coefficient of these terms; None: may be
            any size.
    """

    fit: ModelFit
    slopes: PerPoseScores
    forms: tuple[Int[np.ndarray, " _"], ...]
    assumed: tuple[Int[np.ndarray, " _"], ...]
    unselected: tuple[Int[np.ndarray, " _"], ...] = ()
    unselected_squares: tuple[Float[np.ndarray, " _"] | None, ...] = ()

    @property
    def known(self) -> int:
        """How many columns are of springs, members and shapes."""
        beside = (*self.forms, *self.assumed, *self.unselected)
        return self.slopes.gram.shape[1] - sum(map(len, beside))

    @property
    def selected_alone(self) -> "ModelEvaluation":
        """The same without what may be there too."""
        count = self.slopes.gram.shape[1] - sum(map(len, self.unselected))
        first = PerPoseScores(
            self.slopes.gram[:, :count, :count],
            self.slopes.own,
            self.slopes.score[:, :count],
        )
        return replace(self, slopes=first, unselected=(), unselected_squares=())

    @property
    def priors(self) -> Float[np.ndarray, " columns"]:
        """Inverse prior variance of constants and of terms beside; 0 for all others."""
        prior = np.zeros(self.slopes.gram.shape[1])
        for own, block in zip(self.fit.coefficients, self.assumed, strict=True):
            prior[block] = 1.0 / max(float(own[0]) ** 2, 1e-300)
        every = zip(self.unselected_squares, self.unselected, strict=True)
        for square, block in every:
            if square is not None:
                prior[block] = 1.0 / np.maximum(square, 1e-300)
        return prior


def evaluate_model(
    case: SelectionProblem,
    members: Sequence[ModelTerm],
    beside: Sequence[ModelTerm] = (),
) -> ModelEvaluation:
    """Fit members, and gather what poses say of them, in one pass over the readings.

    Where columns were laid out under members, more of one also changes the others',
    linearly near the set alone.

    Args:
        case: What may be looked at.
        members: The set.
        beside: Terms that were not selected but may be there.
    """
    data, situation, split, felt = case.data, case.situation, case.split, case.felt
    nominal, own, steps = [*case.nominal], list[EffectJacobian](), []
    if felt is not None:
        total = felt.total({member.name for member in members})
        data = data.subtract([total], -np.ones(1))
        nominal = [added(*both) for both in zip(nominal, felt.springs, strict=True)]
    for member in members:
        law = member.jacobian(situation)
        slopes = shape_columns(situation, member, np.eye(law.columns))
        more = None if felt is None else felt.laws.get(member.name)
        if felt is not None and more is not None and more.columns == law.columns:
            law = added(law, more)
            for j, slope in enumerate(slopes):
                of_shape = felt.shapes.get((member.name, j))
                slopes[j] = slope if of_shape is None else added(slope, of_shape)
        own.append(law)
        steps.extend(slopes)
    forms = [m.hypothesis.variants(situation, m.where, m.shape) for m in members]
    forms += [m.hypothesis.assumed(situation, m.where, m.shape) for m in members]
    unselected = [m.jacobian(situation) for m in beside]
    forms += unselected
    some = [form for form in forms if form.columns]
    fold, held = training(split), [*nominal, *own, *steps]
    found = normal_equations_of(data, [*held, *some], fold)
    widths = [law.columns for law in own]
    given = with_priors(found.gram[1], len(nominal), members, widths, situation)
    of_poses = per_pose_scores(data, held, fold).own
    every = PerPoseScores(np.stack([found.gram[0], given]), of_poses, found.score)
    first = sum(s.columns for s in (*nominal, *own))
    score = every.score[~split.held_out].sum(axis=0)
    fit = fit_of(members, own, every.gram[1][:first, :first], score[:first])
    weight = [
        part
        for member, part in zip(members, fit.coefficients, strict=True)
        for _ in range(member.degrees_of_freedom)
    ]
    known = first + len(weight)
    ends = known + np.cumsum([0, *(form.columns for form in forms)])
    mix = np.zeros((len(score), ends[-1]))
    mix[:first, :first] = np.eye(first)
    at = first
    for column, part in enumerate(weight, start=first):
        mix[at : at + len(part), column] = part
        at += len(part)
    mix[at:, known:] = np.eye(ends[-1] - known)
    blocks = tuple(np.arange(a, b) for a, b in pairwise(ends))
    count = len(members)
    return ModelEvaluation(
        fit,
        every.mixed(mix, known),
        blocks[:count],
        blocks[count : 2 * count],
        blocks[2 * count :],
        tuple(
            _mean_square_of(situation, term, fit, law.columns)
            for term, law in zip(beside, unselected, strict=True)
        ),
    )


def dispersion_of(case: SelectionProblem, look: ModelEvaluation) -> float:
    """Return by how much poses differ beyond the stated errors, along the set."""
    widths = [len(own) for own in look.fit.coefficients]
    count = case.library.nominal + sum(widths)
    mask, some = ~case.split.held_out, np.arange(count)
    own = look.slopes.own[mask][:, some[:, None], some]
    fitted = np.concatenate([look.fit.springs, *look.fit.coefficients])
    score = look.slopes.score[mask][:, some] - own @ fitted
    scale = 1.0 / np.sqrt(np.maximum(np.diag(own.sum(axis=0)), 1e-300))
    own, score = own * scale * scale[:, None], score * scale
    members, nothing = look.fit.members, np.zeros((count, count))
    first = case.library.nominal
    prior = with_priors(nothing, first, members, widths, case.situation)
    spread = jackknife_covariance(own, score, prior * scale * scale[:, None])
    return max(1.0, float(np.sum(own.sum(axis=0) * spread)) / count)


DISPERSED = 1.5
"""Dispersion of poses from which a set is looked at without what it makes its own laws
feel, too; chosen: above what few poses leave by chance."""


def evaluate_consistently(
    case: SelectionProblem, terms: Sequence[ModelTerm], beside: Sequence[ModelTerm]
) -> ModelEvaluation:
    """Evaluate a set, with what it makes its own laws feel where poses agree with that.

    What a little more of a torque changes of a play is linear over less than what
    closes it, and the few poses there hold whatever the play's law is wrong by.

    Args:
        case: What may be looked at.
        terms: The set.
        beside: Terms that were not selected but may be there.
    """
    look = evaluate_model(case, terms, beside)
    found = dispersion_of(case, look)
    if case.felt is None or found < DISPERSED:
        return look
    less = evaluate_model(replace(case, felt=None), terms, beside)
    return less if dispersion_of(case, less) < found else look


# --- Intervals of parameters ----------------------------------------------------------

LEVEL = SETTINGS.confidence
FORM = 0.9
"""Share of the way from the interval's end to nothing by which other shapes of any law
or another form of its own may widen the interval of a size that is not nothing while
shapes are held; chosen."""


def parameters_of(
    situation: StaticState,
    springs: Sequence[int],
    look: ModelEvaluation,
    split: Split,
) -> list[FittedParameters]:
    """Return every member's parameters of the vocabulary with 95 % intervals.

    Args:
        situation: Where the arm stood.
        springs: Axes whose compliance is nominal.
        look: The fitted set.
        split: Which poses may be looked at.
    """
    fit, found = look.fit, look.slopes
    known = look.known
    gram = found.gram[1][:known, :known]
    fitted = np.concatenate([fit.springs, *fit.coefficients])
    fitted = np.pad(fitted, (0, len(gram) - len(fitted)))
    own = found.own[~split.held_out][:, :known, :known]
    score = found.score[~split.held_out][:, :known] - own @ fitted
    scale = unit_scale(np.diag(gram))  # zero: counts, has no slope
    inverse = np.linalg.pinv(gram * scale * scale[:, None], rcond=1e-10)
    widths, first = [len(c) for c in fit.coefficients], len(fit.springs)
    given = with_priors(0.0 * gram, first, fit.members, widths, situation)
    spread = jackknife_covariance(
        own * scale * scale[:, None], score * scale, given * scale * scale[:, None]
    )
    grow = np.sqrt(
        np.maximum(np.diag(spread) / np.maximum(np.diag(inverse), 1e-300), 1.0)
    )
    wider = grow * scale
    cov = inverse * wider * wider[:, None]
    sizes = len(fit.springs) + sum(map(len, fit.coefficients))
    inner = (gram * scale * scale[:, None])[:sizes, :sizes]
    held = np.linalg.pinv(inner, rcond=1e-10, hermitian=True)
    held = held * wider[:sizes] * wider[:sizes, None]
    unsure = _covariance_of_the_unknown(look) + _covariance_of_forms(look)
    shift = shift_by_forms(look, split) - fitted
    freedom = max(2, len(score) - 1)
    answers = []
    every = zip(fit.members, fit.coefficients, _columns_of_members(look), strict=True)
    for member, coefficients, own in every:
        index = np.concatenate([np.arange(len(fit.springs)), own])
        some, of_sizes = np.ix_(index, index), index[: len(index) - len(member.shape)]
        held_alone = held[np.ix_(of_sizes, of_sizes)]
        errors = _Errors(cov[some], held_alone, unsure[some], shift[index])
        term = _FittedTerm(situation, springs, member, fit.springs, coefficients)
        answers.append(_with_intervals(term, errors, freedom))
    return answers


def shift_by_forms(
    look: ModelEvaluation, split: Split
) -> Float[np.ndarray, " columns"]:
    """Return the fit of springs, members and shapes beside other forms of the laws.

    Each law's other forms together have a prior whose variance is their own mean
    square beyond noise: which form is true is not known. What they do as the law and
    its shapes would is counted with these. Constants stay as laws assume them.

    Args:
        look: The fitted set.
        split: Which poses may be looked at.
    """
    gram, asked = look.slopes.gram[1], look.slopes.score[~split.held_out].sum(axis=0)
    scale = unit_scale(np.diag(gram))
    scale[np.concatenate([np.zeros(0, dtype=int), *look.assumed])] = 0.0
    gram, asked = gram * scale * scale[:, None], asked * scale
    inverse = np.linalg.pinv(gram, rcond=1e-10, hermitian=True)
    first, noise = inverse @ asked, np.diag(inverse)
    prior = np.zeros(len(gram))
    for block in (*look.forms, *look.unselected):
        square = float(np.sum(first[block] ** 2 - noise[block]))
        prior[block] = len(block) / max(square, 1e-300)
    inner = gram + np.diag(prior)
    size = np.sqrt(np.diag(inner))
    even = 1.0 / np.where(size > 0.0, size, 1.0)
    inner, right = inner * even * even[:, None], asked * even
    fitted = even * np.linalg.lstsq(inner, right, rcond=1e-14)[0]
    return scale[: look.known] * (_as_laws_say(look, gram, scale) @ fitted)


def _as_laws_say(
    look: ModelEvaluation,
    gram: Float[np.ndarray, "columns columns"],
    scale: Float[np.ndarray, " columns"],
) -> Float[np.ndarray, "known columns"]:
    """Return the map from a fit beside other forms to one of laws that does as much.

    Sizes of forms that have some are added to the law's; what else forms do is what
    the law and its shapes would do of it.

    Args:
        look: The fitted set.
        gram: Of scaled columns.
        scale: Of columns.
    """
    told = np.eye(look.known, len(gram))
    every = zip(look.fit.members, _columns_of_members(look), look.forms, strict=True)
    for member, own, block in every:
        if not len(block):
            continue
        rest, pulled = own, gram[np.ix_(own, block)]
        size = member.hypothesis.size_of_variants
        if size is not None:
            law = own[0]
            told[law, block] += size * scale[block] / scale[law]
            rest = own[1:]
            pulled = pulled[1:] - np.outer(gram[rest, law], told[law, block])
        by = np.linalg.lstsq(gram[np.ix_(rest, rest)], pulled, rcond=1e-9)[0]
        told[np.ix_(rest, block)] += by
    return told


def _covariance_of_forms(
    look: ModelEvaluation,
) -> Float[np.ndarray, "columns columns"]:
    """Return what other forms of laws add to the covariance of members.

    Whatever readings say of it, the form of a law is wrong by `LAW_ACCURACY` of what it
    explains, spread over its other forms, by what of these neither the law nor its
    shapes can do; but none is more than the whole law.
    """
    known, given = look.known, look.slopes.gram[1]
    forms = np.concatenate([np.zeros(0, dtype=int), *look.forms])
    some = np.concatenate([np.arange(known), forms])
    scale = unit_scale(np.diag(given))
    gram = given * scale * scale[:, None]
    prior = np.zeros(len(gram))
    every = zip(
        look.fit.coefficients, _columns_of_members(look), look.forms, strict=True
    )
    for coefficients, own, block in every:
        if not len(block):
            continue
        law = own[: len(coefficients)]
        explained = float(coefficients @ given[np.ix_(law, law)] @ coefficients)
        beside = gram[np.ix_(own, block)]
        like = np.linalg.lstsq(gram[np.ix_(own, own)], beside, rcond=1e-9)[0]
        beyond = np.maximum(1.0 - np.sum(beside * like, axis=0), 1e-12)
        share = np.minimum(LAW_ACCURACY / (len(block) * beyond), 1.0)
        prior[block] = 1.0 / np.maximum(share * explained, 1e-300)
    told = _as_laws_say(look, gram, scale)[:, some]
    alone = np.linalg.pinv(gram[:known, :known], rcond=1e-10, hermitian=True)
    whole = gram[np.ix_(some, some)] + np.diag(prior[some])
    even = unit_scale(np.diag(whole))
    both = np.linalg.pinv(whole * even * even[:, None], rcond=1e-12, hermitian=True)
    total = (told * even) @ both @ (told * even).T - alone
    return total * scale[:known] * scale[:known, None]


def _covariance_of_the_unknown(
    look: ModelEvaluation,
) -> Float[np.ndarray, "columns columns"]:
    """Return what else is not known adds to the covariance of members.

    A constant that a law assumes has the spread of its prior, whatever readings say of
    it: the sizes were fitted beside the assumed one. Terms that were not selected have
    coefficients with a prior as wide as those of the same effect that were selected:
    what data do not hold of them they do not hold of what moves alike.
    """
    known, gram, prior = look.known, look.slopes.gram[1], look.priors
    constants = np.concatenate([np.zeros(0, dtype=int), *look.assumed])
    beside = np.concatenate([np.zeros(0, dtype=int), *look.unselected])
    beside = beside[prior[beside] > 0.0]
    some = np.concatenate([np.arange(known), beside])
    scale = unit_scale(np.maximum(np.diag(gram), 0.0) + prior)
    inner = gram * scale * scale[:, None]
    own = np.linalg.pinv(inner[:known, :known], rcond=1e-10, hermitian=True)
    whole = inner[np.ix_(some, some)] + np.diag((prior * scale**2)[some])
    both = np.linalg.pinv(whole, rcond=1e-12, hermitian=True)[:known, :known]
    by_constant = own @ inner[:known, constants]
    spread = 1.0 / (prior * scale**2)[constants]
    total = both - own + by_constant * spread @ by_constant.T
    return total * scale[:known] * scale[:known, None]


def _mean_square_of(
    situation: StaticState, term: ModelTerm, fit: ModelFit, columns: int
) -> Float[np.ndarray, " columns"] | None:
    """Return the mean square of each coefficient of a term's effect in a set.

    An axis' zero may be as large as the turns of the links that were named. Where the
    effect has other coefficients at the sites where it was named, it is as large
    beside its priors as there.
    """
    law, every = term.hypothesis, list(zip(fit.members, fit.coefficients, strict=True))
    named = [(m, c) for m, c in every if m.name[0] == term.name[0]]
    alike = [c for _, c in named if len(c) == columns]
    if alike:
        return np.mean(np.square(alike), axis=0)
    prior = law.prior_sigma(situation, term.where)
    if named and prior is not None:
        shares = [c / m.hypothesis.prior_sigma(situation, m.where) for m, c in named]
        rate = np.mean([np.mean(share**2) for share in shares])
        return np.broadcast_to(np.square(prior) * rate, columns)
    turns = [c[3:] for m, c in every if m.name[0] == law.shares_rate_with]
    return np.full(columns, np.mean(np.square(turns))) if turns else None


def _columns_of_members(look: ModelEvaluation) -> list[Int[np.ndarray, " _"]]:
    """Return the columns of each member's law and of its shapes."""
    at = len(look.fit.springs)
    shape_at = at + sum(len(c) for c in look.fit.coefficients)
    found = []
    for member, own in zip(look.fit.members, look.fit.coefficients, strict=True):
        shapes = np.arange(shape_at, shape_at + member.degrees_of_freedom)
        found.append(np.concatenate([np.arange(at, at + len(own)), shapes]))
        at, shape_at = at + len(own), shape_at + member.degrees_of_freedom
    return found


@dataclass(frozen=True)
class _Errors:
    """Errors of the springs and of a member's coefficients and shapes.

    Attributes:
        covariance: By how the fit moves as poses are left out.
        held: The same of springs and coefficients, the shapes of all members held.
        unsure: What terms that were not selected, assumed constants and the form of
            laws add to it.
        shift: How far the fit moves beside other forms of the laws.
    """

    covariance: Float[np.ndarray, "n n"]
    held: Float[np.ndarray, "sizes sizes"]
    unsure: Float[np.ndarray, "n n"]
    shift: Float[np.ndarray, " n"]


@dataclass(frozen=True, eq=False)
class _FittedTerm:
    """A term of a set with its fit and that of the springs.

    Attributes:
        situation: Where the arm stood.
        springs: Axes of the springs.
        member: The term.
        softer: Changes of the springs' compliances, in rad/(N m).
        coefficients: Of the term's columns.
    """

    situation: StaticState
    springs: Sequence[int]
    member: ModelTerm
    softer: Float[np.ndarray, " springs"]
    coefficients: Float[np.ndarray, " columns"]

    @property
    def fitted(self) -> Float[np.ndarray, " n"]:
        """Return springs, coefficients and shapes, one after the other."""
        return np.concatenate([self.softer, self.coefficients, self.member.shape])

    def reported(self, fitted: Float[np.ndarray, " n"]) -> dict[str, float]:
        """Return the parameters that people read, of some springs and numbers."""
        ends = np.cumsum([len(self.softer), len(self.coefficients)])
        softer, coefficients, shape = np.split(fitted, ends)
        compliance = self.situation.compliance.copy()
        compliance[list(self.springs)] += softer
        state, where = self.situation.with_compliance(compliance), self.member.where
        found = self.member.hypothesis.parameters(state, where, shape, coefficients)
        number = int | float | np.floating
        return {k: float(v) for k, v in found.items() if isinstance(v, number)}

    def slopes(
        self, steps: Float[np.ndarray, " n"]
    ) -> Float[np.ndarray, "parameters n"]:
        """Return slopes of the reported parameters by differences.

        Args:
            steps: Of springs, coefficients and shapes; 0: no slope.
        """
        start = self.fitted
        slope = np.zeros((len(self.reported(start)), len(start)))
        for i, step in enumerate(steps):
            if step <= 0:
                continue
            high, low = start.copy(), start.copy()
            high[i] += step
            low[i] -= step
            up, down = self.reported(high), self.reported(low)
            slope[:, i] = [(up[k] - down[k]) / (2 * step) for k in up]
        return slope


def _with_intervals(
    term: _FittedTerm, errors: _Errors, freedom: int
) -> FittedParameters:
    """Return the reported parameters of a term with intervals of `LEVEL`.

    Args:
        term: As it was fitted.
        errors: Of its springs, coefficients and shapes.
        freedom: Degrees of freedom of their estimate.
    """
    law, here = term.member.hypothesis, term.reported(term.fitted)
    cov, quantile = errors.covariance, float(student.ppf(0.5 + LEVEL / 2, freedom))
    slope = term.slopes(1e-3 * np.sqrt(np.maximum(np.diag(cov), 0.0)))
    total = slope @ (cov + errors.unsure) @ slope.T
    spread = np.sqrt(np.maximum(np.diag(total), 0.0))
    of_sizes = slope[:, : len(errors.held)]
    held = of_sizes @ errors.held @ of_sizes.T
    fixed = np.sqrt(np.maximum(np.diag(held), 0.0))
    moved = slope @ errors.shift
    names, nothing, grain = list(here), law.nothing, law.grain(term.situation)
    found = dict[str, Interval]()
    for name, s, by, own in zip(names, spread, moved, fixed, strict=True):
        value = here[name]
        half = float(quantile * own + grain.get(name, 0.0))
        wide = float(quantile * np.hypot(s, by) + grain.get(name, 0.0))
        if name in nothing and half < abs(value - nothing[name]):
            # poses left out need it, in whatever form and shape
            wide = min(wide, half + FORM * (abs(value - nothing[name]) - half))
        if name in law.logarithmic and value > 0.0:
            factor = float(np.exp(min(wide / value, 50.0)))
            found[name] = Interval(value, value / factor, value * factor)
        else:
            found[name] = Interval(value, value - wide, value + wide)
    for name, parts in law.quotients.items():
        if name in found:
            of = [names.index(part) for part in parts]
            joint = total[np.ix_(of, of)] + np.outer(moved[of], moved[of])
            above, below = (here[part] for part in parts)
            found[name] = quotient_interval(above, below, joint, quantile)
    sizes = [k for k, name in enumerate(names) if name in nothing]
    apart = np.array([here[names[k]] - nothing[names[k]] for k in sizes])
    coarse = np.array([grain.get(names[k], 0.0) / quantile for k in sizes])
    together = joint_statistic(apart, held[np.ix_(sizes, sizes)] + np.diag(coarse**2))
    limit = float(fisher.ppf(LEVEL, max(len(sizes), 1), freedom))
    return FittedParameters(found, together, limit)
