"""Forward kinematics, Jacobians and joint torques of a chain in many configurations.

==========  ==========================================================================
Equation    base_from_k = base_from_parent before_k Rz(q_k), a slide: … Tz(q_k)
            column k of J at p: [z_k x (p - o_k); z_k], a slide: [z_k; 0]
            load torque = J^T wrench; gravity torque_k = sum_b m_b J_b,k . g
Source      Siciliano et al. 2009, "Robotics: Modelling, Planning and Control",
            sections 2.7, 3.1 and 7.3
Valid       rigid links; a tree of hinges and slides
Ignores     friction, elasticity, motion
==========  ==========================================================================
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from bench.shared.recording import Payload
from stiffness.robot.chain import Chain, Place

# --- Point Jacobian -------------------------------------------------------------------


def point_jacobian(
    point: Float[np.ndarray, "*many 3"],
) -> Float[np.ndarray, "*many 3 6"]:
    """Return the matrix from a twist to a point's displacement: [1, -point x]."""
    many = point.shape[:-1]
    taken = np.zeros((*many, 3, 6))
    taken[..., range(3), range(3)] = 1.0
    x, y, z = point[..., 0], point[..., 1], point[..., 2]
    taken[..., 0, 4], taken[..., 0, 5] = z, -y
    taken[..., 1, 3], taken[..., 1, 5] = -z, x
    taken[..., 2, 3], taken[..., 2, 4] = y, -x
    return taken


# --- Standing -------------------------------------------------------------------------


