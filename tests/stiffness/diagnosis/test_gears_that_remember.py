from dataclasses import replace

import numpy as np
import pytest
from small_bench import MODEL, arm

from bench.effects.parse import parse_all
from bench.experiment import record
from bench.instruments import Instruments, Markers
from bench.rig import Rig
from bench.standard_plans import table_one_plan
from scenarios.pipelines.patching import memory_of, patch_of_diagnosis
from stiffness.diagnosis.diagnose import diagnose
from stiffness.diagnosis.result import Name, NamedEffect
from stiffness.experiment.visits import BEFORE, NOTHING


@pytest.mark.parametrize(
    ("said", "parameter", "size"),
    [
        ("hysteresis@a3,width_rad=2e-4", "width_rad", 2e-4),
        ("creep@a2,ratio=0.1,time_s=40", "ratio", 0.1),
    ],
)
def test_effect_whose_state_lasts_from_visit_to_visit_is_named(said, parameter, size):
    """Every visit begins as the one before ended; without that both had no name."""
    rig = Rig(MODEL)
    rig = Rig(MODEL, effects=parse_all((said,), rig.nominal))
    flange, plan = Instruments(markers=Markers("flange")), table_one_plan(poses=24)
    recording = record(rig, plan, flange, seed=1, memory="carried")
    nominal = arm().for_recording(recording)
    found = diagnose(recording, nominal)
    assert found.verdict == "explained"
    (named,) = found.named
    assert f"{named.name.effect}@{named.name.where}" == said.split(",")[0]
    assert round(named.shape[1]) == BEFORE
    np.testing.assert_allclose(named.parameters[parameter].estimate, size, rtol=0.2)
    patch = patch_of_diagnosis(found, recording, nominal)
    assert patch.memory == "carried"
    assert set(patch.fitted) == {f"a{k}" for k in range(1, 7)}


@pytest.mark.parametrize(
    ("shares", "memory"),
    [((0.2, 0.001), "forgotten"), ((0.001, 0.2), "carried"), ((), "forgotten")],
)
def test_one_memory_of_all_gears_is_that_of_what_explains_most(shares, memory):
    named = [
        NamedEffect(Name("hysteresis", "a2"), 1.0, (), {}, (10.0, float(NOTHING))),
        NamedEffect(Name("creep", "a1"), 1.0, (), {}, (30.0, float(BEFORE))),
        NamedEffect(Name("hardening", "a1"), 1.0, (), {}, (30.0,)),
    ]
    of = [replace(one, share=share) for one, share in zip(named, shares, strict=False)]
    assert memory_of(of or named) == memory
    assert memory_of(named[1:]) == "carried"
