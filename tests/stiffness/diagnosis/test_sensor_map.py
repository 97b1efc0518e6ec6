"""What a force sensor does wrong is placed at the sensor."""

from dataclasses import replace

import hypothesis_truth as truth
import numpy as np
import pytest
from numpy.testing import assert_allclose
from small_bench import MECHANICS, MODEL, arm, prepared, recording

from bench.effects.parse import parse_all
from bench.experiment import record
from bench.instruments import Instruments
from bench.instruments.force_sensor import ForceSensor
from bench.rig import Rig
from bench.shared.recording import Recording
from bench.standard_plans import table_one_plan
from stiffness.diagnosis.diagnose import diagnose
from stiffness.effects.encoder_offset import EncoderOffset
from stiffness.effects.geometry_error import GeometryError
from stiffness.effects.gravity_load import GravityLoad
from stiffness.effects.jacobian import JointRotation
from stiffness.effects.mass_scale import MassScale
from stiffness.effects.residual_map import residual_map
from stiffness.effects.statics import reading, torque_at_sensor
from stiffness.effects.wrench_gain import WrenchGain
from stiffness.effects.wrench_misalignment import WrenchMisalignment


@pytest.mark.parametrize("true", [(), ("hysteresis@a3", "bearing_tilt@a4")])
def test_channels_that_take_up_parts_of_each_other_are_placed_at_the_sensor(true):
    """Crosstalk of 2 %, as makers state it: links bent, masses pulled, axes coupled."""
    draw = np.random.default_rng(3)
    scale = np.block([[np.ones((3, 3)), np.full((3, 3), 3.0)],
                      [np.full((3, 3), 0.1), np.ones((3, 3))]])  # fmt: skip
    crosstalk = 0.02 * scale * draw.normal(size=(6, 6)) * ~np.eye(6, dtype=bool)
    sensor = ForceSensor(gain=tuple(map(tuple, crosstalk.tolist())))
    rig = Rig(MODEL)
    rig = replace(rig, effects=parse_all(true, rig.nominal))
    plan = table_one_plan(poses=60)
    made = record(rig, plan, Instruments(force_sensor=sensor), seed=1)
    laws = (*MECHANICS, GravityLoad(), WrenchGain(), WrenchMisalignment())
    found = diagnose(made, arm(), laws)
    assert {f"{e.name.effect}@{e.name.where}" for e in found.named} == set(true)
    assert found.unexplained_places[0].where == "wrench_sensor"
    assert found.unexplained_places[0].depends_on == ("load",)


def held_back(values: np.ndarray, slip: float) -> np.ndarray:
    """Return what a play holds of each column along a path, from rest at its first."""
    held = [np.zeros(values.shape[1])]
    for change in np.diff(values, axis=0):
        held.append(np.clip(held[-1] + change, -slip, slip))
    return np.array(held)


@pytest.mark.parametrize(
    ("kind", "depends_on"),
    [("curve", "load"), ("lag", "history"), ("zero", "time"), ("span", "time")],
)
def test_force_sensor_that_errs_by_its_data_sheet_takes_no_names_of_the_arm(
    kind, depends_on
):
    """Nonlinearity of 1 %, hysteresis of 0.5 %, a zero that drifts by 1 %, a scale."""
    made = recording("bearing_tilt@a4,u_rad_per_nm=8e-6,v_rad_per_nm=8e-6", poses=60)
    wrench, hours = made.wrench, made.time / np.ptp(made.time)
    assert wrench is not None
    full = np.repeat(np.abs(wrench.reshape(-1, 2, 3)).max(axis=(0, 2)), 3)
    share = wrench / full
    visits = [share[made.visit == visit] for visit in np.unique(made.visit)]
    error = {
        "curve": 0.01 * share * np.abs(share),
        "lag": 0.15 * np.concatenate([held_back(v, 0.03) for v in visits]),
        "zero": 0.01 * hours[:, None] * np.array([1.0, -0.6, 1.5, 1.0, 0.6, -1.0]),
        "span": 0.05 * hours[:, None] * share,
    }[kind]
    laws = (*MECHANICS, GravityLoad(), MassScale(), WrenchGain(), WrenchMisalignment())
    found = diagnose(replace(made, wrench=wrench + full * error), arm(), laws)
    named = {f"{e.name.effect}@{e.name.where}" for e in found.named}
    assert named <= {"bearing_tilt@a4"}
    assert {one.where for one in found.unexplained_places} == {"wrench_sensor"}
    assert depends_on in found.unexplained_places[0].depends_on


def loads_of_visits(made: Recording) -> np.ndarray:
    """Return the largest load of each row's visit, as it was read."""
    assert made.wrench is not None
    force = np.linalg.norm(made.wrench[:, :3], axis=1)
    most = np.zeros_like(made.wrench)
    for visit in np.unique(made.visit):
        own = np.flatnonzero(made.visit == visit)
        most[own] = made.wrench[own[np.argmax(force[own])]]
    return most


def test_sensor_zeroed_under_a_load_is_placed_and_takes_no_weights():
    """A hook of a tenth of the largest load hung on the rope, in each visit."""
    true = {
        "hysteresis@a2": "width_rad=2e-4",
        "bearing_tilt@a4": "u_rad_per_nm=8e-6,v_rad_per_nm=8e-6",
        "encoder_offset@a3": "offset_rad=4e-4",
    }
    made = recording(*(f"{name},{size}" for name, size in true.items()), poses=60)
    assert made.wrench is not None
    zeroed = replace(made, wrench=made.wrench - 0.1 * loads_of_visits(made))
    laws = (*MECHANICS, EncoderOffset(), GravityLoad(), GeometryError(), WrenchGain())
    found = diagnose(zeroed, arm(), laws)
    assert {f"{e.name.effect}@{e.name.where}" for e in found.named} == {*true}
    assert found.unexplained_places[0].where == "wrench_sensor"
    said = {(w.code, w.where) for w in found.warnings}
    assert ("tared_under_load", "wrench_sensor") in said


def test_what_was_tared_away_pulls_as_the_visits_load_does():
    """Equation: per newton of the largest force, J' of the visit's load over its size.

    Rows without a load have it too.
    """
    here = prepared().situation
    (tare,) = (b.jacobian for b in residual_map(here) if b.kind == "tare")
    most = loads_of_visits(replace(here.recording, wrench=reading(here)))
    force = np.linalg.norm(most[:, :3], axis=1, keepdims=True)
    parts = np.split(most / force, 2, axis=1)
    along = np.concatenate([(here.sensor_axes @ p[..., None]) for p in parts], axis=1)
    wound = torque_at_sensor(here, along)[..., 0] * here.compliance
    assert np.abs(wound[here.steps[:, 0]]).max() > 1e-7
    for part in tare.parts:
        assert isinstance(part, JointRotation)
        assert_allclose(part.law[:, 0], np.max(force) * wound[:, part.axis], atol=1e-12)


def test_channels_of_the_map_do_what_gains_do():
    """Equation: of the 6 x 6 matrix, the diagonal is minus the gains."""
    here = prepared().situation
    blocks = residual_map(here)
    (channels,) = (b.jacobian for b in blocks if b.kind == "channels")
    shape = WrenchGain().shapes(here, "wrench_sensor")[0]
    gains = truth.moved(here, WrenchGain().jacobian(here, "wrench_sensor", shape))
    own = truth.moved(here, channels)[..., ::7]
    shown = np.abs(own).max(axis=(0, 1, 2)) > 1e-15
    assert_allclose(own[..., shown], -gains, atol=1e-12)
