import numpy as np
import pytest
from small_bench import MODEL, arm

from bench.effects.parse import parse_all
from bench.experiment import record
from bench.instruments import Instruments, Markers
from bench.rig import Rig
from bench.standard_plans import table_one_plan
from scenarios.pipelines.patching import patch_of_diagnosis
from stiffness.diagnosis.diagnose import diagnose
from stiffness.experiment.visits import BEFORE


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
