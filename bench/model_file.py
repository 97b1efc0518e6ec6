"""Model files, MJCF or URDF: checked as text, loaded, and written as plain MJCF.

A user's model is text, checked before anything is built from it: a few lines can ask
for a gigabyte, or name a file that lies elsewhere or never ends. What is found is said;
nothing is compiled and no other file is opened.

MuJoCo reads either kind; `plain_mjcf` writes the moving parts back as one
self-contained MJCF text at full precision, without includes, defaults, pictures,
sites or contacts, so that Pinocchio and MuJoCo read the very same arm.

A `model.xml` that a diagnosis wrote is read as the corrected arm: the user's axes, with
corrected lengths, zeros, masses and springs. What bears the prefix `PATCH` is part of
the structure: its joints are held at zero, its bodies are merged into their children.
What was mounted is taken off: a recording says itself what it carries.

A joint that follows another one, MJCF's equality of two joints or a URDF's `<mimic>`,
stays a joint, and plain MJCF notes its law in a custom text, which both engines leave
alone: postures obey it, see `followers_of`. What loads it winds up its own spring, if
it has one, and not its leader's.
"""

import math
import os
import stat
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
from numpy.polynomial import Polynomial

from bench.shared.errors import BenchError, LeftOut, Unusable, refuse
from bench.shared.format.faults import quoted
from bench.shared.models import ModelFacts

# --- Check of the text ----------------------------------------------------------------

LARGEST_MODEL = 20_000_000
"""Bytes of a file that are still read; chosen: a hundred times an arm's file."""
MOST_PARTS = 20_000
"""Parts that a model may unfold to; chosen: a hundred times an arm's."""
MOST_CELLS = 10_000_000
"""Cells of a picture or a field of heights; chosen: three million pixels."""
FOLDERS = ("meshdir", "texturedir", "assetdir")


def faults_of(main: Path) -> list[str]:
    """Say in sentences why a model and what it includes must not be compiled."""
    faults: list[str] = []
    folders, parts = {main.parent}, 0.0
    waiting, seen = [(main, 1.0)], set()
    while waiting:
        path, copies = waiting.pop()
        if path in seen:
            continue
        seen.add(path)
        root = _parsed(path, faults)
        if root is None:
            continue
        if root.tag == "robot":
            faults += _faults_of_urdf(root)
        for compiler in root.iter("compiler"):
            given = (compiler.get(name, "") for name in FOLDERS)
            folders |= {main.parent / name for name in given if name}
        for element, many in _unfolded(root, copies):
            parts += many
            faults += _too_large(element)
            if root.tag == "robot":
                continue
            for name in (v for k, v in element.items() if v and k.startswith("file")):
                places = [folder / name for folder in (*sorted(folders), path.parent)]
                there = [place for place in places if os.path.lexists(place)]
                faults += _elsewhere(there, main.parent.resolve(), name)
                if element.tag in ("include", "model") and not faults:
                    waiting += [(place, many) for place in there[:1]]
    if parts > MOST_PARTS:
        faults.append(f"it unfolds to {parts:.3g} parts; the most is {MOST_PARTS}.")
    return list(dict.fromkeys(faults))


def _parsed(path: Path, faults: list[str]) -> ElementTree.Element | None:
    if not stat.S_ISREG(path.stat().st_mode):
        faults.append(f"{quoted(path.name)} is not a file.")
    elif path.stat().st_size > LARGEST_MODEL:
        faults.append(f"{quoted(path.name)} is larger than {LARGEST_MODEL} bytes.")
    else:
        source = path.read_bytes()
        if b"<!ENTITY" in source:
            fault = "declares XML entities; write them out."
            faults.append(f"{quoted(path.name)} {fault}")
            return None
        try:
            source.decode()  # as MuJoCo takes it, whatever it declares
            return ElementTree.fromstring(source)
        except UnicodeDecodeError:
            faults.append(f"{quoted(path.name)} is not UTF-8 text; save it as that.")
        except (ElementTree.ParseError, ValueError, LookupError) as error:
            faults.append(f"{quoted(path.name)} is no XML: {error}.")
    return None


