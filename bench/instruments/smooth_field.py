"""Over a hand's breadth the error of a tracker hardly changes, over its volume it does.

==========  ==========================================================================
Equation    f(p) = sd sqrt(2/M) Σ cos(k_m·p + φ_m) per coordinate, k ~ N(0, 1/L²),
            M features; covariance sd² exp(-d²/(2 L²)) at distance d, |f| ≤ sd sqrt(2 M)
Source      Rahimi & Recht 2007, "Random features for large-scale kernel machines"
Valid       inside the measuring volume
Ignores     growth towards the volume's edges, change over the day
==========  ==========================================================================
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

FEATURES = 64
"""M; chosen: the sum is then near enough to a normal distribution."""
CORRELATION_LENGTH = 0.5
"""L in m; chosen: a third of the measuring volume's side."""


@dataclass(frozen=True)
class SmoothField:
    """A random vector at every point of space, the same whenever one comes back.

    Attributes:
        wave: Wave vectors k, in rad/m.
        phase: Phases φ, in rad.
        sd: One sigma of each coordinate, in m.
    """

    wave: Float[np.ndarray, "features 3 3"]
    phase: Float[np.ndarray, "features 3"]
    sd: float

    def at(self, place: Float[np.ndarray, "*rows 3"]) -> Float[np.ndarray, "*rows 3"]:
        """Return the field at places, in m."""
        if self.sd == 0.0:
            return np.zeros_like(place)
        total = np.zeros_like(place)
        for wave, phase in zip(self.wave, self.phase, strict=True):
            total += np.cos(place @ wave.T + phase)
        return self.sd * np.sqrt(2.0 / len(self.phase)) * total


def smooth_field(
    sd: float, random: np.random.Generator, length: float = CORRELATION_LENGTH
) -> SmoothField:
    """Draw a field.

    Args:
        sd: One sigma of each coordinate, in m.
        random: Where the draws come from.
        length: Over which it changes, in m.
    """
    wave = random.standard_normal((FEATURES, 3, 3)) / length
    phase = random.uniform(0.0, 2.0 * np.pi, (FEATURES, 3))
    return SmoothField(wave, phase, sd)
