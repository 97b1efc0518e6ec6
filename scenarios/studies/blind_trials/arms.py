"""Draws arms of other builds: six or seven axes, or six axes on a lift column.

Lengths, offsets, masses and springs are drawn about those of arms that carry 5 to
20 kg. Axes deviate from right angles, so that no closed-form kinematics fits.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scenarios.pipelines.synthetic_recording import KR10

YAW, PITCH, ROLL, LIFT = "yaw", "pitch", "roll", "lift"
BUILDS: dict[str, tuple[str, ...]] = {
    "six": (YAW, PITCH, PITCH, ROLL, PITCH, ROLL),
    "seven": (YAW, PITCH, YAW, PITCH, ROLL, PITCH, ROLL),
    "column": (LIFT, YAW, PITCH, PITCH, ROLL, PITCH, ROLL),
}
"""Kinds of axes from the base to the tool; the arm is upright at zero."""
DIRECTION = {YAW: (0, 0, 1), PITCH: (0, 1, 0), ROLL: (0, 0, 1), LIFT: (0, 0, 1)}
RANGE = {YAW: 2.8, PITCH: 1.7, ROLL: 2.8}
LOAD, WEIGHT = 100.0, 120.0
"""The heaviest load in N, and weight of an arm in N per metre of its reach; chosen."""
WOUND_UP = 2.5e-3
"""Largest wind-up of a gear in rad; a KR10 has 1.5 to 4e-3 under 100 N."""
OFF = 0.1
"""One sigma of an axis' direction, in rad; chosen."""


@dataclass(frozen=True)
class Arm:
    """The model file of an arm of the trials, and its number of axes."""

    file: Path
    axes: int


THE_KR10 = Arm(KR10, 6)


def arm_of(name: str, seed: int, folder: Path) -> Arm:
    """Return the KR10, or write the model of another arm.

    Args:
        name: `kr10` or one of `BUILDS`.
        seed: Of lengths, masses, springs and everything else that is drawn.
        folder: Folder of the model file.
    """
    if name == "kr10":
        return THE_KR10
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"{name}_{seed}.xml"
    text = arm_text(BUILDS[name], f"{name} {seed}", seed)
    file.write_text(text, encoding="utf-8")
    return Arm(file, len(BUILDS[name]))


def arm_text(build: Sequence[str], name: str, seed: int) -> str:
    """Return the model of an arm as MJCF.

    Args:
        build: Kinds of its axes, from the base to the tool.
        name: Name of the model.
        seed: Of lengths, masses, springs and everything else that is drawn.
    """
    draw = np.random.default_rng(seed)
    turning = [kind for kind in build if kind != LIFT]
    lengths = _lengths(draw, len(turning))
    begins, ends = [], []
    reach = float(sum(lengths))
    at = draw.uniform(0.15, 0.3)
    for k, kind in enumerate(build, start=1):
        along = np.array(DIRECTION[kind]) + OFF * draw.normal(size=3)
        aside = 0.04 * draw.normal(size=2)
        length = 0.15 if kind == LIFT else lengths.pop(0)
        mass = 4.0 + 30.0 * (reach / 1.3) * max(reach - at, 0.1) / reach
        thick = 0.03 + 0.05 * max(reach - at, 0.1) / reach
        begins.append(
            f'<body name="link_{k}" pos="{_row(aside[0], aside[1], at)}">'
            f'<inertial mass="{mass:.4f}" pos="0 0 {length / 2:.4f}"'
            f' diaginertia="{_row(*_inertia(mass, length, thick))}"/>'
            + _joint(k, kind, along, max(reach - 0.5 * at, 0.2), draw)
            + f'<geom type="capsule" size="{thick:.4f}"'
            f' fromto="0 0 0 0 0 {max(length, 0.02):.4f}" mass="0"'
            ' contype="0" conaffinity="0"/>'
        )
        ends.append("</body>")
        at = length
        reach = max(reach - length, 0.1)
    flange = f'<body name="flange" pos="{_row(0, 0, at)}"/>'
    return (
        f'<mujoco model="{name}"><compiler angle="radian" autolimits="true"/>'
        '<worldbody><body name="base"><inertial mass="30" pos="0 0 0.1"'
        ' diaginertia="0.5 0.5 0.5"/><geom type="cylinder" size="0.12 0.1"'
        ' pos="0 0 0.1" mass="0" contype="0" conaffinity="0"/>'
        f"{''.join(begins)}{flange}{''.join(ends)}"
        "</body></worldbody></mujoco>\n"
    )


def _lengths(draw: np.random.Generator, axes: int) -> list[float]:
    """Return the links' lengths in m: shoulder, two long links, others, wrist."""
    between = [float(draw.uniform(0.05, 0.15)) for _ in range(axes - 3)]
    long = [float(draw.uniform(0.35, 0.6)) for _ in range(2)]
    return [between[0], long[0], *between[1:-2], long[1], *between[-2:], 0.1][:axes]


def _joint(
    k: int, kind: str, along: np.ndarray, reach: float, draw: np.random.Generator
) -> str:
    """Return a joint in MJCF with a spring that its load winds up by some 2.5 mrad."""
    axis = _row(*(along / np.linalg.norm(along)))
    if kind == LIFT:
        stiffness = 1e6 * 2.0 ** draw.uniform(-1, 1)
        return (
            f'<joint name="a{k}" type="slide" axis="{axis}" range="0 0.6"'
            f' stiffness="{stiffness:.1f}"/>'
        )
    stiffness = reach * (LOAD + WEIGHT * reach) / WOUND_UP * 2.0 ** draw.uniform(-1, 1)
    limit = RANGE[kind]
    return (
        f'<joint name="a{k}" axis="{axis}" range="{-limit} {limit}"'
        f' stiffness="{stiffness:.1f}"/>'
    )


def _inertia(mass: float, length: float, thick: float) -> tuple[float, float, float]:
    """Return a cylinder's moments of inertia: m (3 r² + h²) / 12 twice and m r² / 2."""
    across = mass * (3 * thick**2 + length**2) / 12
    return across, across, mass * thick**2 / 2


def _row(*numbers: float) -> str:
    return " ".join(f"{number:.6f}" for number in numbers)
