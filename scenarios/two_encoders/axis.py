"""An axis that is read twice, what lies between its encoders, and what that leaves."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from stiffness.two_encoders.found import Between
from stiffness.two_encoders.motions import Motion

WINDOW = 0.1
"""Seconds that are averaged beside the full rate; chosen: gear ripple is faster."""
DECADE = 10.0
"""How far a spring of the model may be off and still be nominal."""


@dataclass(frozen=True)
class Axis:
    """One axis, what lies between its encoders, and the proof.

    Attributes:
        name: a1, a2 …
        fitted: Motions that were fitted.
        judged: The last motion, that was not.
        found: What was believed and what was refused.
        before: What the nominal simulation leaves of the judged motion, in rad.
        after: What the simulator leaves of it with what was named, in rad.
        noise: Of a row, one sigma, in rad.
        stated: Whether the recording states it.
        beyond_before: P-value of the nominal simulation leaving more than noise.
        beyond_after: The same of what was named, on the judged motion.
        model_give: Compliance of the model's spring, in rad/(N m); 0: rigid.
        give: Compliance as fitted, and half its interval; None: torque is not known.
    """

    name: str
    fitted: tuple[Motion, ...]
    judged: Motion
    found: Between
    before: Float[np.ndarray, " rows"]
    after: Float[np.ndarray, " rows"]
    noise: float
    stated: bool
    beyond_before: float
    beyond_after: float
    model_give: float = 0.0
    give: tuple[float, float] | None = None

    @property
    def is_nominal_spring(self) -> bool:
        """Return whether the wind-up is the model's own, within a decade."""
        if self.model_give == 0.0 or self.give is None:
            return False
        low, high = self.model_give / DECADE, self.model_give * DECADE
        return low <= self.give[0] <= high


def rms(left: Float[np.ndarray, " rows"], time: Float[np.ndarray, " rows"]) -> float:
    """Return the root of the mean square of means over a window, in rad."""
    part = np.floor((time - time[0]) / WINDOW + 1e-9).astype(int)
    means = np.bincount(part, left) / np.bincount(part)
    return float(np.sqrt(np.mean((means - means.mean()) ** 2)))


def whole_rms(left: Float[np.ndarray, " rows"]) -> float:
    """Return the root of the mean square of all rows, in rad."""
    return float(np.sqrt(np.mean((left - left.mean()) ** 2)))
