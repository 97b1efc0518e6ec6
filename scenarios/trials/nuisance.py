"""Instruments of a trial are as imperfect as they state, and no more.

Every trial has the usual nuisance: an unknown frame, markers beside their places, noise
and hidden readings. One kind of trial has the worst that a good cell has, in turn.
"""

from dataclasses import replace

from bench.instruments import Encoders, ForceSensor, Instruments, Markers, Tracker
from bench.instruments.encoders import ARRIVAL
from bench.instruments.force_sensor import SIZE, TURN
from scenarios.trials.strata import Stratum

PLACEMENT, OCCLUSIONS = 5e-4, 0.02
"""Markers are off by so many m, one sigma; such a share of readings is hidden."""
FIELD = 1.5e-5
"""Correlated error of the tracker in m, in the stratum that has one."""
DEPTH = (1e-5, 1e-5, 2.5e-5)
"""Tracker's noise in m where it is worst in depth."""


def instruments_of(stratum: Stratum, number: int) -> Instruments:
    """Return instruments with the usual nuisance, or one of the worst in turn."""
    usual = Instruments(
        tracker=Tracker(occlusions=OCCLUSIONS),
        markers=Markers(
            "flange" if stratum.targets == "flange" else "all", placement=PLACEMENT
        ),
    )
    if stratum.name != "null_nuisance":
        return usual
    tracker = usual.tracker
    worst = (
        replace(usual, force_sensor=ForceSensor(turn=TURN, size=SIZE)),
        replace(usual, tracker=replace(tracker, repeatability=DEPTH)),
        replace(usual, tracker=replace(tracker, field=FIELD)),
        replace(usual, encoders=Encoders(arrival=ARRIVAL)),
        replace(
            usual,
            tracker=replace(tracker, repeatability=DEPTH, field=FIELD),
            force_sensor=ForceSensor(turn=TURN, size=SIZE),
            encoders=Encoders(arrival=ARRIVAL),
        ),
    )
    return worst[number % len(worst)]