XACRO = "{http://www.ros.org/wiki/xacro}", "{http://wiki.ros.org/xacro}"
"""What elements of URDF that xacro has to expand are called by; old and new."""


def _faults_of_urdf(robot: ElementTree.Element) -> list[str]:
    """Name what MuJoCo passes over in silence: masses, leaders and macros."""
    if any(element.tag.startswith(XACRO) for element in robot.iter()):
        return ["it has macros; expand them first: xacro FILE > model.urdf."]
    faults = []
    for link in robot.iter("link"):
        for mass in link.iterfind("inertial/mass"):
            if not _is_mass(text := mass.get("value", "")):
                name = quoted(link.get("name", ""))
                faults.append(f"link {name} has the mass {quoted(text)}.")
    joints = {joint.get("name") for joint in robot.iterfind("joint")}
    for joint in robot.iterfind("joint"):
        for mimic in joint.iterfind("mimic"):
            if (leader := mimic.get("joint", "")) not in joints:
                name = quoted(joint.get("name", ""))
                faults.append(f"joint {name} follows {quoted(leader)}, which is none.")
    return faults


def _is_mass(text: str) -> bool:
    try:
        return 0.0 <= float(text) < np.inf
    except ValueError:
        return False


def _unfolded(
    element: ElementTree.Element, copies: float
) -> Iterator[tuple[ElementTree.Element, float]]:
    """Walk through all elements, each with how many of it there will be."""
    waiting = [(element, copies)]
    while waiting:
        node, many = waiting.pop()
        if node.tag in ("replicate", "composite", "flexcomp"):
            for count in node.get("count", "1").split():
                many *= max(_number(count), 1)
        yield node, many
        waiting += [(child, many) for child in node]


def _too_large(element: ElementTree.Element) -> list[str]:
    cells = math.prod(
        _number(element.get(name, "")) for name in ("nrow", "ncol", "width", "height")
    )
    if element.tag == "size":  # of every body, joint … or state, each by itself
        asked = (v for k, v in element.items() if k != "memory")
        cells = max(map(_number, asked), default=1)
    if cells <= MOST_CELLS:
        return []
    return [f"its {element.tag} has {cells:.3g} cells; the most is {MOST_CELLS}."]


def _number(text: str) -> float:
    """Return a count as MuJoCo reads it, of however many digits; 1 where it is none."""
    digits = text.strip().removeprefix("+")
    return float(digits) if digits.isdecimal() else 1.0


def _elsewhere(there: list[Path], home: Path, name: str) -> list[str]:
    faults = []
    for place in there:
        if not place.is_file():
            faults.append(f"{quoted(name)} is not a file.")
        elif not place.resolve().is_relative_to(home):
            faults.append(f"{quoted(name)} leaves the model's folder; put it inside.")
        elif place.stat().st_size > LARGEST_MODEL:
            faults.append(f"{quoted(name)} is larger than {LARGEST_MODEL} bytes.")
    return faults


# --- Loading --------------------------------------------------------------------------

SPECK = 1e-12
"""Mass in kg and inertia in kg m² of a seat, and the least of a URDF's link, whose file
may give none; the least that MuJoCo accepts for a moving body. Its weight at 1 m is
1e-11 N m, below the 1e-10 at which an equilibrium converges."""
ROOT = "everything"
"""Body on which all hangs where several stand in the world."""
LEAST_KG = 1e-9
"""Mass below which a body counts as having none; chosen."""
HINGE, SLIDE = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE

PATCH = "patch:"
"""Prefix of the names of all parts that a patch adds to a user's model."""
GEAR = "_gear"
"""End of the name of the joint that carries an axis' spring in a patched model."""
RIGID = 1e9
"""Stiffness in N m/rad (N/m) of an axis that a model calls rigid (0); chosen: 100 N m
turn it by 0.1 µrad."""

