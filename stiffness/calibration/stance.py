"""The arm as drawn so far, standing in every posture, with what gravity does to it."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from stiffness.calibration import geometry
from stiffness.calibration.readings import Readings
from stiffness.standing import Standing


@dataclass(frozen=True)
class Drawn:
    """All that a rigid prediction needs.

    Attributes:
        values: Of the drawing's numbers, see `geometry.entries_of`.
        base_from_tracker: In m.
        places: Of targets in their bodies' frames, in m.
    """

    values: Float[np.ndarray, " entries"]
    base_from_tracker: Float[np.ndarray, "4 4"]
    places: Float[np.ndarray, "markers 3"]

    def stepped(self, step: Float[np.ndarray, " silent"]) -> "Drawn":
        """Move on by a step of entries, of the frame (3 + 3) and of the places."""
        n = len(self.values)
        away = np.eye(4)
        away[:3, :3] = Rotation.from_rotvec(-step[n + 3 : n + 6]).as_matrix()
        away[:3, 3] = -step[n : n + 3]
        return Drawn(
            self.values + step[:n],
            away @ self.base_from_tracker,
            self.places + step[n + 6 :].reshape(-1, 3),
        )


@dataclass(frozen=True)
class Stance:
    """Where targets should be, and every lever that could move them.

    Attributes:
        readings: What was seen.
        drawn: What the arm is taken to be.
        standing: The arm in the rows' postures.
        point: Where the targets should be, in the base's frame, in m.
        carried: Of each target, the axes that carry it.
    """

    readings: Readings
    drawn: Drawn
    standing: Standing
    point: Float[np.ndarray, "rows 3"]
    carried: tuple[tuple[int, ...], ...]

    @classmethod
    def of(cls, readings: Readings, drawn: Drawn) -> "Stance":
        """Stand the arm as drawn."""
        arm = readings.arm
        axes = len(arm.axes)
        chain = geometry.redrawn(arm.chain, drawn.values)
        drawn_arm = replace(arm, chain=chain)
        standing = drawn_arm.at(readings.posture + drawn.values[:axes])
        point = np.zeros_like(readings.seen)
        carried = []
        for m, body in enumerate(readings.bodies):
            own = readings.marker == m
            point[own] = standing.point(body, drawn.places[m])[own]
            carried.append(tuple(chain.carriers(drawn_arm.place(body).axis)))
        return cls(readings, drawn, standing, point, tuple(carried))

    @cached_property
    def residual(self) -> Float[np.ndarray, "rows 3"]:
        """Seen less said, along the base's axes, in m."""
        frame = self.drawn.base_from_tracker
        return self.readings.seen @ frame[:3, :3].T + frame[:3, 3] - self.point

    @cached_property
    def lever(self) -> Float[np.ndarray, "axes rows 3"]:
        """How targets move per unit of each axis."""
        axes = range(len(self.standing.chain.parent))
        return np.stack([self._by_marker(geometry.turning, k) for k in axes])

    @cached_property
    def moment(self) -> Float[np.ndarray, "axes rows 3"]:
        """Moment of gravity, the tool's too, about each axis' origin, in N m."""
        standing, chain = self.standing, self.standing.chain
        masses = standing.masses(self.readings.tool)
        moment = np.zeros_like(standing.origin)
        for axis, mass, at in zip(*masses, strict=True):
            for k in chain.carriers(axis):
                arm = at - standing.origin[k]
                moment[k] += np.cross(arm, mass * chain.gravity)
        return moment

    @cached_property
    def torque(self) -> Float[np.ndarray, "rows axes"]:
        """Gravity's torque about each axis, in N m (N along one that slides)."""
        return self.standing.gravity_torque(self.readings.tool)

    def tilting(self, axis: int, about: Float[np.ndarray, "rows 3"]) -> np.ndarray:
        """Return how targets move per turn of an axis' seat about a direction."""
        moved = np.cross(about, self.point - self.standing.origin[axis])
        return np.where(self._hangs_on(axis)[:, None], moved, 0.0)

    def silent(self) -> Float[np.ndarray, "rows 3 silent"]:
        """Return how predictions move with entries, frame and places."""
        entries = geometry.columns
        drawing = np.zeros((*self.point.shape, len(self.drawn.values)))
        places = np.zeros((*self.point.shape, 3 * len(self.readings.bodies)))
        for m, body in enumerate(self.readings.bodies):
            own = self.readings.marker == m
            drawing[own] = entries(self.standing, self.point, self.carried[m])[own]
            places[own, :, 3 * m : 3 * m + 3] = self.standing.turn(body)[own]
        frame = np.zeros((*self.point.shape, 6))
        frame[:, :, :3] = np.eye(3)
        for j, along in enumerate(np.eye(3)):
            frame[:, :, 3 + j] = np.cross(along, self.point)
        return np.concatenate([drawing, frame, places], axis=2)

    def _hangs_on(self, axis: int) -> np.ndarray:
        hangs = np.array([axis in carried for carried in self.carried])
        return hangs[self.readings.marker]

    def _by_marker(self, function, axis: int) -> Float[np.ndarray, "rows 3"]:
        moved = function(self.standing, self.point, axis, range(len(self.moment)))
        return np.where(self._hangs_on(axis)[:, None], moved, 0.0)
