"""Mechanisms: what a rig has beyond its nominal arm, written into a user's MJCF.

The rig is built on a plain chain with an end and a seat before each axis. Joints on
those become joints before the axis' own in the user's body, in the same order: the
engine turns a body by one joint after the other, so the two are the same mechanism.
"""

from collections.abc import Sequence
from xml.etree.ElementTree import Element, SubElement

import mujoco
import numpy as np
from jaxtyping import Float

from bench.cell import HOOK_SITE, MOUNT
from bench.effects.effect import Command
from bench.effects.encoder_offset import EncoderOffset
from bench.effects.springs import ARMATURE, MOST_JOINTS
from bench.kinematic_chain import Anatomy, wraps_on_joints
from bench.model_file import (
    GEAR,
    LEAST_KG,
    PATCH,
    RIGID,
    SLIDE,
    Stand,
    after,
    moved_about,
    numbers,
)
from bench.rig import Rig
from bench.shared.recording import Payload
from bench.user_model import UserModel

# --- Numbers and parts of a model's text ---------------------------------------------


def part(root: Element, name: str) -> Element:
    """Return a part of an element, made where there is none."""
    found = root.find(name)
    return SubElement(root, name) if found is None else found


def joint_element(name: str, slides: bool) -> Element:
    """Return a joint that takes nothing from the default classes."""
    return Element(
        "joint",
        name=name,
        type="slide" if slides else "hinge",
        ref="0",
        springref="0",
        springdamper="0 0",
        frictionloss="0",
        limited="false",
        actuatorfrclimited="false",
    )


def seen_from(element: Element, frame: Stand) -> None:
    """Write a joint in a frame that stands thus in the one that it was written in."""
    position, quat = frame
    back = np.zeros(4)
    mujoco.mju_negQuat(back, quat)
    for name, origin in (("pos", position), ("axis", np.zeros(3))):
        values = np.array([float(word) for word in element.get(name, "").split()])
        turned = np.zeros(3)
        mujoco.mju_rotVecQuat(turned, values - origin, back)
        element.set(name, numbers(turned))


def parent_of(root: Element, child: Element) -> Element:
    """Return the element that holds another."""
    return next(parent for parent in root.iter() if child in list(parent))


LIGHT_KG, LIGHT_KG_M2 = 1e-6, 1e-6
"""Mass and inertia of an inserted body; chosen: 10 µN of weight, far from singular."""
STAND_KEYS = ("pos", "quat", "axisangle", "euler", "xyaxes", "zaxis")


