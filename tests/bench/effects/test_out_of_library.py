from pathlib import Path

import numpy as np
import pytest
from lever import lever, moments, respond, turn
from numpy.testing import assert_allclose, assert_array_equal

from bench.effects import EFFECTS
from bench.effects.out_of_library import OUT_OF_LIBRARY_EFFECTS
from bench.effects.out_of_library.axis_crosstalk import AxisCrosstalk
from bench.effects.out_of_library.foot_lift_off import FootLiftOff
from bench.effects.out_of_library.loose_bearing import LooseBearing
from bench.effects.out_of_library.softening import Softening
from bench.effects.out_of_library.thrust_turn import TOGETHER, ThrustTurn
from bench.effects.out_of_library.warming_gear import WarmingGear
from bench.effects.places import misplaced
from bench.effects.wrist_coupling import WristCoupling
from bench.rig import Rig
from stiffness.effects import HYPOTHESES

OWN = 5e4
"""Stiffness of the lever's axis, in N m/rad."""
PLACES = {FootLiftOff: "base", AxisCrosstalk: "a3"}
POSTURE = np.deg2rad([[10.0, -60.0, 90.0, 20.0, 40.0, 10.0]] * 3)


def settled(kr10: Path, *effects):
    """Return where the flange of a KR10 is under a few loads."""
    wrench = np.zeros((len(POSTURE), 3, 6))
    wrench[:, :, 0], wrench[:, :, 1] = [0.0, 50.0, -50.0], [0.0, 200.0, -200.0]
    states = Rig(kr10, effects).respond(POSTURE, wrench, np.ones((len(POSTURE), 3)))
    return states.position[:, states.bodies.index("flange")]


@pytest.fixture(scope="module")
def nominal(kr10):
    return settled(kr10)


@pytest.mark.parametrize("kind", OUT_OF_LIBRARY_EFFECTS)
def test_outsider_switched_off_changes_nothing(kind, kr10, nominal):
    effect = kind(PLACES.get(kind, "a2"))
    assert_array_equal(settled(kr10, effect.off()), nominal)


@pytest.mark.parametrize("kind", OUT_OF_LIBRARY_EFFECTS)
def test_outsider_of_its_usual_size_moves_the_flange_by_a_micrometre(
    kind, kr10, nominal
):
    effect = kind(PLACES.get(kind, "a2"))
    rig = Rig(kr10)
    assert misplaced(effect, rig.anatomy) == []
    moved = np.linalg.norm(settled(kr10, effect) - nominal, axis=1)
    assert 1e-6 < np.max(moved) < 1e-2


def test_no_name_of_the_vocabulary_is_an_outsider():
    names = {kind.name for kind in OUT_OF_LIBRARY_EFFECTS}
    assert len(names) == len(OUT_OF_LIBRARY_EFFECTS)
    assert not names & {kind.name for kind in EFFECTS}
    assert not names & {hypothesis.effect for hypothesis in HYPOTHESES}


# --- Equations -----------------------------------------------------------------------


def test_softening_gives_more_beyond_its_preload_both_ways(tmp_path):
    rig = Rig(lever(tmp_path), (Softening("a1", 0.5, 20.0),))
    low, high, other = turn(respond(rig, moments(20.0, 30.0, -30.0)))[:, 1]
    assert_allclose(low, 20.0 / OWN, rtol=1e-9)
    assert_allclose(high, 20.0 / OWN + 10.0 / (0.5 * OWN), rtol=1e-9)
    assert_allclose(other, -high, rtol=1e-9)


def test_thread_turns_the_axis_by_torque_and_by_thrust(tmp_path):
    c, lead, r = 1e-5, 0.1, TOGETHER
    rig = Rig(lever(tmp_path), (ThrustTurn("a1", c, lead),))
    thrust = np.zeros((1, 6))
    thrust[0, 1] = 100.0  # along the axis, y
    about = turn(respond(rig, moments(10.0)))[0, 1]
    along = turn(respond(rig, thrust))[0, 1]
    assert_allclose(about, 10.0 / OWN + c * (1 - r) * 10.0, rtol=1e-6)
    assert_allclose(along, c * r * lead * 100.0, rtol=1e-3)  # levers move by 1e-4


def test_loose_bearing_tilts_one_way_only(tmp_path):
    rig = Rig(lever(tmp_path), (LooseBearing("a1", 1e-5),))
    tilts = []
    for axis in (0, 2):  # u and v lie across the axis, y
        open_, closed = turn(respond(rig, moments(10.0, -10.0, axis=axis)))[:, axis]
        tilts.append(sorted([abs(open_), abs(closed)]))
    closed, open_ = max(tilts, key=max)
    assert_allclose(open_, 1e-4, rtol=1e-6)
    assert closed < 1e-6


def test_foot_lifts_off_beyond_its_preload_alone(tmp_path):
    rig = Rig(lever(tmp_path), (FootLiftOff("base", 1e-5, np.pi / 2, 20.0),))
    bare = Rig(lever(tmp_path))
    torque = moments(-50.0, 10.0, 20.0, 30.0)
    extra = turn(respond(rig, torque))[:, 1] - turn(respond(bare, torque))[:, 1]
    assert_allclose(extra[3] - extra[2], 10.0 * 1e-5, rtol=1e-3)
    assert np.max(np.abs(extra[:2])) < 1e-6  # a thousandth of what the gap would give


def test_axes_near_the_base_couple_as_those_of_a_wrist_do(kr10):
    one = settled(kr10, AxisCrosstalk("a3", "a2", 1e-6))
    assert_array_equal(one, settled(kr10, WristCoupling("a3", "a2", 1e-6)))


def test_gear_loses_its_stiffness_visit_by_visit(tmp_path):
    rig = Rig(lever(tmp_path), (WarmingGear("a1", 0.2, 2.0),))
    stiffness = rig.command(np.zeros((4, 1))).stiffness[:, 0]
    expected = OWN * (1 - 0.2 * (1 - np.exp(-np.arange(4) / 2.0)))
    assert_allclose(stiffness, expected, rtol=1e-12)
