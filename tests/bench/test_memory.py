import json

import numpy as np
import pytest
from lever import LENGTH, lever, moments
from numpy.testing import assert_allclose

from bench.effects.creep import Creep
from bench.effects.hysteresis import Hysteresis
from bench.effects.lost_motion import LostMotion
from bench.effects.transmission_error import TransmissionError
from bench.equilibrium import GearStates
from bench.experiment import record
from bench.rig import Rig
from bench.shared.plan import Plan, parse_path
from bench.standard_plans import table_one_plan
from scenarios import record as command

STIFFNESS = 5e4
WIDTH = 4e-4
GEAR = Hysteresis("a1", width_rad=WIDTH, elements=1, stiffening=0.5)


def plan(*degrees, path="0", move_time=10.0, hold=20.0):
    posture = np.radians(degrees)[:, None]
    visits = np.arange(len(posture))
    return Plan(
        "memory",
        posture=posture,
        posture_id=visits,
        pulley=np.zeros(len(posture), int),
        path=parse_path(path, hold=hold),
        move_time=move_time,
    )


def wound(rig, of, memory="carried"):
    """Return what the axis turned beyond its command, row by row, in rad."""
    states = rig.carry_out(of, memory=memory)
    return states.axis_angle[:, 0] - of.posture[of.row_visit, 0]


@pytest.mark.parametrize("gear", [GEAR, LostMotion("a1"), Creep("a1", ratio=0.2)])
def test_two_visits_of_one_posture_are_one_long_visit(tmp_path, gear):
    """Where the way leads nowhere, a row begins as the row before it ended."""
    rig = Rig(lever(tmp_path, mass=40.0), (gear,))
    twice = wound(rig, plan(20, 20, path="0,10,4,0", move_time=0.0))
    once = wound(rig, plan(20, path="0,10,4,0,0,10,4,0"), "forgotten")
    np.testing.assert_allclose(twice, once, rtol=0, atol=1e-11)


def slipped(torque, stiffness=STIFFNESS):
    """Return wind-up along a torque that changes in steps, of one slipping spring."""
    beside = GEAR.stiffening * stiffness
    most = WIDTH / 2 * stiffness
    angle = friction = last = 0.0
    for now in torque:
        trial = friction + beside * (now - last) / (stiffness + beside)
        friction = float(np.clip(trial, -most, most))
        angle, last = (now - friction) / stiffness, now
    return angle


def test_hysteresis_feels_the_torque_of_the_way(tmp_path):
    """Past the level posture: the torque grows and falls again before the arrival."""
    rig = Rig(lever(tmp_path, mass=40.0), (GEAR,))
    found = wound(rig, plan(-70, 60))
    way = np.radians(np.linspace(-70, 60, 2001))
    weight = 9.81 * (40.0 + rig.mounted.payload.mass)
    torque = weight * LENGTH * np.cos(way)
    expected = slipped([torque[0]]), slipped(torque)
    assert abs(slipped(torque) - slipped([torque[-1]])) > 1e-4  # not from nothing
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5)
    fresh = wound(rig, plan(-70, 60), "forgotten")
    np.testing.assert_allclose(fresh[1], slipped([torque[-1]]), rtol=0, atol=1e-5)


@pytest.mark.parametrize("stiffening", [0.05, 0.6, 5.0, 20.0])
@pytest.mark.parametrize("share", [-1.0, 0.0, 1.0])
def test_gear_of_any_stiffness_begins_at_the_torque_that_is_asked_for(
    tmp_path, share, stiffening
):
    """Four elements together: the joint follows what each of them lets go."""
    gear = Hysteresis("a1", width_rad=WIDTH, stiffening=stiffening)
    rig, bare = (Rig(lever(tmp_path, mass=40.0), e) for e in ((gear,), ()))
    load = moments(30.0)[None], np.ones((1, 1))
    states = rig.respond(np.zeros((1, 1)), *load, initial=slipping(rig, share))
    free = bare.respond(np.zeros((1, 1)), *load).axis_angle
    expected = free - share * WIDTH / 2
    assert_allclose(states.axis_angle, expected, rtol=0, atol=0.005 * WIDTH)


@pytest.mark.parametrize("share", [-1.0, 0.0, 0.4, 1.0])
def test_what_slips_in_a_gear_begins_at_the_torque_that_is_asked_for(tmp_path, share):
    """Under the first load, whatever came before; then the torque changes by loads."""
    rig = Rig(lever(tmp_path, mass=40.0), (GEAR,))
    torque = np.array([30.0, 45.0, -20.0, 5.0])
    states = rig.respond(
        np.zeros((1, 1)),
        moments(*torque)[None],
        np.ones((1, 4)),
        initial=slipping(rig, share),
    )
    most, beside = WIDTH / 2 * STIFFNESS, GEAR.stiffening * STIFFNESS
    weight = 9.81 * (40.0 + rig.mounted.payload.mass) * LENGTH
    friction, expected = share * most, []
    for k, now in enumerate(torque):
        change = now - torque[k - 1] if k else 0.0
        trial = friction + beside * change / (STIFFNESS + beside)
        friction = float(np.clip(trial, -most, most))
        expected.append((weight + now - friction) / STIFFNESS)
    assert_allclose(states.axis_angle[:, 0], expected, rtol=0, atol=3e-6)


