"""A small exact simulator of arms with joint springs, without the bench."""

from dataclasses import replace

import numpy as np

from bench.shared.recording import (
    LOADED,
    UNLOADED,
    Marker,
    Payload,
    Recording,
    TrackerSpec,
    WrenchSpec,
)
from stiffness.robot.arm import Arm
from stiffness.robot.equilibrium import equilibrium

TABLE_3 = np.array([50.90e3, 63.36e3, 50.34e3, 2.27e3, 8.89e3, 1.39e3])
"""Wu et al. 2024, Table 3, in N m/rad."""
PLACES = np.array([[60, 0, 5], [30, 35, 5], [30, -35, 5], [10, 10, 30]]) * 1e-3
HOOK = np.array([0.04, 0.03, 0.06])
"""Point where the rope pulls, in the flange's frame, in m; beside the last axis."""
BASE_FROM_TRACKER = np.array(
    [[0.0, -1.0, 0.0, 2.1], [0.8, 0.0, -0.6, 0.3], [0.6, 0.0, 0.8, 0.9], [0, 0, 0, 1.0]]
)


def postures(arm: Arm, count: int, seed: int) -> np.ndarray:
    """Draw postures in the working range of a bench, away from the limits, in rad."""
    low = np.deg2rad([-60, -120, 40, -90, -80, -120])
    high = np.deg2rad([60, -40, 120, 90, 80, 120])
    return np.random.default_rng(seed).uniform(low, high, (count, len(arm.axes)))


def cartesian_compliance(
    arm: Arm, posture: np.ndarray, compliance: np.ndarray, point_in_flange: np.ndarray
) -> np.ndarray:
    """Return C_X = J diag(compliance) J^T of small deflections, Wu et al. 2024, Eq. 6.

    Args:
        arm: Kinematics.
        posture: One row per pose, in rad.
        compliance: Of each axis, in rad/(N m).
        point_in_flange: Point where the wrench acts and displacement is taken, in m.

    Returns:
        Displacement (m, rad) per wrench (N, N m), along the base's axes, 6 x 6 a pose.
    """
    jacobian = arm.jacobian(posture, "flange", point_in_flange)
    return (jacobian * compliance) @ jacobian.swapaxes(1, 2)


def record(
    arm: Arm,
    posture: np.ndarray,
    forces: np.ndarray,
    *,
    compliance: np.ndarray = 1.0 / TABLE_3,
    noise: np.random.Generator | None = None,
    hook: np.ndarray = HOOK,
    tool: Payload | None = None,
    tracker_noise: float = 10e-6,
    places: np.ndarray = PLACES,
    frame: str = "sensor",
) -> Recording:
    """Pull at the hook with forces along the base's axes, one unloaded reading first.

    Args:
        arm: Kinematics and masses.
        posture: One row per pose, in rad.
        forces: Poses x plateaus x 3, in N.
        compliance: True compliance of each axis, in rad/(N m).
        noise: Generator of the instruments' errors; None: they have none.
        hook: Point where the force acts, in the flange's frame, in m.
        tool: Payload that the model does not have.
        tracker_noise: One sigma per coordinate, in m.
        places: Markers in the flange's frame, in m.
        frame: Axes along which the force sensor reports.
    """
    poses, plateaus = forces.shape[:2]
    pulled = np.concatenate([np.zeros((poses, 1, 3)), forces], axis=1).reshape(-1, 3)
    held = np.repeat(posture, plateaus + 1, axis=0)
    wrench = np.concatenate([pulled, np.zeros_like(pulled)], axis=1)
    rest = equilibrium(arm, held, compliance, wrench, hook, tool)
    standing = arm.at(rest)
    origin = np.array([0.0, 0.0, 0.02])
    lever = standing.point("flange", hook) - standing.point("flange", origin)
    seen = np.concatenate([pulled, np.cross(lever, pulled)], axis=1)
    if frame == "sensor":
        turn = standing.turn("flange")
        parts = [np.einsum("cji,cj->ci", turn, seen[:, k : k + 3]) for k in (0, 3)]
        seen = np.concatenate(parts, axis=1)
    in_base = np.stack([standing.point("flange", place) for place in places], axis=1)
    turn = BASE_FROM_TRACKER[:3, :3]
    points = (in_base - BASE_FROM_TRACKER[:3, 3]) @ turn
    if noise is not None:
        points = points + tracker_noise * noise.standard_normal(points.shape)
        sigma = np.repeat([0.04, 0.002], 3)
        seen = seen + sigma * noise.standard_normal(seen.shape)
    rows = len(held)
    stage = np.where(np.arange(rows) % (plateaus + 1) == 0, UNLOADED, LOADED)
    visit = np.repeat(np.arange(poses), plateaus + 1)
    return Recording(
        name="small truth",
        time=np.arange(rows, dtype=float),
        posture_id=visit,
        visit=visit,
        posture=held,
        load_time=np.maximum(np.arange(rows, dtype=float) - 1.0, 0.0),
        stage=stage,
        wrench=seen,
        markers=tuple(Marker(f"m{k}", "flange", p) for k, p in enumerate(places)),
        points=points,
        base_from_tracker=BASE_FROM_TRACKER,
        tracker=TrackerSpec(np.full(3, tracker_noise)),
        wrench_sensor=WrenchSpec(
            accuracy_force=0.04,
            accuracy_torque=0.002,
            position=origin,
            frame="sensor" if frame == "sensor" else "base",
        ),
        tool=tool,
    )


def pulls(poses: int, plateaus: int, seed: int) -> np.ndarray:
    """Draw forces of 40 to 100 N in every direction: poses x plateaus x 3."""
    draw = np.random.default_rng(seed)
    towards = draw.standard_normal((poses, plateaus, 3))
    towards /= np.linalg.norm(towards, axis=2, keepdims=True)
    return towards * draw.uniform(40.0, 100.0, (poses, plateaus, 1))


def permuted(recording: Recording, order: np.ndarray) -> Recording:
    """Return a recording with its visits in another order, times unchanged."""
    rows = np.concatenate([np.flatnonzero(recording.visit == v) for v in order])
    shuffled = recording.take(rows)
    return replace(shuffled, time=recording.time, load_time=recording.load_time)
