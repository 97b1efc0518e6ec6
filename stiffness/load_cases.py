"""A load case is a posture that motors hold and a load that pulls: what was done."""

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from bench.errors import Unusable
from bench.recording import Payload


@dataclass(frozen=True)
class LoadCases:
    """What a method is asked to predict for, one static case per row.

    Asked for is how far the end-effector point moves, along the base's axes, when the
    wrench comes to act on an arm that already bends under its own weight.

    Attributes:
        posture: Joint angles that the motors hold, in rad.
        wrench_in_base: What the world exerts on the robot: force in N, then torque in
            N m about `origin_in_flange`, along the base's axes.
        point_in_flange: The end-effector point of each case, in the flange's frame, m.
        origin_in_flange: The sensor's origin in the flange's frame, in m.
        payload: What is mounted beyond the model; None = nothing.

    Raises:
        Unusable: Where arrays disagree in shape or hold what is no number, naming all.
    """

    posture: Float[np.ndarray, "cases axes"]
    wrench_in_base: Float[np.ndarray, "cases 6"]
    point_in_flange: Float[np.ndarray, "cases 3"]
    origin_in_flange: Float[np.ndarray, "3"] = field(
        default_factory=lambda: np.zeros(3)
    )
    payload: Payload | None = None

    def __post_init__(self):
        """Check shapes and numbers."""
        cases = len(self.posture)
        faults = []
        for name, columns in (("wrench_in_base", 6), ("point_in_flange", 3)):
            shape = np.shape(getattr(self, name))
            if shape != (cases, columns):
                faults.append(f"{name} is {shape}, expected {(cases, columns)}.")
        for name in ("posture", "wrench_in_base", "point_in_flange"):
            value = getattr(self, name)
            if not np.isfinite(value).all():
                row = int(np.argwhere(~np.isfinite(value))[0][0])
                faults.append(f"{name}, row {row}: not a number.")
        if faults:
            raise Unusable("The load cases", faults)

    def __len__(self) -> int:
        """Return the number of cases."""
        return len(self.posture)

    def take(self, rows: np.ndarray) -> "LoadCases":
        """Return the same with only these rows (indices or a mask)."""
        return replace(
            self,
            posture=self.posture[rows],
            wrench_in_base=self.wrench_in_base[rows],
            point_in_flange=self.point_in_flange[rows],
        )