mujoco.set_mju_user_warning(lambda text: None)  # else it writes a file where one stands


def load(path: Path | str) -> mujoco.MjModel:
    """Compile a model file.

    Bodies and joints without a name are numbered. A URDF keeps its fixed links and
    loses its meshes, whose places only its own workspace knows. An axis with a `ref`
    gets one of zero and a body turned by it, at the same angles. Of a patched model the
    axes stay, see the head of this file. Lengths are in m, masses in kg, angles in rad.

    Raises:
        BenchError: Where the file is missing.
        Unusable: Where the file is no model that MuJoCo can compile.
    """
    path, what = Path(path), f"Model {str(path)!r}"
    spec = read_spec(path)
    try:
        take_out_pictures(spec)
        added = take_out_patch(spec)
        model = spec.compile()
    except (ValueError, RuntimeError) as error:
        raise Unusable(what, [" ".join(str(error).split())]) from None
    _refuse_nonsense(path, model)
    if left := ", ".join(filter(None, (added, _left_out(model)))):
        warnings.warn(f"{what}: {left} left out.", LeftOut, stacklevel=2)
    _make_zero_the_reference(model)
    return model


FOLLOWS = "follows:"
"""Prefix of the name of a custom text of plain MJCF: a leader and coefficients of its
angle, q = c0 + c1 q_leader + c2 q_leader² …, for the joint whose name follows."""


def followers_of(model: mujoco.MjModel) -> dict[str, tuple[str, tuple[float, ...]]]:
    """Return joints that follow others: their leaders, and polynomials of its angle.

    Returns:
        By the follower's name; coefficients from the constant on, in rad (m).
    """
    found: dict[str, tuple[str, tuple[float, ...]]] = {}
    for e in range(model.neq):
        if _is_following(model, e):
            names = [model.joint(j[e]).name for j in (model.eq_obj1id, model.eq_obj2id)]
            found[names[0]] = names[1], _trimmed(model.eq_data[e, :5])
    joints = {model.joint(j).name for j in range(model.njnt)}
    for t in range(model.ntext):
        name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_TEXT, t)
        follower = name.removeprefix(FOLLOWS)
        if name.startswith(FOLLOWS) and follower in joints:
            start, size = model.text_adr[t], model.text_size[t]
            text = model.text_data[start : start + size].decode().rstrip("\0")
            law, _, leader = text.partition(":")
            found[follower] = leader, tuple(map(_coefficient, law.split()))
    return found


