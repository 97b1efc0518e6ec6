"""Motions measured on both sides of a gear, and joint torques from the model.

A `Motion` is one axis during one run of a stream: angle before the gear, difference
between the two encoders, and joint torque.

Torque of an axis whose motor torque was not recorded (`modelled_torque`):

==========  ==========================================================================
Equation    torque = M(q) q'' + C(q, q') q' + g(q), the arm's own and its tool's
Source      Featherstone 2008, "Rigid Body Dynamics Algorithms", chapter 5
Valid       masses as in the model; motions slow against the smoothing time of 0.1 s
Ignores     friction, the rotors' own inertia (it winds up no gear), a load that the
            recording does not state, the tool's inertia against acceleration
==========  ==========================================================================
"""

from dataclasses import dataclass, replace

import numpy as np
import pinocchio
from jaxtyping import Float
from scipy.interpolate import CubicSpline
from scipy.signal import savgol_coeffs, savgol_filter

from bench.shared.errors import refuse
from bench.shared.recording import Recording
from stiffness.robot.arm import Arm
from stiffness.robot.mjcf import without_other_joints

# --- Motions --------------------------------------------------------------------------

FEWEST = 3
"""Minimum number of motions of an axis: two are fitted, one is left out."""
SHORTEST = 50
"""Minimum rows of a motion; chosen: fewer do not fill ten stretches of time."""
STRETCHES = 10
"""Number of stretches of time per motion; within one the residual is correlated."""
SMOOTHED = 0.1
"""Window in s over which a torque and its friction are smoothed; chosen: an arm's load
changes more slowly, and a current's noise would make every gear look stiffer."""


@dataclass(frozen=True, eq=False)
class Motion:
    """One axis during one motion.

    Attributes:
        time: Since the start of the recording, in s.
        angle: Angle before the gear, referred to the axis, in rad.
        speed: Its speed, in rad/s.
        torque: Joint torque, output side, smoothed, in N m; None: unknown.
        scatter: Noise of a measured torque after smoothing, standard deviation, in N m.
        measured: Whether the torque is the motor's, and so includes friction.
        apart: Angle after the gear less the one before it, mean subtracted, in rad.
    """

    posture_id: int
    time: Float[np.ndarray, " rows"]
    angle: Float[np.ndarray, " rows"]
    speed: Float[np.ndarray, " rows"]
    torque: Float[np.ndarray, " rows"] | None
    apart: Float[np.ndarray, " rows"]
    scatter: float = 0.0
    measured: bool = True

    def stretches(self) -> np.ndarray:
        """Return the number of the stretch that each row belongs to."""
        span = self.time[-1] - self.time[0]
        part = (self.time - self.time[0]) / span * STRETCHES
        return np.minimum(part.astype(int), STRETCHES - 1)

    def later(self, delay: float, velocity_lag: bool = False) -> "Motion":
        """Return the motion corrected for a second encoder that is `delay` s late.

        The delay is in s. With `velocity_lag` it lags in proportion to speed alone, as
        after a controller's extrapolation; else its value is exactly that of `delay`
        ago.
        """
        if delay == 0.0:
            return self
        then = self.time - delay

        def ago(values: Float[np.ndarray, " rows"]) -> Float[np.ndarray, " rows"]:
            return CubicSpline(self.time, values)(then)

        angle = ago(self.angle)
        lag = delay * self.speed if velocity_lag else self.angle - angle
        apart = self.apart + lag
        return replace(
            self,
            angle=angle,
            speed=ago(self.speed),
            torque=None if self.torque is None else ago(self.torque),
            apart=apart - apart.mean(),
        )

    def smooth(self, values: Float[np.ndarray, " rows"]) -> Float[np.ndarray, " rows"]:
        """Smooth a signal with the window of the torque."""
        return smoothed(values, self.time)


def smoothed(
    values: Float[np.ndarray, "rows *more"],
    time: Float[np.ndarray, " rows"],
    derivative: int = 0,
) -> Float[np.ndarray, "rows *more"]:
    """Fit a cubic to every 0.1 s and return its value or a derivative in the middle."""
    rows, step = _window(time)
    return np.asarray(savgol_filter(values, rows, 3, derivative, step, axis=0))


def _window(time: Float[np.ndarray, " rows"]) -> tuple[int, float]:
    """Return the number of rows of the window, and the time between rows in s."""
    step = float(time[-1] - time[0]) / (len(time) - 1)
    longest = len(time) - 1 + len(time) % 2
    return min(max(5, 2 * round(0.5 * SMOOTHED / step) + 1), longest), step


