"""Bending and torsion of a link under load, as of a beam.

==========  ==========================================================================
Equation    a force F across the end: deflection F L³/3EI, slope F L²/2EI; a moment M:
            slope M L/EI, deflection M L²/2EI; a torque T along it: twist T L/GJ
            at a share s of the way, d and m L the end's deflection and slope across:
            deflection (3 s² - 2 s³) d + (s³ - s²) m L, twist s T L/GJ
            EI = bending_nm2 about u (`_directions`), bending_ratio of it about v
Source      Euler-Bernoulli beam, held at one axis and loaded at the next; size: an
            aluminium tube of 150 mm with 8 mm wall, EI = 6.3e5 N m², GJ = 4.7e5 N m²
            (chosen; cast links differ)
Valid       small deflections; a straight link of one section
Ignores     shear, stretch, the bend under the link's own distributed weight; where
            bearings sit: the beam goes from joint origin to joint origin of the model
            (on the KR10's link_4 that is 9 degrees off the forearm's centre line)
==========  ==========================================================================
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation
from typing_extensions import override

from bench.effects.effect import ModelEffect, assumed, optional, size
from bench.effects.springs import add_spring, frame_along
from bench.kinematic_chain import Anatomy, pose_in
from bench.shared.errors import Unusable

ALONG = 1e-3
"""Part of an axis across a link below which it tells no direction there; chosen."""


@dataclass(frozen=True)
class LinkBending(ModelEffect):
    """Hinges L/EI and L/GJ at mid-link, slides L³/12EI across it: an exact equivalent.

    Attributes:
        bending_nm2: EI about the direction of an axis across the link: its own, or the
            next where the link lies along its own; inf is rigid.
        torsion_nm2: GJ; inf is rigid.
        bending_ratio: EI about the direction across both, over bending_nm2.
        marks_bend: Whether marks on the link move with the part of it that they are on
            (1), or sit where it does not bend yet (0).
    """

    name: ClassVar[str] = "link_bending"
    bending_nm2: float = size(6.3e5, 1.0, off=math.inf)
    torsion_nm2: float = size(4.7e5, 1.0, off=math.inf)
    bending_ratio: float = optional(1.0, 1e-9, 1e6)
    marks_bend: int = assumed(0, 0, 1)

    @override
    def build(self, spec: mujoco.MjSpec, arm: Anatomy) -> None:
        link = arm.body(self.where)
        end = spec.body(arm.end_of(self.where))
        rotation, origin = pose_in(end, spec.body(link))
        start = rotation.T @ (_anchor(spec, arm, link) - origin)  # in the end's frame
        tip = _anchor(spec, arm, end.name)
        length = float(np.linalg.norm(tip - start))
        if length < 1e-4:
            fault = f"{link!r} has no length between its axes; it cannot bend."
            raise Unusable(f"Effect {self.name!r} at {self.where!r}", [fault])
        u, v, w = _directions(spec, arm, link, end, (tip - start) / length).T
        middle = (start + tip) / 2
        bend, name = self.bending_nm2 / length, f"{link}_bend"
        if math.isfinite(bend):
            stiff = {"u": bend, "v": bend * self.bending_ratio}
            shear = {k: 12 * stiff[about] / length**2 for k, about in ("uv", "vu")}
            for k, along in (("u", u), ("v", v)):
                add_spring(end, f"{name}_{k}", along, stiff[k], pos=middle)
            for k, along in (("u", u), ("v", v)):
                add_spring(end, f"{name}_along_{k}", along, shear[k], slide=True)
        if math.isfinite(self.torsion_nm2):
            add_spring(end, f"{name}_twist", w, self.torsion_nm2 / length, pos=middle)


def _directions(
    spec: mujoco.MjSpec, arm: Anatomy, link: str, end: mujoco.MjsBody, w: np.ndarray
) -> Float[np.ndarray, "3 3"]:
    """Return the directions u and v across a link and w along it, as columns.

    A casting is alike on both sides of the plane in which its axis swings it: u is the
    direction of its own axis, or of the next where the link lies along its own.

    Args:
        spec: The model.
        arm: Its parts.
        link: Name of the link's body.
        end: The body at its end, in whose frame directions are.
        w: Along the link.
    """
    held, (rotation, _) = _held(arm), pose_in(end, spec.body(link))
    axes = [rotation.T @ np.array(spec.joint(held[link]).axis)]
    if end.name in held:
        axes.append(np.array(spec.joint(held[end.name]).axis))
    across = [axis - w * (w @ axis) for axis in axes]
    own = np.linalg.norm(across[0]) >= np.sqrt(0.5)  # nearer across than along
    u = across[0] if own else across[-1]
    size = np.linalg.norm(u)
    if size < ALONG:
        return frame_along(w)
    return np.column_stack([u / size, np.cross(w, u / size), w])


def _held(arm: Anatomy) -> dict[str, str]:
    """Return the axis of each link and end, by name of the body."""
    held = {arm.end(axis): axis for axis in arm.axes}
    return held | dict(zip(arm.links, arm.axes, strict=True))


def _anchor(
    spec: mujoco.MjSpec | mujoco.MjModel, arm: Anatomy, body: str
) -> np.ndarray:
    """Return where the axis on a link or an end is held, in that body's frame, in m."""
    held = _held(arm)
    return np.array(spec.joint(held[body]).pos) if body in held else np.zeros(3)


