"""Patched model: the user's own MJCF with the mechanisms of a patch put in.

Everything of the user's file stays: bodies, meshes, materials, default classes,
actuators, sensors, key frames. A URDF becomes the MJCF that MuJoCo makes of it. What is
added bears the prefix `patch:` (`bench.model_file.PATCH`) in its name:

- an axis' joint is the motor's side: its position is the angle that the controller
  reports, its `ref` the offset of the encoder, and a stiff spring holds it at its
  `springref`, as the brake or the position loop does;
- beside it in the same body `patch:AXIS_gear` carries the axis' spring, and the
  tendons of laws that are not linear act on it. It is zero where nothing winds it up,
  so another posture is commanded by `qpos_spring` of the axes alone;
- bearings, links and the base give way in joints before the axis' own. A body of its
  own is inserted only where more than six joints meet or a tendon starts;
- lengths and angles of links, and masses, are corrected where they stand.

The actuators that drive the axes are kept and switched off by their group, since the
held axes stand for them; the model's comment says how to let them drive.

The engine integrates with `discrete`, implicit in all springs, so that stiff springs
are stable at any time step. Every added joint is damped beyond its critical damping.
"""

import copy
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import mujoco
import numpy as np
from jaxtyping import Float

from bench.effects.effect import CommandEffect, ModelEffect
from bench.effects.encoder_offset import EncoderOffset
from bench.kinematic_chain import Anatomy, carriers_of, wraps_on_joints
from bench.mechanisms import Mechanisms, part
from bench.model_file import PATCH, RIGID, numbers
from bench.rig import Rig
from bench.shared.errors import BenchError, Unusable
from bench.user_model import ASSETS, UserModel, plain_model, user_model

DAMPING_RATIO = 1.5
"""Of an added joint, by its inertia at the held posture; chosen: no overshoot, since
what slips remembers it."""
INERTIA_SETTINGS = (
    *("inertiafromgeom", "settotalmass", "balanceinertia", "boundmass"),
    *("boundinertia", "inertiagrouprange", "meshdir", "texturedir", "assetdir"),
)
ACTUATOR_NUMBERS = (
    *("gear", "ctrlrange", "forcerange", "actrange"),
    *("gainprm", "biasprm", "dynprm"),
)
PASSIVE_FLAGS = ("spring", "damper", "passive", "gravity")


@dataclass(frozen=True)
class PatchedModel:
    """A user's model with a patch in it.

    Attributes:
        assets: Its meshes and pictures by their names in `ASSETS`.
        held: Angles at which its springs hold the axes, as reported, in rad (m).
        not_held: What is true by the patch and not in the model, in sentences.
    """

    text: str
    assets: dict[str, bytes] = field(repr=False)
    held: dict[str, float]
    not_held: tuple[str, ...]

    def compiled(self) -> mujoco.MjModel:
        """Return the compiled model, as MuJoCo reads it from the folder."""
        beside = {f"{ASSETS}/{name}": data for name, data in self.assets.items()}
        return mujoco.MjModel.from_xml_string(self.text, beside)


def patched_model(rig: Rig, arm_file: Path | None, marks: bool = False) -> PatchedModel:
    """Put the mechanisms of a patched rig into the user's file.

    The file is what the rig was made of, by default the arm in the patch; it holds no
    marks that a patch may place.

    Raises:
        Unusable: Where the result does not compile.
    """
    why = ""
    try:
        if arm_file is not None:
            return _Patching(rig, user_model(Path(arm_file)), marks).done()
    except (BenchError, ValueError, RuntimeError, KeyError) as error:
        why = " ".join(str(error).split())
    lost = [f"all of the file but the arm's bodies and joints: {why}"] if why else []
    try:
        return _Patching(rig, plain_model(rig.nominal, *lost), marks).done()
    except (ValueError, RuntimeError) as error:
        fault = " ".join(str(error).split())
        raise Unusable("The model with its patch", [fault]) from None


# --- The patch in it ------------------------------------------------------------------


