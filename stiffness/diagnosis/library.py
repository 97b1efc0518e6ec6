"""All hypotheses at all places with all shapes stand in one row, beside the map.

The first columns are the nominal ones: the springs that are fitted silently.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from stiffness.diagnosis.deferred import Deferred, deferred
from stiffness.diagnosis.hypotheses.hypothesis import Hypothesis
from stiffness.diagnosis.residual_map import residual_map
from stiffness.diagnosis.signature import Signature, turn
from stiffness.diagnosis.situation import Situation


@dataclass(frozen=True)
class Candidate:
    """One hypothesis at one place.

    Attributes:
        hypothesis: Which.
        where: Where, as in an answer.
        shapes: Its grid.
        columns: Numbers of its columns for each shape.
    """

    hypothesis: Hypothesis
    where: str
    shapes: Float[np.ndarray, "shapes parameters"]
    columns: tuple[Int[np.ndarray, " columns"], ...]

    @property
    def name(self) -> tuple[str, str]:
        """Effect and place."""
        return self.hypothesis.effect, self.where

    @property
    def freedom(self) -> int:
        """How many numbers are fitted: coefficients and shape."""
        return len(self.columns[0]) + self.shapes.shape[1]


@dataclass(frozen=True)
class Mapped:
    """A part of the residual map, with the numbers of its columns."""

    where: str
    depends_on: str
    columns: Int[np.ndarray, " columns"]


@dataclass(frozen=True)
class Library:
    """All signatures in a row, and who owns which columns.

    Attributes:
        signatures: Nominal, then candidates, then map.
        nominal: How many columns are nominal.
        candidates: Hypotheses at places.
        map: The residual map.
    """

    signatures: tuple[Signature | Deferred, ...]
    nominal: int
    candidates: tuple[Candidate, ...]
    map: tuple[Mapped, ...]


def springs_of(situation: Situation, springs: Sequence[int]) -> tuple[Signature, ...]:
    """Return what more compliance of each fitted axis does."""
    return tuple(turn(k, situation.torque[:, k]) for k in springs)


def library_of(
    situation: Situation, springs: Sequence[int], hypotheses: Sequence[Hypothesis]
) -> Library:
    """Lay out nominal springs, all hypotheses at all places and shapes, and the map."""
    signatures: list[Signature | Deferred] = [*springs_of(situation, springs)]
    at = len(signatures)
    candidates, mapped = [], []
    for hypothesis in hypotheses:
        for where in hypothesis.places(situation):
            shapes = hypothesis.shapes(situation, where)
            owned = []
            for shape in shapes:
                signature = hypothesis.signature(situation, where, shape)
                if len(shapes) > 1:
                    here = (hypothesis, where, shape, situation)
                    signatures.append(deferred(signature, *here))
                else:
                    signatures.append(signature)
                owned.append(np.arange(at, at + signature.columns))
                at += signature.columns
            candidates.append(Candidate(hypothesis, where, shapes, tuple(owned)))
    for block in residual_map(situation):
        signatures.append(block.signature)
        owned = np.arange(at, at + block.signature.columns)
        at += block.signature.columns
        mapped.append(Mapped(block.where, block.depends_on, owned))
    return Library(tuple(signatures), len(springs), tuple(candidates), tuple(mapped))
