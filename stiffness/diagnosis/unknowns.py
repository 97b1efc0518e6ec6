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
from stiffness.diagnosis.columns import Columns
from stiffness.diagnosis.hypotheses.bodies import axes_of
from stiffness.diagnosis.readings import Frames
from stiffness.diagnosis.signature import levers
from stiffness.diagnosis.situation import Situation
from stiffness.diagnosis.smooth_error import rest_of, smooth_basis
from stiffness.diagnosis.unknown_columns import UnknownColumns
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
) -> UnknownColumns:
    """Return columns of what is unknown, and their prior sigmas.

    Args:
        situation: Where the arm stood.
        visits: How rows lie side by side.
        point: Where the markers are.
        field: Whether the tracker's smooth error is among them, where it is stated.
    """
    recording = situation.recording
    count, markers = point.shape[:2]
    frame = np.zeros((count, markers, 3, 0))
    if recording.base_from_tracker is None:
        frame = levers(point)
    places = [
        np.full(3, FREE if marker.position is None else PLACE)
        for marker in recording.markers
    ]
    first = visits.row[:, 0]
    axes = {m.body: axes_of(situation, m.body)[first] for m in recording.markers}
    turn = np.stack([axes[m.body] for m in recording.markers], axis=1)
    tracker = recording.tracker
    waves, rest = np.zeros((count, markers, 0)), np.zeros((count, markers))
    if field and tracker is not None and tracker.volumetric:
        waves = smooth_basis(point.reshape(-1, 3), tracker.volumetric)
        waves = waves.reshape(count, markers, -1)
        rest = rest_of(waves, tracker.volumetric)
    sigma = [np.full(frame.shape[3], FREE), *places, np.ones(3 * waves.shape[2])]
    return UnknownColumns(frame, turn, waves, rest, np.concatenate(sigma))


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
