"""What the tracker saw can be read in other ways: mirrored, in other units and frames.

The same holds of where it is said to stand, and of where markers are said to sit.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from stiffness.diagnosis.diagnosis import Warned
from stiffness.diagnosis.sight import Sight


@dataclass(frozen=True)
class Seeing:
    """Another way to read what the tracker saw, or where it and the markers are.

    Attributes:
        warned: What to say if it is the right one.
        meant: Turns a sight as written into the one meant.
    """

    warned: Warned
    meant: Callable[[Sight], Sight]


def of_sight(sight: Sight) -> Iterator[Seeing]:
    """List how else what the tracker saw may be meant."""
    text = "the markers look mirrored: they fit with {} of the tracker's {}."
    for i, name in enumerate("xyz" if sight.transform is not None else "y"):
        sign = np.ones(3)
        sign[i] = -1.0
        said = text.format("the sign", f"{name} changed")
        if sight.transform is None:
            said = text.format("one coordinate", "with the other sign")
        yield Seeing(Warned("mirrored", "tracker", said), _seen(np.diag(sign)))
    if sight.transform is not None:
        for i, j in combinations(range(3), 2):
            swap = np.eye(3)
            swap[[i, j]] = swap[[j, i]]
            said = text.format(f"{'xyz'[i]} and {'xyz'[j]}", "swapped")
            yield Seeing(Warned("mirrored", "tracker", said), _seen(swap))
    for factor, words in ((1e3, "in m where mm are expected"), (1e-3, "in µm, not mm")):
        text = f"marker positions look as if given {words}: they fit times {factor:g}."
        yield Seeing(Warned("units", "tracker", text), _seen(factor * np.eye(3)))
    if sight.given.any():
        for factor in (1e3, 1e-3):
            text = (
                "position_mm of the markers look as if given in another unit: they fit "
                f"times {factor:g}."
            )
            yield Seeing(
                Warned("units", "markers", text),
                lambda s, f=factor: replace(s, place=s.place * f),
            )
    if sight.transform is not None:
        for factor in (1e3, 1e-3):
            text = (
                "[frames.tracker] position_mm looks as if given in another unit: it "
                f"fits times {factor:g}."
            )
            yield Seeing(
                Warned("units", "tracker", text),
                lambda s, f=factor: _moved(s, f),
            )
        text = (
            "[frames.tracker] looks inverted: it fits the other way round. p_base = "
            "R(quaternion) p_tracker + position is expected."
        )
        yield Seeing(Warned("tracker_frame", "tracker", text), _inverted)


def less_is_stated(sight: Sight) -> Iterator[Seeing]:
    """List what to doubt wholly where no other reading of it fits."""
    if sight.transform is not None:
        text = (
            "[frames.tracker] does not fit: with a frame that is fitted to the markers "
            "all agree. Correct it, or leave it out."
        )
        yield Seeing(
            Warned("tracker_frame", "tracker", text),
            lambda s: replace(s, transform=None),
        )
    if sight.given.any():
        text = (
            "position_mm of the markers do not fit: with places that are fitted all "
            "agree. Correct them, or leave out what is not known to a millimetre."
        )
        yield Seeing(
            Warned("marker_places", "markers", text),
            lambda s: replace(s, given=np.zeros_like(s.given)),
        )


def _seen(matrix: np.ndarray):
    return lambda sight: replace(sight, y=sight.y @ matrix.T)


def _moved(sight: Sight, factor: float) -> Sight:
    assert sight.transform is not None
    moved = sight.transform.copy()
    moved[:3, 3] *= factor
    return replace(sight, transform=moved)


def _inverted(sight: Sight) -> Sight:
    assert sight.transform is not None
    return replace(sight, transform=np.linalg.inv(sight.transform))
