"""Geometry error of a link: shift and rotation of the next axis against the drawing.

==========  ==========================================================================
Equation    p' = p + (x, y, z), R' = exp([(rx, ry, rz)]×) R for the next axis' seat (or
            the flange) in the link's frame
Source      rigid motion, rotation vector (Rodrigues 1840); size: lengths err by 0.1 to
            0.5 mm and angles by 0.2 to 1 mrad before calibration (Slamani 2012)
Valid       always
Ignores     nothing at rest
==========  ==========================================================================
"""

from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation
from typing_extensions import override

from bench.effects.effect import ModelEffect
from bench.kinematic_chain import Anatomy, pose_in, rotation_of


@dataclass(frozen=True)
class GeometryError(ModelEffect):
    """Shift and rotation of a link's end, and of everything beyond it.

    Attributes:
        x_m, y_m, z_m: Shift in the link's frame.
        rx_rad, ry_rad, rz_rad: Rotation vector in the link's frame, about the end's
            origin.
    """

    name: ClassVar[str] = "geometry_error"
    x_m: float = 3e-4
    y_m: float = 0.0
    z_m: float = 0.0
    rx_rad: float = 0.0
    ry_rad: float = 5e-4
    rz_rad: float = 0.0

    @override
    def build(self, spec: mujoco.MjSpec, arm: Anatomy) -> None:
        end, link = spec.body(arm.end_of(self.where)), spec.body(arm.body(self.where))
        below = pose_in(end.parent, link)[0]  # what the end hangs on may be turned
        shift, turn = np.reshape(list(self.parameters().values()), (2, 3)) @ below
        end.pos = np.asarray(end.pos, float) + shift
        turned = Rotation.from_rotvec(turn) * Rotation.from_matrix(rotation_of(end))
        end.quat = turned.as_quat(scalar_first=True)
