"""A shape is searched coarsely with all sets, then finely where it matters.

==========  ==========================================================================
Equation    gain(shape) on nine points between the neighbours of the coarse best, and
            the top of the parabola through the best three; then once more within a step
            of these; the other parameters held
Source      variable projection (Golub & Pereyra 1973): amplitudes solved at each shape
Valid       one hump between neighbours of the coarse grid
Ignores     shapes beyond the grid's ends
==========  ==========================================================================
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from stiffness.diagnosis.data import Data
from stiffness.diagnosis.evidence import evidence_of, without
from stiffness.diagnosis.member import Member, solve, training
from stiffness.diagnosis.signature import Signature, values, with_values
from stiffness.diagnosis.situation import Situation
from stiffness.diagnosis.split import Split

TRIES = 9
"""Values that are tried at once."""
WHOLE = ("with", "settled", "within", "beside")
"""Shape parameters that count something and have nothing in between."""


def refined(
    data: Data,
    situation: Situation,
    nominal: Sequence[Signature],
    members: Sequence[Member],
    split: Split,
    passes: int = 2,
) -> tuple[Member, ...]:
    """Move each shape parameter to where the set explains most, in turn."""
    members = list(members)
    for sweep in range(passes if sum(m.freedom for m in members) else 0):
        for k, member in enumerate(members):
            grid = member.hypothesis.shapes(situation, member.where)
            for j in range(member.freedom):
                if member.hypothesis.shape_names[j] in WHOLE:
                    continue
                members[k] = _along(
                    data, situation, nominal, (members, k, j, sweep), grid, split
                )
    return tuple(members)


def _along(data, situation, nominal, at, grid, split) -> Member:
    """Return a member with one shape parameter at its best between grid neighbours."""
    members, k, j, sweep = at
    member = members[k]
    factor = member.hypothesis.shape_names[j] in member.hypothesis.logarithmic
    tries = tried(float(member.shape[j]), np.unique(grid[:, j]), sweep, factor)
    if tries[-1] - tries[0] < 1e-12 * max(1.0, abs(tries[0])):
        return member
    others = [m.signature(situation) for i, m in enumerate(members) if i != k]
    shaped = []
    for value in tries:
        shape = member.shape.copy()
        shape[j] = np.exp(value) if factor else value
        shaped.append(Member(member.hypothesis, member.where, shape))
    own = [m.signature(situation) for m in shaped]
    evidence = evidence_of(data, [*nominal, *others, *own], training(split))
    gram, score = evidence.gram[1], evidence.score[~split.held_out].sum(axis=0)
    n = sum(s.columns for s in (*nominal, *others))
    known = np.arange(n)
    share = without(gram, known)
    score = score - score[known] @ share
    gram = gram - gram[:, known] @ share
    width = own[0].columns
    gains = []
    for i in range(len(tries)):
        block = np.arange(n + i * width, n + (i + 1) * width)
        ask = score[block]
        gains.append(float(ask @ solve(gram[np.ix_(block, block)], ask)))
    best = int(np.argmax(gains))
    value = tries[best]
    if 0 < best < len(tries) - 1:
        a, b, c = gains[best - 1 : best + 2]
        bend = a - 2 * b + c
        if bend < 0:
            value += 0.5 * (a - c) / bend * (tries[1] - tries[0])
    shape = member.shape.copy()
    shape[j] = np.exp(value) if factor else value
    return Member(member.hypothesis, member.where, shape)


def tried(
    here: float, grid: Float[np.ndarray, " points"], sweep: int, factor: bool
) -> Float[np.ndarray, "9"]:
    """Return values that are tried, or their logarithms where an error is a factor.

    Args:
        here: The best so far.
        grid: Coarse values, in order.
        sweep: 0: between the neighbours of the grid's nearest; later: a step of these
            to either side.
        factor: Whether an error is a factor.
    """
    if factor:
        here, grid = float(np.log(here)), np.log(grid)
    nearest = int(np.argmin(np.abs(grid - here)))
    low, high = grid[max(nearest - 1, 0)], grid[min(nearest + 1, len(grid) - 1)]
    if sweep:
        step = (high - low) / (TRIES - 1)
        low, high = max(low, here - step), min(high, here + step)
    return np.linspace(low, high, TRIES)


def shape_columns(
    situation: Situation, member: Member, coefficients: np.ndarray
) -> list[Signature]:
    """Return what a little more of each shape parameter does, per unit of it.

    Args:
        situation: Where the arm stood.
        member: Whose shape.
        coefficients: Of its columns; or several sets of them, one a column.
    """
    sets = coefficients.reshape(len(coefficients), -1)
    slopes = []
    for j in range(member.freedom):
        if member.hypothesis.shape_names[j] in WHOLE:
            slopes.append(Signature(sets.shape[1]))
            continue
        span = np.ptp(member.hypothesis.shapes(situation, member.where)[:, j])
        step = 1e-3 * (span if span > 0 else max(1.0, abs(member.shape[j])))
        sides = []
        for sign in (1.0, -1.0):
            shape = member.shape.copy()
            shape[j] += sign * step
            sides.append(Member(member.hypothesis, member.where, shape))
        high, low = (m.signature(situation) for m in sides)
        slopes.append(_difference(high, low, sets / (2 * step)))
    return slopes


def _difference(high: Signature, low: Signature, weight: np.ndarray) -> Signature:
    parts = []
    for one, other in zip(high.parts, low.parts, strict=True):
        parts.append(with_values(one, (values(one) - values(other)) @ weight))
    return Signature(weight.shape[1], tuple(parts))
