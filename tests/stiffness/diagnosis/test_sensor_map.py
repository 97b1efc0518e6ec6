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
from bench.standard_plans import table_one_plan
from stiffness.diagnosis.diagnose import diagnose
from stiffness.effects.gravity_load import GravityLoad
from stiffness.effects.mass_scale import MassScale
from stiffness.effects.residual_map import residual_map
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


@pytest.mark.parametrize("depends_on", ["load", "history", "time"])
def test_force_sensor_that_errs_by_its_data_sheet_takes_no_names_of_the_arm(depends_on):
    """Nonlinearity of 1 %, hysteresis of 0.5 %, a zero that drifts by 1 %."""
    made = recording("bearing_tilt@a4,u_rad_per_nm=8e-6,v_rad_per_nm=8e-6", poses=60)
    wrench, hours = made.wrench, made.time / np.ptp(made.time)
    assert wrench is not None
    full = np.repeat(np.abs(wrench.reshape(-1, 2, 3)).max(axis=(0, 2)), 3)
    share = wrench / full
    visits = [share[made.visit == visit] for visit in np.unique(made.visit)]
    error = {
        "load": 0.01 * share * np.abs(share),
        "history": 0.15 * np.concatenate([held_back(v, 0.03) for v in visits]),
        "time": 0.01 * hours[:, None] * np.array([1.0, -0.6, 1.5, 1.0, 0.6, -1.0]),
    }[depends_on]
    laws = (*MECHANICS, GravityLoad(), MassScale(), WrenchGain(), WrenchMisalignment())
    found = diagnose(replace(made, wrench=wrench + full * error), arm(), laws)
    named = {f"{e.name.effect}@{e.name.where}" for e in found.named}
    assert named <= {"bearing_tilt@a4"}
    assert {one.where for one in found.unexplained_places} == {"wrench_sensor"}
    assert depends_on in found.unexplained_places[0].depends_on


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
