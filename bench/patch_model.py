"""MuJoCo writes six digits; a model that is to be the same arm needs them all.

`model.xml` is MuJoCo's own rendering with every number of bodies, joints, sites and
tendons put back at full precision from the compiled model.
"""

from collections.abc import Callable
from xml.etree import ElementTree

import mujoco
import numpy as np

from bench.rig import Rig

HEADER = """
This arm with what a diagnosis put into it, for MuJoCo 4. Set the option
integrator="discrete" and a large timestep to find its rest. patch.json is the exact
record: it holds also what no MJCF can, such as laws that depend on the commanded angle,
faults of instruments, and for how long a creeping axis is held.
"""


def mjcf_of(rig: Rig) -> str:
    """Return the patched arm as MJCF text."""
    model = rig.model
    spec = rig.spec.copy()
    root = ElementTree.fromstring(spec.to_xml())
    fill: dict[str, Callable[[ElementTree.Element, mujoco.MjModel], None]] = {
        "body": _body,
        "joint": _joint,
        "site": _site,
    }
    for tag, write in fill.items():
        for element in root.iter(tag):
            if element.get("name"):
                write(element, model)
    for section in root.iter("tendon"):
        for element in section:
            _tendon(element, model)
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding="unicode")
    return f"<!--{HEADER}-->\n{text}\n"


def _body(element: ElementTree.Element, model: mujoco.MjModel) -> None:
    b = model.body(element.get("name")).id
    element.set("pos", _numbers(model.body_pos[b]))
    element.set("quat", _numbers(model.body_quat[b]))
    inertial = element.find("inertial")
    if inertial is not None and model.body_mass[b] > 0:
        inertial.attrib.clear()
        inertial.set("pos", _numbers(model.body_ipos[b]))
        inertial.set("quat", _numbers(model.body_iquat[b]))
        inertial.set("mass", _numbers(model.body_mass[b]))
        inertial.set("diaginertia", _numbers(model.body_inertia[b]))


def _joint(element: ElementTree.Element, model: mujoco.MjModel) -> None:
    joint = model.joint(element.get("name"))
    j, position, velocity = joint.id, joint.qposadr[0], joint.dofadr[0]
    element.set("pos", _numbers(model.jnt_pos[j]))
    element.set("axis", _numbers(model.jnt_axis[j]))
    element.set("stiffness", _numbers(model.jnt_stiffness[j]))
    element.set("damping", _numbers(model.dof_damping[velocity]))
    element.set("armature", _numbers(model.dof_armature[velocity]))
    element.set("ref", _numbers(model.qpos0[position]))
    element.set("springref", _numbers(model.qpos_spring[position]))


def _site(element: ElementTree.Element, model: mujoco.MjModel) -> None:
    element.set("pos", _numbers(model.site(element.get("name")).pos))


def _tendon(element: ElementTree.Element, model: mujoco.MjModel) -> None:
    t = model.tendon(element.get("name")).id
    element.set("stiffness", _numbers(model.tendon_stiffness[t]))
    element.set("springlength", _numbers(model.tendon_lengthspring[t]))
    if element.get("springyield"):
        element.set("springyield", _numbers(model.tendon_springyield[t]))
    first = model.tendon_adr[t]
    for w, wrap in enumerate(element.findall("joint")):
        wrap.set("coef", _numbers(model.wrap_prm[first + w]))


def _numbers(values: object) -> str:
    return " ".join(repr(float(v)) for v in np.ravel(np.asarray(values)))