class Mechanisms:
    """Moves the mechanisms of a rig into the XML of a user's model."""

    def __init__(self, rig: Rig, user: UserModel, held: Float[np.ndarray, " axes"]):
        """Prepare to change a model; springs hold its axes at angles in rad (m)."""
        self.rig, self.arm, self.true = rig, rig.anatomy, rig.model
        self.own, self.root = user.model, user.root
        self.bodies = {b.get("name", ""): b for b in self.root.iter("body")}
        self.bodies["world"] = part(self.root, "worldbody")
        self.held, self.lost = held, list[str]()
        payload = rig.mounted.payload
        is_on_flange = self.true.body(MOUNT).mass[0] <= LEAST_KG and payload.mass > 0
        self.mounted = payload if is_on_flange else None
        command = rig.command(held[None])
        self.offset = offsets_of(rig, self.arm)
        self.other = command.reference[0] - held - self.offset
        self.stiffness = command.stiffness[0]

    def put_in(self) -> list[str]:
        """Carry it out; return what of the user's file had to go."""
        self._unframe()
        for axis in self.arm.axes:
            self._axis(axis)
        for name in self.bodies:
            if name not in self.arm.links and name != "world":
                self._other_body(name)
        self._tendons()
        self._sensor()
        return self.lost

    def _unframe(self) -> None:
        """Take bodies out of frames; each gets its whole pose from the compiled one."""
        for parent in list(self.root.iter()):
            for frame in parent.findall("frame"):
                self._empty(parent, frame, "")

    def _empty(self, parent: Element, frame: Element, above: str) -> None:
        kind = frame.get("childclass", above)
        for inner in frame.findall("frame"):
            self._empty(parent, inner, kind)
        place = list(parent).index(frame) + 1 if frame in list(parent) else len(parent)
        for body in frame.findall("body"):
            frame.remove(body)
            if kind and not body.get("childclass"):
                body.set("childclass", kind)
            parent.insert(place, body)
            place += 1

    def _stand(self, body: Element, position: np.ndarray, quat: np.ndarray) -> None:
        for key in STAND_KEYS:
            body.attrib.pop(key, None)
        body.set("pos", numbers(position))
        body.set("quat", numbers(quat))

    def _inertial(self, body: Element, name: str) -> None:
        true = self.true.body(name)
        mass, centre = float(true.mass[0]), true.ipos.copy()
        mounted = self.mounted if name == self.arm.flange else None
        if mounted is not None:  # it hangs on the flange as a body of its own
            moment = mass * centre - mounted.mass * mounted.com
            mass -= mounted.mass
            centre = moment / mass if mass > LEAST_KG else centre
            body.append(_inserted_mass(f"{PATCH}mounted", mounted))
        for old in body.findall("inertial"):
            body.remove(old)
        light = mass <= LEAST_KG
        if light and not body.findall("joint"):
            return
        inertial = Element(
            "inertial",
            mass=numbers([LIGHT_KG if light else mass]),
            pos=numbers(centre),
            quat=numbers(true.iquat),
            diaginertia=numbers([LIGHT_KG_M2] * 3 if light else true.inertia),
        )
        body.insert(0, inertial)

    def _axis(self, axis: str) -> None:
        """Put one axis' link, its mechanisms and its gear in place."""
        name = self.arm.links[self.arm.axes.index(axis)]
        link, own = self.bodies[name], self.own.joint(axis)
        end, seat = (
            self.true.body(self.arm.end(axis)),
            self.true.body(self.arm.seat(axis)),
        )
        ref = float(self.own.qpos0[own.qposadr[0]])
        joints_end = self.joints_on(end.id)
        joints_seat = self.joints_on(seat.id)
        sites = self._sites_on(end.id)
        joint = next(j for j in link.iter("joint") if j.get("name") == axis)
        mine = self._gear(axis, joint, ref)
        room = MOST_JOINTS - len(mine)
        before = [*joints_end, *joints_seat]
        shift = moved_about(self.own, own.id, ref)
        start = (end.pos.copy(), end.quat.copy())
        if len(before) <= room and not sites:
            for added in before:
                seen_from(added, shift)
            stands, chain = after(start, shift), before
        else:
            parent = parent_of(self.root, link)
            carrier = _inserted(f"{PATCH}{axis}_end", joints_end)
            self._stand(carrier, *start)
            carrier.extend(sites)
            parent.insert(list(parent).index(link), carrier)
            parent.remove(link)
            if len(joints_seat) > room:
                below = _inserted(f"{PATCH}{axis}_seat", joints_seat)
                carrier.append(below)
                carrier, joints_seat = below, []
            carrier.append(link)
            for added in joints_seat:
                seen_from(added, shift)
            stands, chain = shift, joints_seat
        self._stand(link, *stands)
        holder = parent_of(self.root, joint)
        place = list(holder).index(joint)
        holder.remove(joint)
        for element in (*chain, *mine):
            holder.insert(place, element)
            place += 1
        for site in self._sites_on(self.true.body(name).id):
            link.append(site)
        self._inertial(link, name)

    def _gear(self, axis: str, joint: Element, ref: float) -> list[Element]:
        """Return the axis' own joint, held, and the joint of its gear."""
        k = self.arm.axes.index(axis)
        own = self.own.joint(axis)
        joint.set("pos", numbers(own.pos))
        joint.set("axis", numbers(own.axis))
        joint.set("ref", numbers([ref - self.offset[k]]))
        joint.set("springref", numbers([self.held[k]]))
        joint.set("stiffness", numbers([RIGID]))
        joint.set("springdamper", "0 0")
        joint.set("armature", numbers(self.own.dof_armature[own.dofadr]))
        joint.set("frictionloss", "0")
        if self.own.jnt_limited[own.id]:
            joint.set("range", numbers(self.own.jnt_range[own.id]))
        if self.own.dof_frictionloss[own.dofadr[0]]:
            why = "a load would rest on it, and the patch was fitted without"
            self.lost.append(f"the friction of joint {axis!r} in the file: {why}")
        true = self.true.joint(axis)
        rigid = self.stiffness[k] >= RIGID and not self._tendons_on(true.id)
        if rigid and self.other[k] == 0.0:
            return [joint]
        spring = joint_element(f"{PATCH}{axis}{GEAR}", bool(own.type[0] == SLIDE))
        spring.set("pos", joint.get("pos", ""))
        spring.set("axis", joint.get("axis", ""))
        spring.set("stiffness", numbers([self.stiffness[k]]))
        spring.set("springref", numbers([self.other[k]]))
        spring.set("armature", numbers([ARMATURE]))
        return [joint, spring]

    def _other_body(self, name: str) -> None:
        """Correct a body that no axis moves: the base, a flange, what is fixed."""
        body, true = self.bodies[name], self.true.body(name)
        self._stand(body, true.pos, true.quat)
        place = 0
        for added in self.joints_on(true.id):
            body.insert(place, added)
            place += 1
        for site in self._sites_on(true.id):
            body.append(site)
        self._inertial(body, name)

    def joints_on(self, body: int) -> list[Element]:
        """Return the mechanisms of a body of the rig as joints, in their order."""
        found = []
        known = {self.rig.nominal.joint(j).name for j in range(self.rig.nominal.njnt)}
        first = self.true.body_jntadr[body]
        for j in range(first, first + self.true.body_jntnum[body]):
            true = self.true.joint(j)
            if true.name in known:
                continue
            element = joint_element(f"{PATCH}{true.name}", bool(true.type[0] == SLIDE))
            element.set("pos", numbers(true.pos))
            element.set("axis", numbers(true.axis))
            element.set("stiffness", numbers(self.true.jnt_stiffness[[j]]))
            element.set("armature", numbers(self.true.dof_armature[true.dofadr]))
            damping = self.true.dof_damping[true.dofadr]
            if damping[0]:
                element.set("damping", numbers(damping))
            found.append(element)
        return found

    def _sensor(self) -> None:
        """Mark where the force sensor sits."""
        place = self.rig.mounted.sensor_position
        if np.any(place):
            flange = self.bodies[self.arm.flange]
            name, size = f"{PATCH}force_sensor", "0.002"
            SubElement(
                flange, "site", name=name, pos=numbers(place), size=size, group="5"
            )

    # --- Tendons and their sites

    def _tendons(self) -> None:
        """Write the mechanisms' tendons, on gears instead of axes."""
        kept = self._kept()
        if not kept:
            return
        section = part(self.root, "tendon")
        true = self.true
        for t in kept:
            first, joints = true.tendon_adr[t], self._wrapped(t)
            tendon = SubElement(
                section,
                "fixed" if joints else "spatial",
                name=f"{PATCH}{true.tendon(t).name}",
                stiffness=numbers([true.tendon_stiffness[t]]),
                springlength=numbers(true.tendon_lengthspring[t]),
                damping="0",
                limited="false",
            )
            if true.tendon_springyield[t] > 0.0:
                tendon.set("springyield", numbers([true.tendon_springyield[t]]))
            for w, j in enumerate(joints, start=first):
                name = true.joint(j).name
                gear = f"{PATCH}{name}" + GEAR * (name in self.arm.axes)
                coef = numbers([true.wrap_prm[w]])
                SubElement(tendon, "joint", joint=gear, coef=coef)
            if not joints:
                for w in range(first, first + true.tendon_num[t]):
                    site = f"{PATCH}{true.site(true.wrap_objid[w]).name}"
                    SubElement(tendon, "site", site=site)

    def _tendons_on(self, joint: int) -> list[int]:
        """Return the rig's tendons that act on a joint of it."""
        return [t for t in self._kept() if joint in self._wrapped(t)]

    def _sites_on(self, body: int) -> list[Element]:
        """Return the sites of a rig's body on which a kept tendon hangs."""
        true, used = self.true, set()
        for t in self._kept():
            if not self._wrapped(t):
                first = true.tendon_adr[t]
                used |= set(
                    true.wrap_objid[first : first + true.tendon_num[t]].tolist()
                )
        return [
            Element(
                "site",
                name=f"{PATCH}{true.site(s).name}",
                pos=numbers(true.site_pos[s]),
                size="0.002",
                group="5",
            )
            for s in sorted(used)
            if true.site_bodyid[s] == body
        ]

    def _kept(self) -> list[int]:
        """Return the rig's tendons without the ropes of its cell."""
        true, kept = self.true, []
        hook = mujoco.mj_name2id(true, mujoco.mjtObj.mjOBJ_SITE, HOOK_SITE)
        for t in range(true.ntendon):
            first, count = true.tendon_adr[t], true.tendon_num[t]
            wraps = slice(first, first + count)
            site = true.wrap_type[wraps] == mujoco.mjtWrap.mjWRAP_SITE
            if not np.any(site & (true.wrap_objid[wraps] == hook)):
                kept.append(t)
        return kept

    def _wrapped(self, tendon: int) -> list[int]:
        return self.true.wrap_objid[wraps_on_joints(self.true, tendon)].tolist()


def _inserted(name: str, joints: Sequence[Element]) -> Element:
    body = Element("body", name=name)
    if joints:
        inertia = numbers([LIGHT_KG_M2] * 3)
        mass = numbers([LIGHT_KG])
        SubElement(body, "inertial", mass=mass, pos="0 0 0", diaginertia=inertia)
    body.extend(joints)
    return body


def _inserted_mass(name: str, payload: Payload) -> Element:
    """Return a point mass as a body."""
    body = Element("body", name=name)
    mass, inertia = numbers([payload.mass]), numbers([LIGHT_KG_M2] * 3)
    place = numbers(payload.com)
    SubElement(body, "inertial", mass=mass, pos=place, diaginertia=inertia)
    return body


def offsets_of(rig: Rig, arm: Anatomy) -> Float[np.ndarray, " axes"]:
    """Return by how much each axis stands beyond its report, at any angle, in rad."""
    nothing = np.zeros((1, len(arm.axes)))
    whole = np.zeros(len(arm.axes))
    for effect in rig.effects:
        if isinstance(effect, EncoderOffset):
            whole += effect.command(nothing, Command(nothing, nothing), arm).reference[
                0
            ]
    return whole
