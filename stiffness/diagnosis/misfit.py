"""How far readings miss the fitted nominal arm, and how far noise alone would.

==========  ==========================================================================
Equation    rms^2 = sum |d - mean d|^2 / (readings - visits) + mean |m|^2, d what rows
            of a visit leave of a marker, m what its visits' means leave; by noise:
            mean tr S / frames + mean tr D^-1, S of one frame, D of `Roots`
Source      definition; the two are orthogonal parts of the same readings
Valid       markers that were seen
Ignores     what the fit of the nominal takes of the noise; how axes return and the
            wrench errs
==========  ==========================================================================
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from stiffness.diagnosis.between import Between
from stiffness.diagnosis.case import Case
from stiffness.diagnosis.prepare import Prepared
from stiffness.diagnosis.readings import shares_of
from stiffness.diagnosis.signature import levers


@dataclass(frozen=True)
class Misfit:
    """3-D rms of a reading.

    Attributes:
        rms: What the fitted nominal arm leaves, in m.
        noise: What the tracker's errors alone would leave, in m.
    """

    rms: float
    noise: float


def misfit_of(prepared: Prepared, case: Case) -> Misfit:
    """Return how far readings miss the arm with its springs as they were fitted.

    Args:
        prepared: The recording against its nominal model.
        case: The same with springs as the readings have them.
    """
    rms, noise = _within(prepared, case)
    if case.data.between is not None:
        share = shares_of(prepared.situation.recording)
        more, by_noise = _between(case.data.between, share)
        rms, noise = rms + more, noise + by_noise
    return Misfit(float(np.sqrt(rms)), float(np.sqrt(noise)))


def _within(prepared: Prepared, case: Case) -> tuple[float, float]:
    """Return mean squares of differences within visits, and by noise; 0 without."""
    readings, visits = prepared.readings, prepared.data.visits
    left = np.nan_to_num(readings.value) - _softer(prepared, case)
    weight = visits.gather(readings.weight) * visits.counts[..., None]
    seen = weight > 0
    count = seen.sum(axis=1)
    freedom = int(np.maximum(count - 1, 0).sum())
    if not freedom:
        return 0.0, 0.0
    values = np.where(seen[..., None], visits.gather(left), 0.0)
    mean = values.sum(axis=1) / np.maximum(count, 1)[..., None]
    apart = np.where(seen[..., None], values - mean[:, None], 0.0)
    one = np.trace(np.linalg.inv(readings.inverse))
    share = np.broadcast_to(shares_of(prepared.situation.recording), seen.shape)
    by_noise = one * np.mean(share[seen] / weight[seen])
    return float(np.sum(apart**2)) / freedom, float(by_noise)


def _softer(prepared: Prepared, case: Case) -> Float[np.ndarray, "rows markers 3"]:
    """Return how markers move as springs are not those that were prepared."""
    situation = prepared.situation
    change = case.situation.compliance - situation.compliance
    twist = situation.screw * (situation.torque * change)[..., None]
    carried = situation.carried[1:, prepared.readings.body].astype(float)
    expected = np.nan_to_num(prepared.readings.point - prepared.readings.value)
    of_marker = np.einsum("rki,km->rmi", twist, carried)
    return np.einsum("rmij,rmj->rmi", levers(expected), of_marker)


def _between(
    between: Between, share: Float[np.ndarray, " markers"]
) -> tuple[float, float]:
    """Return mean squares of what means of visits leave, and by noise."""
    roots = between.roots
    seen: Bool[np.ndarray, "visits markers"] = np.any(roots.half != 0.0, axis=(2, 3))
    undone = np.linalg.pinv(roots.half, hermitian=True)
    longer = np.sqrt(1.0 + roots.size) - 1.0
    along = longer[..., None] * (roots.error.swapaxes(1, 2) @ between.residual)
    white = (between.residual + roots.error @ along).reshape(*seen.shape, 3, 1)
    left = (undone @ white)[..., 0]
    rms = np.mean(np.sum(left[seen] ** 2, axis=1))
    own = share * np.sum(undone**2, axis=(2, 3))
    return float(rms), float(np.mean(own[seen]))
