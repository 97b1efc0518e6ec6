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


@dataclass(frozen=True)
class HeldOut:
    """3-D rms of a reading over the poses held out, of the fitted nominal arm.

    Attributes:
        within: Of differences within visits, each marker's mean taken off, in m.
        whole: With what means of visits leave; NaN where they are not compared.
    """

    within: float
    whole: float


def held_out_misfit(prepared: Prepared, case: Case) -> HeldOut:
    """Return how far the fitted nominal arm misses the poses held out; NaN without.

    Args:
        prepared: The recording against its nominal model.
        case: The same with springs as the readings have them.
    """
    rows = case.split.held_out[prepared.data.visits.pose]
    apart, seen = _apart(prepared, case)
    count = int(seen[rows].sum())
    if not count:
        return HeldOut(np.nan, np.nan)
    square, whole = float(np.sum(apart[rows] ** 2)) / count, np.nan
    between = case.data.between
    if between is not None:
        left, shown = _left_of_means(between)
        if shown[rows].any():
            means = np.sum(left[rows][shown[rows]] ** 2, axis=1)
            whole = float(np.sqrt(square + np.mean(means)))
    return HeldOut(float(np.sqrt(square)), whole)


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
    apart, seen = _apart(prepared, case)
    freedom = int(np.maximum(seen.sum(axis=1) - 1, 0).sum())
    if not freedom:
        return 0.0, 0.0
    one = np.trace(np.linalg.inv(prepared.readings.inverse))
    share = np.broadcast_to(shares_of(prepared.situation.recording), seen.shape)
    by_noise = one * np.mean(share[seen] / _weight(prepared)[seen])
    return float(np.sum(apart**2)) / freedom, float(by_noise)


def _apart(
    prepared: Prepared, case: Case
) -> tuple[
    Float[np.ndarray, "visits longest markers 3"],
    Bool[np.ndarray, "visits longest markers"],
]:
    """Return residuals less their mean over each visit, and which were seen."""
    left = np.nan_to_num(prepared.readings.value) - _softer(prepared, case)
    seen = _weight(prepared) > 0
    values = np.where(seen[..., None], prepared.data.visits.gather(left), 0.0)
    mean = values.sum(axis=1) / np.maximum(seen.sum(axis=1), 1)[..., None]
    return np.where(seen[..., None], values - mean[:, None], 0.0), seen


def _weight(prepared: Prepared) -> Float[np.ndarray, "visits longest markers"]:
    visits = prepared.data.visits
    return visits.gather(prepared.readings.weight) * visits.counts[..., None]


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
    left, seen = _left_of_means(between)
    rms = np.mean(np.sum(left[seen] ** 2, axis=1))
    undone = np.linalg.pinv(between.roots.half, hermitian=True)
    own = share * np.sum(undone**2, axis=(2, 3))
    return float(rms), float(np.mean(own[seen]))


def _left_of_means(
    between: Between,
) -> tuple[Float[np.ndarray, "visits markers 3"], Bool[np.ndarray, "visits markers"]]:
    """Return what means of visits leave, in m, and which markers were seen."""
    roots = between.roots
    seen: Bool[np.ndarray, "visits markers"] = np.any(roots.half != 0.0, axis=(2, 3))
    undone = np.linalg.pinv(roots.half, hermitian=True)
    longer = np.sqrt(1.0 + roots.size) - 1.0
    along = longer[..., None] * (roots.error.swapaxes(1, 2) @ between.residual)
    white = (between.residual + roots.error @ along).reshape(*seen.shape, 3, 1)
    return (undone @ white)[..., 0], seen
