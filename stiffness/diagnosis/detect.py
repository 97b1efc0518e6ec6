"""Whether anything is there is asked of all hypotheses and of a map that names none."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.stats import chi2

from stiffness.diagnosis.evidence import Evidence
from stiffness.diagnosis.flips import (
    SMALLEST,
    Tested,
    families,
    sign_flips,
    white_scores,
)
from stiffness.diagnosis.library import Library
from stiffness.diagnosis.scatter import Scatter

ALARM = 0.005
"""p-value below which there is a mismatch; the rule of the answer."""
WOULD_SHOW = 45.0
"""Whitened square that a hidden effect would need to be seen. Of twenty effects, each
another, all were seen at 45 to 56 and fifteen at 25 to 31; `scenarios.blind_trials
--strata one_45` holds it to nine in ten."""
FEWEST = 10
"""Poses from which random signs can reject: fewer are all alike or all turned in more
than one of 400 cases, and there are two families."""
MISSTATED = 4.0
"""Variance of poses over that of the stated errors that is still taken for misstated
noise; chosen: twice the stated size. Random signs are blind to a law whose own sign
changes from pose to pose; this is what it leaves."""
MEASURED = 1.5
"""The same where the noise is not only stated but measured; chosen: recordings of
nothing have 0.7 to 1.1."""
SCATTERED = 1.3
"""Variance of readings over that of their errors that is still taken for noise, where
it is measured; chosen: recordings of nothing have 0.6 to 1.13."""


@dataclass(frozen=True)
class Found:
    """What the test of everything found.

    Candidates are one family and the map another, so that a thousand names do not
    drown what has none.

    Attributes:
        tested: Candidates at every shape, then blocks of the map, then whole places of
            the map, then the whole map.
        candidates: How many blocks belong to candidates.
        blocks: How many to the map's blocks.
        places: Names of the places of the map.
        where: Place of each block that was tested; the whole map has none.
        dispersion: Mean square of white scores of the map: noise variance over the
            stated one if nothing is there.
        poses: How many poses that is the mean of.
        scatter: Of the readings themselves.
    """

    tested: Tested
    candidates: int
    blocks: int
    places: tuple[str, ...]
    where: tuple[str, ...]
    dispersion: float
    poses: int
    scatter: Scatter

    @property
    def p_value(self) -> float:
        """Return the p-value: of any block, of wild poses, or of wild readings."""
        over = self.dispersion / self.scatter.wild
        beyond = float(chi2.sf(self.poses * over, self.poses))
        beyond = min(beyond, self.scatter.p_value(self.calm))
        return min(self.tested.p_value, max(beyond, SMALLEST))

    @property
    def calm(self) -> float:
        """Return the scatter of readings that is still taken for noise."""
        wild = self.scatter.wild
        return SCATTERED if wild == MEASURED else wild

    @property
    def excess(self) -> float:
        """Return the whitened square that errors do not make: the map's, or all."""
        of_map = float(self.tested.captured[-1] - self.tested.freedom[-1])
        return max(of_map, self.scatter.excess) if self.scatters else of_map

    @property
    def scatters(self) -> bool:
        """Return whether readings surely scatter by more than noise does."""
        return self.scatter.p_value(self.calm) < ALARM

    @property
    def strongest(self) -> int:
        """Return the number of the block that rejects most."""
        together, z = self.tested.together, self.tested.z
        return int(np.lexsort((-z, together))[0])

    def of_places(self, values: np.ndarray) -> dict[str, float]:
        """Return values of whole places of the map."""
        start = self.candidates + self.blocks
        named = values[start : start + len(self.places)]
        return dict(zip(self.places, (float(v) for v in named), strict=True))


def detect(
    library: Library,
    evidence: Evidence,
    score: Float[np.ndarray, "poses columns"],
    known: Int[np.ndarray, " known"],
    poses: np.ndarray,
    seed: int,
    scatter: Scatter,
) -> Found:
    """Test every candidate and the map beyond known columns.

    Args:
        library: Candidates and map.
        evidence: Gram matrices of all columns.
        score: Of the data without what the known columns explain.
        known: Columns that may explain for free.
        poses: Mask of the poses to look at.
        seed: Of the random signs.
        scatter: Of the readings.
    """
    share = np.bincount(evidence.fold[poses], minlength=len(evidence.gram)) > 0
    gram = evidence.gram[share].sum(axis=0)
    own = [block for c in library.candidates for block in c.columns]
    parts = [m.columns for m in library.map]
    places = tuple(dict.fromkeys(m.where for m in library.map))
    whole = [
        np.concatenate([m.columns for m in library.map if m.where == place])
        for place in places
    ]
    every: Sequence[np.ndarray] = [*own, *parts, *whole, np.concatenate(parts)]
    white = white_scores(gram, score[poses], known, every, evidence.raw)
    tested = families(
        sign_flips(white[: len(own)], seed), sign_flips(white[len(own) :], seed + 1)
    )
    of_map = np.concatenate(white[len(own) : len(own) + len(parts)], axis=1)
    dispersion = float(np.sum(of_map**2) / max(1, of_map.shape[1]))
    where = (
        *(c.where for c in library.candidates for _ in c.columns),
        *(m.where for m in library.map),
        *places,
        "",
    )
    count = int(poses.sum())
    return Found(
        tested, len(own), len(parts), places, where, dispersion, count, scatter
    )
