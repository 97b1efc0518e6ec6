"""Outliers: readings of single marks far off, found by rigid bodies and by visits.

Marks of one body keep their distances and the volumes that they span:

==========  ==========================================================================
Equation    |y_i - y_j| and (y_j - y_i) x (y_k - y_i) . (y_l - y_i) of each row less
            their medians, over their own robust spread; in a row where one is large:
            the most marks that a rigid motion fits, and how far the others are from
            where these have them
Source      rigid registration: Kabsch 1976, "A solution for the best rotation to relate
            two sets of vectors", Acta Crystallographica A32, 922; spread: 1.4826 times
            the median absolute deviation (Huber 1981, "Robust statistics")
Valid       three marks of a body or more, not on a line; of relative readings, which
            show no distance, once they are counted from where the arm has the marks
Ignores     three marks: a shift out of their plane, which turns the body
==========  ==========================================================================

A mark that no other checks, or of which another may be off, stays near where the fitted
arm has it:

==========  ==========================================================================
Equation    |r - median of r over the visit|, r = reading less where it should be, over
            the same of nine in ten of the mark's readings; of absolute readings the
            median over all rows too
Source      as above
Valid       bodies with one or two marks
Ignores     what is not far beyond the largest that effects leave
==========  ==========================================================================

An outlier is left out, as if the mark had not been seen, and is listed. One
that is often far off is none: then the mark moves, and that is a finding.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float, Int

from bench.shared.recording import Recording
from stiffness.robot.kinematics import point_jacobian

OUTLIER_SIGMAS = 8.0
"""Robust sigmas from which a reading is one; chosen: normal noise is there once in
1e14 readings, a mark that slips stays there, and that is no outlier."""
CLOSE = 4.0
"""Robust sigmas within which the other marks of its body fit; chosen."""
RARE, FEW = 0.02, 2
"""Share of a mark's readings, and how many of them, up to which outliers are rare;
chosen: more are what the mark does."""
LEAST = 1e-7
"""Spread below which all is rounding, in m; chosen."""
NEAR, FAR = 0.9, 5.0
"""Quantile of a mark's residuals, and the multiple of it beyond which one is far off;
chosen: 12 sigma of normal noise."""
MOST_OUTLYING = 3
"""Most marks of a body that are left out in one row; chosen for time."""
SHOWN = 5
"""Outliers that are named in a sentence; the whole list is in the answer."""
CONSISTENT = 1.4826
"""Standard deviation of a normal law over its median absolute deviation."""


EVERY = "*"
"""Stands for all marks."""
ODD, OF_MOST, ODD_PART = 3.0, 0.8, 0.5
"""Multiple of a quantile of what a set leaves of poses from which one is odd; and part
of what it leaves of all that odd ones have. Chosen: where a tracker was bumped, rows
were exchanged or a reading repeated in 4 to 8 of 80 visits, these poses had 4 to 17
times the quantile and 88 to 99 % of what was left, and no other had over 1.8 times."""
LEAST_ODD, MOST_ODD, FEWEST_EVEN = 10.0, 0.1, 20
"""Least size over noise and largest share of odd poses, and poses that there are at
least; chosen: more are a group of their own, and fewer tell no quantile."""


@dataclass(frozen=True)
class Outlier:
    """A reading far off.

    Attributes:
        row: Of the recording.
        pose: Id of the pose.
        marker: The mark's name; `EVERY` for all marks of the row.
        size: How far it is from where the others have it, in m; of `EVERY`, from where
            the nominal arm has them.
    """

    row: int
    pose: int
    marker: str
    size: float


def outliers_of(
    recording: Recording,
    residual: Float[np.ndarray, "rows markers 3"] | None = None,
    point: Float[np.ndarray, "rows markers 3"] | None = None,
) -> tuple[Outlier, ...]:
    """Return the outliers of a recording, by rows.

    Args:
        recording: With markers, or without: then there are none.
        residual: Readings less where the fitted arm has them, in m; None where nothing
            is fitted yet: then marks of bodies with less than three of them are only
            compared with the other rows of their visit, and others of relative readings
            not at all.
        point: Where they are by the readings, along any axes, in m; None: as read.
    """
    if recording.points is None or not recording.markers:
        return ()
    found, fitted = np.zeros(recording.points.shape[:2]), residual is not None
    point = _rigid(recording) if point is None else point
    groups = [np.unique(recording.visit, return_inverse=True)[1]]
    if residual is None:
        residual = recording.points
    elif recording.displacement == "absolute":
        groups.append(np.zeros_like(groups[0]))
    for marks in markers_of_bodies(recording).values():
        if len(marks) <= 2:
            _of_visits(residual, groups, marks, found)
        elif point is not None:
            unsure = _of_body(point, marks, found)
            if fitted and len(unsure):
                far = np.zeros_like(found)
                _of_visits(residual, groups, marks, far)
                found[unsure] += far[unsure]
    return tuple(
        Outlier(
            int(row),
            int(recording.posture_id[row]),
            recording.markers[m].name,
            float(found[row, m]),
        )
        for row, m in np.argwhere(_rare(recording.points, found))
    )


def without_outliers(recording: Recording, outliers: Iterable[Outlier]) -> Recording:
    """Return a recording in which some readings were not seen."""
    outliers = tuple(outliers)
    if not outliers:
        return recording
    assert recording.points is not None
    index = {marker.name: m for m, marker in enumerate(recording.markers)}
    points = recording.points.copy()
    for outlier in outliers:
        mark = slice(None) if outlier.marker == EVERY else index[outlier.marker]
        points[outlier.row, mark] = np.nan
    return replace(recording, points=points)


def spread_of_bodies(recording: Recording) -> float | None:
    """Return one sigma of a coordinate by distances between marks of one body, in m.

    None where no body has three marks that were measured separately, and of relative
    readings.
    """
    points = _rigid(recording)
    if points is None:
        return None
    alone = {m for m, k in enumerate(recording.markers) if k.target is None}
    found = [
        _odd_rows(points[:, marks])[1]
        for marks in markers_of_bodies(recording).values()
        if len(marks) > 2 and alone.issuperset(marks)
    ]
    return float(np.median(found)) if found else None


def outlier_text(found: Sequence[Outlier]) -> str:
    """Say how many readings were left out, and name the worst."""
    largest = sorted(found, key=lambda o: -o.size)
    shown = [f"{o.marker} in pose {o.pose} by {1e3 * o.size:.3g} mm" for o in largest]
    more = f" and {len(found) - SHOWN} more" if len(found) > SHOWN else ""
    are = "reading was" if len(found) == 1 else "readings were"
    return f"{len(found)} outlying {are} left out: {', '.join(shown[:SHOWN])}{more}."


def _rigid(recording: Recording) -> Float[np.ndarray, "rows markers 3"] | None:
    """Return readings between which distances are those of bodies; None: none are."""
    return recording.points if recording.displacement == "absolute" else None


def markers_of_bodies(recording: Recording) -> dict[str, list[int]]:
    """Return the markers that are said to be on each body."""
    bodies: dict[str, list[int]] = {}
    for m, marker in enumerate(recording.markers):
        bodies.setdefault(marker.body, []).append(m)
    return bodies


def _rare(points: np.ndarray, found: np.ndarray) -> Bool[np.ndarray, "rows markers"]:
    """Return which readings are outliers, of marks that seldom are."""
    outlying = found > 0.0
    seen = np.isfinite(points).all(axis=2).sum(axis=0)
    return outlying & (outlying.sum(axis=0) <= np.maximum(RARE * seen, FEW))


# --- Marks of a rigid body ------------------------------------------------------------


def _of_body(
    points: np.ndarray, marks: list[int], found: np.ndarray
) -> Int[np.ndarray, " unsure"]:
    """Note the sizes of outliers of a body's marks in `found`.

    Returns:
        The rows in which some mark is one, and which is not to be told.
    """
    y = points[:, marks]
    odd, sigma = _odd_rows(y)
    place = _shape(y, odd)
    if place is None:
        return odd
    for row in odd:
        for m, size in _outlying_marks(y[row], place, sigma):
            found[row, marks[m]] = size
    return odd[~np.any(found[odd][:, marks] > 0.0, axis=1)]


def _odd_rows(y: Float[np.ndarray, "rows marks 3"]) -> tuple[np.ndarray, float]:
    """Return rows in which a body is not what it is, and one sigma of a coordinate."""
    count = y.shape[1]
    pairs = _combinations(count, 2)
    apart = [np.linalg.norm(y[:, i] - y[:, j], axis=1) for i, j in pairs]
    spreads = [_spread(values) for values in apart]
    known = [s for s in spreads if np.isfinite(s)]
    if not known:
        return np.zeros(0, dtype=int), LEAST
    sigma = max(float(np.median(known)) / np.sqrt(2.0), LEAST)
    odd = np.zeros(len(y), dtype=bool)
    for values, spread in zip(apart, spreads, strict=True):
        odd |= _beyond(values, max(spread, sigma))
    for i, j, k, m in _combinations(count, 4):
        a, b, c = (y[:, n] - y[:, i] for n in (j, k, m))
        volume = np.einsum("ri,ri->r", np.cross(a, b), c)
        odd |= _beyond(volume, _spread(volume))
    return np.flatnonzero(odd), sigma


def _combinations(count: int, size: int) -> list[tuple[int, ...]]:
    """Return sets of marks, few of four of them where there are many marks."""
    sets = list(combinations(range(count), size))
    return sets if size == 2 else [s for s in sets if s[:3] == (0, 1, 2)]


def _spread(values: np.ndarray) -> float:
    seen = values[np.isfinite(values)]
    if not len(seen):
        return np.nan
    return CONSISTENT * float(np.median(np.abs(seen - np.median(seen))))


def _beyond(values: np.ndarray, spread: float) -> Bool[np.ndarray, " rows"]:
    if not np.isfinite(values).any():
        return np.zeros(len(values), dtype=bool)
    off = np.abs(values - np.nanmedian(values))
    return np.nan_to_num(off) > CLOSE * spread + 1e-12


def _shape(y: np.ndarray, odd: np.ndarray) -> Float[np.ndarray, "marks 3"] | None:
    """Return where the marks are on their body, of rows in which all are as usual."""
    rows = np.setdiff1d(np.flatnonzero(np.isfinite(y).all(axis=(1, 2))), odd)
    if not len(rows):
        return None
    place = y[rows[0]]
    for _ in range(2):
        moved = np.stack([_onto(y[r], place) for r in rows[:: len(rows) // 50 + 1]])
        place = np.median(moved, axis=0)
    return place


def _onto(points: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Return points moved rigidly, as near to places as may be."""
    turn, middle, centre = _registered(points, place)
    return (points - middle) @ turn.T + centre


