"""Fit of a model: coefficients, nonlinear shape parameters, and held-out gain.

A case is what naming looks at: data, hypotheses, and what may not be seen.

A named effect is a hypothesis at a place with a shape, and what was fitted to it.

A shape is searched coarsely with all sets, then finely where it matters.

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
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from stiffness.diagnosis.candidates import Library, springs_of
from stiffness.diagnosis.sufficient_statistics import (
    PerPoseScores,
    SufficientStatistics,
    normal_equations_of,
    per_pose_scores,
)
from stiffness.effects.base import Hypothesis
from stiffness.effects.jacobian import EffectJacobian, values, with_values
from stiffness.experiment.static_state import StaticState
from stiffness.regression.elimination import projection_coefficients
from stiffness.regression.normal_equations import NormalEquations
from stiffness.regression.splits import Split

# --- Selection problem ----------------------------------------------------------------


@dataclass(frozen=True)
class SelectionProblem:
    """Everything that naming looks at.

    Attributes:
        data: Readings without what the nominal fit explains.
        situation: Where the arm stood.
        springs: Axes whose compliance is nominal.
        library: All columns.
        normal_equations: What the readings say about them.
        split: Which poses may be looked at.
        seed: Of random signs.
        dispersion_limit: Dispersion of poses up to which errors may be misstated.
    """

    data: SufficientStatistics
    situation: StaticState
    springs: tuple[int, ...]
    library: Library
    normal_equations: NormalEquations
    split: Split
    seed: int
    dispersion_limit: float

    @property
    def nominal(self) -> tuple[EffectJacobian, ...]:
        """The nominal columns."""
        return springs_of(self.situation, self.springs)

    @property
    def poses(self) -> int:
        """How many poses may be looked at."""
        return int(np.sum(~self.split.held_out))


# --- Terms of a model -----------------------------------------------------------------


@dataclass(frozen=True)
class ModelTerm:
    """One hypothesis at one place with one shape."""

    hypothesis: Hypothesis
    where: str
    shape: Float[np.ndarray, " parameters"]

    @property
    def name(self) -> tuple[str, str]:
        """Effect and place."""
        return self.hypothesis.effect, self.where

    def jacobian(self, situation: StaticState) -> EffectJacobian:
        """Return its columns."""
        return self.hypothesis.jacobian(situation, self.where, self.shape)

    @property
    def degrees_of_freedom(self) -> int:
        """How many shape parameters there are."""
        return len(self.shape)


@dataclass(frozen=True)
class ModelFit:
    """A set of members fitted together with the nominal springs.

    Attributes:
        members: Which.
        gain: Whitened square explained beyond the nominal columns, training poses.
        springs: Change of each fitted compliance.
        coefficients: Of each member.
        degrees_of_freedom: Coefficients and shapes.
    """

    members: tuple[ModelTerm, ...]
    gain: float
    springs: Float[np.ndarray, " springs"]
    coefficients: tuple[Float[np.ndarray, " _"], ...]
    degrees_of_freedom: int


def training(split: Split) -> np.ndarray:
    """Return one fold index per pose: 0 held out, 1 fitted."""
    return (split.fold > 0).astype(int)


def fit_model(
    data: SufficientStatistics,
    situation: StaticState,
    nominal: Sequence[EffectJacobian],
    members: Sequence[ModelTerm],
    split: Split,
) -> ModelFit:
    """Fit members and nominal springs to the training poses."""
    own = [m.jacobian(situation) for m in members]
    found = normal_equations_of(data, [*nominal, *own], training(split))
    score = found.score[~split.held_out].sum(axis=0)
    return fit_of(members, own, found.gram[1], score)


def fit_of(
    members: Sequence[ModelTerm],
    own: Sequence[EffectJacobian],
    gram: Float[np.ndarray, "columns columns"],
    score: Float[np.ndarray, " columns"],
) -> ModelFit:
    """Solve for nominal springs, which come first, and members.

    Args:
        members: The set.
        own: Their signatures.
        gram: Of the training poses.
        score: The same.
    """
    solved = solve(gram, score)
    n = len(gram) - sum(s.columns for s in own)
    before = score[:n] @ solve(gram[:n, :n], score[:n]) if n else 0.0
    gain = float(score @ solved - before)
    ends = np.cumsum([n, *(s.columns for s in own)])
    parts = tuple(solved[a:b] for a, b in pairwise(ends))
    freedom = sum(s.columns for s in own) + sum(m.degrees_of_freedom for m in members)
    return ModelFit(tuple(members), gain, solved[:n], parts, freedom)


def solve(gram: np.ndarray, score: np.ndarray) -> np.ndarray:
    """Solve normal equations whose columns have very different units."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(gram), 1e-300))
    scaled = gram * scale * scale[:, None] + 1e-9 * np.eye(len(gram))
    return scale * np.linalg.solve(scaled, scale * score)


def held_out_gain(
    data: SufficientStatistics, signatures: Sequence[EffectJacobian], split: Split
) -> Float[np.ndarray, " poses"]:
    """Return how much better each pose is predicted by fits that have not seen it.

    Half the fall in whitened square against the data as they are: an expected log
    predictive density, pose by pose; 0 for the poses of the hold-out.
    """
    return gain_left_out(per_pose_scores(data, signatures, training(split)), split)