def _scatter(
    rough: Float[np.ndarray, " rows"], time: Float[np.ndarray, " rows"]
) -> float:
    """Return the noise of a smoothed signal, estimated from what smoothing removed."""
    rows = _window(time)[0]
    kept = float(savgol_coeffs(rows, 3)[rows // 2])  # share of white noise's variance
    sigma = 1.4826 * float(np.median(np.abs(rough - np.median(rough))))
    return sigma * np.sqrt(kept / (1.0 - kept))


def motions_of(
    recording: Recording, torque: Float[np.ndarray, "rows axes"] | None = None
) -> dict[int, tuple[Motion, ...]]:
    """Return the motions of every axis with two encoders, in order of time.

    The model's joint torque, in N m, serves axes whose motor torque was not recorded.

    Raises:
        Unusable: Where no axis has two encoders, or one has fewer than `FEWEST`
            motions; with all faults.
    """
    faults = []
    if recording.rows != "stream":
        faults.append('rows are "plateaus"; two encoders are compared in a "stream".')
    axes = axes_read_twice(recording)
    if not axes:
        faults.append("no axis has an angle after its gear (a1_link_deg …).")
    every = {}
    if not faults:
        ids = np.unique(recording.posture_id)
        for axis in axes:
            found = [_motion(recording, axis, int(i), torque) for i in ids]
            motions = sorted((m for m in found if m), key=lambda m: m.time[0])
            every[axis] = tuple(motions)
            if len(motions) < FEWEST:
                faults.append(
                    f"a{axis + 1} has {len(motions)} motions of {SHORTEST} rows with "
                    "both encoders: two are fitted, one judges; give each motion a "
                    f"`pose` of its own, {FEWEST} or more."
                )
    refuse(f"Recording {recording.name!r}", faults)
    return every


def axes_read_twice(recording: Recording) -> tuple[int, ...]:
    """Return the axes with encoders on both sides of their gears."""
    if recording.link_posture is None:
        return ()
    seen = np.isfinite(recording.link_posture).any(axis=0)
    return tuple(int(k) for k in np.flatnonzero(seen))


def _motion(
    recording: Recording, axis: int, pose: int, modelled: np.ndarray | None
) -> Motion | None:
    assert recording.link_posture is not None
    link = recording.link_posture[:, axis]
    rows = np.flatnonzero((recording.posture_id == pose) & np.isfinite(link))
    rows = rows[np.diff(recording.time[rows], prepend=-np.inf) > 0.0]
    if len(rows) < SHORTEST:
        return None
    time, angle = recording.time[rows], recording.posture[rows, axis]
    read = recording.axis_torque
    measured = read is not None and bool(np.ptp(read[:, axis]) > 0.0)
    torque = read if measured else modelled
    apart = link[rows] - angle
    smooth = None if torque is None else smoothed(torque[rows, axis], time)
    scatter = 0.0
    if torque is not None and measured:
        scatter = _scatter(torque[rows, axis] - smooth, time)
    return Motion(
        posture_id=pose,
        time=time,
        angle=angle,
        speed=np.gradient(angle, time),
        torque=smooth,
        apart=apart - apart.mean(),
        scatter=scatter,
        measured=measured,
    )


# --- Torques of the model -------------------------------------------------------------


def modelled_torque(
    recording: Recording, arm: Arm
) -> Float[np.ndarray, "rows axes"] | None:
    """Return the joint torque of every axis of an arm in a stream, in N m.

    Return none for a model without gravity, which has no weight to carry.
    """
    if not np.any(arm.chain.gravity):
        return None
    torque = -arm.gravity_torque(recording.posture, recording.tool)
    for pose in np.unique(recording.posture_id):
        rows = np.flatnonzero(recording.posture_id == pose)
        if len(rows) >= SHORTEST:
            q, time = recording.posture[rows], recording.time[rows]
            rate, acceleration = (smoothed(q, time, order) for order in (1, 2))
            torque[rows] += _moving(arm, q, rate, acceleration)
    return torque


def _moving(
    arm: Arm, q: np.ndarray, rate: np.ndarray, acceleration: np.ndarray
) -> Float[np.ndarray, "rows axes"]:
    """Return the torque for speed and acceleration, without gravity, in N m."""
    model = without_other_joints(arm.file.model, arm.axes).copy()
    model.gravity.setZero()
    model.armature = np.zeros(model.nv)
    data = model.createData()
    joints = [model.joints[model.getJointId(name)] for name in arm.axes]
    at, turns = [j.idx_q for j in joints], [j.idx_v for j in joints]
    inside = np.empty_like(q), np.empty_like(q), np.empty_like(q)
    inside[0][:, at], inside[1][:, turns], inside[2][:, turns] = q, rate, acceleration
    found = [pinocchio.rnea(model, data, *row) for row in zip(*inside, strict=True)]
    return np.array(found)[:, turns]
