"""A torso carries several arms; ropes, patches and proofs know one chain to one hand.

The joints of the other arms are held at zero, as `stiffness.arm` holds what a recording
does not name.
"""

from collections.abc import Collection
from pathlib import Path
from xml.etree import ElementTree

import mujoco

from bench.anatomy import branches, carriers_of
from bench.errors import UnknownName, Unusable
from bench.model_file import load, plain_mjcf
from bench.recording import Recording


def axes_to(model: mujoco.MjModel, hand: str) -> tuple[str, ...]:
    """Return the joints that carry a body, from the base on.

    Args:
        model: The arm or torso alone.
        hand: Name of a body.

    Raises:
        UnknownName: Where the model has no such body.
        Unusable: Where no joint carries it.
    """
    names = [model.body(b).name for b in range(1, model.nbody)]
    if hand not in names:
        raise UnknownName("body", hand, names)
    carriers = carriers_of(model, int(model.body(hand).id))
    axes = [j for j in range(model.njnt) if int(model.jnt_bodyid[j]) in carriers]
    if not axes:
        raise Unusable("The model", [f"no joint carries {hand!r}."])
    return tuple(model.joint(j).name for j in axes)


def with_axes(model: mujoco.MjModel, axes: Collection[str]) -> mujoco.MjModel:
    """Return a model in which only these joints move.

    Raises:
        UnknownName: Where the model has no such joint.
    """
    known = [model.joint(j).name for j in range(model.njnt)]
    for axis in axes:
        if axis not in known:
            raise UnknownName("joint", axis, known)
    root = ElementTree.fromstring(plain_mjcf(model))
    for body in root.iter("body"):
        for joint in body.findall("joint"):
            if joint.get("name") not in axes:
                body.remove(joint)
    return mujoco.MjModel.from_xml_string(
        ElementTree.tostring(root, encoding="unicode")
    )


def moving(recording: Recording, arm_file: Path) -> tuple[str, ...]:
    """Return which joints of a model with several arms a recording moves; () = all.

    Raises:
        Unusable: Where they form no chain.
    """
    model = load(arm_file)
    if not branches(model):
        return ()
    if recording.axes and not branches(with_axes(model, recording.axes)):
        return tuple(recording.axes)
    fault = (
        "it carries several arms, and the simulator takes one chain at a time: record "
        "each arm by itself and name its joints in [robot] axes, the others at zero"
    )
    raise Unusable("The model", [f"{fault}."])
