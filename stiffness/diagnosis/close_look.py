"""A set is looked at closely once: fit, prediction and intervals together."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from stiffness.diagnosis.by_pose import ByPose, by_pose
from stiffness.diagnosis.data import Data
from stiffness.diagnosis.member import (
    Member,
    SetFit,
    fit_of,
    gain_left_out,
    training,
)
from stiffness.diagnosis.refine import shape_columns
from stiffness.diagnosis.signature import Signature
from stiffness.diagnosis.situation import Situation
from stiffness.diagnosis.split import Split


@dataclass(frozen=True)
class CloseLook:
    """What poses say of nominal springs, members, their shapes' slopes, other forms.

    Attributes:
        fit: Members fitted together with the nominal springs.
        forms: How many other forms of the members' laws there are.
        gain: Whitened square explained by members and these together.
        predicted: Gain on each pose by fits that did not see it; with the other forms
            where these help, for poses that span little make them go astray.
        slopes: The same of springs, members and a little more of each shape.
    """

    fit: SetFit
    forms: int
    gain: float
    predicted: Float[np.ndarray, " poses"]
    slopes: ByPose


def close_look(
    data: Data,
    situation: Situation,
    nominal: Sequence[Signature],
    members: Sequence[Member],
    forms: Sequence[Signature],
    split: Split,
) -> CloseLook:
    """Look at members closely, in one pass over the readings.

    Args:
        data: The readings.
        situation: Where the arm stood.
        nominal: Columns of the springs.
        members: The set.
        forms: Other accepted forms of the members' laws; they may help to predict.
        split: Which poses may be looked at.
    """
    own = [m.signature(situation) for m in members]
    steps = [
        s
        for m, one in zip(members, own, strict=True)
        for s in shape_columns(situation, m, np.eye(one.columns))
    ]
    every = by_pose(data, [*nominal, *own, *forms, *steps], training(split))
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
        for _ in range(member.freedom)
    ]
    mix = np.zeros((ends[4], len(first) + len(weight)))
    mix[first, first] = 1.0
    at = ends[3]
    for column, part in enumerate(weight, start=len(first)):
        mix[at : at + len(part), column] = part
        at += len(part)
    count = sum(s.columns for s in forms)
    return CloseLook(fit, count, gain, predicted, every.mixed(mix))


def _some(every: ByPose, columns: Int[np.ndarray, " some"]) -> ByPose:
    inner = np.ix_(columns, columns)
    gram = every.gram[:, inner[0], inner[1]]
    own = every.own[:, inner[0], inner[1]]
    return ByPose(gram, own, every.score[:, columns])
