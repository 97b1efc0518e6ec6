"""A patched rig has nothing around it but what its recording says is mounted."""

from dataclasses import dataclass, field
from functools import cached_property

import mujoco
import numpy as np
from jaxtyping import Float
from typing_extensions import override

from bench.cell import Cell
from bench.recording import Payload
from bench.rig import Rig


@dataclass(frozen=True)
class BareCell(Cell):
    """Nothing around the arm but a sensor without mass, where a recording has it."""

    sensor_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    held: Payload = field(default_factory=Payload)

    @property
    @override
    def sensor_position(self) -> Float[np.ndarray, "3"]:
        return np.array(self.sensor_m)

    @property
    @override
    def payload(self) -> Payload:
        return self.held


@dataclass(frozen=True)
class WrittenRig(Rig):
    """A rig whose arm comes with the patch."""

    text: str = ""

    @cached_property
    @override
    def nominal(self) -> mujoco.MjModel:
        return mujoco.MjModel.from_xml_string(self.text)
