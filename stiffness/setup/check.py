"""Set-up errors: angles read otherwise, odd units, swapped markers, wrong loads.

A marker's column of another size than its neighbours' is in another unit.

==========  ==========================================================================
Equation    rms of a marker's misfit, its columns as written, and times 1000 or 1/1000
Source      enumeration; a wrong unit moves a marker by its way, physics by a hundredth
Valid       absolute readings; columns whose range is thirty times off the arm's
Ignores     units that are wrong in all columns, which are told as one mistake
==========  ==========================================================================

Markers of one body whose names were mixed up stand where the others should.

==========  ==========================================================================
Equation    min over permutations s of sum_m |inside_m - place_s(m)|^2, body by body
            and visit by visit; inside = R_b^T (R y + t - o_b), place = stated, or the
            median over visits
Source      assignment: Kuhn 1955, "The Hungarian method for the assignment problem"
Valid       absolute readings; markers farther apart than the arm is wrong
Ignores     markers that changed their body; places that nobody stated, mixed up in more
            than half of the visits: then the names are as good
==========  ==========================================================================

An axis counted the wrong way round is no effect of physics but a mistake of set-up.

==========  ==========================================================================
Equation    rms of a rigid fit of frame and places, under each reading of the files:
            as they are, an axis reversed, two swapped, one counted against another, a
            zero shifted, mirrored, other units, markers on another body …
Source      enumeration; a mistake moves markers by a tenth of the reach, physics by a
            hundredth at most
Valid       absolute readings; relative ones are tested by the loads, in `loads`
Ignores     three mistakes at once, unless all are reversed axes
==========  ==========================================================================
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product

import numpy as np
from scipy.optimize import linear_sum_assignment
from threadpoolctl import threadpool_limits

from bench.shared.errors import Warned
from bench.shared.recording import Marker, Recording
from stiffness.experiment.outliers import (
    markers_of_bodies,
    outliers_of,
    without_outliers,
)
from stiffness.robot.arm import Arm
from stiffness.robot.tracker_frame import (
    MARKER_POSITION_SIGMA,
    STEPS,
    TrackerFit,
    TrackerObservations,
    extent_of,
    fit_tracker_frame,
    fit_tracker_frame_once,
)
from stiffness.setup.alternatives import (
    Angles,
    best_shift,
    detect_column_errors,
    less_is_stated,
    of_angles,
    of_sight,
    of_signs,
)
from stiffness.setup.loads import (
    ends_of_bodies,
    load_setup_errors,
    some_visits,
)

# --- Errors of set-up -----------------------------------------------------------------

GROSS = 0.03
"""Rigid misfit over the extent that no arm's own errors make; chosen: ten times an
uncalibrated arm's (1.2 mm rms, 3 mm at most, Slamani 2012)."""
BETTER = 3.0
"""Factor by which another reading of the files must fit better; chosen: what bends and
sags stays in every reading, and is a few millimetres at most."""


# --- Unit errors of a marker ----------------------------------------------------------

OFF = 30.0
"""Factor between the ranges of a column and of the arm from which a unit is doubted;
chosen: the root of the thousand between m and mm."""
SMALL = 0.003
"""Misfit over the arm's range below which a marker is where it should be; chosen: a
tenth of the gross one, what a badly calibrated arm has."""
RANGE_QUANTILES = (0.05, 0.95)
"""Quantiles between which a column's range is taken: a glint has no say; chosen."""
VISITS_FOR_UNITS = 30
"""Visits that this looks at; chosen for time."""
UNITS = ((1e3, "m where mm are expected"), (1e-3, "mm where m are expected"))


