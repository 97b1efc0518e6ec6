"""Encoders: motor angles, and with a second encoder angles after the gears.

The controller reports the commanded angle. The motor reaches it up to a small random
error, which no reading contains; it limits the repeatability of a pose.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from bench.instruments.random_streams import Streams
from bench.shared.errors import not_sizes, refuse

ARRIVAL = 7e-6
"""A plausible standard deviation of an axis' arrival, in rad: the KR10's repeatability
of 0.02 mm (Wu et al. 2024, section 3.1) taken as three sigma at the flange, and 0.63 m
from A1, A2 and A3 to the flange at home: 0.02e-3 / 3 / 0.63 / sqrt(3) = 6.1e-6, rounded
up."""


@dataclass(frozen=True)
class Encoders:
    """The encoders at the motors, and where there are any, those after the gears.

    Attributes:
        arrival: Scatter of the true motor angle around the reported one, standard
            deviation per visit and axis, in rad; 0: the reported angle is exact.
        link_side: Whether there are encoders after the gears.
        repeatability: Their stated standard deviation, in rad. Chosen: 0.0005°, a good
            ring encoder.
        noise: Their white noise in units of what they state; 0: none.
    """

    arrival: float = 0.0
    link_side: bool = False
    repeatability: float = float(np.deg2rad(0.0005))
    noise: float = 1.0

    def __post_init__(self):
        """Check all sizes at once."""
        names = ("arrival", "repeatability", "noise")
        faults = not_sizes({name: getattr(self, name) for name in names})
        refuse("Encoders", faults)

    def arrive(
        self, visits: int, axes: int, chance: Streams
    ) -> Float[np.ndarray, "visits axes"]:
        """Return how far beyond its reported angle each motor stops, in rad."""
        return self.arrival * chance["arrival"].standard_normal((visits, axes))

    def read(
        self,
        angle: Float[np.ndarray, "rows axes"],
        slides: Sequence[bool],
        chance: Streams,
    ) -> Float[np.ndarray, "rows axes"] | None:
        """Return the readings after the gears, in rad; None without such encoders.

        A slide has none: the format has no such column. The true angles after the gears
        are in rad.
        """
        if not self.link_side:
            return None
        drawn = chance["link_encoders"].standard_normal(angle.shape)
        reading = angle + self.noise * self.repeatability * drawn
        return np.where(slides, np.nan, reading)
