"""Inverse kinematics of ortho-parallel arms with a spherical wrist, in closed form.

==========  ==========================================================================
Equation    tan^2((t3 + psi) / 2) = ((c2 + k)^2 - r^2) / (r^2 - (c2 - k)^2), the law of
            cosines in half angles; k = |(a2, c3)|, psi = atan2(a2, c3)
Source      Brandstötter, Angerer, Hofbaur 2014, "An analytical solution of the inverse
            kinematics problem of industrial serial manipulators with an ortho-parallel
            basis and a spherical wrist"; the seven lengths are its parameters, the
            derivation here is our own, in half angles and atan2, exact near singular
            postures as well
Valid       six turning axes, A2 parallel to A3, A4 A5 A6 meet in one point
Ignores     joint limits, self-collision
==========  ==========================================================================

Internally, angles t are zero for the upright arm: t = sign * q - offset.
r is the distance from axis 2 to the wrist centre in the plane of the arm.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from bench.shared.errors import refuse

AXES = 6
SOLUTIONS = 8
ROUNDING = 1e-12  # m; chosen: so little out of reach is rounding, the arm stretches
ALIGNED = 1e-13  # chosen: sin(t5) below it is rounding; A4 and A6 are then one axis


@dataclass(frozen=True)
class OrthoParallelArm:
    """Geometry of an ortho-parallel arm: seven lengths, six zeros and six signs.

    Attributes:
        a1: From axis 1 forward to axis 2, in m.
        a2: From axis 3 forward to the forearm's axis, arm upright, in m.
        b: Sideways, along y, from axis 1 to the plane of the arm, in m.
        c1: Height of axis 2 above the base, in m.
        c2: From axis 2 to axis 3, in m.
        c3: From axis 3 along the forearm to the wrist centre, in m.
        c4: From the wrist centre to the flange, in m.
        offset: Zero of each axis, in rad.
        sign: Sense of each axis, +1 or -1.

    Raises:
        Unusable: Where a length is not finite, the upper arm or the forearm has
            none, or the zeros and signs are not six.
    """

    a1: float
    a2: float
    b: float
    c1: float
    c2: float
    c3: float
    c4: float
    offset: tuple[float, ...] = (0.0,) * AXES
    sign: tuple[int, ...] = (1,) * AXES

    def __post_init__(self):
        """Check the parameters, naming every fault."""
        faults = [
            f"{name} is {getattr(self, name)}, expected a finite length in m."
            for name in ("a1", "a2", "b", "c1", "c2", "c3", "c4")
            if not np.isfinite(getattr(self, name))
        ]
        if self.c2 <= 0 or np.hypot(self.a2, self.c3) <= 0:
            faults.append("c2 and the length of (a2, c3) must be above zero.")
        if len(self.offset) != AXES or not np.all(np.isfinite(self.offset)):
            faults.append(f"offset is {self.offset}, expected six angles in rad.")
        if len(self.sign) != AXES or not set(self.sign) <= {-1, 1}:
            faults.append(f"sign is {self.sign}, expected six of +1 or -1.")
        refuse("Ortho-parallel arm", faults)


def inverse(
    arm: OrthoParallelArm, base_from_flange: Float[np.ndarray, "*poses 4 4"]
) -> Float[np.ndarray, "*poses 8 6"]:
    """Return all eight postures that reach each transform, in rad within -pi to pi.

    Solution 4 s + 2 e + w: shoulder s = 0 faces the wrist, 1 has turned away; e = 0 has
    t3 + psi >= 0 (elbow up where the shoulder faces the wrist), 1 the other elbow; w =
    0 has t5 >= 0, 1 the flipped wrist. Where nothing reaches, the row is NaN. Where A4
    and A6 are one axis, t4 is 0 for w = 0. Poses of the flange are in m, with
    orthonormal rotations. The flange's z axis points out of it; with the arm upright
    (all t = 0) its axes are parallel to the base's.
    """
    flange = base_from_flange.reshape(-1, 4, 4)
    rotation = flange[:, :3, :3]
    x, y, z = (flange[:, :3, 3] - arm.c4 * rotation[:, :, 2]).T  # wrist centre, m
    solutions = np.full((len(flange), SOLUTIONS, AXES), np.nan)
    radius, side = np.hypot(x, y), abs(arm.b)
    depth = np.sqrt(np.maximum((radius - side) * (radius + side), 0.0))
    forearm, psi = np.hypot(arm.a2, arm.c3), np.arctan2(arm.a2, arm.c3)
    longest, shortest = arm.c2 + forearm, abs(arm.c2 - forearm)
    for index in range(SOLUTIONS):
        shoulder, elbow, flip = index // 4, index // 2 % 2, index % 2
        reach = -depth if shoulder else depth
        t1 = np.arctan2(y, x) - np.arctan2(arm.b, reach)
        out, up = reach - arm.a1, z - arm.c1
        r = np.hypot(out, up)
        bend = 2.0 * np.arctan2(
            np.sqrt(np.maximum((longest - r) * (longest + r), 0.0)),
            np.sqrt(np.maximum((r - shortest) * (r + shortest), 0.0)),
        )
        t3 = (-bend if elbow else bend) - psi
        across = arm.a2 * np.cos(t3) + arm.c3 * np.sin(t3)
        along = arm.c2 - arm.a2 * np.sin(t3) + arm.c3 * np.cos(t3)
        t2 = np.arctan2(out, up) - np.arctan2(across, along)
        forearm_from_base = np.swapaxes(_about_z(t1) @ _about_y(t2 + t3), -1, -2)
        wrist_angles = _wrist(forearm_from_base @ rotation, flipped=bool(flip))
        solution = np.stack([t1, t2, t3, *wrist_angles], axis=-1)
        reached = (r <= longest + ROUNDING) & (r >= shortest - ROUNDING)
        reached &= radius >= side - ROUNDING
        solutions[reached, index] = solution[reached]
    posture = (solutions + np.array(arm.offset)) * np.array(arm.sign)
    posture = np.arctan2(np.sin(posture), np.cos(posture)) + 0.0  # no negative zeros
    return posture.reshape(*base_from_flange.shape[:-2], SOLUTIONS, AXES)


def _wrist(
    forearm_from_flange: Float[np.ndarray, "poses 3 3"], flipped: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return t4, t5, t6, in rad, with R = Rz(t4) Ry(t5) Rz(t6).

    t5 and t6 are read after t4 is taken off, so they make up for any rounding in it.
    """
    across = forearm_from_flange[:, :2, 2]
    aligned = np.hypot(across[:, 0], across[:, 1]) < ALIGNED
    t4 = np.where(aligned, 0.0, np.arctan2(across[:, 1], across[:, 0]))
    t4 = t4 + np.pi if flipped else t4
    rest = np.swapaxes(_about_z(t4), -1, -2) @ forearm_from_flange
    t5 = np.arctan2(rest[:, 0, 2], rest[:, 2, 2])
    t6 = np.arctan2(rest[:, 1, 0], rest[:, 1, 1])
    return t4, t5, t6


def _about_y(angle: Float[np.ndarray, " poses"]) -> Float[np.ndarray, "poses 3 3"]:
    """Return rotations about y by angles in rad."""
    c, s, o, i = np.cos(angle), np.sin(angle), np.zeros_like(angle), np.ones_like(angle)
    return np.stack([c, o, s, o, i, o, -s, o, c], axis=-1).reshape(-1, 3, 3)


def _about_z(angle: Float[np.ndarray, " poses"]) -> Float[np.ndarray, "poses 3 3"]:
    """Return rotations about z by angles in rad."""
    c, s, o, i = np.cos(angle), np.sin(angle), np.zeros_like(angle), np.ones_like(angle)
    return np.stack([c, -s, o, s, c, o, o, o, i], axis=-1).reshape(-1, 3, 3)
