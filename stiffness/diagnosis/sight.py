"""What the tracker saw is laid beside where the arm's bodies should have been."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from bench.recording import Recording
from stiffness.arm import Arm
from stiffness.diagnosis.readings import Frames

FAR = 10.0
"""A reading this many times as far from the middle as nearly all is no place where the
arm was; chosen."""


@dataclass(frozen=True)
class Sight:
    """Readings of markers beside where the arm's bodies should be.

    Attributes:
        turned: From each marker's body to the base.
        origin: Of each marker's body, in m.
        y: Readings in the tracker's frame, in m; NaN where not seen.
        place: Of each marker in its body, in m.
        given: Whether that place is stated.
        transform: base_from_tracker; None where not stated.
    """

    turned: Float[np.ndarray, "visits markers 3 3"]
    origin: Float[np.ndarray, "visits markers 3"]
    y: Float[np.ndarray, "visits markers 3"]
    place: Float[np.ndarray, "markers 3"]
    given: Bool[np.ndarray, " markers"]
    transform: Float[np.ndarray, "4 4"] | None

    @classmethod
    def of(cls, arm: Arm, recording: Recording, posture: np.ndarray) -> "Sight":
        """Stand the arm in the recording's postures, one for each of its rows."""
        standing, markers = arm.at(posture), recording.markers
        assert recording.points is not None
        placements = {
            m.body: standing.placement(m.body) for m in markers
        }  # bodies carry several markers
        all_of_them = np.stack([placements[m.body] for m in markers], axis=1)
        return cls(
            turned=all_of_them[..., :3, :3],
            origin=all_of_them[..., :3, 3],
            y=recording.points,
            place=np.array(
                [np.zeros(3) if m.position is None else m.position for m in markers]
            ),
            given=np.array([m.position is not None for m in markers]),
            transform=recording.base_from_tracker,
        )

    @property
    def weight(self) -> Float[np.ndarray, "visits markers"]:
        """One for a reading, 0 where there is none or none that can be."""
        seen = np.isfinite(self.y).all(axis=2)
        if not seen.any():
            return seen.astype(float)
        off = np.abs(self.y - np.median(self.y[seen], axis=0)).max(axis=2)
        most = np.quantile(off[seen], 0.95)
        return (seen & (np.nan_to_num(off) <= FAR * most)).astype(float)

    def misfit(self, frames: Frames) -> Float[np.ndarray, "visits markers 3"]:
        """Return readings less where they should be, along the base's axes, in m."""
        point = np.nan_to_num(self.y) @ frames.turn.T + frames.shift
        return (
            point - np.einsum("vmij,mj->vmi", self.turned, frames.place) - self.origin
        )


def extent_of(sight: Sight) -> float:
    """Return over how large a box the readings go, in m."""
    y = sight.y[sight.weight > 0]
    return float(np.ptp(y, axis=0).max()) if len(y) else 0.0