def _coefficient(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def _trimmed(law: np.ndarray) -> tuple[float, ...]:
    """Return coefficients without zeros at the end."""
    return tuple(np.trim_zeros(law, "b").tolist())


def _is_following(model: mujoco.MjModel, e: int) -> bool:
    """Return whether an equality is an active one of two joints."""
    joint = model.eq_type[e] == mujoco.mjtEq.mjEQ_JOINT
    return bool(joint and model.eq_active0[e] and model.eq_obj2id[e] >= 0)


def read_spec(path: Path) -> mujoco.MjSpec:
    """Read a model file with all that is in it; what has no name is numbered.

    Raises:
        BenchError: Where the file is missing.
        Unusable: Where it must not be compiled or is no model.
    """
    if not path.is_file():
        raise BenchError(f"There is no model file {str(path)!r}; give an MJCF or URDF.")
    if faults := faults_of(path):
        raise Unusable(f"Model {str(path)!r}", faults)
    try:
        spec = mujoco.MjSpec.from_file(str(path))
    except (ValueError, RuntimeError) as error:
        fault = " ".join(str(error).split())
        raise Unusable(f"Model {str(path)!r}", [fault]) from None
    _name_parts(spec)
    if b"<robot" in path.read_bytes():
        take_out_meshes(spec)
        spec.compiler.fusestatic = False
        spec.compiler.boundmass = spec.compiler.boundinertia = SPECK
    return spec


def _name_parts(spec: mujoco.MjSpec) -> None:
    for kind, parts in (("body", spec.bodies[1:]), ("joint", spec.joints)):
        names = {part.name for part in parts}
        for k, part in enumerate(parts, start=1):
            if not part.name:
                part.name = next(
                    name
                    for n in range(k, k + len(names) + 1)
                    if (name := f"{kind}_{n}") not in names
                )
                names.add(part.name)


def take_out_pictures(spec: mujoco.MjSpec) -> None:
    """Take out fields of heights and textures: small files of them can be huge."""
    fields = [g for g in spec.geoms if g.type == mujoco.mjtGeom.mjGEOM_HFIELD]
    for part in (*fields, *spec.hfields, *spec.textures):
        spec.delete(part)
    for material in spec.materials:
        material.textures = [""] * len(material.textures)


def take_out_meshes(spec: mujoco.MjSpec) -> None:
    """Take out meshes and their geoms."""
    for geom in [g for g in spec.geoms if g.type == mujoco.mjtGeom.mjGEOM_MESH]:
        spec.delete(geom)
    for mesh in list(spec.meshes):
        spec.delete(mesh)


def take_out_patch(spec: mujoco.MjSpec) -> str:
    """Hold what a patch added at zero and give the axes their gears' springs.

    Returns:
        What the patch had added and is left out; empty: nothing.
    """
    parts = (*spec.tendons, *spec.sites, *spec.excludes, *spec.texts)
    added = [part for part in parts if part.name.startswith(PATCH)]
    joints = [joint for joint in spec.joints if joint.name.startswith(PATCH)]
    if not added and not joints:
        return ""
    keys = _shorter_keys(spec)
    gears = {
        j.name[len(PATCH) : -len(GEAR)]: j for j in joints if j.name.endswith(GEAR)
    }
    for joint in spec.joints:
        if joint in joints:
            continue
        if joint.name in gears:
            joint.stiffness = list(gears[joint.name].stiffness)
        elif joint.stiffness[0] >= RIGID:
            joint.stiffness = [0.0, 0.0, 0.0]
        joint.springref = joint.ref
    counts = {
        "spring": len(joints) - len(gears),
        "tendon": sum(t.name.startswith(PATCH) for t in spec.tendons),
    }
    loose = [
        body
        for body in spec.bodies
        if body.name.startswith(PATCH) and not list(body.bodies)
    ]
    for part in (*added, *joints, *loose):
        spec.delete(part)
    for key, (qpos, qvel) in zip(spec.keys, keys, strict=True):
        key.qpos, key.qvel = qpos, qvel  # deleting a joint empties them
    several = [f"{n} {kind}{'s' * (n > 1)}" for kind, n in counts.items() if n]
    return f"{' and '.join(several)} of its patch" if several else ""


def _shorter_keys(spec: mujoco.MjSpec) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return positions and velocities of key frames without those of a patch."""
    if not spec.keys:
        return []
    model = spec.compile()
    patch = [model.joint(j).name.startswith(PATCH) for j in range(model.njnt)]
    of_patch = model.jnt_qposadr[patch], model.jnt_dofadr[patch]
    return [
        (np.delete(qpos, of_patch[0]), np.delete(qvel, of_patch[1]))
        for qpos, qvel in zip(model.key_qpos, model.key_qvel, strict=True)
    ]


def _make_zero_the_reference(model: mujoco.MjModel) -> None:
    """Turn (shift) each body by minus its axis' ref, which becomes zero.

    Laws by which joints follow others are of angles from their refs on; now from zero.
    """
    for e in filter(lambda e: _is_following(model, e), range(model.neq)):
        pair = [model.eq_obj1id[e], model.eq_obj2id[e]]
        own, leader = model.qpos0[model.jnt_qposadr[pair]]
        law = Polynomial(model.eq_data[e, :5])(Polynomial([-leader, 1.0])) + own
        model.eq_data[e, :5] = 0.0
        model.eq_data[e, : len(law.coef)] = law.coef
    for j in range(model.njnt):
        place, body = model.jnt_qposadr[j], model.jnt_bodyid[j]
        kind, ref = mujoco.mjtJoint(model.jnt_type[j]), float(model.qpos0[place])
        if kind not in (HINGE, SLIDE) or ref == 0.0:
            continue
        before = model.body_pos[body], model.body_quat[body]
        moved = after(before, moved_about(model, j, -ref))
        model.body_pos[body], model.body_quat[body] = moved
        model.qpos0[place] = 0.0


def moved_about(
    model: mujoco.MjModel, joint: int, by: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return position and quaternion of a body whose only joint has moved.

    Returns:
        Of the moved body in its frame before.
    """
    axis, anchor = model.jnt_axis[joint], model.jnt_pos[joint]
    if model.jnt_type[joint] == SLIDE:
        return by * axis, np.array([1.0, 0.0, 0.0, 0.0])
    quat, turned = np.zeros(4), np.zeros(3)
    mujoco.mju_axisAngle2Quat(quat, axis, by)
    mujoco.mju_rotVecQuat(turned, anchor, quat)
    return anchor - turned, quat


def _left_out(model: mujoco.MjModel) -> str:
    """List what a model states beyond rigid bodies, axes and linear springs."""
    stated = {
        "equality constraints that are not of two joints": any(
            not _is_following(model, e) for e in range(model.neq)
        ),
        "tendons": model.ntendon,
        "springs that are not linear": np.any(model.jnt_stiffnesspoly),
        "angles at which springs are slack": np.any(
            (model.qpos_spring != model.qpos0)[model.jnt_qposadr]
            & (model.jnt_stiffness > 0.0)
        ),
        "friction of joints": np.any(model.dof_frictionloss),
        "gravity compensation": np.any(model.body_gravcomp),
    }
    return ", ".join(name for name, there in stated.items() if there)


def _refuse_nonsense(path: Path, model: mujoco.MjModel) -> None:
    stands = (model.body_pos, model.body_quat, model.jnt_pos, model.jnt_axis)
    sizes = (model.body_mass, model.opt.gravity, model.qpos0)
    faults = []
    if not all(np.isfinite(values).all() for values in (*stands, *sizes)):
        faults.append("a position, an axis, a mass or gravity in it is not a number.")
    for name, (leader, law) in followers_of(model).items():
        if not np.isfinite(law).all():
            faults.append(f"joint {name!r} follows {leader!r} by what is no number.")
    stiff = model.jnt_stiffness
    for j in np.flatnonzero(~((stiff >= 0) & np.isfinite(stiff))):
        size = model.jnt_stiffness[j]
        faults.append(f"joint {model.joint(j).name!r} has the stiffness {size}.")
    for b in np.flatnonzero(model.body_jntnum > 1):
        name, count = model.body(b).name, model.body_jntnum[b]
        faults.append(f"body {name!r} has {count} joints; give each a body of its own.")
    refuse(f"Model {str(path)!r}", faults)


def facts_of(model: mujoco.MjModel) -> ModelFacts:
    """Return names and limits of a model; places have the format's names too."""
    own = [model.body(b).name or f"body_{b}" for b in range(1, model.nbody)]
    links = [f"link_{k + 1}" for k in range(model.njnt)]
    bodies = [*own, "base", *links, "flange", "tool"]
    limits = np.where(model.jnt_limited[:, None], model.jnt_range, [[-np.inf, np.inf]])
    return ModelFacts(
        joints=tuple(model.joint(j).name for j in range(model.njnt)),
        slides=tuple(bool(kind == SLIDE) for kind in model.jnt_type),
        lower=limits[:, 0],
        upper=limits[:, 1],
        bodies=tuple(dict.fromkeys(b for b in bodies if not b.startswith(PATCH))),
    )


def plain_mjcf(model: mujoco.MjModel) -> str:
    """Write bodies and joints of a compiled model as plain MJCF, in rad and m.

    Numbers read back to the last bit.
    """
    root = ElementTree.Element("mujoco", model="arm")
    ElementTree.SubElement(root, "compiler", angle="radian", autolimits="true")
    ElementTree.SubElement(root, "option", gravity=numbers(model.opt.gravity))
    elements = {0: ElementTree.SubElement(root, "worldbody")}
    if np.count_nonzero(model.body_parentid[1:] == 0) > 1:  # Pinocchio reads the first
        elements[0] = ElementTree.SubElement(elements[0], "body", name=ROOT)
    stands = {b: (model.body_pos[b], model.body_quat[b]) for b in range(model.nbody)}
    for b in range(1, model.nbody):
        parent = int(model.body_parentid[b])
        if model.body(parent).name.startswith(PATCH):
            stands[b] = after(stands[parent], stands[b])
        if model.body(b).name.startswith(PATCH):
            elements[b] = elements[parent]
            continue
        pos, quat = stands[b]
        body = ElementTree.SubElement(
            elements[parent],
            "body",
            name=model.body(b).name or f"body_{b}",
            pos=numbers(pos),
            quat=numbers(quat),
        )
        elements[b] = body
        if model.body_mass[b] > 0:
            ElementTree.SubElement(
                body,
                "inertial",
                mass=numbers([model.body_mass[b]]),
                pos=numbers(model.body_ipos[b]),
                quat=numbers(model.body_iquat[b]),
                diaginertia=numbers(model.body_inertia[b]),
            )
        first = model.body_jntadr[b]
        for j in range(first, first + model.body_jntnum[b]):
            body.append(_joint(model, j))
    if laws := followers_of(model):
        custom = ElementTree.SubElement(root, "custom")
        for name, (leader, law) in laws.items():
            data = f"{numbers(law)}:{leader}"
            ElementTree.SubElement(custom, "text", name=f"{FOLLOWS}{name}", data=data)
    return ElementTree.tostring(root, encoding="unicode")


Stand = tuple[np.ndarray, np.ndarray]
"""Position in m and quaternion of a body in another frame."""


def after(start: Stand, then: Stand) -> Stand:
    """Return one stand followed by another, which is seen from it."""
    position, quat = np.zeros(3), np.zeros(4)
    mujoco.mju_rotVecQuat(position, then[0], start[1])
    mujoco.mju_mulQuat(quat, start[1], then[1])
    return start[0] + position, quat


def _joint(model: mujoco.MjModel, j: int) -> ElementTree.Element:
    kind = mujoco.mjtJoint(model.jnt_type[j])
    if kind not in (HINGE, SLIDE):
        raise Unusable(
            "The model",
            [f"joint {model.joint(j).name!r} is neither a hinge nor a slide."],
        )
    position, velocity = model.jnt_qposadr[j], model.jnt_dofadr[j]
    joint = ElementTree.Element(
        "joint",
        name=model.joint(j).name or f"joint_{j}",
        type="hinge" if kind == HINGE else "slide",
        pos=numbers(model.jnt_pos[j]),
        axis=numbers(model.jnt_axis[j]),
        ref=numbers([model.qpos0[position]]),
        springref=numbers([model.qpos_spring[position]]),
        stiffness=numbers([model.jnt_stiffness[j]]),
        armature=numbers([model.dof_armature[velocity]]),
        damping=numbers([model.dof_damping[velocity]]),
    )
    if model.jnt_limited[j]:
        joint.set("range", numbers(model.jnt_range[j]))
    return joint


def numbers(values: Iterable[float]) -> str:
    """Return numbers as text that reads back to the last bit."""
    return " ".join(repr(float(value)) for value in np.ravel(np.asarray(values)))
