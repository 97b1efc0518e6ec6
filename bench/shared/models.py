"""Models of robots as both sides share them: plain text, names and limits of parts."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class ModelFacts:
    """Joints from base to tip with their limits, and bodies, by name.

    Attributes:
        joints: All joints that move.
        slides: Whether each is prismatic.
        lower: Lower limits, in rad (m for slides); minus infinity where none.
        followers: Joints that follow others, and are not recorded unless named.
    """

    joints: tuple[str, ...]
    slides: tuple[bool, ...]
    lower: Float[np.ndarray, " joints"]
    upper: Float[np.ndarray, " joints"]
    bodies: tuple[str, ...]
    followers: tuple[str, ...] = ()

    @property
    def axes(self) -> tuple[str, ...]:
        """The joints that a recording has where it names none."""
        return tuple(name for name in self.joints if name not in self.followers)


@dataclass(frozen=True, repr=False)
class RobotModel:
    """A robot's model, read from its file.

    Attributes:
        mjcf: Its bodies, joints and masses as self-contained MJCF text, in m and rad.
        facts: Names and limits that a recording is checked against.
    """

    file: Path
    mjcf: str = field(repr=False)
    facts: ModelFacts

    def __repr__(self):
        """Return the file's name and what moves."""
        joints = ", ".join(self.facts.joints)
        return f"RobotModel({self.file.name!r}, joints {joints})"


def axis_unit(slides: bool | np.bool_) -> tuple[str, float]:
    """Return the unit in which people read an axis, and its number per rad or m."""
    return ("mm", 1e3) if slides else ("°", float(np.degrees(1.0)))
