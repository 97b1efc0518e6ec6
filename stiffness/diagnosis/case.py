"""A case is what naming looks at: data, hypotheses, and what may not be seen."""

from dataclasses import dataclass

import numpy as np

from stiffness.diagnosis.data import Data
from stiffness.diagnosis.evidence import Evidence
from stiffness.diagnosis.library import Library, springs_of
from stiffness.diagnosis.signature import Signature
from stiffness.diagnosis.situation import Situation
from stiffness.diagnosis.split import Split


@dataclass(frozen=True)
class Case:
    """Everything that naming looks at.

    Attributes:
        data: Readings without what the nominal fit explains.
        situation: Where the arm stood.
        springs: Axes whose compliance is nominal.
        library: All columns.
        evidence: What the readings say about them.
        split: Which poses may be looked at.
        seed: Of random signs.
        wild: Dispersion of poses up to which errors may be misstated.
    """

    data: Data
    situation: Situation
    springs: tuple[int, ...]
    library: Library
    evidence: Evidence
    split: Split
    seed: int
    wild: float

    @property
    def nominal(self) -> tuple[Signature, ...]:
        """The nominal columns."""
        return springs_of(self.situation, self.springs)

    @property
    def poses(self) -> int:
        """How many poses may be looked at."""
        return int(np.sum(~self.split.held_out))