def _registered(
    points: np.ndarray, place: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    middle, centre = points.mean(axis=0), place.mean(axis=0)
    u, _, v = np.linalg.svd((place - centre).T @ (points - middle))
    return u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v, middle, centre


def _outlying_marks(
    y: Float[np.ndarray, "marks 3"], place: Float[np.ndarray, "marks 3"], sigma: float
) -> list[tuple[int, float]]:
    """Return which marks are outliers in one row, and how far off, in m."""
    seen = [m for m in range(len(y)) if np.isfinite(y[m]).all()]
    some = _consistent(y, place, seen, sigma)
    found: list[tuple[int, float]] = []
    for m in (m for m in seen if m not in some):
        turn, middle, centre = _registered(place[some], y[some])
        off = (place[m] - middle) @ turn.T + centre - y[m]
        size, error = float(np.linalg.norm(off)), off @ _precision(y, m, some) @ off
        if len(some) == 2:
            size = float(np.abs(_distances(y, place, m, some)).max())
            error = size**2
        if error > (OUTLIER_SIGMAS * sigma) ** 2:
            found.append((m, size))
    return found


def _consistent(
    y: np.ndarray, place: np.ndarray, seen: list[int], sigma: float
) -> list[int]:
    """Return the most marks that move as one body; all of them where none are clear."""
    for count in range(len(seen), max(1, len(seen) - MOST_OUTLYING - 1), -1):
        sets = [list(some) for some in combinations(seen, count)]
        fits = [_distance_errors(y, place, some) for some in sets]
        best = int(np.argmin(fits))
        if fits[best] <= CLOSE * sigma and (count > 2 or _clear(fits, best)):
            return sets[best]
    return seen


def _precision(
    y: Float[np.ndarray, "marks 3"], mark: int, others: list[int]
) -> Float[np.ndarray, "3 3"]:
    """Return the inverse covariance of a mark's misfit, for readings of sigma one.

    Where marks lie nearly on a line, the body that they show may turn about it.
    """
    lever = point_jacobian(y - y[others].mean(axis=0))
    moved = lever[others].reshape(-1, 6)
    back = np.linalg.pinv(moved.T @ moved, rcond=LEAST, hermitian=True)
    return np.linalg.inv(np.eye(3) + lever[mark] @ back @ lever[mark].T)


def _clear(fits: list[float], best: int) -> bool:
    """Return whether one pair of marks keeps its distance and no other does."""
    rest = min((fit for at, fit in enumerate(fits) if at != best), default=np.inf)
    return fits[best] < rest / 2.0


def _distance_errors(y: np.ndarray, place: np.ndarray, some: list[int]) -> float:
    """Return the largest misfit of marks that move rigidly, in m."""
    off = _onto(y[some], place[some]) - place[some]
    return float(np.linalg.norm(off, axis=1).max())


def _distances(
    y: np.ndarray, place: np.ndarray, mark: int, others: list[int]
) -> Float[np.ndarray, " others"]:
    """Return by how much a mark's distances differ, in m."""
    seen = np.linalg.norm(y[others] - y[mark], axis=1)
    return seen - np.linalg.norm(place[others] - place[mark], axis=1)


# --- Marks that no other checks -------------------------------------------------------


def _of_visits(
    residual: Float[np.ndarray, "rows markers 3"],
    groups: Sequence[Int[np.ndarray, " rows"]],
    marks: list[int],
    found: np.ndarray,
) -> None:
    """Note the sizes of readings far from where a mark is in other rows of a group."""
    for m in marks:
        for group in groups:
            size = _from_median(residual[:, m], group)
            far = far_off(size)
            found[far, m] = size[far]


def far_off(size: Float[np.ndarray, " rows"]) -> Bool[np.ndarray, " rows"]:
    """Return which sizes are far beyond those of nearly all; NaN is none."""
    seen = size[np.isfinite(size)]
    if not len(seen):
        return np.zeros(len(size), dtype=bool)
    most = max(FAR * float(np.quantile(seen, NEAR)), LEAST)
    far: Bool[np.ndarray, " rows"] = np.nan_to_num(size) > most
    return far


def _from_median(
    values: Float[np.ndarray, "rows 3"], group: Int[np.ndarray, " rows"]
) -> Float[np.ndarray, " rows"]:
    """Return distances from the medians of groups with three readings or more."""
    away = np.full(len(values), np.nan)
    seen = np.isfinite(values).all(axis=1)
    order = np.flatnonzero(seen)[np.argsort(group[seen], kind="stable")]
    for rows in np.split(order, np.flatnonzero(np.diff(group[order])) + 1):
        if len(rows) > 2:
            middle = np.median(values[rows], axis=0)
            away[rows] = np.linalg.norm(values[rows] - middle, axis=1)
    return away


# --- Poses that follow nothing that others do -----------------------------------------


def odd_poses(
    square: Float[np.ndarray, " poses"], readings: Float[np.ndarray, " poses"]
) -> Bool[np.ndarray, " poses"]:
    """Return which poses a set misses far more than nearly all others.

    Args:
        square: Whitened square of each pose that a set leaves, beyond noise.
        readings: How many of marks each has.
    """
    square = np.maximum(square, 0.0)
    size = np.sqrt(square / np.maximum(readings, 1))
    if np.sum(readings > 0) < FEWEST_EVEN:
        return np.zeros(len(size), dtype=bool)
    limit = ODD * float(np.quantile(size[readings > 0], OF_MOST))
    odd: Bool[np.ndarray, " poses"] = (size > limit) & (square > LEAST_ODD**2)
    part = float(np.sum(square[odd])) / max(float(np.sum(square)), 1e-300)
    return odd & (part >= ODD_PART) & (np.mean(odd) <= MOST_ODD)


def outliers_at(
    recording: Recording, odd: Iterable[int], residual: Float[np.ndarray, "rows _ 3"]
) -> tuple[Outlier, ...]:
    """Return all readings of some poses as outliers, one a row.

    Args:
        recording: With markers.
        odd: Ids of the poses.
        residual: How far each reading is from where the nominal arm has it, in m.
    """
    pose, square = recording.posture_id, np.sum(residual**2, axis=2)
    seen = np.isfinite(square).sum(axis=1)
    size = np.sqrt(np.nansum(square, axis=1) / np.maximum(seen, 1))
    rows = np.flatnonzero(np.isin(pose, [*odd]) & (seen > 0))
    return tuple(
        Outlier(int(row), int(pose[row]), EVERY, float(size[row])) for row in rows
    )


def odd_text(found: Sequence[Outlier]) -> str:
    """Say which poses were left out whole."""
    poses = sorted({o.pose for o in found})
    shown = ", ".join(map(str, poses[:SHOWN]))
    more = f" and {len(poses) - SHOWN} more" if len(poses) > SHOWN else ""
    are = "pose was" if len(poses) == 1 else "poses were"
    return (
        f"{len(poses)} {are} left out ({shown}{more}), of which what explains all "
        "others leaves far more. Was the tracker bumped there, were rows exchanged, or "
        "was a reading or a load written down twice?"
    )
