"""Every force of the whole truth is accounted for: rope, weight, sensor and springs."""

import mujoco
import numpy as np
import pytest

from bench import equilibrium
from bench.cell import GRAVITY, HOOK_SITE, MOUNT
from bench.effects.pulley_friction import PulleyFriction
from bench.rig import Rig
from bench.shared.errors import BenchError
from bench.shared.plan import Plan, parse_path
from bench.standard_plans import table_one_plan as table_one
from bench.study_arm import default_truth

CLOSE = 1e-6
"""In N, and in N m on levers of at most a metre: the bar."""
NEWTON_METRE = 1e-9
FRICTION = PulleyFriction("rig", ratio=0.02)


@pytest.fixture(scope="module")
def plan():
    """Six visits over all six pulleys, up and down with a dwell."""
    return table_one(6, parse_path("0,5,10@120,5,0"))


@pytest.fixture(scope="module")
def rig(kr10):
    """The default truth with friction in the pulleys on top."""
    truth = default_truth()
    return Rig(kr10, (*truth.effects, FRICTION), truth.stiffness)


@pytest.fixture(scope="module")
def states(rig, plan):
    return rig.carry_out(plan)


def turn(states, body=MOUNT):
    return states.rotation[:, states.bodies.index(body)]


def rope_at_hook(rig: Rig, hook: np.ndarray, pulley: int) -> np.ndarray:
    """Return the direction in which a rope leaves the hook, without the simulator.

    It is tangent to the pulley in the plane of hook, pulley and weight, over the top.
    """
    centre = rig.mounted.pulley[pulley]
    outward = centre * [1, 1, 0] / np.linalg.norm(centre[:2])
    weight = centre + rig.mounted.pulley_radius * outward - [0, 0, 0.3]
    to_centre, distance = centre - hook, np.linalg.norm(centre - hook)
    normal = np.cross(to_centre, weight - hook)
    normal /= np.linalg.norm(normal)
    angle = np.arcsin(rig.mounted.pulley_radius / distance)
    along, beside = to_centre / distance, np.cross(normal, to_centre / distance)
    ways = [np.cos(angle) * along + s * np.sin(angle) * beside for s in (1, -1)]
    return max(ways, key=lambda way: way[2])


def tension(plan: Plan) -> np.ndarray:
    """Return what a rope pulls with by hand: friction helps it up and not down."""
    weight = GRAVITY * plan.row_mass
    return weight * (1 - FRICTION.ratio * plan.row_direction)


def test_whole_truth_leaves_less_than_a_nanonewton_metre_unbalanced(states):
    assert states.residual <= NEWTON_METRE


def test_sensor_reads_the_ropes_tension_in_its_direction(rig, plan, states):
    hook = states.point(MOUNT, np.array(rig.mounted.hook))
    pulled = turn(states) @ states.wrench[:, :3, None]
    for row, visit in enumerate(plan.row_visit):
        expected = tension(plan)[row] * rope_at_hook(rig, hook[row], plan.pulley[visit])
        np.testing.assert_allclose(pulled[row, :, 0], expected, rtol=0, atol=CLOSE)


def test_sensor_reads_the_moment_of_the_hooks_lever(rig, states):
    lever = np.cross(np.array(rig.mounted.hook), states.wrench[:, :3])
    np.testing.assert_allclose(states.wrench[:, 3:], lever, rtol=0, atol=CLOSE)


def test_weight_beyond_the_sensor_is_taken_off_in_every_posture(rig, plan, states):
    """What hangs on the unloaded hook is nothing, however the plate is turned."""
    unloaded = plan.row_mass == 0.0
    assert np.ptp(turn(states)[unloaded, 2, 2]) > 0.1
    np.testing.assert_allclose(states.wrench[unloaded], 0.0, atol=CLOSE)