def gain_left_out(found: PerPoseScores, split: Split) -> Float[np.ndarray, " poses"]:
    """Return the same as `held_out_gain` from what poses say of the columns."""
    own, of_pose = found.own, found.score
    whole = own[~split.held_out].sum(axis=0)
    score = of_pose[~split.held_out].sum(axis=0)
    gain = np.zeros(len(own))
    for f in range(1, split.count + 1):
        inside = split.fold == f
        if not inside.any():
            continue
        ask = score - of_pose[inside].sum(axis=0)
        beta = solve(whole - own[inside].sum(axis=0), ask)
        curve = np.einsum("i,pij,j->p", beta, own[inside], beta)
        gain[inside] = of_pose[inside] @ beta - 0.5 * curve
    return gain


# --- Test of the residual -------------------------------------------------------------


def other_forms(
    case: SelectionProblem, members: Sequence[ModelTerm]
) -> list[EffectJacobian]:
    """Return the other accepted forms of named laws.

    They are not held against a name, nor do they earn one for another effect.
    """
    forms = (m.hypothesis.variants(case.situation, m.where, m.shape) for m in members)
    return [form for form in forms if form.columns]


# --- Refinement of shapes -------------------------------------------------------------

TRIES = 9
"""Values that are tried at once."""
WHOLE = ("with", "settled", "within", "beside")
"""Shape parameters that count something and have nothing in between."""


def refined(
    data: SufficientStatistics,
    situation: StaticState,
    nominal: Sequence[EffectJacobian],
    members: Sequence[ModelTerm],
    split: Split,
    passes: int = 2,
) -> tuple[ModelTerm, ...]:
    """Move each shape parameter to where the set explains most, in turn."""
    members = list(members)
    for sweep in range(passes if sum(m.degrees_of_freedom for m in members) else 0):
        for k, member in enumerate(members):
            grid = member.hypothesis.shapes(situation, member.where)
            for j in range(member.degrees_of_freedom):
                if member.hypothesis.shape_names[j] in WHOLE:
                    continue
                members[k] = _along(
                    data, situation, nominal, (members, k, j, sweep), grid, split
                )
    return tuple(members)


def _along(data, situation, nominal, at, grid, split) -> ModelTerm:
    """Return a member with one shape parameter at its best between grid neighbours."""
    members, k, j, sweep = at
    member = members[k]
    factor = member.hypothesis.shape_names[j] in member.hypothesis.logarithmic
    tries = tried(float(member.shape[j]), np.unique(grid[:, j]), sweep, factor)
    if tries[-1] - tries[0] < 1e-12 * max(1.0, abs(tries[0])):
        return member
    others = [m.jacobian(situation) for i, m in enumerate(members) if i != k]
    shaped = []
    for value in tries:
        shape = member.shape.copy()
        shape[j] = np.exp(value) if factor else value
        shaped.append(ModelTerm(member.hypothesis, member.where, shape))
    own = [m.jacobian(situation) for m in shaped]
    evidence = normal_equations_of(data, [*nominal, *others, *own], training(split))
    gram, score = evidence.gram[1], evidence.score[~split.held_out].sum(axis=0)
    n = sum(s.columns for s in (*nominal, *others))
    known = np.arange(n)
    share = projection_coefficients(gram, known)
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
    return ModelTerm(member.hypothesis, member.where, shape)


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
    situation: StaticState, member: ModelTerm, coefficients: np.ndarray
) -> list[EffectJacobian]:
    """Return what a little more of each shape parameter does, per unit of it.

    Args:
        situation: Where the arm stood.
        member: Whose shape.
        coefficients: Of its columns; or several sets of them, one a column.
    """
    sets = coefficients.reshape(len(coefficients), -1)
    slopes = []
    for j in range(member.degrees_of_freedom):
        if member.hypothesis.shape_names[j] in WHOLE:
            slopes.append(EffectJacobian(sets.shape[1]))
            continue
        span = np.ptp(member.hypothesis.shapes(situation, member.where)[:, j])
        step = 1e-3 * (span if span > 0 else max(1.0, abs(member.shape[j])))
        if member.hypothesis.shape_names[j] in member.hypothesis.logarithmic:
            step = min(step, 0.5 * float(member.shape[j]))  # never below zero
        sides = []
        for sign in (1.0, -1.0):
            shape = member.shape.copy()
            shape[j] += sign * step
            sides.append(ModelTerm(member.hypothesis, member.where, shape))
        high, low = (m.jacobian(situation) for m in sides)
        slopes.append(_difference(high, low, sets / (2 * step)))
    return slopes


def _difference(
    high: EffectJacobian, low: EffectJacobian, weight: np.ndarray
) -> EffectJacobian:
    parts = []
    for one, other in zip(high.parts, low.parts, strict=True):
        parts.append(with_values(one, (values(one) - values(other)) @ weight))
    return EffectJacobian(weight.shape[1], tuple(parts))
