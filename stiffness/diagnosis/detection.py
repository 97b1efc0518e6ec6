"""Detection: max-T test of all effects and of the residual map, and overdispersion.

What no law explains still shows: readings scatter by more than their errors.

==========  ==========================================================================
Equation    dispersion = sum of whitened squares / degrees of freedom, of differences
            within visits or of their means, whichever is larger, or of one marker's
            means; p-value of its being at most w: normal, standard error over poses,
            times the number of markers (Bonferroni)
Source      goodness of fit; the pose as the unit that errs independently
Valid       errors that are stated, or measured by marks of one body
Ignores     the few coefficients that were fitted
==========  ==========================================================================

The map asks along laws of axes. A mark that sags, or a tracker whose circle errs, moves
readings along none of them.

Whether anything is there is asked of all hypotheses and of a map that names none.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int
from scipy.stats import chi2, norm

from stiffness.diagnosis.candidates import Library
from stiffness.diagnosis.sufficient_statistics import SufficientStatistics
from stiffness.regression.normal_equations import NormalEquations
from stiffness.regression.testing import (
    SIGNIFICANCE,
    SMALLEST,
    MaxTResult,
    combine_tests,
    sign_flip_test,
    white_scores,
)

# --- Dispersion of the readings -------------------------------------------------------

WITNESSES = 2
"""Other markers of a body that tell which one moves; chosen: three of them."""
FEWEST_FOR_DISPERSION = 20
"""Poses from which scatter is judged; chosen."""


@dataclass(frozen=True)
class Scatter:
    """How readings scatter once everything known is taken off.

    Attributes:
        dispersion: Variance over that of the errors.
        error: Its standard error over poses.
        excess: Whitened square beyond the errors.
        dispersion_limit: Dispersion of poses along laws up to which errors may be
            misstated.
        markers: The same of each marker's means alone; empty where there are none.
        witnesses: How many other markers a marker's body has.
    """

    dispersion: float
    error: float
    excess: float
    dispersion_limit: float
    markers: tuple["Scatter", ...] = ()
    witnesses: int = 0

    def p_value(self, most: float) -> float:
        """Return the p-value of no dispersion's being more than this."""
        alone = [marker.p_value(most) for marker in self.markers]
        own = float(norm.sf((self.dispersion - most) / max(self.error, 1e-12)))
        return min([own, *(len(alone) * p for p in alone)])

    @property
    def marker(self) -> int | None:
        """Return which marker has most of the excess, against the others of its body.

        None where none has: a marker alone goes where its body goes.
        """
        excess = [marker.excess for marker in self.markers]
        if not excess:
            return None
        worst = int(np.argmax(excess))
        seen = self.markers[worst].witnesses >= WITNESSES
        return worst if seen and 2.0 * excess[worst] > sum(excess) else None


def scatter_of(data: SufficientStatistics, dispersion_limit: float) -> Scatter:
    """Return how readings scatter, of both blocks the one that does more.

    Args:
        data: The residuals.
        dispersion_limit: Dispersion of poses along laws up to which errors may be
            misstated.
    """
    pose, within = data.visits.posture_index, data.within
    found = _of(pose, within.square, within.degrees_of_freedom, dispersion_limit)
    if data.between is None:
        return found
    between = data.between
    seen = np.any(between.whitening.half != 0.0, axis=(2, 3))  # (visits, markers)
    square = np.sum(between.residual.reshape(*seen.shape, 3) ** 2, axis=2)
    share = max(1.0 - data.nuisance_count / max(3.0 * seen.sum(), 1.0), 0.0)
    freedom = 3.0 * share * seen
    body = np.unique(between.carries, axis=1, return_inverse=True)[1].ravel()
    others = np.bincount(body)[body] - 1
    markers = tuple(
        replace(_of(pose, s, f, dispersion_limit), witnesses=int(n))
        for s, f, n in zip(square.T, freedom.T, others, strict=True)
    )
    means = _of(pose, square.sum(axis=1), freedom.sum(axis=1), dispersion_limit)
    return replace(max(found, means, key=lambda s: s.dispersion), markers=markers)


def _of(
    pose: Int[np.ndarray, " visits"],
    square: Float[np.ndarray, " visits"],
    degrees_of_freedom: Float[np.ndarray, " visits"],
    dispersion_limit: float,
) -> Scatter:
    one, free = np.bincount(pose, square), np.bincount(pose, degrees_of_freedom)
    one, free = one[free > 0.0], free[free > 0.0]
    if len(one) < FEWEST_FOR_DISPERSION:
        return Scatter(0.0, 1.0, 0.0, dispersion_limit)
    ratio = float(one.sum() / free.sum())
    error = float(np.linalg.norm(one - ratio * free) / free.sum())
    return Scatter(
        ratio, error, max(float(one.sum() - free.sum()), 0.0), dispersion_limit
    )


