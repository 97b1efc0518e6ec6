from dataclasses import replace

import numpy as np
import pytest

from bench.effect_size import EffectSize, effect_sizes
from bench.effects.parse import parse_all
from bench.experiment import record
from bench.instruments import ForceSensor, Instruments, Tracker
from bench.instruments.tracker import STILL
from bench.rig import Rig
from bench.shared.errors import BenchError
from bench.shared.plan import parse_path
from bench.standard_plans import table_one_plan

PLAN = table_one_plan(8, parse_path("0,5,10,0"))
QUIET = Instruments(
    tracker=Tracker(noise=0.0, frame_error=STILL), force_sensor=ForceSensor(noise=0.0)
)


def sizes_of(file, *words: str, plan=PLAN, watch: Instruments | None = None):
    rig = Rig(file)
    rig = replace(rig, effects=parse_all(words, rig.nominal))
    return rig, tuple(effect_sizes(rig, plan, watch or Instruments()))


def test_size_is_the_difference_of_two_recordings_without_noise(kr10):
    """Marks seen in the tracker's frame are as far apart as in the base's."""
    words = ("hysteresis@a2,width_rad=3e-4", "pulley_friction@rig,ratio=0.03")
    rig, sizes = sizes_of(kr10, *words)
    whole = record(rig, PLAN, QUIET)
    for k, size in enumerate(sizes):
        other = replace(rig, effects=(rig.effects[1 - k],))
        without = record(other, PLAN, QUIET)
        assert size.effect == rig.effects[k]
        moved = np.linalg.norm(
            np.array(whole.points) - np.array(without.points), axis=2
        )
        wrench = (np.array(whole.wrench) - np.array(without.wrench)).reshape(-1, 2, 3)
        force, torque = np.linalg.norm(wrench, axis=2).T
        for found, vectors in (
            (size.points, moved),
            (size.force, force),
            (size.torque, torque),
        ):
            np.testing.assert_allclose(found, np.sqrt(np.mean(vectors**2)), rtol=1e-6)


def test_what_instruments_do_is_seen_without_moving_the_arm(kr10):
    """A bias of 0.5 N; a scale of 1e-4 where the tracker sees from 2 to 4 m."""
    words = ("wrench_bias@wrench_sensor,fx_n=0.3,fy_n=0.4", "tracker_scale@tracker")
    _, (bias, scale) = sizes_of(kr10, *words)
    assert (bias.points, bias.torque) == (0.0, 0.0)
    assert bias.force == pytest.approx(0.5)
    assert scale.force == 0.0 and scale.points > 1e-5


def test_drift_counts_by_the_clock_of_the_whole_plan(kr10):
    """Of 151 visits some are simulated, at the times at which they happen."""
    plan = table_one_plan(151, parse_path("0,10"))
    words = ["drift@base,x_m_per_h=1e-4"]
    words += [f"encoder_offset@a{k},offset_rad=1e-4" for k in range(1, 7)]
    _, (drift, *_) = sizes_of(kr10, *words, plan=plan)
    assert drift.visits < plan.visits
    whole = 1e-4 * np.sqrt(np.mean((plan.time / 3600.0) ** 2))
    assert drift.points == pytest.approx(whole, rel=0.03)


def test_misaligned_tracker_moves_what_the_manifest_says(kr10):
    words = ("tracker_misalignment@tracker,x_m=3e-4,z_m=4e-4",)
    _, (size,) = sizes_of(kr10, *words)
    assert size.points == pytest.approx(5e-4, rel=1e-9)


def test_noise_does_not_enter_a_size(kr10):
    words = ("creep@a2",)
    loud = Instruments(tracker=Tracker(noise=5.0, field=1e-4, occlusions=0.3))
    assert sizes_of(kr10, *words)[1] == sizes_of(kr10, *words, watch=loud)[1]


def test_effect_without_which_the_others_find_no_rest_has_no_size(kr10, monkeypatch):
    carried_out = Rig.carry_out

    def only_with_creep(rig, *plan):
        if "creep" not in [effect.name for effect in rig.effects]:
            raise BenchError("Visit 0 finds no rest.")
        return carried_out(rig, *plan)

    monkeypatch.setattr(Rig, "carry_out", only_with_creep)
    _, (creep, tilt) = sizes_of(kr10, "creep@a2", "bearing_tilt@a3")
    assert np.isnan(creep.points) and np.isnan(creep.over_noise(Instruments()))
    assert tilt.points > 0.0


def test_size_over_noise_is_that_of_the_instrument_that_sees_it_best(kr10):
    _, (effect, *_) = sizes_of(kr10, "creep@a2")
    instruments = Instruments(tracker=Tracker(repeatability=(1e-5, 1e-5, 1e-5)))
    for points, force, torque, expected in (
        (2e-5, 0.0, 0.0, 2.0),
        (2e-5, 0.4, 0.0, 10.0),
        (0.0, 0.0, 0.04, 20.0),
    ):
        size = EffectSize(effect.effect, points, force, torque, 1)
        assert size.over_noise(instruments) == pytest.approx(expected)
