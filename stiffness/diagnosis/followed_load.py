"""What gives way follows a load: springs, and what gives way at once.

==========  ==========================================================================
Equation    d = sum_k J_k (c_k t_k + b_k t_k / (|t_k| + t0)), c_k, b_k >= 0, t = J^T w:
            marker's differences within a visit from springs in all axes, and from what
            gives way at once
Source      Siciliano et al. 2009, "Robotics: Modelling, Planning and Control", 7.3;
            non-negative least squares: Lawson & Hanson 1974
Valid       a measured wrench that changes within visits
Ignores     everything that gives way but the axes
==========  ==========================================================================
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from bench.recording import Recording
from stiffness.arm import Arm
from stiffness.diagnosis.readings import Frames
from stiffness.standing import Standing
from stiffness.wrench import wrench_in_base

EXPLAINS = 0.8
"""Share of the deflection that springs and what gives way at once must explain
together in a reading that is believed; chosen: in trials of the bench they explain more
with every effect of the vocabulary."""
TENTH = 0.1
"""t0 over the rms of an axis' torque; chosen: play is closed by a tenth of it."""


@dataclass(frozen=True)
class Fit:
    """Springs that follow a load.

    Attributes:
        compliance: Of each axis by springs alone, in rad/(N m); none is negative.
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


def followed(some: Recording, arm: Arm, frames: Frames) -> Fit | None:
    """Fit what gives way.

    Args:
        some: Pairs of rows: before the load and under it.
        arm: The nominal arm, with the recording's names.
        frames: Where the tracker and the markers are.

    Returns:
        None where no marker was seen in both rows of a pair.
    """
    standing = arm.at(some.posture)
    points, sensor, tracker = some.points, some.wrench_sensor, some.tracker
    assert points is not None and sensor is not None and tracker is not None
    moved = (points[1::2] - points[::2]) @ frames.turn.T
    wrench = wrench_in_base(some, standing)
    torque = standing.load_torque(wrench, sensor.body, sensor.position)
    torque = torque[1::2] - torque[::2]
    size = TENTH * np.sqrt(np.mean(torque**2, axis=0))
    play = torque / np.maximum(np.abs(torque) + size, 1e-12)
    jacobian = jacobians(some, standing, frames)[::2]
    laws = [jacobian * law[:, None, None] for law in (torque, play)]
    columns = np.concatenate(laws, axis=3)
    seen = np.isfinite(moved).all(axis=2)
    if not seen.any():
        return None
    design, aim = columns[seen].reshape(-1, 2 * len(arm.axes)), moved[seen].ravel()
    size = np.linalg.norm(design, axis=0)
    size = np.where(size > 0, size, 1.0)
    axes = len(arm.axes)
    stacked = np.column_stack([design / size, aim])
    value, vector = np.linalg.eigh(stacked.T @ stacked)
    turned = np.sqrt(np.maximum(value, 0.0))[:, None] * vector.T  # fits alike
    _, rest = nnls(turned[:, :-1], turned[:, -1])
    springs, _ = nnls(turned[:, :axes], turned[:, -1])
    noise = 2.0 * np.sum(tracker.repeatability**2)
    count = seen.sum()
    return Fit(
        springs / size[:axes],
        float(np.sqrt(max(rest**2 / count - noise, noise / 10.0))),
        float(np.sqrt(max(aim @ aim / count - noise, 0.0))),
        springs**2 > 0.1 * (aim @ aim),
    )


def jacobians(some: Recording, standing: Standing, frames: Frames) -> np.ndarray:
    """Return (rows, markers, 3, axes), in m per rad."""
    placed = zip(some.markers, frames.place, strict=True)
    each = [standing.jacobian(marker.body, place) for marker, place in placed]
    return np.stack(each, axis=1)[:, :, :3]