@dataclass(frozen=True)
class ArmState:
    """A chain in many postures at once, everything along the base's axes.

    Attributes:
        chain: Axes, bodies and masses.
        attachment: Function from a body's name to its attachment.
        rotation: Rotation of each axis' frame.
        origin: Origin of each axis' frame, in m.
    """

    chain: Chain
    attachment: Callable[[str], Place]
    rotation: Float[np.ndarray, "axes cases 3 3"]
    origin: Float[np.ndarray, "axes cases 3"]

    @classmethod
    def of(
        cls,
        chain: Chain,
        attachment: Callable[[str], Place],
        posture: Float[np.ndarray, "cases axes"],
    ) -> "ArmState":
        """Return the chain with every axis at its coordinate."""
        cases, axes = posture.shape
        rotation = np.empty((axes, cases, 3, 3))
        origin = np.empty((axes, cases, 3))
        cos, sin = np.cos(posture), np.sin(posture)
        for k in chain.order:
            before, carrier = chain.before[k, :3], chain.parent[k]
            if carrier < 0:
                frame = np.broadcast_to(before, (cases, 3, 4))
                start = frame[:, :, 3]
            else:
                frame = rotation[carrier].reshape(-1, 3) @ before
                frame = frame.reshape(cases, 3, 4)
                start = origin[carrier] + frame[:, :, 3]
            x, y, z = frame[:, :, 0], frame[:, :, 1], frame[:, :, 2]
            if chain.slides[k]:
                rotation[k] = frame[:, :, :3]
                origin[k] = start + posture[:, k, None] * z
                continue
            c, s = cos[:, k, None], sin[:, k, None]
            rotation[k, :, :, 0] = c * x + s * y
            rotation[k, :, :, 1] = c * y - s * x
            rotation[k, :, :, 2] = z
            origin[k] = start
        return cls(chain, attachment, rotation, origin)

    def take(self, cases: np.ndarray) -> "ArmState":
        """Return the chain in some of the postures (indices or a mask)."""
        rotation, origin = self.rotation[:, cases], self.origin[:, cases]
        return ArmState(self.chain, self.attachment, rotation, origin)

    def placement(self, body: str) -> Float[np.ndarray, "cases 4 4"]:
        """Return a body's transforms to the base's frame, in m."""
        place = self.attachment(body)
        cases = self.origin.shape[1]
        if place.axis < 0:
            return np.tile(place.placement, (cases, 1, 1))
        moved = np.zeros((cases, 4, 4))
        moved[:, :3, :3] = self.rotation[place.axis]
        moved[:, :3, 3] = self.origin[place.axis]
        moved[:, 3, 3] = 1.0
        return moved @ place.placement

    def turn(self, body: str) -> Float[np.ndarray, "cases 3 3"]:
        """Return the rotations from a body's axes to the base's."""
        return self.placement(body)[:, :3, :3]

    def point(
        self, body: str, position: Float[np.ndarray, "*cases 3"]
    ) -> Float[np.ndarray, "cases 3"]:
        """Return a point of a body in the base's frame, in m.

        Args:
            body: The body's name.
            position: The point in the body's frame, one for all cases or one each, m.
        """
        place = self.attachment(body)
        inner = position @ place.placement[:3, :3].T + place.placement[:3, 3]
        if place.axis < 0:
            return np.broadcast_to(inner, self.origin.shape[1:]).copy()
        turned = (self.rotation[place.axis] @ inner[..., None])[..., 0]
        return self.origin[place.axis] + turned

    def jacobian(
        self, body: str, position: Float[np.ndarray, "*cases 3"]
    ) -> Float[np.ndarray, "cases 6 axes"]:
        """Return the geometric Jacobian at a point of a body.

        Rows 0 to 2: velocity of the point, in m/rad; rows 3 to 5: angular velocity of
        the body; both along the base's axes.
        """
        columns = np.zeros((self.origin.shape[1], 6, len(self.origin)))
        point = self.point(body, position)
        for k in self.chain.carriers(self.attachment(body).axis):
            along = self.rotation[k, :, :, 2]
            if self.chain.slides[k]:
                columns[:, :3, k] = along
            else:
                columns[:, :3, k] = cross(along, point - self.origin[k])
                columns[:, 3:, k] = along
        return columns

    def load_torque(
        self,
        wrench_in_base: Float[np.ndarray, "cases 6"],
        body: str,
        position: Float[np.ndarray, "*cases 3"],
    ) -> Float[np.ndarray, "cases axes"]:
        """Return the torque that a wrench exerts on the axes: J^T wrench, in N m.

        Args:
            wrench_in_base: Force, then torque about the point, along the base's axes.
            body: The body it acts on.
            position: The point in the body's frame, in m.
        """
        jacobian = self.jacobian(body, position)
        return np.einsum("cia,ci->ca", jacobian, wrench_in_base)

    def masses(
        self, payload: Payload | None = None
    ) -> tuple[
        list[int], Float[np.ndarray, " masses"], Float[np.ndarray, "masses cases 3"]
    ]:
        """Return the masses that the axes carry: their axis, size in kg and place in m.

        Args:
            payload: A mass mounted on the flange.
        """
        chain = self.chain
        bodies = (self.rotation @ chain.centre[:, None, :, None])[..., 0] + self.origin
        axes, mass = list(range(len(chain.mass))), chain.mass
        if payload is not None and payload.mass:
            bodies = np.concatenate([bodies, self.point("flange", payload.com)[None]])
            mass = np.append(mass, payload.mass)
            axes.append(self.attachment("flange").axis)
        return axes, mass, bodies

    def gravity_torque(
        self, payload: Payload | None = None
    ) -> Float[np.ndarray, "cases axes"]:
        """Return the torque that gravity exerts on the axes, in N m.

        A motor that holds the arm exerts the opposite.

        Args:
            payload: A mass mounted on the flange.
        """
        chain = self.chain
        axes, mass, bodies = self.masses(payload)
        carried = np.zeros((len(self.origin), len(mass)))  # by each axis, of each body
        for body, axis in enumerate(axes):
            carried[chain.carriers(axis), body] = mass[body]
        total = carried.sum(axis=1)
        moment = np.tensordot(carried, bodies, 1) - total[:, None, None] * self.origin
        turning = moment @ _times(chain.gravity)
        sliding = total[:, None, None] * chain.gravity
        pull = np.where(chain.slides[:, None, None], sliding, turning)
        return np.einsum("kci,kci->ck", self.rotation[:, :, :, 2], pull)


def _times(vector: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """Return the matrix M with row @ M = row x vector."""
    return np.cross(np.eye(3), vector)


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the cross products of rows; three times as fast as numpy's own."""
    product = np.empty_like(b)
    product[:, 0] = a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1]
    product[:, 1] = a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]
    product[:, 2] = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return product
