"""Standard plans: the paper's Table 1 for a KR10, a tour of the joint range otherwise.

The table asks a KR10 R1100-2 for 61 joint-space and 90 Cartesian postures; any other
arm tours its own range of motion (`tour`).

Source: Wu et al. 2024, "Neural network-based transfer learning to improve stiffness
modeling of industrial robots with small experimental data sets", section 3.1, Table 1.
The table leaves open or contradicts itself, and here is what was chosen:

- Interval of A2: not given. 15 degrees gives 48 postures with A1 = 0 and, with the
  twelve of A1 = -15 and -30, 60 of the 61 (10 degrees would give 81).
- The 61st: not given. Home, A = (0, -90, 90, 0, 0, 0) degrees, A5 as nowhere else.
- A4 = 0 (text). A5 "adjusted according to the measurement": sixths of the most that is
  free, which is 90 degrees (Table 4), but no more than A3 + A5 = 180 degrees, where the
  flange is parallel to the upper arm and does not yet point into it. Never zero, where
  A4 and A6 are one axis; in an order that does not follow A2 or A3.
- A6 "adjusted" as well, yet near 0 (section 4.1): up to 30 degrees either way, which
  turns the hook beside its axis.
- Z: 300 to 800 mm, interval 300, number 3, cannot all be true. Range and number stand
  (they give the 90 of the text): 300, 550, 800 mm.
- Orientation in space: not given. Flange straight down, turned with A1, so that
  A4 = A6 = 0; A5 then runs from 0.8 to 90.2 degrees, which is the range of Table 4.
"""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float, Int

from bench import postures
from bench.inverse_kinematics import OrthoParallelArm, inverse
from bench.postures import Room
from bench.rig import Rig
from bench.shared.errors import Unusable
from bench.shared.plan import (
    DEFAULT_PATH,
    PULLEY_PLACES,
    LoadStep,
    Plan,
    evenly_spaced,
    mixed_pulleys,
    repeated,
)

# --- Table 1 of the paper -------------------------------------------------------------

KR10 = OrthoParallelArm(
    a1=0.025,
    a2=-0.025,
    b=0.0,
    c1=0.400,
    c2=0.560,
    c3=0.515,
    c4=0.090,
    offset=(0.0, -np.pi / 2, 0.0, 0.0, 0.0, 0.0),
    sign=(-1, 1, 1, -1, 1, -1),
)
"""The lengths follow from the joint frames in KUKA's description of the KR10 R1100-2
(github.com/kroshu/kuka_robot_descriptions, kr10_r1100_2_macro.xacro); angles are KUKA's
own, zero with the arm stretched forward. The flange's frame is KUKA's $FLANGE."""

LIMITS = np.deg2rad(
    [[-170, 170], [-190, 45], [-120, 156], [-185, 185], [-120, 120], [-350, 350]]
)
"""Lowest and highest angle of A1 to A6, in rad; same source."""

JOINT_SPACE_DEG = (
    (0, 0, -90, 0),
    (0, 30, -120, -30),
    (0, 60, -150, -30),
    (0, 90, -150, -60),
    (0, 120, -180, -60),
    (0, 150, -180, -60),
    (-15, 0, 0, 0),
    (-15, 30, -30, -30),
    (-15, 60, -30, -30),
    (-15, 90, -60, -60),
    (-15, 120, -60, -60),
    (-15, 150, -60, -60),
    (-30, 0, 0, 0),
    (-30, 30, -30, -30),
    (-30, 60, -30, -30),
    (-30, 90, -60, -60),
    (-30, 120, -60, -60),
    (-30, 150, -60, -60),
)
"""The rows of Table 1: A1, A3, then A2 from and to."""

A2_STEP_DEG = 15
A5_SIXTHS = (1, 4, 2, 5, 3, 6)
A6_DEG = (0, 30, -15, 15, -30)  # five against six: all pairs with A5 come up
HOME_DEG = (0, -90, 90, 0, 0, 0)
GRID_MM = (np.linspace(300, 800, 6), np.linspace(-300, 300, 5), (300, 550, 800))
FACING_ELBOW_UP = 0  # the first solution of `inverse`; its wrist has A5 >= 0


def joint_space_postures() -> Float[np.ndarray, "61 6"]:
    """Return the table's first group, in rad, home last."""
    postures = []
    for a1, a3, lowest, highest in JOINT_SPACE_DEG:
        for a2 in range(lowest, highest + 1, A2_STEP_DEG):
            sixths = A5_SIXTHS[len(postures) % len(A5_SIXTHS)]
            a5 = sixths / 6 * min(90, 180 - a3)
            a6 = A6_DEG[len(postures) % len(A6_DEG)]
            postures.append((a1, a2, a3, 0, a5, a6))
    return np.deg2rad([*postures, HOME_DEG])


def grid() -> Float[np.ndarray, "90 4 4"]:
    """Return where the flange shall be, base_from_flange in m: x slowest, z fastest."""
    x, y, z = (axis.ravel() for axis in np.meshgrid(*GRID_MM, indexing="ij"))
    transform = np.tile(np.eye(4), (len(x), 1, 1))
    transform[:, :3, 3] = np.stack([x, y, z], axis=-1) / 1e3
    away = np.arctan2(y, x)  # rad, how the arm is turned about the base's z
    transform[:, 0, 0], transform[:, 1, 0] = -np.cos(away), -np.sin(away)
    transform[:, 0, 1], transform[:, 1, 1] = -np.sin(away), np.cos(away)
    transform[:, 2, 2] = -1.0
    return transform


