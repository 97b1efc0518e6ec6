"""Residuals: measured less expected marker positions, with weights and rigid groups.

==========  ==========================================================================
Equation    residual = R p_tracker + t - (R_b place + o_b), b the marker's body at the
            nominal equilibrium
Source      definition
Valid       a tracker frame and marker places that are nearly right
Ignores     nothing: residuals are exact, only columns are linearised
==========  ==========================================================================
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from bench.shared.recording import Recording
from stiffness.experiment.static_state import StaticState
from stiffness.robot.arm import Arm
from stiffness.robot.tracker_frame import TrackerFit

# --- Fitted frame and marker positions ------------------------------------------------


def seen_in_base(
    recording: Recording, frames: TrackerFit
) -> Float[np.ndarray, "rows markers 3"]:
    """Return readings along the base's axes, in m; NaN where not seen."""
    assert recording.points is not None
    return recording.points @ frames.turn.T + frames.shift


def expected(
    situation: StaticState, frames: TrackerFit
) -> Float[np.ndarray, "rows markers 3"]:
    """Return the expected marker positions, in m."""
    standing = situation.arm.at(situation.rest)
    markers = situation.recording.markers
    return np.stack(
        [
            standing.point(marker.body, place)
            for marker, place in zip(markers, frames.marker_positions, strict=True)
        ],
        axis=1,
    )


SURE = 0.3
"""Least spread of a reading that counts, over the root mean square of all; chosen: one
of few frames is known to a third."""


def weight_of(recording: Recording) -> Float[np.ndarray, "rows markers"]:
    """Return the number of frames of each reading; 0 where it was not seen.

    A reading with a spread of its own counts as the frames that would give it.
    The points of a 6D target are one reading and share its weight, so that its position
    has the stated accuracy, and its rotation that of one sigma at the points.
    """
    assert recording.points is not None
    seen = np.isfinite(recording.points).all(axis=2)
    frames = 1.0 if recording.frames is None else recording.frames[:, None]
    tracker = recording.tracker
    if recording.spread is not None and tracker is not None:
        stated = np.mean(tracker.repeatability**2)
        own = np.mean(recording.spread**2, axis=2) / stated
        frames = np.where(np.isnan(own), frames, 1.0 / np.maximum(own, SURE**2))
    return np.asarray(seen * frames * shares_of(recording), dtype=float)


def shares_of(recording: Recording) -> Float[np.ndarray, " markers"]:
    """Return each marker's share of a reading, which the points of a target divide."""
    targets = [m.target for m in recording.markers]
    return np.array([1.0 if t is None else 1.0 / targets.count(t) for t in targets])


def rigid_groups(
    recording: Recording, body: Int[np.ndarray, " markers"]
) -> Int[np.ndarray, " markers"]:
    """Return groups of markers that were measured separately and move together.

    Points of a 6D target were not measured separately: each is a group of its own.
    """
    alone = body.max(initial=0) + 1 + np.arange(len(body))
    whole = np.array([m.target is not None for m in recording.markers])
    return np.where(whole, alone, body)


def bodies_of(
    arm: Arm, recording: Recording
) -> tuple[tuple[str, ...], Int[np.ndarray, " markers"]]:
    """Return the bodies that carry markers, base first, and each marker's body.

    Bodies fixed to each other, such as a flange and its tool, count as one.
    """
    axis = [arm.attachment(marker.body).axis for marker in recording.markers]
    order = sorted(set(axis), key=lambda k: len(arm.chain.carriers(k)))
    names = []
    for k in order:
        first = axis.index(k)
        names.append(recording.markers[first].body)
    return tuple(names), np.array([order.index(k) for k in axis])


# --- Reduction to sufficient statistics -----------------------------------------------


@dataclass(frozen=True)
class Residuals:
    """Measured less expected marker positions.

    Attributes:
        value: Residuals in m along the base's axes; NaN where not seen.
        point: The readings themselves, in the base's frame.
        weight: Number of frames of each, less for outliers, 0 where not seen.
        inverse: Inverse covariance of one frame's reading, 1/m^2.
        body: Index of each marker's body.
        centre: What readings hold of kinematic errors about which the arm stands, in m;
            None: it stands as drawn.
    """

    value: Float[np.ndarray, "rows markers 3"]
    point: Float[np.ndarray, "rows markers 3"]
    weight: Float[np.ndarray, "rows markers"]
    inverse: Float[np.ndarray, "3 3"]
    body: Int[np.ndarray, " markers"]
    centre: Float[np.ndarray, "rows markers 3"] | None = None