# --- Detection ------------------------------------------------------------------------

WOULD_SHOW = 45.0
"""Whitened square that a hidden effect would need to be seen. Of twenty effects, each
another, all were seen at 45 to 56 and fifteen at 25 to 31; `scenarios.blind_trials
--strata one_45` holds it to nine in ten."""
FEWEST_POSES = 10
"""Poses from which random signs can reject: fewer are all alike or all turned in more
than one of 400 cases, and there are two families."""
MISSTATED = 4.0
"""Variance of poses over that of stated errors that fewer than `FEWEST_POSES` must
exceed to differ; chosen: twice the stated size. Of more poses any such variance is
taken for noise that was misstated: only where noise is measured it is a finding."""
MEASURED = 1.5
"""The same where the noise is not only stated but measured; chosen: recordings of
nothing have 0.7 to 1.1."""
SCATTERED = 1.3
"""Variance of readings over that of their errors that is still taken for noise, where
it is measured; chosen: recordings of nothing have 0.6 to 1.13."""


@dataclass(frozen=True)
class DetectionTest:
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

    tested: MaxTResult
    candidates: int
    blocks: int
    places: tuple[str, ...]
    where: tuple[str, ...]
    dispersion: float
    poses: int
    scatter: Scatter

    @property
    def p_value(self) -> float:
        """Return the p-value: of any block, of overdispersed poses, or of outliers."""
        if not self.is_noise_known:
            return self.tested.p_value
        over = self.dispersion / self.scatter.dispersion_limit
        beyond = float(chi2.sf(self.poses * over, self.poses))
        beyond = min(beyond, self.scatter.p_value(self.scatter_limit))
        return min(self.tested.p_value, max(beyond, SMALLEST))

    @property
    def is_noise_known(self) -> bool:
        """Return whether more scatter than noise makes is a finding, law or none."""
        return self.scatter.dispersion_limit == MEASURED or self.poses < FEWEST_POSES

    @property
    def noise_ratio(self) -> float:
        """Return the noise that scatter along no law would be, over the present one.

        One where a law is found, one mark moves alone, or poses are few.
        """
        of_mark = self.is_overdispersed and self.scatter.marker is not None
        lawful = self.tested.p_value < SIGNIFICANCE
        if lawful or of_mark or self.poses < FEWEST_POSES:
            return 1.0
        return float(np.sqrt(max(self.scatter.dispersion, self.dispersion)))

    @property
    def scatter_limit(self) -> float:
        """Return the scatter of readings that is still taken for noise."""
        limit = self.scatter.dispersion_limit
        return SCATTERED if limit == MEASURED else limit

    @property
    def excess(self) -> float:
        """Return the whitened square that errors do not make: the map's, or all."""
        of_map = float(self.tested.captured[-1] - self.tested.degrees_of_freedom[-1])
        return max(of_map, self.scatter.excess) if self.is_overdispersed else of_map

    @property
    def is_overdispersed(self) -> bool:
        """Return whether readings surely scatter by more than known noise does."""
        if not self.is_noise_known:
            return False
        return self.scatter.p_value(self.scatter_limit) < SIGNIFICANCE

    @property
    def most_significant(self) -> int:
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
    normal_equations: NormalEquations,
    score: Float[np.ndarray, "poses columns"],
    known: Int[np.ndarray, " known"],
    poses: np.ndarray,
    seed: int,
    scatter: Scatter,
) -> DetectionTest:
    """Test every candidate and the map beyond known columns.

    Args:
        library: Candidates and map.
        normal_equations: Gram matrices of all columns.
        score: Of the data without what the known columns explain.
        known: Columns that may explain for free.
        poses: Mask of the poses to look at.
        seed: Of the random signs.
        scatter: Of the readings.
    """
    share = (
        np.bincount(normal_equations.fold[poses], minlength=len(normal_equations.gram))
        > 0
    )
    gram = normal_equations.gram[share].sum(axis=0)
    own = [block for c in library.candidates for block in c.columns]
    parts = [m.columns for m in library.map]
    places = tuple(dict.fromkeys(m.where for m in library.map))
    whole = [
        np.concatenate([m.columns for m in library.map if m.where == place])
        for place in places
    ]
    every: Sequence[np.ndarray] = [*own, *parts, *whole, np.concatenate(parts)]
    white = white_scores(gram, score[poses], known, every, normal_equations.raw)
    tested = combine_tests(
        sign_flip_test(white[: len(own)], seed),
        sign_flip_test(white[len(own) :], seed + 1),
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
    return DetectionTest(
        tested, len(own), len(parts), places, where, dispersion, count, scatter
    )
