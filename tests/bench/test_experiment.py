from dataclasses import replace
from shutil import copytree

import numpy as np
import pytest
from scipy.linalg import expm

from bench import standard_plans
from bench.cell import GRAVITY
from bench.effects.drift import Drift
from bench.effects.effect import InstrumentEffect
from bench.effects.marker_slip import MarkerSlip
from bench.effects.tracker_misalignment import TrackerMisalignment
from bench.effects.tracker_scale import TrackerScale
from bench.effects.wrench_bias import WrenchBias
from bench.effects.wrench_gain import WrenchGain
from bench.effects.wrench_misalignment import WrenchMisalignment
from bench.experiment import Instruments, faulty, record
from bench.instruments import Encoders, ForceSensor, Markers, Tracker
from bench.rig import Rig
from bench.shared.format import folder as files
from bench.shared.plan import parse_path

PLAN = standard_plans.table_one_plan(8, parse_path("0,5,10,0"), revisits=2)
SILENT = Instruments(
    tracker=Tracker(noise=0.0, frame_error=(0.0,) * 6),
    force_sensor=ForceSensor(noise=0.0),
)
FAULTS: tuple[InstrumentEffect, ...] = (
    WrenchBias("wrench_sensor", fy_n=0.3, tz_nm=-0.01),
    WrenchGain("wrench_sensor", fz=0.02, ty=-0.01),
    WrenchMisalignment("wrench_sensor", rx_rad=0.01),
    TrackerScale("tracker", ratio=2e-4),
    TrackerMisalignment("tracker", y_m=1e-3, rx_rad=2e-3),
    Drift("tracker", y_m_per_h=1e-5, rz_rad_per_h=1e-5),
    Drift("base", z_m_per_h=1e-5),
    MarkerSlip("marker:link2_a", z_m=1e-4, time_s=500.0),
)
NAMES = [f"{fault.name}@{fault.where}" for fault in FAULTS]
each_fault = pytest.mark.parametrize("fault", FAULTS, ids=NAMES)


@pytest.fixture(scope="module")
def rig(kr10):
    """A KR10 with linear springs."""
    return Rig(kr10)


@pytest.fixture(scope="module")
def silent(rig):
    """What instruments without any error see of it."""
    return record(rig, PLAN, SILENT, seed=4)


def numbers(recording):
    """Everything in a recording that a reading or a statement is made of."""
    frame = recording.base_from_tracker
    held = (recording.points, recording.wrench, recording.posture)
    return [*held, np.zeros(1) if frame is None else frame]


# --- A recording ---------------------------------------------------------------------


def test_same_seed_writes_the_same_files(rig, tmp_path):
    watch = Instruments(
        tracker=Tracker(field=15e-6, occlusions=0.05),
        force_sensor=ForceSensor(turn=0.005),
        encoders=Encoders(arrival=7e-6, link_side=True),
    )
    for folder in ("one", "two"):
        files.write(tmp_path / folder, record(Rig(rig.arm_file), PLAN, watch, seed=4))
    for file in ("samples.csv", "recording.toml"):
        one, two = ((tmp_path / f / file).read_bytes() for f in ("one", "two"))
        assert one == two
    seen = [numbers(record(rig, PLAN, watch, seed=seed))[1] for seed in (4, 5)]
    assert np.all(seen[0] != seen[1])


def test_recording_reads_back_as_it_was_written(rig, tmp_path):
    watch = Instruments(
        tracker=Tracker(occlusions=0.05, frames=4, field=1e-5, frame_error=(0.0,) * 6),
        encoders=Encoders(link_side=True),
    )
    made = record(rig, PLAN, watch, seed=4, name="a name")
    files.write(tmp_path / "r", made)
    read, notes = files.read(tmp_path / "r")
    assert (read.name, read.robot, notes) == ("a name", "kr10_r1100_2", ())
    for name in (
        "time",
        "posture_id",
        "visit",
        "load_time",
        "load_mass",
        "wrench",
        "frames",
    ):
        np.testing.assert_array_equal(getattr(read, name), getattr(made, name))
    np.testing.assert_array_equal(read.stage, made.stage)
    # lengths and angles went through mm and degrees: some units in the last place
    for name in ("points", "posture", "link_posture", "base_from_tracker"):
        ours, theirs = getattr(made, name), getattr(read, name)
        np.testing.assert_allclose(theirs, ours, rtol=0, atol=5e-15)
    for ours, theirs in zip(made.markers, read.markers, strict=True):
        assert (ours.name, ours.body) == (theirs.name, theirs.body)
        places = np.array([theirs.position, ours.position], float)
        np.testing.assert_allclose(*places, rtol=0, atol=1e-15)
    assert read.tracker is not None and read.tracker.volumetric == pytest.approx(1e-5)
    assert read.tool is not None
    assert read.tool.mass == rig.mounted.payload.mass


