"""Instruments turn the true states of an arm into readings.

What to use when: `Markers` say which points of the arm are followed, `Tracker` where it
sees them, `ForceSensor` what it makes of the rope's pull, and `Encoders` what the
controller and a second encoder after the gear report. `Instruments` holds one of each;
their sizes are what really happens, and what they state of themselves is beside it.
"""

from dataclasses import dataclass, field

from bench.instruments.encoders import Encoders
from bench.instruments.force_sensor import ForceSensor
from bench.instruments.markers import Markers, Slip
from bench.instruments.tracker import Tracker

__all__ = ["Encoders", "ForceSensor", "Instruments", "Markers", "Slip", "Tracker"]


@dataclass(frozen=True)
class Instruments:
    """Everything that watches an experiment.

    Attributes:
        tracker: Sees points.
        force_sensor: Feels the rope.
        encoders: Report the axes' angles.
        markers: The points.
    """

    tracker: Tracker = field(default_factory=Tracker)
    force_sensor: ForceSensor = field(default_factory=ForceSensor)
    encoders: Encoders = field(default_factory=Encoders)
    markers: Markers = field(default_factory=Markers)
