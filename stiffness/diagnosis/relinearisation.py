"""Relinearisation of all columns about the effects that were selected.

==========  ==========================================================================
Equation    y = f(c0) + (c1 - c0) df/dc + (c - c1) df/dc' + sizes x columns'; df/dc as
            prepared, what is dashed at the compliance c1 and under the masses and the
            hardening that were named, or the wrench that was found, in the round before
Source      Gauss-Newton in springs, fixed point in loads: these turn what gives way,
            whose columns then hold the product of both
Valid       lever arms held: they move by a thousandth
Ignores     where the arm rests under it all: that stays as it was prepared; what else
            changes the pull on springs: a rope's friction
==========  ==========================================================================
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from stiffness.diagnosis.candidates import library_of, springs_of
from stiffness.diagnosis.detection import MEASURED, MISSTATED
from stiffness.diagnosis.model_fit import (
    ModelFit,
    ModelTerm,
    SelectionProblem,
    solve,
    training,
)
from stiffness.diagnosis.nominal_fit import Prepared
from stiffness.diagnosis.sufficient_statistics import (
    SufficientStatistics,
    normal_equations_of,
)
from stiffness.effects.base import Hypothesis
from stiffness.effects.jacobian import JacobianBlock, values, with_values
from stiffness.experiment.static_state import StaticState
from stiffness.regression.splits import Split, seed_of, split_of

MOVED = 0.03
"""Share by which a compliance or a load may change under names before all columns are
laid out anew; chosen: what a load or a mass winds up goes with it, and sizes are said
to some per cent."""
TINY = 1e-9
"""A load in N or N m that is none; chosen."""


def build_problem(
    prepared: Prepared,
    hypotheses: Sequence[Hypothesis],
    softer: Float[np.ndarray, " springs"] | None = None,
    named: ModelFit | None = None,
) -> SelectionProblem:
    """Lay out everything that naming looks at.

    Args:
        prepared: The recording against its nominal model.
        hypotheses: What may be named.
        softer: By how much each fitted compliance is another than prepared, in rad/(N
            m); None: as the data say where nothing is named.
        named: What pulls at the arm beyond the model; None: nothing.
    """
    recording = prepared.situation.recording
    split = split_of(recording)
    data, situation = linearised(prepared, split, softer, named)
    library = library_of(situation, prepared.springs, hypotheses)
    evidence = normal_equations_of(data, library.jacobians, training(split))
    return SelectionProblem(
        data,
        situation,
        prepared.springs,
        library,
        evidence,
        split,
        seed_of(recording),
        MEASURED if prepared.degrees_of_freedom else MISSTATED,
    )


def linearised(
    prepared: Prepared,
    split: Split,
    softer: Float[np.ndarray, " springs"] | None = None,
    named: ModelFit | None = None,
) -> tuple[SufficientStatistics, StaticState]:
    """Return readings and static state under the springs and loads that were found.

    Args:
        prepared: The recording against its nominal model.
        split: Which poses may be looked at.
        softer: As in `build_problem`.
        named: As in `build_problem`.
    """
    data, situation = prepared.data, prepared.situation
    springs = springs_of(situation, prepared.springs)
    if springs:
        own, moved = list(prepared.springs), situation.compliance.copy()
        if softer is None:
            evidence = normal_equations_of(data, springs, training(split))
            softer = solve(evidence.gram.sum(axis=0), evidence.score.sum(axis=0))
        change = _within_a_decade(softer, moved[own])
        data = data.subtract(springs, change)
        moved[own] += change
        situation = situation.with_compliance(moved)
    return data, situation if named is None else _under(situation, named)


def changes(case: SelectionProblem, prepared: Prepared, fit: ModelFit) -> bool:
    """Return whether a set changes springs or loads so that columns change with them.

    Args:
        case: As laid out.
        prepared: The recording against its nominal model.
        fit: The set.
    """
    return _softened(case, fit) or _change(case, prepared, fit) >= MOVED


def _under(situation: StaticState, fit: ModelFit) -> StaticState:
    """Return the situation with all that the members of a set make each other feel."""
    sized = list(zip(fit.members, fit.coefficients, strict=True))
    for member, size in sized:
        situation = _acting(situation, member, size)
    giving = tuple(_giving(*one) for one in sized if one[0].hypothesis.linear)
    return replace(situation, giving=giving)


def _acting(situation: StaticState, member: ModelTerm, size: np.ndarray) -> StaticState:
    return member.hypothesis.acting(situation, member.where, member.shape, size)


def _giving(
    member: ModelTerm, size: Float[np.ndarray, " columns"]
) -> Callable[[StaticState], tuple[JacobianBlock, ...]]:
    """Return what a member does in any situation."""

    def parts(situation: StaticState) -> tuple[JacobianBlock, ...]:
        law = member.jacobian(situation).parts
        return tuple(with_values(p, values(p) @ size[:, None]) for p in law)

    return parts


def loads_of(case: SelectionProblem, fit: ModelFit) -> frozenset[tuple[str, str]]:
    """Return the names of a set that change what the others feel."""
    here = case.situation
    return frozenset(
        member.name
        for member, size in zip(fit.members, fit.coefficients, strict=True)
        if _acting(here, member, size) is not here
    )


def changes_loads(case: SelectionProblem, member: ModelTerm) -> bool:
    """Return whether a member changes forces on the arm, whatever its size."""
    here = case.situation
    size = np.ones(member.jacobian(here).columns)
    return _acting(here, member, size).moment is not here.moment


def _softened(case: SelectionProblem, fit: ModelFit) -> bool:
    """Return whether names leave springs so different that columns change with them."""
    before = case.situation.compliance[list(case.springs)]
    return bool(np.any(np.abs(fit.springs) > MOVED * before))


def _change(case: SelectionProblem, prepared: Prepared, fit: ModelFit) -> float:
    """Return the largest share by which loads or slopes of springs have changed."""
    now, then = _under(prepared.situation, fit), case.situation
    loads = [(now.moment, then.moment), (now.torque[..., None], then.torque[..., None])]
    shares = [0.0]
    for new, old in loads:
        change, size = (np.sqrt(np.mean(x**2, axis=(0, 2))) for x in (new - old, old))
        shares.extend(change / np.maximum(size, TINY))
    if now.curved or then.curved:
        every = range(len(now.axes))
        new, old = (np.stack([x.softness_of(k) for k in every]) for x in (now, then))
        shares.append(float(np.sqrt(np.max(np.mean((new - old) ** 2, axis=1)))))
    return float(max(shares))


def total_softening(
    case: SelectionProblem, prepared: Prepared, fit: ModelFit
) -> Float[np.ndarray, " springs"]:
    """Return by how much compliances are other than prepared."""
    own = list(prepared.springs)
    moved = case.situation.compliance - prepared.situation.compliance
    return moved[own] + fit.springs


def _within_a_decade(
    change: Float[np.ndarray, " springs"], before: Float[np.ndarray, " springs"]
) -> Float[np.ndarray, " springs"]:
    return np.clip(change, -0.9 * before, 9.0 * before)
