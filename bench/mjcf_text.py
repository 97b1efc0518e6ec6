"""Small parts of MJCF text: sections, joints and poses in full precision."""

from collections.abc import Iterable
from xml.etree.ElementTree import Element, SubElement

import mujoco
import numpy as np

Stand = tuple[np.ndarray, np.ndarray]
"""Position in m and quaternion of a body in another frame."""


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


def after(start: Stand, then: Stand) -> Stand:
    """Return one stand followed by another, which is seen from it."""
    position, quat = np.zeros(3), np.zeros(4)
    mujoco.mju_rotVecQuat(position, then[0], start[1])
    mujoco.mju_mulQuat(quat, start[1], then[1])
    return start[0] + position, quat


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


def numbers(values: Iterable[float]) -> str:
    """Return numbers as text that reads back to the last bit."""
    return " ".join(repr(float(value)) for value in np.ravel(np.asarray(values)))
