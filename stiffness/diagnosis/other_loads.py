"""A wrench can be read in other ways: other signs, units and axes."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from bench.recording import Recording
from stiffness.arm import Arm
from stiffness.diagnosis.diagnosis import Warned
from stiffness.diagnosis.other_readings import of_angles
from stiffness.diagnosis.set_up_sizes import KGF, LBF

FORCES = (("kgf", KGF), ("lbf", LBF))
"""Other units of force, in N."""


def of_loads(some: Recording, arm: Arm) -> Iterator[tuple[Warned, Recording]]:
    """List how else the load, and relative displacements, may be meant.

    Args:
        some: With a wrench.
        arm: The nominal arm, with the recording's names.
    """
    wrench, sensor = some.wrench, some.wrench_sensor
    assert wrench is not None and sensor is not None
    text = (
        "the wrench looks reversed: the arm moves against it. Give what the world "
        "exerts on the robot."
    )
    if some.displacement == "relative":
        text += " Or the displacements are counted backwards."
    yield Warned("wrench_sign", "wrench_sensor", text), replace(some, wrench=-wrench)
    for part, columns in (("force", slice(0, 3)), ("torque", slice(3, 6))):
        sign = np.ones(6)
        sign[columns] = -1.0
        text = f"the {part} looks reversed: the arm moves against it, not the rest."
        warned = Warned("wrench_sign", "wrench_sensor", text)
        yield warned, replace(some, wrench=wrench * sign)
    for unit, size_in_n in FORCES:
        text = (
            f"the forces look as if given in {unit}, the torques in Nm: they fit "
            f"together with the forces times {size_in_n:g}. N is expected."
        )
        meant = wrench * np.array([size_in_n] * 3 + [1.0] * 3)
        yield Warned("units", "wrench_sensor", text), replace(some, wrench=meant)
    for factor in (1e3, 1e-3):
        size = np.array([1.0] * 3 + [factor] * 3)
        text = (
            "torques and forces look as if given in units that do not belong together: "
            f"they fit with the torques times {factor:g}. N and Nm are expected."
        )
        warned = Warned("units", "wrench_sensor", text)
        yield warned, replace(some, wrench=wrench * size)
    other = "base" if sensor.frame == "sensor" else "sensor"
    text = (
        f"the wrench looks as if given along the axes of the {other}, not of the "
        f"{sensor.frame}: say frame = {other!r} in [sensors.wrench]."
    )
    turned = replace(some, wrench_sensor=replace(sensor, frame=other))
    yield Warned("wrench_frame", "wrench_sensor", text), turned
    text = f"{text[:-1]}, and change its sign."
    warned = Warned("wrench_sign", "wrench_sensor", text)
    yield warned, replace(turned, wrench=-wrench)
    if some.displacement == "relative":
        for angles in of_angles(some.posture, arm.slides):
            yield angles.warned, replace(some, posture=angles.meant(some.posture))