def test_recording_says_what_was_planned(silent):
    np.testing.assert_array_equal(silent.time, PLAN.time)
    np.testing.assert_array_equal(silent.posture, PLAN.posture[PLAN.row_visit])
    np.testing.assert_array_equal(silent.load_mass, PLAN.row_mass)
    np.testing.assert_array_equal(silent.posture_id, PLAN.posture_id[PLAN.row_visit])
    assert silent.name == PLAN.name


# --- The truth behind it -------------------------------------------------------------


def rope(rig, hook, pulley):
    """Return where the rope leaves the hook, worked out without the simulator.

    It is tangent to the pulley in the plane of hook, pulley and weight, and goes over
    the top.
    """
    centre = rig.mounted.pulley[pulley]
    outward = centre * [1, 1, 0] / np.linalg.norm(centre[:2])
    weight = centre + rig.mounted.pulley_radius * outward - [0, 0, 0.3]
    to_centre = centre - hook
    distance = np.linalg.norm(to_centre)
    normal = np.cross(to_centre, weight - hook)
    normal /= np.linalg.norm(normal)
    angle = np.arcsin(rig.mounted.pulley_radius / distance)
    along, beside = to_centre / distance, np.cross(normal, to_centre / distance)
    ways = [np.cos(angle) * along + s * np.sin(angle) * beside for s in (1, -1)]
    return max(ways, key=lambda way: way[2])


def test_wrench_is_the_ropes_pull_about_the_sensors_origin(rig, silent):
    states = rig.carry_out(PLAN)
    hook = np.array(rig.mounted.hook)
    at_hook = states.point("sensor_far_side", hook)
    turn = states.rotation[:, states.bodies.index("sensor_far_side")]
    for row, visit in enumerate(PLAN.row_visit):
        tension = GRAVITY * PLAN.row_mass[row]
        pull = tension * rope(rig, at_hook[row], PLAN.pulley[visit])
        in_sensor = turn[row].T @ pull
        expected = [*in_sensor, *np.cross(hook, in_sensor)]
        np.testing.assert_allclose(silent.wrench[row], expected, rtol=0, atol=1e-6)


def test_readings_are_the_true_places_of_the_marks(rig, silent):
    states = rig.carry_out(PLAN)
    frame = silent.base_from_tracker
    for m, marker in enumerate(silent.markers):
        true = states.point(rig.anatomy.body(marker.body), marker.position)
        seen = silent.points[:, m] @ frame[:3, :3].T + frame[:3, 3]
        np.testing.assert_allclose(seen, true, rtol=0, atol=1e-13)


def test_base_frame_is_the_base_bodys_wherever_the_model_puts_it(kr10, tmp_path, root):
    """An arm whose base stands turned in its model's world reads the same in it."""
    text = kr10.read_text().replace(
        '<body name="base">', '<body name="base" pos="0.3 -0.2 0.1" quat="1 0 0 1">'
    )
    turned = tmp_path / "turned.xml"
    turned.write_text(text)
    copytree(kr10.parent / "meshes", tmp_path / "meshes")
    unloaded = replace(PLAN, path=parse_path("0"))
    ours, theirs = (
        numbers(record(Rig(arm), unloaded, SILENT, seed=4))[0] for arm in (kr10, turned)
    )
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-9)


def test_arrival_moves_the_arm_and_not_its_report(rig, silent):
    watch = replace(SILENT, encoders=Encoders(arrival=7e-6, link_side=True))
    scattered = record(rig, PLAN, watch, seed=4)
    np.testing.assert_array_equal(scattered.posture, silent.posture)
    moved = (scattered.points - silent.points).reshape(10, 4, -1, 3)
    flange = np.linalg.norm(moved[..., -4:, :], axis=-1)
    assert 1e-6 < flange.mean() < 2e-5  # about 7 µm, see bench.instruments.encoders
    # within a visit it is the same shift, to what the deflection changes of the levers
    assert np.abs(moved - moved[:, :1]).max() < 1e-2 * flange.max()


