"""A KR10 tours the paper's table of postures, any other arm its own range of motion."""

from pathlib import Path

import numpy as np

from bench import postures, table_one
from bench.load_path import LoadStep
from bench.plan import DEFAULT_PATH, Plan, mixed_pulleys, repeated
from bench.rig import Rig
from bench.room import Room


def tour(
    rig: Rig,
    poses: int,
    path: tuple[LoadStep, ...] = DEFAULT_PATH,
    revisits: int = 0,
    seed: int = 0,
) -> Plan:
    """Return a plan that shows all axes of an arm at work.

    Args:
        rig: The arm and its cell.
        poses: How many postures; a KR10's table has 151.
        path: What hangs on the hook in each.
        revisits: How many of them are visited once more at the end.
        seed: Of the postures, where they are spread.

    Raises:
        Unusable: Where there are not that many postures.
    """
    pulleys = len(rig.mounted.pulley)
    if is_kr10(rig):
        return table_one.plan(poses, path, revisits, pulleys)
    room = Room(rig.nominal, rig.anatomy, rig.mounted)
    once = Plan(
        name=f"{Path(rig.arm_file).stem}, {poses} postures",
        posture=postures.spread(room.limits, poses, seed, room),
        pose=np.arange(poses),
        pulley=mixed_pulleys(poses, pulleys),
        path=path,
    )
    return repeated(once, revisits)


def is_kr10(rig: Rig) -> bool:
    """Say whether an arm has the six ranges of motion of a KR10 R1100-2."""
    ranges = rig.nominal.jnt_range
    return ranges.shape == table_one.LIMITS.shape and np.allclose(
        ranges, table_one.LIMITS, rtol=0.0, atol=1e-6
    )
