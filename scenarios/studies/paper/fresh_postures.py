"""Fresh postures of the paper's region, with their true deflections.

The region is that of the paper's Table 1. A fresh posture of its first group lies
within half a step of one of that group's postures, one of its second group in the
box of its grid, flange straight down. As in the experiment, 60 : 90 are of the first :
second.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from bench import standard_plans
from bench.experiment import record
from bench.instruments import ForceSensor, Instruments, Tracker
from bench.inverse_kinematics import inverse
from bench.postures import Room, spread
from bench.rig import Rig
from bench.shared.plan import DEFAULT_PATH, Plan, mixed_pulleys
from stiffness.experiment.deflections import LoadCases, one_per_pose
from stiffness.robot.arm import Arm

SILENT = Instruments(
    tracker=Tracker(noise=0.0, frame_error=(0.0,) * 6),
    force_sensor=ForceSensor(noise=0.0),
)
UP_TO_LOAD = DEFAULT_PATH[:5]
"""The experiment's path up to its first reading under the full load."""
STEPS_DEG = (15.0, 15.0, 30.0, 0.0, 15.0, 15.0)
"""Steps of Table 1's first group by axis; those of A5 and A6 were chosen there."""
GRID = np.array([[0.3, 0.8], [-0.3, 0.3], [0.3, 0.8]])
"""Limits of the grid of Table 1's second group along x, y, z, in m."""


@dataclass(frozen=True)
class Unseen:
    """Fresh load cases and their true deflections.

    Attributes:
        cases: Postures and loads.
        deflection: True, without noise, in m, along the base's axes.
    """

    cases: LoadCases
    deflection: Float[np.ndarray, "cases 3"]


def unseen(rig: Rig, arm: Arm, count: int, seed: int) -> Unseen:
    """Simulate fresh poses, each under its full load for the first time.

    Args:
        rig: The truth.
        arm: The nominal arm.
        count: Number of poses.
        seed: Of the postures.
    """
    plan = fresh_plan(fresh_postures(rig, count, seed), seed)
    seen = one_per_pose(arm, record(rig, plan, SILENT, seed))
    return Unseen(seen.cases, seen.deflection)


def fresh_plan(posture: Float[np.ndarray, "count 6"], seed: int) -> Plan:
    """Return the plan that visits fresh postures, with pulleys in another order."""
    count = len(posture)
    return Plan(
        f"{count} fresh postures",
        posture,
        np.arange(count),
        np.random.default_rng(seed).permutation(mixed_pulleys(count)),
        UP_TO_LOAD,
    )


def fresh_postures(rig: Rig, count: int, seed: int) -> Float[np.ndarray, "count 6"]:
    """Return postures of the experiment's region without collisions, in rad."""
    room = Room(rig.nominal, rig.anatomy, rig.mounted)
    second = round(count * 90 / 150)
    inside = spread(GRID, second, seed, lambda p: room(facing_down(p)), central=1.0)
    box = np.array([[0.0, 1.0]] * 6)
    near = spread(box, count - second, seed, lambda u: room(_near(u)), central=1.0)
    return np.concatenate([_near(near), facing_down(inside)])


def facing_down(place: Float[np.ndarray, "rows 3"]) -> Float[np.ndarray, "rows 6"]:
    """Return postures with the flange at positions in m, as Table 1's second group."""
    transform = np.tile(np.eye(4), (len(place), 1, 1))
    away = np.arctan2(place[:, 1], place[:, 0])
    transform[:, 0, 0], transform[:, 1, 0] = -np.cos(away), -np.sin(away)
    transform[:, 0, 1], transform[:, 1, 1] = -np.sin(away), np.cos(away)
    transform[:, 2, 2] = -1.0
    transform[:, :3, 3] = place
    return inverse(standard_plans.KR10, transform)[:, standard_plans.FACING_ELBOW_UP]


def _near(unit: Float[np.ndarray, "rows 6"]) -> Float[np.ndarray, "rows 6"]:
    """Turn numbers from 0 to 1 into postures near those of the first group.

    The number of the axis that does not move chooses the posture of the table.
    """
    table = standard_plans.joint_space_postures()[:-1]  # home stands alone
    still = STEPS_DEG.index(0.0)
    row = np.minimum((unit[:, still] * len(table)).astype(int), len(table) - 1)
    posture = table[row] + np.deg2rad(STEPS_DEG) * (unit - 0.5)
    low, high = table.min(axis=0), table.max(axis=0)
    return np.clip(posture, low, high)
