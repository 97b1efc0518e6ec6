"""What is named changes what all else feels; then all columns are laid out anew.

==========  ==========================================================================
Equation    y = f(c0) + (c - c0) df/dc + sizes x columns, df/dc and columns at c and
            under the torques of what was named in the round before
Source      Gauss-Newton, lever arms held: they move by a thousandth
Valid       masses, and springs that names leave softer or stiffer
Ignores     where else the arm rests under them: that stays as it was prepared
==========  ==========================================================================
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from stiffness.diagnosis.case import Case
from stiffness.diagnosis.detect import MEASURED, MISSTATED, Found
from stiffness.diagnosis.evidence import evidence_of
from stiffness.diagnosis.hypotheses.hypothesis import Hypothesis
from stiffness.diagnosis.library import library_of, springs_of
from stiffness.diagnosis.member import SetFit, solve, training
from stiffness.diagnosis.naming import Named, name
from stiffness.diagnosis.prepare import Prepared
from stiffness.diagnosis.situation import Situation
from stiffness.diagnosis.split import seed_of, split_of

MOVED = 0.03
"""Share by which a compliance or a moment may change under names before all columns are
laid out anew; chosen: what a load or a mass winds up goes with it, and sizes are said
to some per cent."""
AGAIN = 2
"""How often; chosen: the second time moves a tenth of the first."""
UNSETTLED = 0.3
"""Share of a moment from which names that come and go with it are not believed; then
nothing is laid under; chosen: ten times `MOVED`."""


def case_of(
    prepared: Prepared,
    hypotheses: Sequence[Hypothesis],
    softer: Float[np.ndarray, " springs"] | None = None,
    named: SetFit | None = None,
) -> Case:
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
    data, situation = prepared.data, prepared.situation
    springs = springs_of(situation, prepared.springs)
    if springs:
        own, moved = list(prepared.springs), situation.compliance.copy()
        if softer is None:
            evidence = evidence_of(data, springs, training(split))
            softer = solve(evidence.gram.sum(axis=0), evidence.score.sum(axis=0))
        change = _within_a_decade(softer, moved[own])
        data = data.less(springs, change)
        moved[own] += change
        situation = situation.with_compliance(moved)
    situation = situation if named is None else _under(situation, named)
    library = library_of(situation, prepared.springs, hypotheses)
    evidence = evidence_of(data, library.signatures, training(split))
    return Case(
        data,
        situation,
        prepared.springs,
        library,
        evidence,
        split,
        seed_of(recording),
        MEASURED if prepared.freedom else MISSTATED,
    )


def settled(
    case: Case, prepared: Prepared, hypotheses: Sequence[Hypothesis], found: Found
) -> tuple[Case, Named]:
    """Name what there is, and lay out anew what that changes.

    Args:
        case: As laid out where nothing is named.
        prepared: The recording against its nominal model.
        hypotheses: What may be named.
        found: The test before anything is named.
    """
    named = name(case, found)
    for _ in range(AGAIN):
        fit = named.best.fit
        if not _softened(case, fit) and _weight(case, prepared, fit) < MOVED:
            break
        case = case_of(prepared, hypotheses, _total(case, prepared, fit), fit)
        named = name(case, found)
    fit = named.best.fit
    if _weight(case, prepared, fit) > UNSETTLED:
        case = case_of(prepared, hypotheses, _total(case, prepared, fit))
        named = name(case, found)
    return case, named


def _under(situation: Situation, fit: SetFit) -> Situation:
    """Return the situation with all that the members of a set make each other feel."""
    if len(fit.members) > 1:
        for member, size in zip(fit.members, fit.coefficients, strict=True):
            situation = member.hypothesis.acting(situation, member.where, size)
    return situation


def _softened(case: Case, fit: SetFit) -> bool:
    """Return whether names leave springs so different that columns change with them."""
    before = case.situation.compliance[list(case.springs)]
    return bool(np.any(np.abs(fit.springs) > MOVED * before))


def _weight(case: Case, prepared: Prepared, fit: SetFit) -> float:
    """Return the largest share by which a moment is another than was laid out under."""
    now, then = _under(prepared.situation, fit).moment, case.situation.moment
    change, size = (np.sqrt(np.mean(m**2, axis=(0, 2))) for m in (now - then, then))
    return float(np.max(change / np.maximum(size, 1e-12)))


def _total(
    case: Case, prepared: Prepared, fit: SetFit
) -> Float[np.ndarray, " springs"]:
    """Return by how much compliances are other than prepared."""
    own = list(prepared.springs)
    moved = case.situation.compliance - prepared.situation.compliance
    return moved[own] + fit.springs


def _within_a_decade(
    change: Float[np.ndarray, " springs"], before: Float[np.ndarray, " springs"]
) -> Float[np.ndarray, " springs"]:
    return np.clip(change, -0.9 * before, 9.0 * before)