class _Patching:
    """Moves the mechanisms of a rig into the XML of a user's model."""

    def __init__(self, rig: Rig, user: UserModel, marks: bool):
        self.rig, self.arm = rig, rig.anatomy
        self.own, self.root, self.assets = user.model, user.root, user.assets
        self.lost, self.marks = list(user.lost), marks
        self.held = held_posture(user.model, self.arm)
        self.mechanisms = Mechanisms(rig, user, self.held)

    def done(self) -> PatchedModel:
        """Carry it out and return the model."""
        self.lost += self.mechanisms.put_in()
        self._hold_others()
        self._contacts()
        self._options()
        self._actuators()
        keys = self.root.find("keyframe")
        if keys is not None:
            self.root.remove(keys)
        model = self._compiled()
        self._damp(model)
        self._part_touching(model)
        model = self._compiled()
        self._keys(part(self.root, "keyframe") if keys is None else keys, model)
        if keys is not None:
            self.root.append(keys)
        self._restore_digits(model)
        held = dict(zip(self.arm.axes, map(float, self.held), strict=True))
        missing = (*self.lost, *not_in_a_model(self.rig, self.arm, self.marks))
        ElementTree.indent(self.root)
        body = ElementTree.tostring(self.root, encoding="unicode")
        text = f"<!--{_comment(held, missing, self._switched)}-->\n{body}\n"
        done = PatchedModel(text, self.assets, held, missing)
        done.compiled()
        return done

    def _compiled(self) -> mujoco.MjModel:
        text = ElementTree.tostring(self.root, encoding="unicode")
        return PatchedModel(text, self.assets, {}, ()).compiled()

    def _hold_others(self) -> None:
        """Hold joints of the file that are no axes of this arm, as the rig does."""
        for element in self.root.iterfind("worldbody//joint"):
            name = element.get("name", "")
            if name in self.arm.axes or name.startswith(PATCH):
                continue
            own = self.own.joint(name)
            element.set("stiffness", numbers([RIGID]))
            element.set("springdamper", "0 0")
            held = _start(self.own)[own.qposadr]
            element.set("springref", numbers(held))

    # --- Contacts

    def _contacts(self) -> None:
        """Let nothing touch that could not touch in the user's file."""
        pairs = []
        own = self.own
        for axis, link in zip(self.arm.axes, self.arm.links, strict=True):
            if f"{PATCH}{axis}_end" in {b.get("name") for b in self.root.iter("body")}:
                parent = own.body(own.body_parentid[own.body(link).id]).name
                while parent.startswith(PATCH):  # of an earlier patch
                    parent = own.body(own.body_parentid[own.body(parent).id]).name
                if own.body(parent).weldid[0]:
                    pairs.append((parent, link))
        moves = self.arm.base
        if moves != "world" and self.mechanisms.joints_on(
            self.rig.model.body(moves).id
        ):
            still = [b for b in range(own.nbody) if not own.body_weldid[b]]
            loose = {b for b in still if own.body(moves).id in carriers_of(own, b)}
            pairs += [
                (own.body(b).name, own.body(a).name)
                for b in sorted(loose)
                for a in still
                if a not in loose and own.body_geomnum[a] and own.body_geomnum[b]
            ]
        self._exclude(pairs)

    def _exclude(self, pairs: Iterable[tuple[str, str]]) -> None:
        for one, other in pairs:
            section = part(self.root, "contact")
            name = f"{PATCH}{one}_{other}"
            known = {frozenset((e.get("body1"), e.get("body2"))) for e in section}
            if frozenset((one, other)) not in known:
                SubElement(section, "exclude", name=name, body1=one, body2=other)

    def _part_touching(self, model: mujoco.MjModel) -> None:
        """Exclude pairs of bodies that overlap where the arm is held."""
        data = self._at_rest(model)
        mujoco.mj_forward(model, data)
        touching = {
            tuple(sorted(int(model.geom_bodyid[g]) for g in contact.geom))
            for contact in data.contact
        }
        pairs = [tuple(model.body(b).name for b in pair) for pair in sorted(touching)]
        for one, other in pairs:
            self.lost.append(
                f"the contact of {one!r} with {other!r}, which overlap where it is held"
            )
        self._exclude([(one, other) for one, other in pairs])

    def _at_rest(self, model: mujoco.MjModel) -> mujoco.MjData:
        data = mujoco.MjData(model)
        start = _start(self.own)
        for j in range(self.own.njnt):
            name = self.own.joint(j).name
            address = model.joint(name).qposadr[0]
            data.qpos[address] = start[self.own.jnt_qposadr[j]]
        for axis, angle in zip(self.arm.axes, self.held, strict=True):
            data.qpos[model.joint(axis).qposadr[0]] = angle
        return data

    # --- Options, actuators, key frames

    def _options(self) -> None:
        option = part(self.root, "option")
        option.set("integrator", "discrete")
        flag = option.find("flag")
        for name in PASSIVE_FLAGS:
            if flag is not None and flag.get(name) == "disable":
                del flag.attrib[name]
        compiler = part(self.root, "compiler")
        for name in INERTIA_SETTINGS:
            compiler.attrib.pop(name, None)
        compiler.set("autolimits", "true")
        section = part(self.root, "custom")
        SubElement(section, "text", name=f"{PATCH}model", data="see the comment above")

    def _actuators(self) -> None:
        """Switch off what drives the held joints, by its group."""
        own = self.own
        self._switched = ""
        kinds = mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT
        on_joint = np.isin(own.actuator_trntype, list(map(int, kinds))).tolist()
        if not any(on_joint):
            return
        groups = {int(own.actuator_group[a]) for a in range(own.nu) if on_joint[a]}
        others = {int(own.actuator_group[a]) for a in range(own.nu) if not on_joint[a]}
        if groups & others or not groups <= set(range(31)):
            free = next(g for g in range(30, -1, -1) if g not in groups | others)
            groups = {free}
            elements = part(self.root, "actuator")
            for element, drives in zip(elements, on_joint, strict=True):
                if drives:
                    element.set("group", str(free))
        option = part(self.root, "option")
        already = option.get("actuatorgroupdisable", "").split()
        switched = sorted(groups | set(map(int, already)))
        option.set("actuatorgroupdisable", " ".join(map(str, switched)))
        self._switched = ", ".join(map(str, sorted(groups)))

    def _keys(self, section: Element, model: mujoco.MjModel) -> None:
        """Write the user's key frames, or the held one, with the added joints at rest.

        At rest under the arm's own weight, the axes commanded where the frame has them.
        """
        own = self.own
        if not own.nkey:
            key = SubElement(section, "key", name=f"{PATCH}held")
            return _rest(key, model, model.qpos_spring)
        for k, key in enumerate(section.findall("key")):
            for name, start, width in (
                ("qpos", model.qpos_spring, "qposadr"),
                ("qvel", np.zeros(model.nv), "dofadr"),
            ):
                if name not in key.attrib and name == "qvel":
                    continue
                whole = start.copy()
                values = getattr(own, f"key_{name}")[k]
                for j in range(own.njnt):
                    new = getattr(model.joint(own.joint(j).name), width)
                    whole[new] = values[getattr(own.joint(j), width)]
                if name == "qpos":
                    _rest(key, model, whole)
                else:
                    key.set(name, numbers(whole))
            for name in ("ctrl", "act", "mpos", "mquat"):
                if name in key.attrib:
                    key.set(name, numbers(getattr(own, f"key_{name}")[k]))

    def _damp(self, model: mujoco.MjModel) -> None:
        """Damp the added joints near critically, by their inertia where it is held."""
        data = self._at_rest(model)
        mujoco.mj_forward(model, data)
        inertia = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, inertia)
        across = _tendon_stiffness(model)
        for element in self.root.iter("joint"):
            name = element.get("name", "")
            if not name.startswith(PATCH) or element.get("damping"):
                continue
            j = model.joint(name)
            stiffness = model.jnt_stiffness[j.id] + across[j.id]
            heavy = inertia[j.dofadr[0], j.dofadr[0]]
            critical = 2.0 * DAMPING_RATIO * math.sqrt(max(stiffness * heavy, 0.0))
            element.set("damping", numbers([critical]))

    def _restore_digits(self, model: mujoco.MjModel) -> None:
        """Give the actuators back the digits that MuJoCo's writer drops."""
        for a, element in enumerate(self.root.findall("actuator/*")):
            for name in ACTUATOR_NUMBERS if element.tag == "general" else ():
                values = getattr(self.own, f"actuator_{name}")[a]
                if not np.array_equal(values, getattr(model, f"actuator_{name}")[a]):
                    element.set(name, numbers(values))


