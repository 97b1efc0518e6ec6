"""A cell has room for a posture if no part is in the floor, a pulley or the trunk."""

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Bool, Float

from bench.anatomy import Anatomy
from bench.cell import Cell, reach

FLOOR = 0.08
"""Least height of a link's origin and of the hook above the base's foot, as a share of
the reach; chosen: a link is about that thick."""
TRUNK = 0.2
"""Least distance of the hook from the base's z axis, same share; chosen."""
PULLEY = 0.15
"""Least distance of the hook from a pulley, same share; chosen."""
FREE = np.pi
"""How far an axis without stops is turned either way, in rad; chosen: a whole turn."""
FREE_SLIDE = 0.5
"""How far one without stops slides either way, as a share of the reach; chosen."""


@dataclass(frozen=True)
class Room:
    """The room that an arm has in its cell.

    Attributes:
        model: The arm alone.
        arm: Its parts.
        cell: What is mounted around it.
    """

    model: mujoco.MjModel
    arm: Anatomy
    cell: Cell

    @property
    def limits(self) -> Float[np.ndarray, "axes 2"]:
        """Lowest and highest value of each axis, in rad (slides in m)."""
        joints = [self.model.joint(axis).id for axis in self.arm.axes]
        stops = self.model.jnt_limited[joints, None].astype(bool)
        slide = FREE_SLIDE * reach(self.model, self.arm)
        free = np.where(self.arm.slides, slide, FREE)
        limits = np.stack([-free, free], axis=1)
        return np.where(stops, self.model.jnt_range[joints], limits)

    def __call__(
        self, posture: Float[np.ndarray, "tried axes"]
    ) -> Bool[np.ndarray, " tried"]:
        """Say of each posture, in rad, whether there is room for it."""
        model, data = self.model, mujoco.MjData(self.model)
        scale = reach(model, self.arm)
        axes = [model.joint(axis).qposadr[0] for axis in self.arm.axes]
        carried = [
            model.body(link).id for link in (*self.arm.links[1:], self.arm.flange)
        ]
        base, flange = model.body(self.arm.base).id, model.body(self.arm.flange).id
        hook_in_flange = self.cell.sensor_position + np.array(self.cell.hook)
        room = np.zeros(len(posture), dtype=bool)
        for row, angles in enumerate(posture):
            data.qpos[axes] = angles
            mujoco.mj_kinematics(model, data)
            turn = data.xmat[base].reshape(3, 3)
            hook = data.xpos[flange] + data.xmat[flange].reshape(3, 3) @ hook_in_flange
            places = (np.vstack([data.xpos[carried], hook]) - data.xpos[base]) @ turn
            apart = np.linalg.norm(self.cell.pulley - places[-1], axis=1)
            room[row] = (
                places[:, 2].min() > FLOOR * scale
                and np.linalg.norm(places[-1, :2]) > TRUNK * scale
                and apart.min() > PULLEY * scale
            )
        return room
