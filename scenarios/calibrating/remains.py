"""What calibration leaves has a look of its own, and is said even without a name."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from scenarios.calibrating.proof import RESAMPLES, Proof, rms
from scenarios.diagnosing.units import label
from stiffness.calibration.calibrated import Calibrated
from stiffness.calibration.growing import growing
from stiffness.calibration.stance import Stance

FAR = np.radians(1.0)
"""An angle further than this from any that was fitted is new to a table; chosen: a
quarter of the shortest wave that matters."""
ALPHA = 0.005
"""Below this p-value something is left."""


@dataclass(frozen=True)
class Remains:
    """What is left on the poses kept back.

    Attributes:
        where: The place that it hangs on most.
        signature: How it looks, in words.
        p_value: Of its being noise: alike in neighbours, or more than was stated.
        new_angle: Rows where some axis stands at an angle that was not fitted.
        by_region: Of each region kept back: its number, rms in m, poses, share of new
            angles.
    """

    where: str
    signature: str
    p_value: float
    new_angle: Bool[np.ndarray, " rows"]
    by_region: tuple[tuple[int, float, int, float], ...]


def remains_of(found: Calibrated, proof: Proof) -> Remains:
    """Look at what is left."""
    held, readings = found.held, found.readings
    new, by_axis = _new_angles(found)
    left, region = proof.after, found.regions.region[held]
    rows = tuple(
        (
            int(r),
            rms(left[region == r]),
            int(np.sum(region == r)),
            float(new[region == r].mean()),
        )
        for r in found.regions.held
    )
    last = found.at_last
    common = np.sqrt(max(last.share, 0.0)) * last.rms
    words = []
    if last.p_value < ALPHA:
        words.append(
            f"neighbouring poses have {1e3 * common:.3f} mm rms in common and differ "
            f"by {1e3 * last.noise:.3f} mm: smooth in posture, not noise"
        )
    floor, beyond = _beyond_stated(found, left, region)
    if beyond < ALPHA:
        words.append(
            f"{1e3 * rms(left):.3f} mm are left where the stated noise leaves "
            f"{1e3 * floor:.3f} mm: something more, or more noise than is stated"
        )
    if new.any() and not new.all():
        words.append(
            f"{1e3 * rms(left[new]):.3f} mm where an axis stands at an angle that no "
            f"fitted pose had ({100 * new.mean():.0f} % of poses), "
            f"{1e3 * rms(left[~new]):.3f} mm elsewhere"
        )
    odd = [
        s
        for s in found.selected.steps
        if s.verdict == "out of bounds" and s.gain > 2.0 * s.error
    ]
    words += [
        f"{s.key[0]} at {s.key[1]} would help ({s.gain / s.error:.1f} standard errors) "
        f"with a {label(s.parameters[0])} beyond what such a mechanism can have: "
        "not named"
        for s in odd
    ]
    stance = Stance.of(readings, found.drawn)
    if grown := growing(stance, found.residual):
        words.append(
            f"{100 * grown.share:.0f} % of it grows with time as if {grown.where} "
            "changed its form, which no effect of the list does"
        )
    words = words or ["nothing beyond the noise shows on the poses kept back"]
    where = odd[0].key[1] if odd else _strongest(found, by_axis, readings.posture[held])
    where = grown.where if grown else where
    p_value = 0.0 if grown else min(last.p_value, beyond)
    return Remains(where, "; ".join(words) + ".", p_value, new, rows)


def _beyond_stated(found: Calibrated, left, region) -> tuple[float, float]:
    """Return what the stated noise leaves, in m, and the p-value of no more than that.

    The noise of what was fitted counts twice: poses kept back lie at the edge.
    """
    if not np.isfinite(found.readings.stated):
        return np.nan, 1.0
    square = 3.0 * found.readings.stated**2 * (1.0 + 2.0 * found.used)
    names, index = np.unique(region, return_inverse=True)
    count = np.bincount(index)
    sums = np.bincount(index, np.sum(left**2, axis=1))
    drawn = np.random.default_rng(0).integers(len(names), size=(RESAMPLES, len(names)))
    mean = sums[drawn].sum(axis=1) / count[drawn].sum(axis=1)
    p_value = (1 + np.sum(mean <= square)) / (1 + RESAMPLES)
    return float(np.sqrt(square)), float(p_value)


def _new_angles(found: Calibrated) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    held = found.held
    posture = found.readings.posture
    by_axis = {}
    for axis in found.tables:
        k = int(axis[1:]) - 1
        known = np.sort(posture[~held, k])
        angle = posture[held, k]
        at = np.clip(np.searchsorted(known, angle), 1, len(known) - 1)
        near = np.minimum(np.abs(angle - known[at - 1]), np.abs(angle - known[at]))
        by_axis[axis] = near > FAR
    some = np.zeros(int(held.sum()), dtype=bool)
    for new in by_axis.values():
        some |= new
    return some, by_axis


def _strongest(
    found: Calibrated,
    by_axis: dict[str, np.ndarray],
    posture: Float[np.ndarray, "rows axes"],
) -> str:
    """Return the axis whose angle sorts what is left best."""
    size = np.sum(found.residual[found.held] ** 2, axis=1)
    best, most = "flange", 0.0
    for k in range(posture.shape[1]):
        if np.ptp(posture[:, k]) == 0.0:
            continue
        edge = np.quantile(posture[:, k], np.linspace(0, 1, 13)[1:-1])
        part = np.searchsorted(edge, posture[:, k])
        means = np.array([size[part == b].mean() for b in np.unique(part)])
        if means.std() > most:
            best, most = f"a{k + 1}", float(means.std())
    return best
