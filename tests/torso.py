"""A torso on a lift with two arms: sixteen axes."""

from dataclasses import replace

import numpy as np

from bench.patch import BareCell
from bench.rig import Rig


def branch(side: str, y: float) -> str:
    """Write an arm of seven axes, turned outwards."""
    opened, turn = "", f'pos="0.02 {y} 0.3" euler="{-300 * y} 0 0"'
    for k, axis in enumerate(("0 0 1", "0 1 0") * 3 + ("0 0 1",), start=1):
        opened += (
            f'<body name="{side}_link_{k}" {turn}><joint name="{side}_{k}" '
            f'axis="{axis}" range="-100 100" stiffness="{7e4 / k:.0f}"/>'
            f'<inertial pos="0 0.01 0.08" mass="{3.2 / k}" diaginertia="1 1 1"/>'
        )
        turn = 'pos="0.01 0 0.17"'
    return f'{opened}<body name="{side}_hand" {turn}/>{"</body>" * 7}'


TORSO = f"""<mujoco><worldbody><body name="base" pos="1 2 0.1" euler="5 0 20">
  <inertial pos="0 0 0.2" mass="40" diaginertia="1 1 1"/>
  <body name="column" pos="0 0 0.5">
    <joint name="lift" type="slide" axis="0 0 1" range="0 0.4" stiffness="1e6"/>
    <inertial pos="0 0 0.1" mass="15" diaginertia="1 1 1"/>
    <body name="chest" pos="0 0 0.25">
      <joint name="waist" axis="0 0 1" range="-120 120" stiffness="1e5"/>
      <inertial pos="0 0 0.2" mass="10" diaginertia="1 1 1"/>
      {branch("left", 0.2)}{branch("right", -0.2)}
    </body></body></body></worldbody></mujoco>"""
"""Sixteen axes: a lift, a waist and two arms."""


def alone(rig: Rig) -> Rig:
    """Return a rig without anything around it."""
    return replace(
        rig, cell=BareCell(np.zeros((0, 3)), sensor_mass=0.0, mount_mass=0.0)
    )


def drawn_postures(rig: Rig, count: int) -> np.ndarray:
    low, high = rig.nominal.jnt_range.T
    return np.random.default_rng(5).uniform(low, high, (count, len(low)))