@pytest.mark.parametrize(("axis", "link"), [("a1", "link_1"), ("a2", "link_2")])
def test_gravity_and_rope_are_what_a_spring_carries(rig, plan, axis, link):
    """Moments of all weights and of the rope, by hand from the true places.

    They equal the stiffness times the wind-up. This axis alone is linear here, for in
    the default truth it hardens, slips and creeps; all other effects stay.
    """
    truth = default_truth()
    others = tuple(e for e in truth.effects if e.where != axis)
    rig = Rig(rig.arm_file, (*others, FRICTION), truth.stiffness)
    states, model = rig.carry_out(plan), rig.model
    seat = states.bodies.index(rig.anatomy.seat(axis))
    origin = states.position[:, seat]
    moment = np.zeros_like(origin)
    for b in range(model.nbody):
        if link in _carriers(model, b):
            centre = states.point(model.body(b).name, model.body_ipos[b])
            weight = model.body_mass[b] * model.opt.gravity
            moment += np.cross(centre - origin, weight)
    pull = (turn(states) @ states.wrench[:, :3, None])[:, :, 0]
    hook = states.point(MOUNT, model.site(HOOK_SITE).pos)
    moment += np.cross(hook - origin, pull)
    along = states.rotation[:, seat] @ model.joint(axis).axis
    about = np.einsum("ri,ri->r", moment, along)
    k = rig.anatomy.axes.index(axis)
    wound = states.axis_angle[:, k] - plan.posture[plan.row_visit, k]
    assert np.ptp(about) > 20.0
    np.testing.assert_allclose(truth.stiffness[k] * wound, about, rtol=0, atol=CLOSE)


def test_history_of_the_whole_truth_shows_on_the_way_down(rig, plan, states):
    """Otherwise the balance above were that of springs alone."""
    flange = states.position[:, states.bodies.index("flange")]
    steps = flange.reshape(plan.visits, -1, 3)
    back = np.linalg.norm(steps[:, 3] - steps[:, 1], axis=1)  # both under 5 kg
    assert back.max() > 1e-5


def _carriers(model: mujoco.MjModel, body: int) -> set[str]:
    """Return a body's name and those of all that carry it."""
    names = {model.body(body).name}
    while body:
        body = int(model.body_parentid[body])
        names.add(model.body(body).name)
    return names


def test_many_visits_are_worked_in_blocks_that_change_nothing(kr10, monkeypatch, capfd):
    """Nor is anything shown: a bar is the scenario's.

    Nor does the message of one that finds no rest count from the block's start.
    """
    plan = table_one(7, parse_path("0,10"))
    whole = Rig(kr10).carry_out(plan)
    monkeypatch.setattr(equilibrium, "BLOCK", 3)
    apart = Rig(kr10).carry_out(plan)
    assert capfd.readouterr() == ("", "")
    np.testing.assert_allclose(apart.position, whole.position, rtol=0, atol=1e-12)
    with pytest.raises(BenchError, match="Visit 6 finds no rest"):
        hold = np.array([step.hold for step in plan.path])
        pull = np.zeros((7, 2, 6))
        pull[6, 1] = np.nan
        Rig(kr10).respond(plan.posture, pull, np.tile(hold, (7, 1)))


def test_an_arm_that_finds_no_rest_leaves_no_file_where_one_stands(
    kr10, tmp_path, monkeypatch
):
    """The engine would write its warnings there."""
    monkeypatch.chdir(tmp_path)
    posture = table_one(2, parse_path("0,10")).posture
    with pytest.raises(BenchError, match="finds no rest"):
        Rig(kr10).respond(posture, np.full((2, 1, 6), 1e300), np.ones((2, 1)))
    assert list(tmp_path.iterdir()) == []


def test_an_arm_that_stands_in_a_cell_already_is_refused(kr10):
    """Its force sensor and ropes would be there twice."""
    with pytest.raises(BenchError, match="the file of the arm alone"):
        Rig(kr10.parent / "scene.xml").carry_out(table_one(1))
