"""Markers of one body whose names were mixed up stand where the others should.

==========  ==========================================================================
Equation    min over permutations s of sum_m |inside_m - place_s(m)|^2, body by body
            and visit by visit; inside = R_b^T (R y + t - o_b), place = stated, or the
            median over visits
Source      assignment: Kuhn 1955, "The Hungarian method for the assignment problem"
Valid       absolute readings; markers farther apart than the arm is wrong
Ignores     markers that changed their body; places that nobody stated, mixed up in more
            than half of the visits: then the names are as good
==========  ==========================================================================
"""

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from bench.recording import Recording
from stiffness.arm import Arm
from stiffness.diagnosis.diagnosis import Warned
from stiffness.diagnosis.first_frames import quickly_seated
from stiffness.diagnosis.sight import Sight

BETTER = 5.0
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
        sure: Whether no turn of the body would look alike.
    """

    warned: Warned
    sure: bool


def mixed_markers(recording: Recording, arm: Arm) -> tuple[Mixed, ...]:
    """Say which markers of a body were mixed up, and when.

    Args:
        recording: With absolute markers.
        arm: The nominal arm, with the recording's names.
    """
    _, every = np.unique(recording.visit, return_index=True)
    first = every[:: -(-len(every) // MANY)]
    looked_at = "" if len(first) == len(every) else " looked at"
    sight = Sight.of(arm, recording.take(first), recording.posture[first])
    bodies: dict[str, list[int]] = {}
    for m, marker in enumerate(recording.markers):
        bodies.setdefault(marker.body, []).append(m)
    told = []
    inside = _inside(sight)
    for own in bodies.values():
        for order, visits in _orders(inside, sight, own).items():
            if len(visits) < TWICE:
                continue
            right = _renamed(sight, visits, order)
            moved = [m for m, n in enumerate(order) if m != n]
            before = _off(inside, sight, moved)[visits]
            after = _off(_inside(right), right, moved)[visits]
            if np.median(after) < np.median(before) / BETTER:
                some = len(visits) < len(first)
                warned = _said(
                    recording,
                    order,
                    moved,
                    first[visits],
                    f"{len(first)} visits{looked_at}" if some else "",
                )
                told.append(Mixed(warned, some or len(own) > len(moved) == 2))
    return tuple(told)


def _inside(sight: Sight) -> np.ndarray:
    """Return where each marker is in its body, (visits, markers, 3), NaN unseen."""
    frames, _ = quickly_seated(sight)
    point = sight.y @ frames.turn.T + frames.shift - sight.origin
    return np.einsum("vmji,vmj->vmi", sight.turned, point)


def _places(inside: np.ndarray, sight: Sight) -> np.ndarray:
    seen = np.isfinite(inside).any(axis=(0, 2))
    middle = np.full(sight.place.shape, np.nan)
    middle[seen] = np.nanmedian(inside[:, seen], axis=0)
    return np.where(sight.given[:, None], sight.place, middle)


def _off(inside: np.ndarray, sight: Sight, some: list[int]) -> np.ndarray:
    """Return how far some markers are from their places, rms, visit by visit."""
    away = (inside - _places(inside, sight))[:, some]
    return np.sqrt(np.mean(np.sum(away**2, axis=2), axis=1))


def _orders(
    inside: np.ndarray, sight: Sight, own: list[int]
) -> dict[tuple[int, ...], np.ndarray]:
    """Return the orders in which a body's markers fit better, and in which visits."""
    places = _places(inside, sight)[own]
    away = inside[:, own, None] - places[None, None]
    cost = np.sum(away**2, axis=3)  # (visits, seen, meant)
    straight = np.arange(len(own))
    visits: dict[tuple[int, ...], list[int]] = {}
    for v in np.flatnonzero(np.isfinite(cost).all(axis=(1, 2))):
        rows, meant = linear_sum_assignment(cost[v])
        moved = meant != straight
        before = cost[v, straight, straight][moved].sum()
        if moved.any() and cost[v, rows, meant][moved].sum() < before / BETTER**2:
            order = np.arange(inside.shape[1])
            order[own] = np.array(own)[meant]
            visits.setdefault(tuple(order.tolist()), []).append(int(v))
    return {order: np.array(some) for order, some in visits.items()}


def _renamed(sight: Sight, visits: np.ndarray, order: tuple[int, ...]) -> Sight:
    """Give readings to the markers that they are taken for."""
    y = sight.y.copy()
    y[visits[:, None], list(order)] = sight.y[visits]
    return replace(sight, y=y)


def _said(
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
        poses = list(Counter(recording.pose[rows].tolist()))
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
