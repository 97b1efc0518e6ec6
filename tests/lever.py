"""Small arms on which every deflection can be calculated by hand."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from bench.rig import Rig, States

LENGTH = 0.5
"""From the axis to the flange, in m."""
HEIGHT = 0.3
"""Of the axis above the base, in m."""


def lever(folder: Path, *, mass: float = 0.0, second_axis: str = "") -> Path:
    """Write an arm of one axis about y whose link points along x.

    Args:
        folder: Folder of the model file.
        mass: Point mass at the link's end, in kg; without one there is no gravity.
        second_axis: Direction of a second axis at the end of the link, if any.

    Returns:
        Its model file. The stiffness is 50 kN m/rad, and 20 kN m/rad at the second.
    """
    inertial = '<inertial mass="{}" pos="{} 0 0" diaginertia="0.01 0.01 0.01"/>'
    end = f'<body name="flange" pos="{LENGTH} 0 0"/>'
    if second_axis:
        end = (
            f'<body name="link_2" pos="{LENGTH} 0 0">{inertial.format(0.1, 0)}'
            f'<joint name="a2" axis="{second_axis}" stiffness="2e4"/>'
            '<body name="flange"/></body>'
        )
    file = folder / "lever.xml"
    file.write_text(
        f"""<mujoco><option gravity="0 0 {-9.81 if mass else 0}"/><worldbody>
        <body name="base">{inertial.format(10, 0)}
          <body name="link_1" pos="0 0 {HEIGHT}">{inertial.format(mass or 1, LENGTH)}
            <joint name="a1" axis="0 1 0" stiffness="5e4"/>
            {end}
          </body>
        </body></worldbody></mujoco>"""
    )
    return file


def respond(
    rig: Rig,
    wrench: Sequence[Sequence[float]] | np.ndarray,
    posture: Sequence[float] = (0.0,),
    hold: Sequence[float] | None = None,
) -> States:
    """Load an arm in one posture, step by step.

    Args:
        rig: The arm.
        wrench: Force in N and torque in N m of each step, along the base's axes.
        posture: Joint angles, in rad.
        hold: Duration of each load, in s; default 1 s.
    """
    steps = len(wrench)
    return rig.respond(
        np.array([posture], float),
        np.array([wrench], float),
        np.array([hold or [1.0] * steps]),
    )


def moments(*torque: float, axis: int = 1) -> np.ndarray:
    """Return pure moments about a direction of the base, default y, step by step."""
    wrench = np.zeros((len(torque), 6))
    wrench[:, 3 + axis] = torque
    return wrench


def turn(states: States, body: str = "flange") -> np.ndarray:
    """Return a body's rotation vector in the base's frame, (rows, 3), in rad."""
    return Rotation.from_matrix(
        states.rotation[:, states.bodies.index(body)]
    ).as_rotvec()


def place(states: States, body: str = "flange") -> np.ndarray:
    """Return the origin of a body, (rows, 3), in m."""
    return states.position[:, states.bodies.index(body)]
