"""Where the tracker stands and the markers sit is unknown, and is no finding.

==========  ==========================================================================
Equation    columns: [1, -p x] for the tracker, R_b for a marker's place, smooth
            functions for the tracker's field; prior sigmas as below
Source      the rules of what counts as nominal: given places within 1 mm, an unstated
            frame, a stated volumetric error
Valid       absolute readings
Ignores     a stated frame that is wrong: that is a finding
==========  ==========================================================================
"""

import numpy as np
from jaxtyping import Float

from stiffness.diagnosis.between import Between
from stiffness.diagnosis.columns import Columns, levers
from stiffness.diagnosis.readings import Frames
from stiffness.diagnosis.situation import Situation
from stiffness.diagnosis.smooth_error import smooth_basis
from stiffness.diagnosis.visits import Visits

PLACE = 1e-3
"""One sigma of a given marker place, in m: what is nominal by the rules."""
FREE = 1.0
"""One sigma of what is not known at all, in m or rad."""


def unknowns(
    situation: Situation,
    visits: Visits,
    point: Float[np.ndarray, "visits markers 3"],
    field: bool,
) -> tuple[Float[np.ndarray, "visits n unknowns"], Float[np.ndarray, " unknowns"]]:
    """Return columns of what is unknown, and their prior sigmas.

    Args:
        situation: Where the arm stood.
        visits: How rows lie side by side.
        point: Where the markers are.
        field: Whether the tracker's smooth error is among them, where it is stated.
    """
    recording = situation.recording
    count, markers = point.shape[:2]
    standing = situation.arm.at(situation.rest[visits.row[:, 0]])
    columns, sigma = [], []
    if recording.base_from_tracker is None:
        columns.append(levers(point).reshape(count, 3 * markers, 6))
        sigma.append(np.full(6, FREE))
    for m, marker in enumerate(recording.markers):
        place = np.zeros((count, markers, 3, 3))
        place[:, m] = standing.turn(marker.body)
        columns.append(place.reshape(count, 3 * markers, 3))
        sigma.append(np.full(3, FREE if marker.position is None else PLACE))
    tracker = recording.tracker
    if field and tracker is not None and tracker.volumetric:
        basis = smooth_basis(point.reshape(-1, 3), tracker.volumetric)
        basis = basis.reshape(count, markers, -1)
        wave = np.zeros((count, markers, 3, 3, basis.shape[2]))
        for i in range(3):
            wave[:, :, i, i] = basis
        columns.append(wave.reshape(count, 3 * markers, -1))
        sigma.append(np.ones(3 * basis.shape[2]))
    return np.concatenate(columns, axis=2), np.concatenate(sigma)


def frames_after(
    frames: Frames,
    between: Between,
    columns: Columns,
    step: Float[np.ndarray, " columns"],
    known: bool,
) -> Frames:
    """Move frame and places to where they are estimated.

    Args:
        frames: As they were when `between` was made.
        between: What the means say of them.
        columns: What else was fitted.
        step: How much of it.
        known: Whether the tracker's frame is stated.
    """
    moved = between.moved
    if columns.count:
        moved = moved - between.absorbed(columns) @ step
    markers = len(frames.place)
    first = 0 if known else 6
    twist = np.zeros(6) if known else moved[:6]
    place = moved[first : first + 3 * markers].reshape(markers, 3)
    return frames.moved(twist, place)
