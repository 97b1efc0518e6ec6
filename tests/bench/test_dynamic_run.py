import numpy as np
import pytest
from dynamic_run import RAMP, dynamic_run

from bench.effects.bearing_tilt import BearingTilt
from bench.effects.creep import Creep
from bench.effects.hardening import Hardening
from bench.effects.hysteresis import Hysteresis
from bench.effects.lost_motion import LostMotion
from bench.effects.wrist_coupling import WristCoupling
from bench.rig import Rig

POSTURE = np.array([0.3, -1.1, 1.4, 0.4, 0.8, -0.5])
WRENCH = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 40.0, -50.0, 0.0, 0.0, 1.0],
        [0.0, -40.0, -100.0, 0.0, 2.0, 0.0],
        [20.0, 30.0, -20.0, 0.0, 0.0, 0.0],
    ]
)
HOLD = np.array([0.6, 0.5, 0.6, 0.5])
HISTORY = (
    Hysteresis("a2", width_rad=2.9e-4),
    Hysteresis("a4", width_rad=2.9e-4),
    Creep("a3", ratio=0.05, time_s=0.5),
    Hardening("a2"),
    LostMotion("a1"),
    BearingTilt("a2"),
    WristCoupling("a5", with_axis="a4"),
)


def at_rest(rig):
    """Return the flange when each load has stood for its time, from the middle of RAMP.

    Each then stands for half of RAMP more, until the next is half on.
    """
    hold = np.column_stack([HOLD, np.full(len(HOLD), RAMP / 2)]).ravel()
    states = rig.respond(POSTURE[None], np.repeat(WRENCH, 2, axis=0)[None], hold[None])
    return states.position[::2, states.bodies.index("flange")]


@pytest.mark.slow
def test_dynamic_run_comes_to_the_rest_that_was_solved_for(kr10):
    """Within 1 µm at the flange: hysteresis, creep in real time, play, hardening."""
    rig = Rig(kr10, HISTORY)
    error = np.abs(dynamic_run(rig, POSTURE, WRENCH, HOLD) - at_rest(rig))
    assert error.max() < 1e-6


def test_effects_of_history_are_far_larger_than_that_agreement(kr10):
    """Without them, and with creep that had all the time, the rest lies elsewhere."""
    rest = at_rest(Rig(kr10, HISTORY))
    for left_out in ("hysteresis", "creep", "lost_motion"):
        others = tuple(e for e in HISTORY if e.name != left_out)
        assert np.abs(at_rest(Rig(kr10, others)) - rest).max() > 1e-5
    patient = (*(e for e in HISTORY if e.name != "creep"), Creep("a3", 0.05, 0.05))
    assert np.abs(at_rest(Rig(kr10, patient)) - rest).max() > 5e-6