@dataclass(frozen=True)
class Beam:
    """A link that bends along its way, undeformed.

    Attributes:
        link: Name of its body.
        end: Name of the body at its end.
        start: Where it begins, in the link's frame, in m.
        tip: Where it ends, in the end's frame, in m.
        rotation: Of the end, in the link's frame.
        origin: Of the end, in the link's frame, in m.
    """

    link: str
    end: str
    start: Float[np.ndarray, "3"]
    tip: Float[np.ndarray, "3"]
    rotation: Float[np.ndarray, "3 3"]
    origin: Float[np.ndarray, "3"]

    @classmethod
    def of(cls, effect: LinkBending, model: mujoco.MjModel, arm: Anatomy) -> "Beam":
        """Return the link of an effect as the compiled model has it."""
        link, end = arm.body(effect.where), arm.end_of(effect.where)
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        own, far = data.body(link), data.body(end)
        turn = own.xmat.reshape(3, 3).T
        anchors = _anchor(model, arm, link), _anchor(model, arm, end)
        place = turn @ far.xmat.reshape(3, 3), turn @ (far.xpos - own.xpos)
        return cls(link, end, *anchors, *place)

    def displacement(
        self,
        rotation: Float[np.ndarray, "rows 3 3"],
        origin: Float[np.ndarray, "rows 3"],
        spot: Float[np.ndarray, "rows 3"],
    ) -> Float[np.ndarray, "rows 3"]:
        """Return how the bend moves spots of the link, in its frame, in m.

        The pose of the end is in the link's frame, as are the spots.
        """
        rest = self.rotation @ self.tip + self.origin
        moved = rotation @ self.tip + origin - rest
        turned = Rotation.from_matrix(rotation @ self.rotation.T).as_rotvec()
        length = np.linalg.norm(rest - self.start)
        w = (rest - self.start) / length
        s = np.clip((spot - self.start) @ w / length, 0.0, 1.0)[:, None]
        twist = (turned @ w)[:, None] * w
        d, m = moved - (moved @ w)[:, None] * w, length * np.cross(turned, w)
        sag = (3 * s**2 - 2 * s**3) * d + (s**3 - s**2) * m
        slope = (6 * (s - s**2) * d + (3 * s**2 - 2 * s) * m) / length
        beside = spot - self.start - s * length * w
        return sag + np.cross(np.cross(w, slope) + s * twist, beside)