def detect_unit_errors(recording: Recording, arm: Arm) -> tuple[Warned, ...]:
    """Name the columns of markers that are in another unit than the rest.

    Args:
        recording: With absolute markers.
        arm: The nominal arm, with the recording's names.
    """
    some = some_visits(recording, VISITS_FOR_UNITS)
    observed = TrackerObservations.of(arm, some, some.posture)
    seen = np.isfinite(observed.y).all(axis=2).sum(axis=0) > 1
    if not seen.any():  # one visit has no range
        return ()
    moves = np.linalg.norm(np.ptp(observed.origin, axis=0), axis=1)
    way = float(moves.max())
    ranges = np.full(observed.marker_positions.shape, np.nan)
    ranges[seen] = np.ptp(
        np.nanquantile(observed.y[:, seen], RANGE_QUANTILES, axis=0), axis=0
    )
    moving = seen & (moves > way / OFF)
    found: dict[int, tuple[str, float, tuple[int, ...]]] = {}
    for factor, words in UNITS:
        odd = ranges > OFF * way if factor < 1.0 else ranges < way / OFF
        odd &= factor * ranges < OFF * way
        whole = odd[seen].all() or 1 < moving.sum() < 2 * odd[moving].any(axis=1).sum()
        left = [] if whole else np.flatnonzero(odd.any(axis=1)).tolist()
        again = True
        while again:  # the frame fits better with each column that is put right
            again = False
            frames = fit_tracker_frame_once(observed)[0]
            left = [m for m in left if _away(observed, m, frames) > SMALL * way]
            for m in [m for m in left if m not in found]:
                columns = _better(observed, m, np.flatnonzero(odd[m]), factor, way)
                if columns:
                    observed = _scaled(observed, m, columns, factor)
                    found[m], again = (words, factor, columns), True
    return tuple(_unit_warning(recording, m, *found[m]) for m in sorted(found))


def _unit_warning(
    recording: Recording, m: int, words: str, factor: float, columns: tuple[int, ...]
) -> Warned:
    name = recording.markers[m].name
    listed = ", ".join(f"{name}_{'xyz'[c]}_mm" for c in columns)
    text = (
        f"{listed}: given in {words}, as it looks, unlike the others; fits times "
        f"{factor:g}. Check the unit in the mapping or the file."
    )
    return Warned("units", "tracker", text)


def _scaled(
    observed: TrackerObservations, m: int, columns: tuple[int, ...], factor: float
) -> TrackerObservations:
    y = observed.y.copy()
    y[:, m, list(columns)] *= factor
    return replace(observed, y=y)


def _better(
    observed: TrackerObservations, m: int, odd: np.ndarray, factor: float, way: float
) -> tuple[int, ...]:
    """Return which of a marker's odd columns fit in the other unit; none: ()."""
    before, best, answer = _marker_residual_rms(observed, m), np.inf, ()
    for columns in _subsets(odd.tolist()):
        left = _marker_residual_rms(_scaled(observed, m, columns, factor), m)
        if left < min(best, before / BETTER, GROSS * way):
            best, answer = left, columns
    return answer


def _subsets(odd: list[int]) -> Iterator[tuple[int, ...]]:
    for count in range(1, len(odd) + 1):
        yield from combinations(odd, count)


def _marker_residual_rms(observed: TrackerObservations, m: int) -> float:
    """Return the rms misfit of one marker, all frames fitted anew, in m."""
    return _away(observed, m, fit_tracker_frame_once(observed)[0])


def _away(observed: TrackerObservations, m: int, frames: TrackerFit) -> float:
    """Return the rms misfit of one marker, its own place free if unknown, in m."""
    seen = np.isfinite(observed.y[:, m]).all(axis=1)
    point = (
        observed.y[seen, m] @ frames.turn.T + frames.shift - observed.origin[seen, m]
    )
    inside = np.einsum("vji,vj->vi", observed.turned[seen, m], point)
    away = inside - (
        observed.marker_positions[m] if observed.given[m] else np.median(inside, axis=0)
    )
    return float(np.sqrt(np.mean(np.sum(away**2, axis=1))))


# --- Swapped markers ------------------------------------------------------------------

