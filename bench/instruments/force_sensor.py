"""Force sensor: wrench with rotation, gain, bias, noise and resolution errors.

==========  ==========================================================================
Equation    reading = (1 + gain) g R [F; M - offset x F] + bias + noise, rounded to the
            resolution; R = exp(turn of the visit)ᵀ exp(mounting)ᵀ, g = 1 + gain of the
            visit
Source      linear calibration of six-axis sensors; sizes at each attribute
Valid       plateaus within the sensor's range
Ignores     drift with temperature, hysteresis of the strain gauges
==========  ==========================================================================
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from bench.instruments.random_streams import Streams
from bench.shared.errors import not_sizes, not_vectors, refuse
from bench.shared.recording import WrenchSpec

NO_GAIN = ((0.0,) * 6,) * 6
TURN = float(np.deg2rad(0.3))
"""Rotation of the force between two visits, one sigma about each axis, in rad; chosen,
as large as a careful mounting leaves."""
SIZE = 0.005
"""Error of the force's size between two visits, one sigma; chosen, beside `TURN`."""


@dataclass(frozen=True)
class ForceSensor:
    """Force sensor on the flange; by default an ATI Axia80-M8.

    Attributes:
        accuracy_force: One sigma that it states, in N; Wu et al. 2024, section 3.1,
            give 0.04 N as its accuracy.
        accuracy_torque: The same in N m; 0.002 N m there.
        noise: White noise of a row in units of what it states; 0: none.
        bias: Reading without a load, in N and N m along its axes.
        gain: Row k holds the errors of channel k per unit of each channel;
            force from torque in 1/m, torque from force in m, the rest without unit.
        mounting: Rotation vector from its stated to its true axes, in rad.
        offset: From its stated to its true origin, in m, along the stated axes.
        turn: One sigma of a rotation about each axis that a whole visit shares, in rad;
            `TURN` for a cable or mounting that gives way.
        size: One sigma of a scale that a whole visit shares; `SIZE` likewise.
        resolution: Smallest step of force and of torque, in N and N m; 0: none.
    """

    accuracy_force: float = 0.04
    accuracy_torque: float = 0.002
    noise: float = 1.0
    bias: tuple[float, ...] = (0.0,) * 6
    gain: tuple[tuple[float, ...], ...] = NO_GAIN
    mounting: tuple[float, ...] = (0.0, 0.0, 0.0)
    offset: tuple[float, ...] = (0.0, 0.0, 0.0)
    turn: float = 0.0
    size: float = 0.0
    resolution: tuple[float, ...] = (0.0, 0.0)

    def __post_init__(self):
        """Check all sizes at once."""
        names = ("accuracy_force", "accuracy_torque", "noise", "turn", "size")
        sizes = {name: getattr(self, name) for name in names}
        faults = not_sizes(sizes | {"resolution": self.resolution})
        rows = {f"gain, row {k}": row for k, row in enumerate(self.gain, start=1)}
        faults += not_vectors({"bias": self.bias, **rows}, 6)
        faults += not_vectors({"mounting": self.mounting, "offset": self.offset}, 3)
        faults += not_vectors({"resolution": self.resolution}, 2)
        if len(self.gain) != 6:
            faults.append(f"gain has {len(self.gain)} rows, expected 6.")
        refuse("Force sensor", faults)

    def read(
        self,
        wrench: Float[np.ndarray, "rows 6"],
        visit: Int[np.ndarray, " rows"],
        chance: Streams,
    ) -> Float[np.ndarray, "rows 6"]:
        """Return the readings of the world's wrench, in N and N m.

        The wrench is about the stated origin, along the stated axes; faults differ from
        visit to visit.
        """
        drawn = chance["wrench_turn"].standard_normal((int(visit.max()) + 1, 4))
        turn = Rotation.from_rotvec(self.turn * drawn[visit, :3])
        scale = (1.0 + self.size * drawn[:, 3])[visit, None]
        seated = Rotation.from_rotvec(self.mounting) * turn
        force, torque = np.hsplit(wrench, 2)
        about_it = (force, torque - np.cross(self.offset, force))
        felt = scale * np.hstack([seated.apply(p, inverse=True) for p in about_it])
        sigma = np.repeat([self.accuracy_force, self.accuracy_torque], 3)
        noise = chance["wrench_noise"].standard_normal(wrench.shape)
        reading = felt + felt @ np.array(self.gain).T + np.array(self.bias)
        reading += self.noise * sigma * noise
        return _rounded(reading, np.repeat(self.resolution, 3))

    def spec(self, body: str, position: Float[np.ndarray, "3"]) -> WrenchSpec:
        """Return its specification, without its faults, at a place of a body, in m."""
        return WrenchSpec(
            accuracy_force=self.accuracy_force,
            accuracy_torque=self.accuracy_torque,
            body=body,
            position=position,
        )


def _rounded(
    reading: Float[np.ndarray, "rows 6"], step: Float[np.ndarray, "6"]
) -> Float[np.ndarray, "rows 6"]:
    """Round to whole steps where a step is given."""
    coarse = np.where(step > 0.0, step, 1.0)
    return np.where(step > 0.0, coarse * np.rint(reading / coarse), reading)
