"""Where an arm truly is under its loads is known to the bench alone."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from bench.errors import BenchError

FURTHEST = 0.5
"""How far an axis may end beside its command, in rad (m); chosen: no arm would hold."""


@dataclass(frozen=True)
class States:
    """Where the arm truly was, row by row. This is truth: no method may see it.

    Attributes:
        bodies: Names of the bodies.
        position: Their origins in the base's world frame, in m.
        rotation: Their orientations; columns are the bodies' axes.
        axis_angle: Angle of each axis after the gear, in rad.
        wrench: What the world exerts on the robot about the sensor's origin, along the
            sensor's axes, in N and N m; the weight beyond the sensor taken off.
        residual: Largest torque left unbalanced, in N m.
    """

    bodies: tuple[str, ...]
    position: Float[np.ndarray, "rows bodies 3"]
    rotation: Float[np.ndarray, "rows bodies 3 3"]
    axis_angle: Float[np.ndarray, "rows axes"]
    wrench: Float[np.ndarray, "rows 6"]
    residual: float

    def point(
        self, body: str, place: Float[np.ndarray, "3"]
    ) -> Float[np.ndarray, "rows 3"]:
        """Return where a point of a body was, in the world's frame, in m."""
        b = self.bodies.index(body)
        return self.position[:, b] + self.rotation[:, b] @ place

    def near(self, commanded: Float[np.ndarray, "rows axes"]) -> "States":
        """Return the states, where every axis stands about where it was told to.

        Args:
            commanded: Angles that the controller reports, in rad (m).

        Raises:
            BenchError: Where an axis ends further off than `FURTHEST`, naming it.
        """
        off = np.nan_to_num(np.abs(self.axis_angle - commanded), nan=np.inf)
        row, axis = np.unravel_index(off.argmax(), off.shape)
        if off[row, axis] > FURTHEST:
            raise BenchError(
                f"In row {row} axis a{axis + 1} ends {off[row, axis]:.3g} rad beside "
                f"its command, more than {FURTHEST}. A spring is too soft for its "
                "load, or an effect too large."
            )
        return self
