"""What is left may grow with time in one link alone, as a link does that warms up.

==========  ==========================================================================
Equation    y = residual, A = drawing, frame and places, and frame and places times
            time, B = one place's numbers times time; share = |P_B y|² / |y|² with A
            projected out of both; p by F, times the number of places
Source      Frisch, Waugh 1933 (what is projected out); Bonferroni
Valid       changes that are small and go one way
Ignores     that readings of one pose err together: hence a share is asked for too
==========  ==========================================================================
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.stats import f as fisher

from stiffness.calibration.geometry import entries_of
from stiffness.calibration.stance import Stance

LEAST, ALPHA = 0.05, 1e-3
"""Share of what is left that has to grow, and its p-value; chosen."""
FAINT = 1e-8
"""Singular value, of the largest, below which columns are the same."""


@dataclass(frozen=True)
class Growing:
    """A place whose numbers change with time.

    Attributes:
        where: An axis or a link.
        share: Of what is left.
    """

    where: str
    share: float


def growing(stance: Stance, residual: Float[np.ndarray, "rows 3"]) -> Growing | None:
    """Return the place that explains most of what is left by changing with time."""
    hours = stance.readings.hours[:, None, None]
    every, rows = stance.silent(), residual.size
    entries = entries_of(stance.standing.chain)
    known = [every, every[:, :, len(entries) :] * hours]
    base = _basis(np.concatenate(known, axis=2).reshape(rows, -1))
    left = residual.ravel() - base @ (base.T @ residual.ravel())
    total, places = float(left @ left), {e.where for e in entries}
    best: Growing | None = None
    for where in sorted(places):
        own = [j for j, e in enumerate(entries) if e.where == where]
        a = (every[:, :, own] * hours).reshape(rows, -1)
        size = float(np.linalg.norm(a))
        a = a - base @ (base.T @ a)
        if np.linalg.norm(a) <= 1e-6 * size:  # no time went by, or it is the frame's
            continue
        basis = _basis(a)
        count, square = basis.shape[1], float(np.sum((basis.T @ left) ** 2))
        rest = rows - base.shape[1] - count
        if rest < 1 or square <= (best.share if best else LEAST) * total:
            continue
        ratio = square / count / ((total - square) / rest)
        if fisher.sf(ratio, count, rest) * len(places) < ALPHA:
            best = Growing(where, square / total)
    return best


def _basis(a: Float[np.ndarray, "n columns"]) -> np.ndarray:
    """Return orthonormal columns that span the same."""
    size = np.linalg.norm(a, axis=0)
    u, s, _ = np.linalg.svd(a / np.where(size > 0.0, size, 1.0), full_matrices=False)
    return u[:, s > FAINT * max(s[0], 1e-300)]
