"""Instruments: readings of the true states of an arm, with errors and specifications.

What to use when: `Markers` defines the tracked points of the arm, `Tracker` measures
their positions, `ForceSensor` the rope's force, and `Encoders` the joint angles at the
motors and at a second encoder after the gear. `Instruments` holds one of each; the
sizes of their errors are the true ones, and their specifications are separate.
"""

from dataclasses import dataclass, field, replace

from bench.instruments.encoders import Encoders
from bench.instruments.force_sensor import ForceSensor
from bench.instruments.markers import Markers, Slip
from bench.instruments.tracker import Tracker

__all__ = ["Encoders", "ForceSensor", "Instruments", "Markers", "Slip", "Tracker"]


@dataclass(frozen=True)
class Instruments:
    """All instruments of an experiment."""

    tracker: Tracker = field(default_factory=Tracker)
    force_sensor: ForceSensor = field(default_factory=ForceSensor)
    encoders: Encoders = field(default_factory=Encoders)
    markers: Markers = field(default_factory=Markers)

    def without_noise(self) -> "Instruments":
        """Return them without random errors and gaps; constant faults stay."""
        tracker = replace(self.tracker, noise=0.0, field=0.0, occlusions=0.0)
        sensor = replace(
            self.force_sensor, noise=0.0, turn=0.0, size=0.0, resolution=(0.0, 0.0)
        )
        return replace(self, tracker=tracker, force_sensor=sensor)
