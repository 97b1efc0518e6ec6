"""Tracker scale: all measured lengths are wrong by a common factor.

==========  ==========================================================================
Equation    reading = (1 + ratio) p, from the tracker's origin
Source      similarity transform of a stereo rig whose baseline errs; size chosen: 50
            parts in a million, a carbon bar some kelvins off
Valid       while the rig stays as warm as it is
Ignores     scale that differs along the axes
==========  ==========================================================================
"""

from dataclasses import dataclass, replace
from typing import ClassVar

from typing_extensions import override

from bench.effects.effect import InstrumentEffect, size
from bench.instruments import Instruments


@dataclass(frozen=True)
class TrackerScale(InstrumentEffect):
    """Scale error of the tracker, common to all directions.

    Attributes:
        ratio: Measured less true length, over the true length.
    """

    name: ClassVar[str] = "tracker_scale"
    ratio: float = size(5e-5, -0.5)

    @override
    def fault(self, instruments: Instruments) -> Instruments:
        tracker = instruments.tracker
        scaled = replace(tracker, scale=tracker.scale + self.ratio)
        return replace(instruments, tracker=scaled)