# --- Where it is held -----------------------------------------------------------------


def held_posture(model: mujoco.MjModel, arm: Anatomy) -> Float[np.ndarray, " axes"]:
    """Return the angles at which the springs of a patched model hold its axes.

    Returns:
        Those of the first key frame, or of the model's reference configuration; an
        angle beyond its range is the middle of that range. In rad (m).
    """
    start, held = _start(model), []
    for axis in arm.axes:
        joint = model.joint(axis)
        angle = float(start[joint.qposadr[0]])
        low, high = model.jnt_range[joint.id]
        if model.jnt_limited[joint.id] and not low <= angle <= high:
            angle = float(low + high) / 2
        held.append(angle)
    return arm.following(np.array(held)[None])[0]


def _start(model: mujoco.MjModel) -> np.ndarray:
    return (model.key_qpos[0] if model.nkey else model.qpos0).copy()


# --- What a model cannot hold ---------------------------------------------------------


def not_in_a_model(rig: Rig, arm: Anatomy, marks: bool = False) -> tuple[str, ...]:
    """Return what is true of a patched rig and cannot be written into MJCF."""
    found = []
    for effect in sorted(rig.effects, key=lambda e: (e.name, e.where)):
        place = f"{effect.name} at {effect.where}"
        if isinstance(effect, ModelEffect | EncoderOffset):
            continue
        if isinstance(effect, CommandEffect):
            found.append(f"{place}: it changes with the commanded angle; the model has "
                         "its value at the held posture")  # fmt: skip
        else:
            found.append(f"{place}: it happens in an instrument or in the rope")
    if marks:
        found.append("places of the marks and the tracker's frame")
    return tuple(dict.fromkeys(found))


