"""A named effect is a hypothesis at a place with a shape, and what was fitted to it."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from stiffness.diagnosis.by_pose import ByPose, by_pose
from stiffness.diagnosis.data import Data
from stiffness.diagnosis.evidence import evidence_of
from stiffness.diagnosis.hypotheses.hypothesis import Hypothesis
from stiffness.diagnosis.signature import Signature
from stiffness.diagnosis.situation import Situation
from stiffness.diagnosis.split import Split


@dataclass(frozen=True)
class Member:
    """One hypothesis at one place with one shape."""

    hypothesis: Hypothesis
    where: str
    shape: Float[np.ndarray, " parameters"]

    @property
    def name(self) -> tuple[str, str]:
        """Effect and place."""
        return self.hypothesis.effect, self.where

    def signature(self, situation: Situation) -> Signature:
        """Return its columns."""
        return self.hypothesis.signature(situation, self.where, self.shape)

    @property
    def freedom(self) -> int:
        """How many shape parameters there are."""
        return len(self.shape)


@dataclass(frozen=True)
class SetFit:
    """A set of members fitted together with the nominal springs.

    Attributes:
        members: Which.
        gain: Whitened square explained beyond the nominal columns, training poses.
        springs: Change of each fitted compliance.
        coefficients: Of each member.
        freedom: Coefficients and shapes.
    """

    members: tuple[Member, ...]
    gain: float
    springs: Float[np.ndarray, " springs"]
    coefficients: tuple[Float[np.ndarray, " _"], ...]
    freedom: int


def training(split: Split) -> np.ndarray:
    """Return one fold index per pose: 0 held out, 1 fitted."""
    return (split.fold > 0).astype(int)


def fit_set(
    data: Data,
    situation: Situation,
    nominal: Sequence[Signature],
    members: Sequence[Member],
    split: Split,
) -> SetFit:
    """Fit members and nominal springs to the training poses."""
    own = [m.signature(situation) for m in members]
    found = evidence_of(data, [*nominal, *own], training(split))
    score = found.score[~split.held_out].sum(axis=0)
    return fit_of(members, own, found.gram[1], score)


def fit_of(
    members: Sequence[Member],
    own: Sequence[Signature],
    gram: Float[np.ndarray, "columns columns"],
    score: Float[np.ndarray, " columns"],
) -> SetFit:
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
    freedom = sum(s.columns for s in own) + sum(m.freedom for m in members)
    return SetFit(tuple(members), gain, solved[:n], parts, freedom)


def solve(gram: np.ndarray, score: np.ndarray) -> np.ndarray:
    """Solve normal equations whose columns have very different units."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(gram), 1e-300))
    scaled = gram * scale * scale[:, None] + 1e-9 * np.eye(len(gram))
    return scale * np.linalg.solve(scaled, scale * score)


def held_out_gain(
    data: Data, signatures: Sequence[Signature], split: Split
) -> Float[np.ndarray, " poses"]:
    """Return how much better each pose is predicted by fits that have not seen it.

    Half the fall in whitened square against the data as they are: an expected log
    predictive density, pose by pose; 0 for the poses of the hold-out.
    """
    return gain_left_out(by_pose(data, signatures, training(split)), split)


def gain_left_out(found: ByPose, split: Split) -> Float[np.ndarray, " poses"]:
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
