"""A robot's model file, MJCF or URDF, says which bodies hang on which joints.

MuJoCo reads either kind; `plain_mjcf` writes the moving parts back as one
self-contained MJCF text at full precision, without includes, defaults, pictures or
contacts, so that Pinocchio and MuJoCo read the very same arm.
"""

from collections.abc import Iterable
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np

from bench.errors import BenchError, Unusable

LARGEST_MODEL = 20_000_000
"""Bytes of a model file that are still read; chosen: a hundred times an arm's file."""


def load(path: Path | str) -> mujoco.MjModel:
    """Compile a model file.

    Args:
        path: An MJCF or URDF file.

    Returns:
        The compiled model; lengths in m, masses in kg, angles in rad.

    Raises:
        BenchError: Where the file is missing or too large.
        Unusable: Where the file is no model that MuJoCo can compile.
    """
    path = Path(path)
    if not path.is_file():
        raise BenchError(f"There is no model file {str(path)!r}; give an MJCF or URDF.")
    if path.stat().st_size > LARGEST_MODEL:
        raise BenchError(f"{str(path)!r} is larger than {LARGEST_MODEL} bytes.")
    if b"<!ENTITY" in path.read_bytes():
        raise BenchError(f"{str(path)!r} declares XML entities; write them out.")
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise Unusable(f"Model {str(path)!r}", [" ".join(str(error).split())]) from None
    _refuse_nonsense(path, model)
    return model


def _refuse_nonsense(path: Path, model: mujoco.MjModel) -> None:
    numbers = (model.body_pos, model.body_quat, model.jnt_pos, model.jnt_axis)
    faults = []
    if not all(np.isfinite(values).all() for values in numbers):
        faults.append("a position or an axis in it is not a number.")
    for j in np.flatnonzero(~(model.jnt_stiffness >= 0)):
        size = model.jnt_stiffness[j]
        faults.append(f"joint {model.joint(j).name!r} has the stiffness {size}.")
    if faults:
        raise Unusable(f"Model {str(path)!r}", faults)


def plain_mjcf(model: mujoco.MjModel) -> str:
    """Write the bodies, joints and sites of a compiled model as plain MJCF.

    Args:
        model: A compiled model.

    Returns:
        MJCF text in rad and m; numbers read back to the last bit.
    """
    root = ElementTree.Element("mujoco", model="arm")
    ElementTree.SubElement(root, "compiler", angle="radian", autolimits="true")
    ElementTree.SubElement(root, "option", gravity=_numbers(model.opt.gravity))
    elements = {0: ElementTree.SubElement(root, "worldbody")}
    for b in range(1, model.nbody):
        body = ElementTree.SubElement(
            elements[model.body_parentid[b]],
            "body",
            name=model.body(b).name or f"body_{b}",
            pos=_numbers(model.body_pos[b]),
            quat=_numbers(model.body_quat[b]),
        )
        elements[b] = body
        if model.body_mass[b] > 0:
            ElementTree.SubElement(
                body,
                "inertial",
                mass=_numbers([model.body_mass[b]]),
                pos=_numbers(model.body_ipos[b]),
                quat=_numbers(model.body_iquat[b]),
                diaginertia=_numbers(model.body_inertia[b]),
            )
        first = model.body_jntadr[b]
        for j in range(first, first + model.body_jntnum[b]):
            body.append(_joint(model, j))
    for s in range(model.nsite):
        ElementTree.SubElement(
            elements[model.site_bodyid[s]],
            "site",
            name=model.site(s).name or f"site_{s}",
            pos=_numbers(model.site_pos[s]),
            quat=_numbers(model.site_quat[s]),
        )
    return ElementTree.tostring(root, encoding="unicode")


def _joint(model: mujoco.MjModel, j: int) -> ElementTree.Element:
    kind = mujoco.mjtJoint(model.jnt_type[j])
    if kind not in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
        raise Unusable(
            "The model",
            [f"joint {model.joint(j).name!r} is neither a hinge nor a slide."],
        )
    position, velocity = model.jnt_qposadr[j], model.jnt_dofadr[j]
    joint = ElementTree.Element(
        "joint",
        name=model.joint(j).name or f"joint_{j}",
        type="hinge" if kind == mujoco.mjtJoint.mjJNT_HINGE else "slide",
        pos=_numbers(model.jnt_pos[j]),
        axis=_numbers(model.jnt_axis[j]),
        ref=_numbers([model.qpos0[position]]),
        springref=_numbers([model.qpos_spring[position]]),
        stiffness=_numbers([model.jnt_stiffness[j]]),
        armature=_numbers([model.dof_armature[velocity]]),
        damping=_numbers([model.dof_damping[velocity]]),
    )
    if model.jnt_limited[j]:
        joint.set("range", _numbers(model.jnt_range[j]))
    return joint


def _numbers(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in np.ravel(np.asarray(values)))