def test_link_encoders_see_the_wind_up_of_the_springs(rig):
    watch = replace(SILENT, encoders=Encoders(link_side=True, noise=0.0))
    recording = record(rig, PLAN, watch, seed=4)
    states = rig.carry_out(PLAN)
    np.testing.assert_array_equal(recording.link_posture, states.axis_angle)
    assert recording.encoder_repeatability == pytest.approx(np.deg2rad(0.0005))


# --- Faults of instruments -----------------------------------------------------------


@each_fault
def test_fault_switched_off_changes_nothing(fault):
    assert fault.off().fault(SILENT) == SILENT
    bare = Instruments()
    assert fault.off().fault(bare) == bare


@each_fault
def test_fault_moves_the_recording(fault, rig, silent):
    seen = record(replace(rig, effects=(fault,)), PLAN, SILENT, seed=4)
    pairs = zip(numbers(seen), numbers(silent), strict=True)
    changed = [np.abs(a - b).max() > 1e-6 for a, b in pairs]
    assert sum(changed) == 1  # and nothing but its own channel


@each_fault
def test_fault_adds_to_the_one_that_is_there(fault):
    assert fault.fault(fault.fault(SILENT)) != fault.fault(SILENT)
    for other in FAULTS:
        one = other.fault(fault.fault(SILENT))
        assert one == fault.fault(other.fault(SILENT))


def test_order_of_faults_changes_nothing(rig):
    one = faulty(Instruments(), replace(rig, effects=FAULTS))
    other = faulty(Instruments(), replace(rig, effects=FAULTS[::-1]))
    assert one == other


@each_fault
def test_fault_reports_exactly_the_parameters_it_was_given(fault):
    assert replace(fault, **fault.parameters()) == fault
    assert set(fault.off().parameters()) == set(fault.parameters())


def test_bias_gain_and_misalignment_read_as_their_equations_say(rig, silent):
    bias, gain, turned = FAULTS[:3]
    cross = np.array([[0, -0.0087, 0], [0.0087, 0, -0.01], [0, 0.01, 0]])
    true = silent.wrench
    for fault, expected in (
        (bias, true + np.array([0.5, 0.3, 0, 0, 0, -0.01])),
        (gain, true * [1.01, 1, 1.02, 1, 0.99, 1]),
        (turned, true @ np.kron(np.eye(2), expm(cross))),
    ):
        seen = record(replace(rig, effects=(fault,)), PLAN, SILENT, seed=4)
        np.testing.assert_allclose(numbers(seen)[1], expected, rtol=0, atol=1e-10)


def test_slip_moves_one_mark_from_its_time_on(rig, silent):
    slip = MarkerSlip("marker:link2_a", x_m=3e-4, z_m=4e-4, time_s=500.0)
    seen = record(replace(rig, effects=(slip,)), PLAN, SILENT, seed=4)
    moved = np.linalg.norm(seen.points - silent.points, axis=2)
    m = [marker.name for marker in silent.markers].index("link2_a")
    late = silent.time >= 500.0
    assert 0 < late.sum() < len(late)
    np.testing.assert_allclose(moved[late, m], 5e-4, atol=1e-12)
    moved[late, m] = 0.0
    assert np.all(moved == 0.0)


def test_misaligned_frame_is_stated_and_readings_stay(rig, silent):
    fault = TrackerMisalignment("tracker", x_m=0.0, rz_rad=0.0, y_m=1e-3)
    seen = record(replace(rig, effects=(fault,)), PLAN, SILENT, seed=4)
    np.testing.assert_array_equal(seen.points, silent.points)
    shift = numbers(seen)[3] - numbers(silent)[3]
    np.testing.assert_allclose(shift[:3, 3], [0.0, 1e-3, 0.0], atol=1e-15)
    np.testing.assert_array_equal(shift[:3, :3], np.zeros((3, 3)))


def test_flange_alone_can_be_watched(rig, silent):
    watch = replace(SILENT, markers=Markers("flange"))
    seen = record(rig, PLAN, watch, seed=4)
    assert [m.name for m in seen.markers] == [f"flange_{x}" for x in "abcd"]
    np.testing.assert_array_equal(seen.points, silent.points[:, -4:])