SWAP_BETTER = 5.0
"""Factor by which a visit's markers must fit better with other names; chosen."""
TWICE = 2
"""Visits in which the same names are mixed up, from which it is said; chosen: one may
be a glint."""
MANY = 1500
"""Visits that this looks at; chosen for time."""
SHOWN = 5
"""Visits that are named; chosen."""


@dataclass(frozen=True)
class Mixed:
    """Markers of one body whose names were mixed up.

    Attributes:
        warned: What to say.
        is_unambiguous: Whether no turn of the body and no mirror would look alike.
    """

    warned: Warned
    is_unambiguous: bool


def detect_swapped_markers(recording: Recording, arm: Arm) -> tuple[Mixed, ...]:
    """Say which markers of a body were mixed up, and when.

    Args:
        recording: With absolute markers.
        arm: The nominal arm, with the recording's names.
    """
    _, every = np.unique(recording.visit, return_index=True)
    first = every[:: -(-len(every) // MANY)]
    looked_at = "" if len(first) == len(every) else " looked at"
    observed = TrackerObservations.of(
        arm, recording.take(first), recording.posture[first]
    )
    told = []
    inside = _inside(observed)
    for own in markers_of_bodies(recording).values():
        for order, visits in _orders(inside, observed, own).items():
            if len(visits) < TWICE:
                continue
            right = _renamed(observed, visits, order)
            moved = [m for m, n in enumerate(order) if m != n]
            before = _off(inside, observed, moved)[visits]
            after = _off(_inside(right), right, moved)[visits]
            if np.median(after) < np.median(before) / SWAP_BETTER:
                some = len(visits) < len(first)
                warned = _swap_warning(
                    recording,
                    order,
                    moved,
                    first[visits],
                    f"{len(first)} visits{looked_at}" if some else "",
                )
                clear = some or len(own) > len(moved) == 2
                told.append(Mixed(warned, clear and not _mirrored(observed, right)))
    return tuple(told)


def _mirrored(observed: TrackerObservations, renamed: TrackerObservations) -> bool:
    """Return whether a mirrored tracker fits better than other names do."""
    after = _rigid_residual_rms(renamed, ROUGH)
    return any(
        _rigid_residual_rms(other.meant(observed), ROUGH) < after
        for other in of_sight(observed)
        if other.warned.code == "mirrored"
    )


def _inside(observed: TrackerObservations) -> np.ndarray:
    """Return where each marker is in its body, (visits, markers, 3), NaN unseen."""
    frames, _ = fit_tracker_frame_once(observed)
    point = observed.y @ frames.turn.T + frames.shift - observed.origin
    return np.einsum("vmji,vmj->vmi", observed.turned, point)


def _places(inside: np.ndarray, observed: TrackerObservations) -> np.ndarray:
    seen = np.isfinite(inside).any(axis=(0, 2))
    middle = np.full(observed.marker_positions.shape, np.nan)
    middle[seen] = np.nanmedian(inside[:, seen], axis=0)
    return np.where(observed.given[:, None], observed.marker_positions, middle)


def _off(
    inside: np.ndarray, observed: TrackerObservations, some: list[int]
) -> np.ndarray:
    """Return how far some markers are from their places, rms, visit by visit."""
    away = (inside - _places(inside, observed))[:, some]
    return np.sqrt(np.mean(np.sum(away**2, axis=2), axis=1))


def _orders(
    inside: np.ndarray, observed: TrackerObservations, own: list[int]
) -> dict[tuple[int, ...], np.ndarray]:
    """Return the orders in which a body's markers fit better, and in which visits."""
    places = _places(inside, observed)[own]
    away = inside[:, own, None] - places[None, None]
    cost = np.sum(away**2, axis=3)  # (visits, seen, meant)
    straight = np.arange(len(own))
    visits: dict[tuple[int, ...], list[int]] = {}
    for v in np.flatnonzero(np.isfinite(cost).all(axis=(1, 2))):
        rows, meant = linear_sum_assignment(cost[v])
        moved = meant != straight
        before = cost[v, straight, straight][moved].sum()
        if moved.any() and cost[v, rows, meant][moved].sum() < before / SWAP_BETTER**2:
            order = np.arange(inside.shape[1])
            order[own] = np.array(own)[meant]
            visits.setdefault(tuple(order.tolist()), []).append(int(v))
    return {order: np.array(some) for order, some in visits.items()}


def _renamed(
    observed: TrackerObservations, visits: np.ndarray, order: tuple[int, ...]
) -> TrackerObservations:
    """Give readings to the markers that they are taken for."""
    y = observed.y.copy()
    y[visits[:, None], list(order)] = observed.y[visits]
    return replace(observed, y=y)


def _swap_warning(
    recording: Recording,
    order: tuple[int, ...],
    moved: list[int],
    rows: np.ndarray,
    among: str,
) -> Warned:
    names = [recording.markers[m].name for m in moved]
    meant = [recording.markers[order[m]].name for m in moved]
    when = ""
    if among:
        poses = list(Counter(recording.posture_id[rows].tolist()))
        more = " …" if len(poses) > SHOWN else ""
        shown = ", ".join(map(str, poses[:SHOWN]))
        when = f" in {len(rows)} of {among} (poses {shown}{more})"
    text = (
        f"{' and '.join(names)} look swapped{when}: each is where the other should be."
    )
    if len(moved) > 2:
        pairs = ", ".join(f"{a} is {b}" for a, b in zip(names, meant, strict=True))
        text = f"the markers' names look mixed up{when}: {pairs}."
    return Warned("marker_names", "markers", text)


DOUBT = 5e-4
"""Rigid misfit over the readings' extent from which other readings are tried; chosen:
half a millimetre on a metre, what a well calibrated arm has (Slamani 2012: 0.3 mm)."""
CLEAR = 10.0
"""Sigmas of the tracker from which a misfit is looked at; chosen."""
ALIKE = 1.1
"""Factor within which readings fit alike; then the first is told. Chosen."""
SAME = 1.001
"""Factor within which a body does as well as another, which nothing turned against it;
chosen: rounding is below."""
VISITS = 30
"""Visits that this looks at; chosen for time."""
PARTNERS = 8
"""Readings that are tried together with each other one; chosen for time."""
ROUGH, LIKELY = 1, 12
"""Steps of a fit by which readings are ranked, and how many are then fitted; chosen for
time."""

Told = tuple[Warned, ...]
Other = tuple[Told, TrackerObservations]


@threadpool_limits.wrap(limits=1, user_api="blas")
def setup_errors(recording: Recording, arm: Arm) -> Told:
    """Return the gross mistakes that the readings show.

    Args:
        recording: What was done and seen.
        arm: The nominal arm, with the recording's names.
    """
    if recording.points is None or recording.tracker is None:
        return ()
    told = _errors(recording, arm)
    outliers = outliers_of(recording)
    if not outliers or any(w.code == "marker_names" for w in told):
        return told
    return _errors(without_outliers(recording, outliers), arm)


def _errors(recording: Recording, arm: Arm) -> Told:
    """Return the mistakes of readings, outliers among them."""
    told: Told = ()
    if recording.displacement == "absolute":
        told = detect_unit_errors(recording, arm)
        told = told or _mistakes_of_columns(recording)
        mixed = () if told else detect_swapped_markers(recording, arm)
        told = told or tuple(m.warned for m in mixed if m.is_unambiguous)
        told = told or _mistakes_of_places(
            recording, arm, tuple(m.warned for m in mixed)
        )
    return told or load_setup_errors(recording, arm)


def _mistakes_of_columns(recording: Recording) -> Told:
    """Hold markers against the rigid body that they are on, whatever the arm is."""
    assert recording.tracker is not None
    noise = CLEAR * float(np.max(recording.tracker.repeatability))
    return detect_column_errors(some_visits(recording, MANY), noise)


def _mistakes_of_places(recording: Recording, arm: Arm, mixed: Told) -> Told:
    """Doubt angles and the tracker, then the markers' names, then what is stated."""
    every = some_visits(recording, VISITS)
    some = every.watching(ends_of_bodies(every.markers, arm))
    posture = some.posture
    observed = TrackerObservations.of(arm, some, posture)
    _, before = fit_tracker_frame(observed)
    others = TrackerObservations.of(arm, every, posture)
    whole = _rigid_residual_rms(others)
    extent = extent_of(observed)
    assert every.tracker is not None
    noise = CLEAR * float(np.max(every.tracker.repeatability))
    places = np.sqrt(3.0) * MARKER_POSITION_SIGMA if observed.given.any() else 0.0
    least = max(DOUBT * extent, noise, places)
    if max(before, whole) <= least:
        return ()
    if before <= least:  # what is wrong is about the other markers
        some, observed, before = every, others, whole
    angles = list(of_angles(posture, arm.slides))
    told = _single(some, arm, angles, observed)
    moved: list[tuple[float, Told]] = []
    if _least(told) > least:
        moved = _on_other_bodies(every, arm, DOUBT * extent)
        if _least(moved) <= least and (said := _best(moved, whole)):
            return said
    answer = _best(told, before)
    if not answer and mixed:
        return mixed
    if _least(told) > DOUBT * extent:
        told += _shifted(some, arm)
        answer = _best(told, before)
    answer = answer or _best(moved, whole)  # of a soft arm, which sags
    settled = _least(told) < DOUBT * extent if answer else before < GROSS * extent
    if settled:
        return answer
    if answer:
        return _best(_likely(_pairs(some, arm, angles)), _least(told)) or answer
    less = [((o.warned,), o.meant(observed)) for o in less_is_stated(observed)]
    text = (
        f"the markers lie {1e3 * before:.0f} mm rms off where this model puts them, "
        "and no single slip explains it. Is it this arm's model, and do the angles of "
        "a row belong to its markers?"
    )
    return (
        _best(_likely(less), before)
        or _best(_likely(_pairs(some, arm, angles)), before)
        or (Warned("wrong_model", "rig", text),)
    )


def _single(
    some: Recording, arm: Arm, angles: Sequence[Angles], observed: TrackerObservations
) -> list[tuple[float, Told]]:
    """Fit other readings of angles and observations, one at a time."""
    posture = some.posture
    others: list[Other] = []
    for one in angles:
        meant = TrackerObservations.of(arm, some, one.meant(posture))
        others.append(((one.warned,), meant))
    others += [((o.warned,), o.meant(observed)) for o in of_sight(observed)]
    return _likely(others)


def _shifted(some: Recording, arm: Arm) -> list[tuple[float, Told]]:
    """Fit the zero of one axis; empty where it is no other one."""

    def seen(meant: np.ndarray) -> TrackerObservations:
        return TrackerObservations.of(arm, some, meant)

    shifted = best_shift(
        some.posture, arm.slides, lambda meant: _rigid_residual_rms(seen(meant), ROUGH)
    )
    if shifted is None:
        return []
    return _likely([((shifted.warned,), seen(shifted.meant(some.posture)))])


def _pairs(some: Recording, arm: Arm, angles: Sequence[Angles]) -> Iterator[Other]:
    """List several reversed axes, then each likely reading with each other one."""

    def seen(meant: np.ndarray) -> TrackerObservations:
        return TrackerObservations.of(arm, some, meant)

    for said, meant in of_signs(some.posture):
        yield said, seen(meant)
    likely = sorted(
        angles, key=lambda o: _rigid_residual_rms(seen(o.meant(some.posture)), ROUGH)
    )
    for one in likely[:PARTNERS]:
        meant = one.meant(some.posture)
        for other in of_angles(meant, arm.slides):
            if other.warned.code != "axis_coupled":  # for time
                yield (one.warned, other.warned), seen(other.meant(meant))
        for seeing in of_sight(seen(meant)):
            yield (one.warned, seeing.warned), seeing.meant(seen(meant))


def _likely(others: Iterable[Other]) -> list[tuple[float, Told]]:
    """Fit the readings that look best after one step, in their order."""
    others = list(others)
    rough = [_rigid_residual_rms(observed, ROUGH) for _, observed in others]
    kept = np.sort(np.argsort(rough, kind="stable")[:LIKELY])
    return [(_rigid_residual_rms(others[i][1]), others[i][0]) for i in kept]


def _least(told: Sequence[tuple[float, Told]]) -> float:
    return min((left for left, _ in told), default=np.inf)


def _best(told: Sequence[tuple[float, Told]], before: float) -> Told:
    """Return the first of what fits best, if it fits clearly better."""
    least = _least(told)
    said = next((said for left, said in told if left <= ALIKE * least), ())
    return said if least < before / BETTER else ()


def _rigid_residual_rms(observed: TrackerObservations, steps: int = STEPS) -> float:
    """Return the rms of a rigid fit, in m."""
    return fit_tracker_frame_once(observed, steps)[1]


def _on_other_bodies(
    every: Recording, arm: Arm, rigid: float
) -> list[tuple[float, Told]]:
    """Fit markers that keep their distances on other bodies, one group after another.

    Args:
        every: Some visits with all markers.
        arm: The nominal arm, with the recording's names.
        rigid: Standard deviation of a distance up to which it is kept, in m.

    Returns:
        One reading, or none where no other body fits better.
    """

    def left(markers: Sequence[Marker], steps: int) -> float:
        meant = replace(every, markers=tuple(markers))
        observed = TrackerObservations.of(arm, meant, every.posture)
        return _rigid_residual_rms(observed, steps)

    bodies = ("base", *(f"link_{k + 1}" for k in range(len(arm.axes))))
    markers = [replace(m, position=None) for m in every.markers]  # by how they move
    groups = _rigid_groups(every, rigid)
    best, moved = left(markers, ROUGH), dict[int, str]()
    while groups:
        tried = []
        for group, body in product(groups, bodies):
            if arm.attachment(markers[group[0]].body).axis != arm.attachment(body).axis:
                other = [
                    replace(m, body=body) if k in group else m
                    for k, m in enumerate(markers)
                ]
                tried.append((left(other, ROUGH), group, body, other))
        least = min(one[0] for one in tried)
        if least >= best / ALIKE:  # both are zero where a single visit was seen
            break
        best, group, body, markers = next(t for t in tried if t[0] < SAME * least)
        groups.remove(group)
        moved |= dict.fromkeys(group, body)
    if not moved:
        return []
    said = "; ".join(
        f"{', '.join(every.markers[k].name for k in sorted(moved) if moved[k] == body)}"
        f" to {body!r}"
        for body in bodies
        if body in moved.values()
    )
    text = (
        "markers look fixed to other bodies than [markers] says: they keep their "
        f"places when given {said}."
    )
    where = f"marker:{every.markers[min(moved)].name}" if len(moved) == 1 else "markers"
    return [(left(markers, STEPS), (Warned("marker_body", where, text),))]


def _rigid_groups(every: Recording, rigid: float) -> list[tuple[int, ...]]:
    """Return the markers of each body that keep their distances from each other."""
    assert every.points is not None
    groups: list[tuple[int, ...]] = []
    for k, marker in enumerate(every.markers):
        apart = np.linalg.norm(every.points - every.points[:, [k]], axis=2)
        near = next(
            (
                g
                for g in groups
                if every.markers[g[0]].body == marker.body
                and np.isfinite(apart[:, g[0]]).sum() > 1
                and np.nanstd(apart[:, g[0]]) < rigid
            ),
            None,
        )
        if near is None:
            groups.append((k,))
        else:
            groups[groups.index(near)] = (*near, k)
    return groups
