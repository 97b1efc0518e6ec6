"""A load moves an arm its own way; an arm that moves against it was read wrongly.

==========  ==========================================================================
Equation    d = sum_k c_k J_k (J^T w)_k, c_k >= 0: marker's differences within a visit
            from springs in all axes; rms left under each reading of the files
Source      Siciliano et al. 2009, "Robotics: Modelling, Planning and Control", 7.3;
            non-negative least squares: Lawson & Hanson 1974
Valid       a measured wrench that changes within visits
Ignores     everything that gives way but the axes
==========  ==========================================================================
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from bench.errors import BenchError
from bench.recording import Recording
from stiffness.arm import Arm
from stiffness.diagnosis.diagnosis import Warned
from stiffness.diagnosis.first_frames import first_frames
from stiffness.diagnosis.other_loads import of_loads
from stiffness.diagnosis.readings import Frames
from stiffness.standing import Standing
from stiffness.wrench import wrench_in_base

VISITS = 40
"""Visits that this looks at; chosen for time."""
LOUD = 3.0
"""Deflection over noise, both rms, from which it can be judged; chosen."""
EXPLAINS = 0.8
"""Share of the deflection that springs must explain in a reading that is believed;
chosen: in trials of the bench they explain more with every effect of the vocabulary."""
BETTER = 3.0
"""Factor in rms by which another reading must fit better; chosen."""
DECADES = 100.0
"""Factor between fitted and nominal compliance that no arm has; chosen."""
FLOPPY, STARK = 0.1, 1e-6
"""Most and least that an arm's axes sag under its own weight, in rad; chosen: those of
industrial arms sag by 1e-4 to 3e-3."""
FELT = 1.0
"""Torque of its own weight from which an axis' sag is judged, in N m; chosen."""
HEAVY, GRAVITY = 3.0, 9.81
"""Factor between the force and the weight on the hook that no rope makes; chosen: a
tackle doubles it, pounds and kilograms for newtons are beyond."""


@dataclass(frozen=True)
class Fit:
    """Springs that follow a load.

    Attributes:
        compliance: Of each axis, in rad/(N m); none is negative.
        left: Rms that they leave of the deflections, in m, noise taken off.
        whole: Rms of the deflections, in m, noise taken off.
        clear: Axes whose spring explains a tenth of the deflection and more.
    """

    compliance: np.ndarray
    left: float
    whole: float
    clear: np.ndarray

    @property
    def explained(self) -> float:
        """Share of the squares that they explain."""
        return 1.0 - (self.left / self.whole) ** 2 if self.whole > 0 else 0.0


def mistakes_of_loads(recording: Recording, arm: Arm) -> tuple[Warned, ...]:
    """Return the gross mistake that differences within visits show.

    Args:
        recording: With markers and a tracker.
        arm: The nominal arm, with the recording's names.
    """
    if recording.wrench is None or recording.wrench_sensor is None:
        return ()
    rows = _rows(recording)
    if not len(rows):
        return ()
    some = recording.take(rows.ravel())
    try:
        frames = first_frames(arm, recording, np.zeros(len(arm.axes)))
    except BenchError:
        return ()
    written = _fit(some, arm, frames)
    assert recording.tracker is not None
    noise = float(np.sqrt(2.0 * np.sum(recording.tracker.repeatability**2)))
    if written is None or written.whole < LOUD * noise:
        return ()
    best, answer = written.left / BETTER, None
    for warned, other in of_loads(some, arm):
        fit = _fit(other, arm, frames)
        if fit is not None and fit.left < best and fit.explained > EXPLAINS:
            best, answer = fit.left, warned
    if answer is None:
        answer = _of_size(some, arm, written)
    return () if answer is None else (answer,)


def _rows(recording: Recording) -> np.ndarray:
    """Return (visits, 2): the row with the least and with the largest load of each."""
    assert recording.wrench is not None
    pairs = []
    for visit in np.unique(recording.visit):
        rows = np.flatnonzero(recording.visit == visit)
        wrench = recording.wrench[rows]
        away = np.linalg.norm(wrench[:, :3] - wrench[0, :3], axis=1)
        last = rows[np.argmax(away)]
        if last != rows[0] and away.max() > 0.0:
            pairs.append((rows[0], last))
    return np.array(pairs[:: max(1, -(-len(pairs) // VISITS))], dtype=int)


def _fit(some: Recording, arm: Arm, frames: Frames) -> Fit | None:
    standing = arm.at(some.posture)
    points, sensor, tracker = some.points, some.wrench_sensor, some.tracker
    assert points is not None and sensor is not None and tracker is not None
    moved = (points[1::2] - points[::2]) @ frames.turn.T
    wrench = wrench_in_base(some, standing)
    torque = standing.load_torque(wrench, sensor.body, sensor.position)
    torque = torque[1::2] - torque[::2]
    columns = _jacobians(some, standing, frames)[::2] * torque[:, None, None]
    seen = np.isfinite(moved).all(axis=2)
    if not seen.any():
        return None
    design, aim = columns[seen].reshape(-1, len(arm.axes)), moved[seen].ravel()
    size = np.linalg.norm(design, axis=0)
    size = np.where(size > 0, size, 1.0)
    answer, rest = nnls(design / size, aim)
    noise = 2.0 * np.sum(tracker.repeatability**2)
    count = seen.sum()
    return Fit(
        answer / size,
        float(np.sqrt(max(rest**2 / count - noise, noise / 10.0))),
        float(np.sqrt(max(aim @ aim / count - noise, 0.0))),
        answer**2 > 0.1 * (aim @ aim),
    )


def _jacobians(some: Recording, standing: Standing, frames: Frames) -> np.ndarray:
    """Return (rows, markers, 3, axes), in m per rad."""
    placed = zip(some.markers, frames.place, strict=True)
    each = [standing.jacobian(marker.body, place) for marker, place in placed]
    return np.stack(each, axis=1)[:, :, :3]


def _of_size(some: Recording, arm: Arm, fit: Fit) -> Warned | None:
    """Doubt units where springs come out as no arm has them."""
    assert some.wrench is not None
    if some.load_mass is not None:
        force = np.linalg.norm(np.diff(some.wrench[:, :3], axis=0)[::2], axis=1)
        hung = GRAVITY * np.abs(np.diff(some.load_mass)[::2])
        if hung.any():
            ratio = float(np.sum(force) / np.sum(hung))
            if not 1.0 / HEAVY < ratio < HEAVY:
                text = (
                    f"the force is {ratio:.3g} times the weight on the hook: check the "
                    "units of fx_n, fy_n, fz_n and of load_kg."
                )
                return Warned("units", "wrench_sensor", text)
    if not fit.clear.any() or fit.explained < EXPLAINS:
        return None
    known = fit.clear & (arm.stiffness > 0)
    weight = np.abs(arm.at(some.posture).gravity_torque(some.tool)).max(axis=0)
    heavy = fit.clear & ~arm.slides & (weight > max(0.1 * weight.max(), FELT))
    sag = (weight * fit.compliance)[heavy]
    words = None
    if known.any():
        ratio = float(np.median(fit.compliance[known] * arm.stiffness[known]))
        if not 1.0 / DECADES < ratio < DECADES:
            words = f"{ratio:.3g} times what the model's springs give"
    if words is None and len(sag) and not STARK < sag.max() < FLOPPY:
        words = f"such that the arm's own weight would turn axes by {sag.max():.2g} rad"
    if words is None:
        return None
    text = f"deflections are {words}: check the units of wrench and markers."
    return Warned("units", "wrench_sensor", text)
