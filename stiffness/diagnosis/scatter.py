"""What no law explains still shows: readings scatter by more than their errors.

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
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int
from scipy.stats import norm

from stiffness.diagnosis.data import Data

WITNESSES = 2
"""Other markers of a body that tell which one moves; chosen: three of them."""
FEWEST = 20
"""Poses from which scatter is judged; chosen."""


@dataclass(frozen=True)
class Scatter:
    """How readings scatter once everything known is taken off.

    Attributes:
        dispersion: Variance over that of the errors.
        error: Its standard error over poses.
        excess: Whitened square beyond the errors.
        wild: Dispersion of poses along laws up to which errors may be misstated.
        markers: The same of each marker's means alone; empty where there are none.
        witnesses: How many other markers a marker's body has.
    """

    dispersion: float
    error: float
    excess: float
    wild: float
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


def scatter_of(data: Data, wild: float) -> Scatter:
    """Return how readings scatter, of both blocks the one that does more.

    Args:
        data: What is left.
        wild: Dispersion of poses along laws up to which errors may be misstated.
    """
    pose, within = data.visits.pose, data.within
    found = _of(pose, within.square, within.freedom, wild)
    if data.between is None:
        return found
    between = data.between
    seen = np.any(between.roots.half != 0.0, axis=(2, 3))  # (visits, markers)
    square = np.sum(between.residual.reshape(*seen.shape, 3) ** 2, axis=2)
    share = max(1.0 - data.unknowns / max(3.0 * seen.sum(), 1.0), 0.0)
    freedom = 3.0 * share * seen
    body = np.unique(between.carries, axis=1, return_inverse=True)[1].ravel()
    others = np.bincount(body)[body] - 1
    markers = tuple(
        replace(_of(pose, s, f, wild), witnesses=int(n))
        for s, f, n in zip(square.T, freedom.T, others, strict=True)
    )
    means = _of(pose, square.sum(axis=1), freedom.sum(axis=1), wild)
    return replace(max(found, means, key=lambda s: s.dispersion), markers=markers)


def _of(
    pose: Int[np.ndarray, " visits"],
    square: Float[np.ndarray, " visits"],
    freedom: Float[np.ndarray, " visits"],
    wild: float,
) -> Scatter:
    one, free = np.bincount(pose, square), np.bincount(pose, freedom)
    one, free = one[free > 0.0], free[free > 0.0]
    if len(one) < FEWEST:
        return Scatter(0.0, 1.0, 0.0, wild)
    ratio = float(one.sum() / free.sum())
    error = float(np.linalg.norm(one - ratio * free) / free.sum())
    return Scatter(ratio, error, max(float(one.sum() - free.sum()), 0.0), wild)
