"""A marker's column of another size than its neighbours' is in another unit.

==========  ==========================================================================
Equation    rms of a marker's misfit, its columns as written, and times 1000 or 1/1000
Source      enumeration; a wrong unit moves a marker by its way, physics by a hundredth
Valid       absolute readings; columns whose range is thirty times off the arm's
Ignores     units that are wrong in all columns, which are told as one mistake
==========  ==========================================================================
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations

import numpy as np

from bench.recording import Recording
from stiffness.arm import Arm
from stiffness.diagnosis.diagnosis import Warned
from stiffness.diagnosis.first_frames import quickly_seated
from stiffness.diagnosis.readings import Frames
from stiffness.diagnosis.sight import Sight

OFF = 30.0
"""Factor between the ranges of a column and of the arm from which a unit is doubted;
chosen: the root of the thousand between m and mm."""
BETTER = 5.0
"""Factor by which the other unit must fit better; chosen, as in `set_up`."""
GROSS = 0.03
"""Misfit over the arm's range that the other unit may leave; chosen, as in `set_up`."""
SMALL = 0.003
"""Misfit over the arm's range below which a marker is where it should be; chosen: a
tenth of the gross one, what a badly calibrated arm has."""
MOST = (0.05, 0.95)
"""Quantiles between which a column's range is taken: a glint has no say; chosen."""
VISITS = 30
"""Visits that this looks at; chosen for time."""
UNITS = ((1e3, "m where mm are expected"), (1e-3, "mm where m are expected"))


def odd_units(recording: Recording, arm: Arm) -> tuple[Warned, ...]:
    """Name the columns of markers that are in another unit than the rest.

    Args:
        recording: With absolute markers.
        arm: The nominal arm, with the recording's names.
    """
    first = np.unique(recording.visit, return_index=True)[1]
    some = recording.take(first[:: -(-len(first) // VISITS)])
    sight = Sight.of(arm, some, some.posture)
    seen = np.isfinite(sight.y).all(axis=2).sum(axis=0) > 1
    if not seen.any():  # one visit has no range
        return ()
    moves = np.linalg.norm(np.ptp(sight.origin, axis=0), axis=1)
    way = float(moves.max())
    ranges = np.full(sight.place.shape, np.nan)
    ranges[seen] = np.ptp(np.nanquantile(sight.y[:, seen], MOST, axis=0), axis=0)
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
            frames = quickly_seated(sight)[0]
            left = [m for m in left if _away(sight, m, frames) > SMALL * way]
            for m in [m for m in left if m not in found]:
                columns = _better(sight, m, np.flatnonzero(odd[m]), factor, way)
                if columns:
                    sight = _scaled(sight, m, columns, factor)
                    found[m], again = (words, factor, columns), True
    return tuple(_said(recording, m, *found[m]) for m in sorted(found))


def _said(
    recording: Recording, m: int, words: str, factor: float, columns: tuple[int, ...]
) -> Warned:
    name = recording.markers[m].name
    listed = ", ".join(f"{name}_{'xyz'[c]}_mm" for c in columns)
    text = (
        f"{listed}: given in {words}, as it looks, unlike the others; fits times "
        f"{factor:g}. Check the unit in the mapping or the file."
    )
    return Warned("units", "tracker", text)


def _scaled(sight: Sight, m: int, columns: tuple[int, ...], factor: float) -> Sight:
    y = sight.y.copy()
    y[:, m, list(columns)] *= factor
    return replace(sight, y=y)


def _better(
    sight: Sight, m: int, odd: np.ndarray, factor: float, way: float
) -> tuple[int, ...]:
    """Return which of a marker's odd columns fit in the other unit; none: ()."""
    before, best, answer = _left(sight, m), np.inf, ()
    for columns in _subsets(odd.tolist()):
        left = _left(_scaled(sight, m, columns, factor), m)
        if left < min(best, before / BETTER, GROSS * way):
            best, answer = left, columns
    return answer


def _subsets(odd: list[int]) -> Iterator[tuple[int, ...]]:
    for count in range(1, len(odd) + 1):
        yield from combinations(odd, count)


def _left(sight: Sight, m: int) -> float:
    """Return the rms misfit of one marker, all frames fitted anew, in m."""
    return _away(sight, m, quickly_seated(sight)[0])


def _away(sight: Sight, m: int, frames: Frames) -> float:
    """Return the rms misfit of one marker, its own place free if unknown, in m."""
    seen = np.isfinite(sight.y[:, m]).all(axis=1)
    point = sight.y[seen, m] @ frames.turn.T + frames.shift - sight.origin[seen, m]
    inside = np.einsum("vji,vj->vi", sight.turned[seen, m], point)
    away = inside - (sight.place[m] if sight.given[m] else np.median(inside, axis=0))
    return float(np.sqrt(np.mean(np.sum(away**2, axis=1))))
