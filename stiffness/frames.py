"""The tracker stands somewhere beside the arm; base markers or the arm tell where.

==========  ==========================================================================
Equation    R, t = argmin sum |R p_tracker + t - p_base|^2, by the SVD of the moment
Source      Kabsch 1976, "A solution for the best rotation to relate two sets of
            vectors", Acta Crystallographica A32, 922
Needs       the frame in the manifest; or three markers on the base whose places are
            known; or markers with known places on moving bodies, not on one line
Assumes     the arm stands where its posture says; springs, where given, are linear
==========  ==========================================================================
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

from bench.errors import Unusable
from bench.recording import UNLOADED, Recording
from stiffness.arm import Arm
from stiffness.equilibrium import equilibrium

FLAT = 1e-3
"""Points whose second extent is below this share of the first lie on a line; chosen."""
ENOUGH = 3
"""Points that fix a frame."""


@dataclass(frozen=True)
class TrackerFrame:
    """Where the tracker stands.

    Attributes:
        base_from_tracker: Transform, in m.
        rms: What the fit left per coordinate, in m; 0 where the frame was stated.
        source: The manifest, markers on the base, or markers on the moving arm.
    """

    base_from_tracker: Float[np.ndarray, "4 4"]
    rms: float
    source: Literal["manifest", "base markers", "arm markers"]


def tracker_frame(
    arm: Arm,
    recording: Recording,
    compliance: Float[np.ndarray, " axes"] | None = None,
) -> TrackerFrame:
    """Find the tracker's frame from the best source that the recording has.

    Args:
        arm: The nominal arm, with the recording's names.
        recording: Its unloaded rows are used.
        compliance: Springs with which the unloaded arm sags under its weight, in
            rad/(N m); None = it stands rigid.

    Returns:
        The transform, what the fit left, and the source.

    Raises:
        Unusable: Where nothing fixes the frame.
    """
    if recording.base_from_tracker is not None:
        return TrackerFrame(recording.base_from_tracker, 0.0, "manifest")
    fixed = [arm.place(marker.body).axis < 0 for marker in recording.markers]
    known = [marker.position is not None for marker in recording.markers]
    on_base = np.array(fixed, dtype=bool) & np.array(known, dtype=bool)
    frame = None
    if recording.displacement == "absolute" and on_base.any():
        frame = _fit(arm, recording, on_base, None, "base markers")
    if frame is None and recording.displacement == "absolute" and any(known):
        chosen = np.array(known, dtype=bool)
        frame = _fit(arm, recording, chosen, compliance, "arm markers")
    if frame is None:
        advice = (
            "the tracker's frame is unknown: give [frames.tracker], or position_mm of "
            "three markers on the base or of the markers on the arm (absolute)."
        )
        raise Unusable(f"Recording {recording.name!r}", [advice])
    return frame


def kabsch(
    source: Float[np.ndarray, "points 3"], target: Float[np.ndarray, "points 3"]
) -> Float[np.ndarray, "4 4"]:
    """Return the rigid transform that takes points nearest to others, in m.

    Raises:
        Unusable: Where the points lie on one line, so that a turn is free.
    """
    middle, aim = source.mean(axis=0), target.mean(axis=0)
    extent = np.linalg.svd(source - middle, compute_uv=False)
    if len(source) < ENOUGH or extent[1] < FLAT * extent[0]:
        raise Unusable(
            "The markers", ["they lie on one line; a turn about it is free."]
        )
    turn = Rotation.align_vectors(target - aim, source - middle)[0].as_matrix()
    transform = np.eye(4)
    transform[:3, :3] = turn
    transform[:3, 3] = aim - turn @ middle
    return transform


def unloaded_rows(recording: Recording) -> Int[np.ndarray, " unloaded"]:
    """Return the rows read without load; each visit's first where none is marked."""
    marked = np.flatnonzero(recording.stage == UNLOADED)
    return marked if len(marked) else np.unique(recording.visit, return_index=True)[1]


def _fit(
    arm: Arm,
    recording: Recording,
    chosen: Bool[np.ndarray, " markers"],
    compliance: np.ndarray | None,
    source: Literal["base markers", "arm markers"],
) -> TrackerFrame | None:
    """Fit the frame to some markers' nominal places; None where they are too few."""
    assert recording.points is not None
    rows = unloaded_rows(recording)
    posture = recording.posture[rows]
    if compliance is not None:
        posture = equilibrium(arm, posture, compliance, payload=recording.tool)
    standing = arm.at(posture)
    seen, nominal = [], []
    for k in np.flatnonzero(chosen):
        marker = recording.markers[k]
        assert marker.position is not None
        point = recording.points[rows, k]
        visible = np.isfinite(point).all(axis=1)
        seen.append(point[visible])
        nominal.append(standing.point(marker.body, marker.position)[visible])
    source_points, target = np.concatenate(seen), np.concatenate(nominal)
    try:
        transform = kabsch(source_points, target)
    except Unusable:
        return None
    left = source_points @ transform[:3, :3].T + transform[:3, 3] - target
    return TrackerFrame(transform, float(np.sqrt(np.mean(left**2))), source)
