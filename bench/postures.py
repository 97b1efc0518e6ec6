"""Configurations spread evenly over the joint range, free of collisions in the cell.

A cell has room for a posture if no part is in the floor, a pulley or the trunk.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Bool, Float
from scipy.stats import qmc

from bench.cell import Cell, reach
from bench.kinematic_chain import Anatomy
from bench.shared.errors import Unusable, refuse

# --- Room in the cell -----------------------------------------------------------------

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
    """The room that an arm has in its cell."""

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
        return np.logical_not(np.any(self.obstacles(posture), axis=1))

    def obstacles(
        self, posture: Float[np.ndarray, "tried axes"]
    ) -> Bool[np.ndarray, "tried 3"]:
        """Say of each posture, in rad, what is in its way: floor, trunk, pulley.

        Axes that follow others are where those have them, wherever the posture does.
        """
        model, data = self.model, mujoco.MjData(self.model)
        posture = self.arm.following(posture)
        scale = reach(model, self.arm)
        axes = [model.joint(axis).qposadr[0] for axis in self.arm.axes]
        carried = [
            model.body(link).id for link in (*self.arm.links[1:], self.arm.flange)
        ]
        base, flange = model.body(self.arm.base).id, model.body(self.arm.flange).id
        hook_in_flange = self.cell.sensor_position + np.array(self.cell.hook)
        blocked = np.zeros((len(posture), 3), dtype=bool)
        for row, angles in enumerate(posture):
            data.qpos[axes] = angles
            mujoco.mj_kinematics(model, data)
            turn = data.xmat[base].reshape(3, 3)
            hook = data.xpos[flange] + data.xmat[flange].reshape(3, 3) @ hook_in_flange
            places = (np.vstack([data.xpos[carried], hook]) - data.xpos[base]) @ turn
            apart = np.linalg.norm(self.cell.pulley - places[-1], axis=1)
            blocked[row] = (
                places[:, 2].min() <= FLOOR * scale,
                np.linalg.norm(places[-1, :2]) <= TRUNK * scale,
                apart.min() <= PULLEY * scale,
            )
        return blocked


# --- Spread of configurations ---------------------------------------------------------

CENTRAL = 0.8  # chosen: a tenth of the range is kept free at either stop
CANDIDATES = 1000  # chosen: tried per posture before the wish is called infeasible

HALF_TURN = np.pi
"""How far axes turn either way where nothing else is asked for, in rad; chosen: that
shows a whole turn, and the cables and hoses of many arms allow no more."""


def within(
    limits: Float[np.ndarray, "axes 2"],
    slides: Sequence[bool],
    widest: float = HALF_TURN,
) -> Float[np.ndarray, "axes 2"]:
    """Return limits that let no axis turn further than asked for; slides stay.

    In rad (slides in m); from the middle of an axis' range where that lies beyond
    `widest` either way from zero.

    Raises:
        Unusable: Where that is no angle above zero.
    """
    if not widest > 0.0:
        fault = f"axes may turn by {np.rad2deg(widest):g}°, expected above 0."
        raise Unusable("Spread of postures", [fault])
    narrow = np.clip(limits, -widest, widest)
    middle, half = limits.mean(axis=1), np.diff(limits, axis=1)[:, 0] / 2.0
    half = np.minimum(half, widest)
    beyond = narrow[:, 0] >= narrow[:, 1]
    narrow[beyond] = np.stack([middle - half, middle + half], axis=1)[beyond]
    return np.where(np.array(slides, bool)[:, None], limits, narrow)


Feasible = Callable[[Float[np.ndarray, "tried axes"]], Bool[np.ndarray, " tried"]]
"""Says of each posture, in rad, whether the cell has room for it."""


def anywhere(posture: Float[np.ndarray, "tried axes"]) -> Bool[np.ndarray, " tried"]:
    """Say of each posture that there is room for it."""
    return np.ones(len(posture), dtype=bool)


def spread(
    limits: Float[np.ndarray, "axes 2"],
    count: int,
    seed: int,
    feasible: Feasible = anywhere,
    central: float = CENTRAL,
) -> Float[np.ndarray, "count axes"]:
    """Return postures of low discrepancy within the central part of the limits.

    Scrambled Halton points (Owen 2017, "A randomized Halton algorithm in R", as in
    `scipy.stats.qmc`), of which the infeasible are passed over. The same seed gives the
    same postures, and fewer of them are the first of more. Limits are in rad (slides in
    m), of which the central share is used.

    Raises:
        Unusable: Where limits are not finite or in order, the share or the count is out
            of range, or too few postures are feasible.
    """
    faults = [
        f"limits of axis a{axis} are {low} to {high}, expected finite and rising; "
        "for an axis without stops give the part that shall be used."
        for axis, (low, high) in enumerate(limits, start=1)
        if not (np.isfinite(low) and np.isfinite(high) and low < high)
    ]
    if not 0.0 < central <= 1.0:
        faults.append(f"central is {central}, expected above 0 and at most 1.")
    if count < 1:
        faults.append(f"count is {count}, expected at least 1.")
    refuse("Spread of postures", faults)
    middle, half = limits.mean(axis=1), np.diff(limits, axis=1)[:, 0] / 2.0
    points = qmc.Halton(len(limits), rng=np.random.default_rng(seed))
    found = np.empty((0, len(limits)))
    tried = 0
    while len(found) < count and tried < CANDIDATES * count:
        batch = middle + central * half * (2.0 * points.random(4 * count) - 1.0)
        found = np.concatenate([found, batch[feasible(batch)]])
        tried += len(batch)
    if len(found) < count:
        fault = (
            f"of {tried} postures tried only {len(found)} were feasible, {count} were "
            "asked for; widen the limits, raise `central` or ask for fewer."
        )
        raise Unusable("Spread of postures", [fault])
    return found[:count]


SAMPLE = 400
"""Postures of which it is said what is in their way; chosen."""


def spread_in(
    room: Room, count: int, seed: int, widest: float = HALF_TURN
) -> Float[np.ndarray, "count axes"]:
    """Return postures of low discrepancy for which a cell has room; see `spread`.

    Raises:
        Unusable: Where there are too few, with what is in the way of the others.
    """
    limits = within(room.limits, room.arm.slides, widest)
    try:
        return room.arm.following(spread(limits, count, seed, room))
    except Unusable as error:
        tried = spread(limits, SAMPLE, seed)
        scale = 1e3 * reach(room.model, room.arm)
        floor, trunk, pulley = room.obstacles(tried).mean(axis=0)
        fault = (
            f"Of the postures {floor:.0%} bring a link or the hook to less than "
            f"{FLOOR * scale:.0f} mm above the base's foot, {trunk:.0%} the hook to "
            f"within {TRUNK * scale:.0f} mm of the base's z axis, and {pulley:.0%} to "
            f"within {PULLEY * scale:.0f} mm of a pulley; "
        )
        fault += (
            "no posture carries the hook away from the base's z axis: a rope cannot "
            "load such an arm; check the directions of its axes and its lengths."
            if trunk == 1.0
            else "check the base's frame (z is up), the joints' ranges and the lengths."
        )
        raise Unusable(error.what, [*error.faults, fault]) from None