COMMENT = """
This is the file of the robot with what a diagnosis found put into it; MuJoCo 4 runs it.
All names that begin with "patch:" were added. patch.json is the exact record.

An axis' joint is the motor's side: its angle is what the controller reports, its ref
the offset of its encoder. A spring of {rigid:g} N m/rad holds it, as a controller
does, at
  {held}
The joint patch:AXIS_gear is the gear's wind-up. Start from the first key frame, where
all is at rest under the arm's own weight. To command another posture, set
qpos_spring of the axes' joints (and qpos, to be there at once). To let
actuators drive instead, set jnt_stiffness of the axes' joints to 0 and switch the
actuators on{groups}. Keep integrator="discrete": it is
implicit in the springs; an explicit one needs a time step of microseconds.

Not in this model, but in patch.json:
  {missing}
"""


def _comment(held: dict[str, float], missing: Sequence[str], groups: str) -> str:
    angles = ", ".join(f"{axis} {angle:.9g}" for axis, angle in held.items())
    actuators = f" (option actuatorgroupdisable, now {groups})" if groups else ""
    lines = "\n  ".join(missing) or "nothing: the model holds all of it"
    text = COMMENT.format(rigid=RIGID, held=angles, groups=actuators, missing=lines)
    return text.replace("--", "- -")  # two hyphens end a comment


# --- At rest --------------------------------------------------------------------------

REST_S = 3.0
"""How long an arm is let come to rest, in s; chosen: 60 times `SLOW_S`."""
SLOW_S = 0.05
"""Longest time of damping over stiffness; chosen: what creeps comes to its end."""


def _rest(key: Element, model: mujoco.MjModel, start: np.ndarray) -> None:
    """Write positions of a key frame, the added joints at rest under the weight.

    What slips is written as well: at rest is another place for a gear that remembers.
    """
    model, rest = copy.copy(model), start.copy()
    model.qpos_spring[:] = start
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    joints = [j for j in range(model.njnt) if model.joint(j).name.startswith(PATCH)]
    stiffness = (model.jnt_stiffness + _tendon_stiffness(model))[joints]
    dofs, added = model.jnt_dofadr[joints], model.jnt_qposadr[joints]
    model.dof_damping[dofs] = np.minimum(model.dof_damping[dofs], SLOW_S * stiffness)
    data = mujoco.MjData(model)
    data.qpos[:] = start
    mujoco.mj_step(model, data, round(REST_S / model.opt.timestep))
    rest[added] = data.qpos[added]
    key.set("qpos", numbers(rest))
    if model.nplastic:
        key.set("plastic", numbers(data.plastic))


# --- Parts ----------------------------------------------------------------------------


def _tendon_stiffness(model: mujoco.MjModel) -> Float[np.ndarray, " joints"]:
    """Return the stiffness that tendons give each joint at most, in N m/rad."""
    found = np.zeros(model.njnt)
    for t in range(model.ntendon):
        for w in wraps_on_joints(model, t):
            lever = float(model.wrap_prm[w])
            found[model.wrap_objid[w]] += model.tendon_stiffness[t] * lever**2
    return found
