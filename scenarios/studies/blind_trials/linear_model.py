"""Linear model of a set of names: what it explains of poses kept back, name by name.

`linear_model_of` lays out the diagnosis' own columns of given names; none is selected.
What an answer explains (`explained_share`) and what the truth would explain are so
computed alike, with sizes fitted beside what names change of each other.

==========  ==========================================================================
Equation    share = (g - g_0) / (e - g_0) on the poses kept back, g = 2 b's - b'G b with
            b fitted to the others, g_0 the same of the nominal columns alone, e the
            whitened square beyond its degrees of freedom; loss of a name = b_i' C_ii^-1
            b_i, b = C s and C = G^-1 with all columns
Source      leave-groups-out validation; the Wald statistic of a block of columns
Valid       columns laid out under all names; shapes moved along their slopes
Ignores     noise that is not stated: the share errs with it
==========  ==========================================================================
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from stiffness.diagnosis.joint_fit import Layout
from stiffness.diagnosis.model_fit import (
    ModelFit,
    ModelTerm,
    SelectionProblem,
    fit_model,
    fit_of,
    fit_shapes,
    shape_columns,
    training,
)
from stiffness.diagnosis.nominal_fit import Prepared
from stiffness.diagnosis.relinearisation import nominal_problem, total_softening
from stiffness.diagnosis.sufficient_statistics import (
    normal_equations_of,
)
from stiffness.regression.normal_equations import losses_without, solve

SWEEPS = 2
"""How often the shape of each name is chosen beside the others; chosen: the second time
changes next to nothing."""


@dataclass(frozen=True, eq=False)
class LinearModel:
    """Names with one shape each, laid out under all that they do.

    Attributes:
        case: The readings, and the nominal columns; its library has nothing else.
        fit: The names, fitted to the poses that are not kept back.
    """

    case: SelectionProblem
    fit: ModelFit


def linear_model_of(
    prepared: Prepared, choices: Sequence[Sequence[ModelTerm]], with_shapes: bool
) -> LinearModel:
    """Choose one shape of each name, and lay out anew under all of them.

    With shapes, these are fitted too, from those that were chosen.
    """
    case = nominal_problem(prepared)
    fit = _chosen(case, choices)
    if fit.members:
        softer = total_softening(case, prepared, fit)
        case = nominal_problem(prepared, softer, fit)
        fit = _chosen(case, choices)
    if with_shapes:
        terms = fit_shapes(case, fit.members)
        fit = fit_model(case, terms)
    return LinearModel(case, fit)


def with_its_columns(prepared: Prepared, model: LinearModel) -> LinearModel:
    """Fit names together with the columns that they lay out.

    One layout is too few where a compensator turns an axis that hardens: 82 % instead
    of all was explained by an answer all of whose names were right.
    """
    if not model.fit.members:
        return model
    point = Layout(prepared, ()).fitted_jointly(model.case, model.fit)
    return LinearModel(nominal_problem(prepared, point.softer, point.named), point.fit)


def _chosen(case: SelectionProblem, choices: Sequence[Sequence[ModelTerm]]) -> ModelFit:
    """Return the fit of one shape of each name, each the best beside the others."""
    terms = [term for own in choices for term in own]
    laws = [term.jacobian(case.situation) for term in terms]
    found = normal_equations_of(case.data, [*case.nominal, *laws], training(case.split))
    gram, score = found.gram[1], found.score[~case.split.held_out].sum(axis=0)
    known = case.library.nominal
    ends = np.cumsum([known, *(law.columns for law in laws)])
    owned = [np.arange(a, b) for a, b in pairwise(ends)]
    first = np.cumsum([0, *(len(own) for own in choices)])
    best = [int(start) for start in first[:-1]]

    def columns(some: Sequence[int]) -> np.ndarray:
        return np.concatenate([np.arange(known), *(owned[k] for k in some)]).astype(int)

    def gain(some: Sequence[int]) -> float:
        at = columns(some)
        return float(score[at] @ solve(gram[np.ix_(at, at)], score[at]))

    for _ in range(SWEEPS):
        for k, (start, end) in enumerate(pairwise(first)):
            if end - start > 1:
                rest = [best[:k], best[k + 1 :]]
                tried = [gain([*rest[0], t, *rest[1]]) for t in range(start, end)]
                best[k] = int(start + np.argmax(tried))
    at = columns(best)
    chosen, own = [terms[k] for k in best], [laws[k] for k in best]
    return fit_of(chosen, own, gram[np.ix_(at, at)], score[at])


def explained_share(model: LinearModel) -> float:
    """Return the share of the mismatch that names explain on the poses kept back."""
    case = model.case
    held_out = case.split.held_out
    laws = [term.jacobian(case.situation) for term in model.fit.members]
    found = normal_equations_of(case.data, [*case.nominal, *laws], training(case.split))
    score = found.score[~held_out].sum(axis=0)

    def gain(columns: int) -> float:
        kept_back = found.score[held_out].sum(axis=0)[:columns]
        beta = solve(found.gram[1][:columns, :columns], score[:columns])
        curve = found.gram[0][:columns, :columns]
        return float(2.0 * beta @ kept_back - beta @ curve @ beta)

    nominal = gain(case.library.nominal)
    whole = float(case.data.mismatch_of_poses[held_out].sum()) - nominal
    return (gain(len(score)) - nominal) / max(whole, 1e-12)


def whitened_square(model: LinearModel) -> float:
    """Return the whitened square of all readings less the fitted nominal model."""
    data = model.case.data
    square = float(data.within.square.sum())
    if data.between is not None:
        square += float(np.sum(data.between.residual**2))
    return square


@dataclass(frozen=True, eq=False)
class Losses:
    """Whitened squares that are lost without each name, and what all names leave."""

    names: Float[np.ndarray, " names"]
    residual: float


def losses_of(model: LinearModel) -> Losses:
    """Return what leaving names out costs while all others move, and the residual.

    Each name has the slopes of its shapes beside its own columns; all poses count.
    """
    case = model.case
    laws, ends = list(case.nominal), [case.library.nominal]
    for term, size in zip(model.fit.members, model.fit.coefficients, strict=True):
        slopes = [p for p in shape_columns(case.situation, term, size) if p.parts]
        own = [term.jacobian(case.situation), *slopes]
        laws += own
        ends.append(ends[-1] + sum(law.columns for law in own))
    every = np.zeros(len(case.split.fold), dtype=int)
    found = normal_equations_of(case.data, laws, every)
    gram, score = found.gram[0], found.score.sum(axis=0)
    lost = losses_without(gram, score, [np.arange(a, b) for a, b in pairwise(ends)])
    residual = whitened_square(model) - float(score @ solve(gram, score))
    return Losses(np.array(lost), residual)
