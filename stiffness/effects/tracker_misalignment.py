"""Tracker misalignment: a stated frame of the tracker that is wrong.

==========  ==========================================================================
Equation    a point p of the base's frame reads p + (x, y, z) + (rx, ry, rz) x p
Source      rotation vector to first order: Rodrigues 1840
Valid       a stated frame that errs by some millimetres and degrees
Ignores     the second order of the turn
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from typing_extensions import override

from stiffness.effects.base import Hypothesis, Shape, absolute
from stiffness.effects.jacobian import BodyTwist, EffectJacobian
from stiffness.experiment.static_state import StaticState

NAMES = ("x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad")


@dataclass(frozen=True)
class TrackerMisalignment(Hypothesis):
    """Error of the tracker frame stated in the manifest."""

    effect: ClassVar[str] = "tracker_misalignment"
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        name: (-0.3, 0.3) for name in NAMES
    }
    magnitudes: ClassVar[tuple[str, ...]] = NAMES

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        recording = situation.recording
        stated = recording.base_from_tracker is not None and recording.markers
        return ("tracker",) if stated and absolute(situation) else ()

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        motion = np.broadcast_to(np.eye(6), (situation.rows, 6, 6))
        return EffectJacobian(6, (BodyTwist(0, motion),))
