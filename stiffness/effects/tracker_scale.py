"""Tracker scale: lengths measured too long or too short by a factor.

==========  ==========================================================================
Equation    a point p reads p + ratio (p - c), c the tracker's position
Source      Umeyama 1991, "Least-squares estimation of transformation parameters between
            two point patterns": the scale of a similarity
Valid       one scale in all directions and all the time
Ignores     the scale of deflections within a visit: ratio times some µm
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from typing_extensions import override

from stiffness.effects.base import Hypothesis, Shape, absolute, marked_point
from stiffness.effects.jacobian import EffectJacobian, MarkerDisplacement
from stiffness.experiment.static_state import StaticState
from stiffness.robot.tracker_frame import LARGEST_SCALE


@dataclass(frozen=True)
class TrackerScale(Hypothesis):
    """Scale error of all lengths measured by the tracker.

    A marker of unknown place is taken at its body's origin, and a tracker of unknown
    place at the base's: fitted marker places and frames absorb the difference.
    """

    effect: ClassVar[str] = "tracker_scale"
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        "ratio": (-LARGEST_SCALE, LARGEST_SCALE),
    }
    magnitudes: ClassVar[tuple[str, ...]] = ("ratio",)

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        seen = situation.recording.markers and absolute(situation)
        return ("tracker",) if seen else ()

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        frame = situation.recording.base_from_tracker
        stand = np.zeros(3) if frame is None else frame[:3, 3]
        parts = []
        for m in range(len(situation.recording.markers)):
            away = marked_point(situation, m) - stand
            parts.append(MarkerDisplacement(m, away[:, :, None]))
        return EffectJacobian(1, tuple(parts))
