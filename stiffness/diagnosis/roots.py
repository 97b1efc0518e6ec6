"""Errors that many readings share make them dependent; a square root undoes it.

==========  ==========================================================================
Equation    (D^-1 + F F')^-1 = R'R = D - H'H, R = (1 + A A')^-1/2 D^1/2, A = D^1/2 F;
            with A = u s v': H = (s^2 / (1 + s^2))^1/2 u' D^1/2
Source      spectral calculus: A A' has the left singular vectors of A
Valid       D positive semidefinite (0 = not seen)
Ignores     nothing
==========  ==========================================================================
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from stiffness.diagnosis.visits import stretches


@dataclass(frozen=True, eq=False)
class Roots:
    """Square roots R of inverse covariances of markers' means, visit by visit.

    Attributes:
        half: D^1/2 of each marker.
        error: u, what shared errors feign, whitened.
        size: s^2 of each.
    """

    half: Float[np.ndarray, "visits markers 3 3"]
    error: Float[np.ndarray, "visits n errors"]
    size: Float[np.ndarray, "visits errors"]

    @classmethod
    def of(
        cls,
        precision: Float[np.ndarray, "visits markers 3 3"],
        feigned: Float[np.ndarray, "visits n errors"],
    ) -> "Roots":
        """Take the roots.

        Args:
            precision: D, inverse covariance of each marker's mean.
            feigned: F, what shared errors feign, one sigma each.
        """
        value, vector = np.linalg.eigh(precision)
        scaled = vector * np.sqrt(np.maximum(value, 0.0))[..., None, :]
        half = scaled @ vector.swapaxes(-1, -2)
        count = min(feigned.shape[1:])
        error, size = (
            np.empty((*feigned.shape[:2], count)),
            np.empty((len(half), count)),
        )
        for some in stretches(len(half)):
            white = _blockwise(half[some], feigned[some])
            error[some], s, _ = np.linalg.svd(white, full_matrices=False)
            size[some] = s**2
        return cls(half, error, size)

    def some(self, visits: Int[np.ndarray, " some"]) -> "Roots":
        """Return those of some visits."""
        return Roots(self.half[visits], self.error[visits], self.size[visits])

    def white(
        self, moved: Float[np.ndarray, "visits n columns"]
    ) -> Float[np.ndarray, "visits n columns"]:
        """Return R x."""
        return self._shrunk(_blockwise(self.half, moved))

    def back(
        self, white: Float[np.ndarray, "visits n columns"]
    ) -> Float[np.ndarray, "visits n columns"]:
        """Return R' x."""
        return _blockwise(self.half, self._shrunk(white))

    def shared(self) -> Float[np.ndarray, "visits errors n"]:
        """Return H."""
        along = _blockwise(self.half, self.error).swapaxes(1, 2)
        return np.sqrt(self.size / (1.0 + self.size))[..., None] * along

    def _shrunk(self, whole: np.ndarray) -> np.ndarray:
        less = 1.0 / np.sqrt(1.0 + self.size) - 1.0
        along = less[..., None] * (self.error.swapaxes(1, 2) @ whole)
        return whole + self.error @ along


def _blockwise(half: np.ndarray, moved: np.ndarray) -> np.ndarray:
    visits, markers = half.shape[:2]
    shaped = half @ moved.reshape(visits, markers, 3, -1)
    return shaped.reshape(visits, 3 * markers, -1)