def cartesian_postures() -> Float[np.ndarray, "90 6"]:
    """Return the table's second group, in rad: arm facing the point, elbow up."""
    return inverse(KR10, grid())[:, FACING_ELBOW_UP]


def table_one_postures() -> Float[np.ndarray, "151 6"]:
    """Return all of Table 1, in rad, joint space first."""
    return np.concatenate([joint_space_postures(), cartesian_postures()])


def table_one_plan(
    poses: int = 151,
    path: tuple[LoadStep, ...] = DEFAULT_PATH,
    revisits: int = 0,
    pulleys: int = PULLEY_PLACES,
) -> Plan:
    """Return the experiment over Table 1: some of its 151 postures, evenly spaced.

    The path hangs on the hook in each; some are visited once more at the end; the rope
    is led over the pulleys in turn. The id of a pose is its row in the table, from 0.

    Raises:
        Unusable: Where the table has not that many postures.
    """
    table = table_one_postures()
    if not 1 <= poses <= len(table):
        fault = (
            f"{poses} postures, the table has {len(table)}; ask for 1 to {len(table)}, "
            "or spread more over the joint limits with bench.postures."
        )
        raise Unusable("Plan over Table 1", [fault])
    chosen = evenly_spaced(len(table), poses)
    once = Plan(
        name=f"Table 1, {poses} postures",
        posture=table[chosen],
        posture_id=chosen,
        pulley=mixed_pulleys(poses, pulleys),
        path=path,
    )
    return repeated(once, revisits)


# --- Tour of any arm ------------------------------------------------------------------


def tour(
    rig: Rig,
    poses: int,
    path: tuple[LoadStep, ...] = DEFAULT_PATH,
    revisits: int = 0,
    seed: int = 0,
    widest: float = postures.HALF_TURN,
) -> Plan:
    """Return a plan that shows all axes of an arm at work.

    A KR10 has the postures of Table 1, at most 151; those of other arms follow from the
    seed and turn an axis by `widest` at most, in rad, either way.

    Raises:
        Unusable: Where there are not that many postures, with what is in their way.
    """
    pulleys = len(rig.mounted.pulley)
    if is_kr10(rig):
        return table_one_plan(poses, path, revisits, pulleys)
    room = Room(rig.nominal, rig.anatomy, rig.mounted)
    posture = postures.spread_in(room, poses, seed, widest)
    name = f"{Path(rig.arm_file).stem}, {poses} postures"
    return repeated(once_each(name, rig, posture, path), revisits)


def once_each(
    name: str,
    rig: Rig,
    posture: Float[np.ndarray, "poses axes"],
    path: tuple[LoadStep, ...],
) -> Plan:
    """Return the plan that visits postures, in rad, once each, with pulleys in turn."""
    return Plan(name, posture, np.arange(len(posture)), _pulleys(rig, posture), path)


NEAR = 0.01
"""How far axes turn under loads, in rad (m on a slide); chosen: ten times a wind-up."""


def _pulleys(
    rig: Rig, posture: Float[np.ndarray, "poses axes"]
) -> Int[np.ndarray, " poses"]:
    """Return pulleys in turn, the next where the rope just leaves or touches one.

    A small turn then changes the direction of the pull at once, so that an arm under
    load may find no rest.
    """
    places = len(rig.mounted.pulley)
    pulley = mixed_pulleys(len(posture), places)
    model = replace(rig, effects=(), stiffness=None).model
    data, around = mujoco.MjData(model), posture.shape[1]
    axes = [model.joint(axis).qposadr[0] for axis in rig.anatomy.axes]
    tendons = [model.tendon(f"rope_{p}").id for p in range(places)]
    turns = NEAR * np.concatenate([np.eye(around), -np.eye(around)])
    for visit, angles in enumerate(posture):
        wrapped = []
        for near in rig.anatomy.following(angles + turns):
            data.qpos[axes] = near
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_tendon(model, data)
            wrapped.append(data.ten_wrapnum[tendons])
        steady = np.ptp(wrapped, axis=0) == 0
        inturn = (pulley[visit] + np.arange(places)) % places
        pulley[visit] = next((p for p in inturn if steady[p]), pulley[visit])
    return pulley


def spread_plan(name: str, rig: Rig, poses: int, path: tuple[LoadStep, ...]) -> Plan:
    """Return the plan of as many postures spread over all of the joints' ranges."""
    room = Room(rig.nominal, rig.anatomy, rig.mounted)
    return once_each(name, rig, postures.spread(room.limits, poses, 0, room), path)


def is_kr10(rig: Rig) -> bool:
    """Say whether an arm has the six ranges of motion of a KR10 R1100-2."""
    ranges = rig.nominal.jnt_range
    return ranges.shape == LIMITS.shape and np.allclose(
        ranges, LIMITS, rtol=0.0, atol=1e-6
    )