def slipping(rig, share):
    """Return a state at one visit: the torque of a1 over that at which it slips."""
    return GearStates({name: np.array([share]) for name in rig.slipping["a1"]})


def test_visits_side_by_side_begin_as_one_after_the_other_left_them(kr10):
    """What slipped and what crept; a posture where gravity hardly winds, too."""
    gears = (
        Hysteresis("a2", width_rad=2e-4),
        Hysteresis("a3", width_rad=1e-4, stiffening=1.5),
        Creep("a2", ratio=0.1, time_s=60.0),
        Creep("a5", ratio=0.05, time_s=200.0),
    )
    rig, count = Rig(kr10, gears), 5
    random = np.random.default_rng(4)
    posture = np.radians([0.0, -80.0, 80.0, 0.0, 30.0, 0.0])
    posture = posture + random.uniform(-0.5, 0.5, size=(count, 6))
    pull, hold = np.zeros((count, 4, 6)), np.full((count, 4), 20.0)
    pull[:, 1:3, 2] = [-60.0, -120.0]
    in_turn = rig.respond(posture, pull, hold, np.full(count, 15.0))
    begun = rig.respond(posture, pull, hold, initial=in_turn.initial)
    fresh = rig.respond(posture, pull, hold)
    away = np.abs(in_turn.axis_angle - fresh.axis_angle).max(axis=0)
    assert np.all(away[[1, 2]] > 3e-5)
    assert_allclose(begun.axis_angle, in_turn.axis_angle, rtol=0, atol=5e-8)


def test_creep_of_the_posture_before_dies_away_with_time(tmp_path):
    """Weightless, 20 s under load, 10 s on the way, 20 s until the next reading."""
    creep = Creep("a1", ratio=0.3, time_s=40.0)
    rig = Rig(lever(tmp_path), (creep,))
    found = wound(rig, plan(0, 30, path="0,10", move_time=10.0, hold=20.0))
    plain = wound(Rig(lever(tmp_path)), plan(0, 30, path="0,10"), "forgotten")
    grown = creep.ratio * -np.expm1(-20.0 / creep.time_s)
    np.testing.assert_allclose(found[1], plain[1] * (1 + grown), rtol=1e-4)
    rest = plain[1] * grown * np.exp(-30.0 / creep.time_s)
    np.testing.assert_allclose(found[2], rest, rtol=1e-4)


def test_what_moves_the_gear_s_reference_leaves_its_memory_alone(tmp_path):
    """An uneven gear turns the output, not what slipped in it."""
    file = lever(tmp_path)
    wave = TransmissionError("a1", amplitude_rad=1e-3, order=3.0, phase_rad=0.4)
    of = plan(0, 40, 10, path="0,10,0")
    with_wave = wound(Rig(file, (GEAR, wave)), of)
    only_wave = wound(Rig(file, (wave,)), of)
    neither = wound(Rig(file), of)
    np.testing.assert_allclose(
        with_wave - only_wave, wound(Rig(file, (GEAR,)), of) - neither, atol=1e-6
    )


def test_gears_forget_unless_they_are_told_to_remember(kr10):
    rig, short = Rig(kr10, (Hysteresis("a2", width_rad=2e-4),)), table_one_plan(poses=4)
    usual = record(rig, short, seed=1)
    said = record(rig, short, seed=1, memory="forgotten")
    carried = record(rig, short, seed=1, memory="carried")
    assert usual.points is not None and carried.points is not None
    np.testing.assert_array_equal(usual.points, said.points)
    first = short.row_visit == 0
    np.testing.assert_allclose(carried.points[first], usual.points[first], atol=1e-12)
    assert np.abs(carried.points - usual.points)[~first].max() > 2e-5


def test_the_truth_file_says_whether_gears_remember(tmp_path):
    for memory in ("forgotten", "carried"):
        truth = tmp_path / f"{memory}.json"
        command.main(
            command.Settings(
                out=tmp_path / memory,
                effect=("hysteresis@a2,width_rad=3e-4",),
                poses=2,
                path="0,10,0",
                memory=memory,
                truth_file=truth,
            )
        )
        assert json.loads(truth.read_text())["memory"] == memory
