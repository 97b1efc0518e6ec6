"""Below what the instruments state of themselves no model can be proved.

==========  ==========================================================================
Equation    var = sum of the tracker's variances per frame (1 - 1/n where the mean over
            n rows of a visit is taken off) + trace(A W A'), A = Σ c_k s_k(p) t_k' how a
            marker answers to the wrench, W the sensor's covariance
Source      propagation of errors to first order
Valid       springs that are nearly linear
Ignores     errors of a whole visit, such as arrival and the force's direction, which
            no instrument here states
==========  ==========================================================================
"""

import numpy as np
from jaxtyping import Float

from bench.proving.columns import turned_by
from bench.proving.gauge import Gauge
from bench.proving.world import Assumed, Seen, World
from bench.rig import RIGID


def floor_of(
    world: World, assumed: Assumed, seen: Seen, gauge: Gauge
) -> tuple[Float[np.ndarray, " rows"], float]:
    """Return the mean square that noise leaves on a marker and on an encoder.

    Returns:
        Of a marker in every row, 3-D, in m²; of an angle, in rad².
    """
    recording = world.recording
    rows = world.replay.rows
    frames = np.ones(rows) if recording.frames is None else recording.frames
    square = np.zeros(rows)
    if recording.tracker is not None:
        square = np.sum(np.asarray(recording.tracker.repeatability) ** 2) / frames
    square = square + _through_the_wrench(world, assumed, seen)
    share = 1.0
    if not gauge.absolute:
        _, counts = np.unique(world.replay.visit, return_counts=True)
        share = 1.0 - 1.0 / counts[world.replay.visit]
    angle = recording.encoder_repeatability or 0.0
    return square * share, float(np.mean(angle**2 * share))


def _through_the_wrench(world: World, assumed: Assumed, seen: Seen) -> np.ndarray:
    spec = world.recording.wrench_sensor
    rows, markers = seen.point.shape[:2]
    if spec is None or world.recording.wrench is None or not markers:
        return np.zeros(rows)
    rig, states = assumed.rig, seen.states
    base, turn = world.base
    sensor = states.position[:, states.bodies.index("load_point")]
    sensor = (sensor - base) @ turn
    unit = np.ones((rows, len(rig.springs)))
    answer = np.zeros((rows, markers, 3, 6))
    for k in world.order:
        if rig.springs[k] >= RIGID:
            continue
        screw = turned_by(world, rig, seen, int(k), unit)
        joint = rig.nominal.joint(rig.anatomy.axes[k])
        b = states.bodies.index(rig.anatomy.links[k])
        along = states.rotation[:, b] @ joint.axis @ turn
        at = states.position[:, b] + states.rotation[:, b] @ joint.pos
        lever = sensor - (at - base) @ turn
        if rig.anatomy.slides[k]:
            torque = np.hstack([along, np.zeros_like(along)])
        else:
            torque = np.hstack([np.cross(along, lever), along])
        answer += screw[..., None] * torque[:, None, None] / rig.springs[k]
    return np.mean(np.sum((answer * spec.sigma) ** 2, axis=(2, 3)), axis=1)
