"""Library of candidate effects: all hypotheses at all places with all shapes.

They stand in one row, beside the residual map. The first columns are the nominal ones:
the springs, a nuisance.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

from stiffness.effects.base import Hypothesis
from stiffness.effects.design_matrix import Deferred, KeptColumns, deferred
from stiffness.effects.jacobian import EffectJacobian
from stiffness.effects.residual_map import (
    GenericTerm,
    residual_map,
    shows_everywhere,
)
from stiffness.effects.statics import springs_of
from stiffness.experiment.static_state import StaticState


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
    def degrees_of_freedom(self) -> int:
        """How many numbers are fitted: coefficients and shape."""
        return len(self.columns[0]) + self.shapes.shape[1]


@dataclass(frozen=True)
class Mapped:
    """A part of the residual map, with the numbers of its columns."""

    where: str
    kind: str
    depends_on: str
    columns: Int[np.ndarray, " columns"]

    @property
    def hypothesis(self) -> GenericTerm:
        """It as a term without a name."""
        return GenericTerm(f"generic_{self.kind}", self.kind, self.depends_on)

    @property
    def shows_everywhere(self) -> bool:
        """Whether names at many places would share out what it does."""
        return shows_everywhere(self.where, (self.depends_on,))


@dataclass(frozen=True)
class ResidualMap:
    """Blocks of the residual map after the nominal columns.

    Attributes:
        columns: Nominal, then each block's.
        blocks: With the numbers of their columns.
    """

    columns: KeptColumns
    blocks: tuple[Mapped, ...]


@dataclass(frozen=True)
class Library:
    """All that is selected from in a row, and who owns which columns.

    Attributes:
        jacobians: Nominal, then candidates.
        nominal: How many columns are nominal.
        candidates: Hypotheses at places.
        map: The residual map, whose columns are counted apart.
    """

    jacobians: tuple[EffectJacobian | Deferred, ...]
    nominal: int
    candidates: tuple[Candidate, ...] = ()
    map: ResidualMap = field(default_factory=lambda: ResidualMap(KeptColumns(()), ()))

    @cached_property
    def columns(self) -> KeptColumns:
        """All signatures, laid out once."""
        return KeptColumns(self.jacobians)

    def of_effects(self, effects: Collection[str]) -> "Library":
        """Return the nominal columns and those of some effects alone."""
        jacobians, candidates = [*self.jacobians[: self.nominal]], []
        first, at = self.nominal, self.nominal
        for candidate in self.candidates:
            after = first + len(candidate.columns)
            if candidate.hypothesis.effect in effects:
                jacobians += self.jacobians[first:after]
                owned = _numbers(at, [*map(len, candidate.columns)])
                candidates.append(replace(candidate, columns=owned))
                at += sum(map(len, owned))
            first = after
        return Library(tuple(jacobians), self.nominal, tuple(candidates))


def library_of(
    situation: StaticState, springs: Sequence[int], hypotheses: Sequence[Hypothesis]
) -> Library:
    """Lay out nominal springs, all hypotheses at all places and shapes, and the map."""
    nominal = springs_of(situation, springs)
    signatures: list[EffectJacobian | Deferred] = [*nominal]
    at, candidates = len(signatures), []
    for hypothesis in hypotheses:
        for where in hypothesis.places(situation):
            shapes = hypothesis.shapes(situation, where)
            for shape in shapes:
                own = hypothesis.jacobian(situation, where, shape)
                if len(shapes) > 1:
                    own = deferred(own, hypothesis, where, shape, situation)
                signatures.append(own)
            owned = _numbers(at, [own.columns for own in signatures[-len(shapes) :]])
            candidates.append(Candidate(hypothesis, where, shapes, owned))
            at += sum(map(len, owned))
    every = residual_map(situation)
    laid_out = KeptColumns((*nominal, *(block.jacobian for block in every)))
    owned = _numbers(len(nominal), [block.jacobian.columns for block in every])
    own = zip(every, owned, strict=True)
    blocks = tuple(Mapped(b.where, b.kind, b.depends_on, columns) for b, columns in own)
    whole = ResidualMap(laid_out, blocks)
    return Library(tuple(signatures), len(nominal), tuple(candidates), whole)


def _numbers(first: int, counts: Sequence[int]) -> tuple[Int[np.ndarray, " _"], ...]:
    """Return the numbers of so many columns each, one after the other."""
    ends = first + np.cumsum([0, *counts])
    return tuple(np.arange(a, b) for a, b in pairwise(ends))
