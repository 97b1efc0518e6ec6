"""Names and limits of a robot model that a recording is checked against."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class ModelFacts:
    """Joints from base to tip with their limits, and bodies, by name.

    Attributes:
        joints: All joints that move.
        slides: Whether each is prismatic.
        lower: Lower limits, in rad (m for slides); minus infinity where none.
        upper: Upper limits.
        bodies: All bodies.
    """

    joints: tuple[str, ...]
    slides: tuple[bool, ...]
    lower: Float[np.ndarray, " joints"]
    upper: Float[np.ndarray, " joints"]
    bodies: tuple[str, ...]
