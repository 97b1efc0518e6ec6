"""The end-effector's deflection is where its markers went when the load came.

==========  ==========================================================================
Equation    d = R (mean of p_loaded - p_unloaded over markers seen in both readings)
Source      Wu et al. 2024, section 3.3: loaded minus unloaded, in the base's frame
Needs       an unloaded reading in the visit; markers on the flange or the tool; wrench
Assumes     the markers do not slip and the base stands still within a visit
==========  ==========================================================================

The wrench is the difference of the same two readings, which takes a sensor's bias and
the weight of what always hangs on it away.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from jaxtyping import Float, Int

from bench.errors import Unusable
from bench.recording import Recording
from stiffness.arm import Arm
from stiffness.frames import TrackerFrame, tracker_frame
from stiffness.load_cases import LoadCases
from stiffness.noise import Noise, noise_of_pairs
from stiffness.pairs import loaded_and_unloaded, usable
from stiffness.wrench import sensor_in_flange, to_flange, wrench_in_base


@dataclass(frozen=True)
class Deflections:
    """What was done to the end-effector and how far it moved, one row per reading.

    Attributes:
        cases: Posture, wrench and the point whose motion is meant: the mean nominal
            place of the markers of that row.
        deflection: Along the base's axes, in m.
        pose: Id of the posture visited.
        row: The recording's row that was read under load.
        noise: What the instruments state.
        frame: Where the tracker stands, and how that is known.
        wrench_in_flange: The wrench along the flange's axes, where the sensor turns
            with it; None where it was given along the base's.
    """

    cases: LoadCases
    deflection: Float[np.ndarray, "rows 3"]
    pose: Int[np.ndarray, " rows"]
    row: Int[np.ndarray, " rows"]
    noise: Noise
    frame: TrackerFrame
    wrench_in_flange: Float[np.ndarray, "rows 6"] | None

    @property
    def visit(self) -> Int[np.ndarray, " rows"]:
        """Which rows share their unloaded reading."""
        return self.noise.visit

    @property
    def sigma(self) -> Float[np.ndarray, "rows 3"]:
        """Each row's standard deviation by the tracker, in m."""
        return self.noise.sigma()

    def take(self, rows: np.ndarray) -> "Deflections":
        """Return the same with only these rows (indices or a mask)."""
        noise, turning = self.noise, self.wrench_in_flange
        return replace(
            self,
            cases=self.cases.take(rows),
            deflection=self.deflection[rows],
            pose=self.pose[rows],
            row=self.row[rows],
            noise=replace(
                noise,
                own=noise.own[rows],
                shared=noise.shared[rows],
                visit=noise.visit[rows],
            ),
            wrench_in_flange=None if turning is None else turning[rows],
        )


Selection: TypeAlias = Callable[
    [Arm, Recording, Float[np.ndarray, " axes"] | None], Deflections
]
"""A way to take deflections from a recording: `every_plateau`, `one_per_pose`."""


def every_plateau(
    arm: Arm,
    recording: Recording,
    compliance: Float[np.ndarray, " axes"] | None = None,
) -> Deflections:
    """Compare every loaded reading with the unloaded one of its visit.

    Args:
        arm: The nominal arm, with the recording's names.
        recording: Plateaus with markers on the flange, else the tool, and a wrench.
        compliance: Springs under which the unloaded arm sags, in rad/(N m); only used
            where the tracker's frame has to be found from the arm's markers.

    Returns:
        One row per loaded plateau whose visit has an unloaded reading.

    Raises:
        Unusable: Where the recording cannot show deflections, with all faults.
    """
    chosen = usable(arm, recording)
    points, tracker = recording.points, recording.tracker
    sensor = recording.wrench_sensor
    assert points is not None and tracker is not None and sensor is not None
    loaded, unloaded = loaded_and_unloaded(recording)
    moved = points[loaded][:, chosen] - points[unloaded][:, chosen]
    seen = np.asarray(np.isfinite(moved).all(axis=-1))
    some = seen.any(axis=-1)
    loaded, unloaded, moved, seen = (a[some] for a in (loaded, unloaded, moved, seen))
    if not len(loaded):
        fault = "no visit has both a loaded and an unloaded reading of a marker."
        raise Unusable(f"Recording {recording.name!r}", [fault])
    weight = seen / seen.sum(axis=1, keepdims=True)
    frame = tracker_frame(arm, recording, compliance)
    turn = frame.base_from_tracker[:3, :3]
    places = _places(arm, recording, chosen, frame)
    standing = arm.at(recording.posture)
    wrench = wrench_in_base(recording, standing)
    wrench = wrench[loaded] - wrench[unloaded]
    turning = None
    if sensor.frame == "sensor":
        flange = standing.turn("flange")[loaded]
        parts = [np.einsum("cji,cj->ci", flange, wrench[:, k : k + 3]) for k in (0, 3)]
        turning = np.concatenate(parts, axis=1)
    return Deflections(
        cases=LoadCases(
            posture=recording.posture[loaded],
            wrench_in_base=wrench,
            point_in_flange=weight @ places,
            origin_in_flange=sensor_in_flange(arm, recording),
            payload=recording.tool,
        ),
        deflection=np.einsum(
            "cm,cmi->ci", weight, np.where(seen[..., None], moved, 0.0)
        )
        @ turn.T,
        pose=recording.pose[loaded],
        row=loaded,
        noise=noise_of_pairs(recording, chosen, weight, (loaded, unloaded), turn),
        frame=frame,
        wrench_in_flange=turning,
    )


def one_per_pose(
    arm: Arm,
    recording: Recording,
    compliance: Float[np.ndarray, " axes"] | None = None,
) -> Deflections:
    """Take of every pose the first reading under its heaviest load; see above."""
    every = every_plateau(arm, recording, compliance)
    force = np.linalg.norm(every.cases.wrench_in_base[:, :3], axis=1)
    mass = recording.load_mass
    heavy = force if mass is None else mass[every.row]
    slack = 0.01 if mass is None else 0.0  # readings of one weight differ by noise
    kept = []
    for pose in np.unique(every.pose):
        rows = np.flatnonzero(every.pose == pose)
        heaviest = rows[heavy[rows] >= (1.0 - slack) * heavy[rows].max()]
        kept.append(heaviest[0])
    return every.take(np.array(kept))


def _places(
    arm: Arm,
    recording: Recording,
    chosen: Int[np.ndarray, " markers"],
    frame: TrackerFrame,
) -> Float[np.ndarray, "markers 3"]:
    """Return the markers' places in the flange's frame, in m; found if not stated."""
    assert recording.points is not None
    places = []
    for k in chosen:
        marker = recording.markers[k]
        if marker.position is not None:
            what = f"Marker {marker.name!r}"
            places.append(to_flange(arm, marker.body, what, marker.position))
            continue
        seen = np.isfinite(recording.points[:, k]).all(axis=1)
        flange = arm.at(recording.posture[seen]).placement("flange")
        base_from_tracker = frame.base_from_tracker
        point = recording.points[seen, k] @ base_from_tracker[:3, :3].T
        point = point + base_from_tracker[:3, 3] - flange[:, :3, 3]
        places.append(np.einsum("cji,cj->ci", flange[:, :3, :3], point).mean(axis=0))
    return np.stack(places)
