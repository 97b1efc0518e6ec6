"""What is promised of long recordings: a sample of the poses is looked at, and said."""

from dataclasses import replace

import numpy as np

from bench.experiment import record
from bench.instruments import Instruments, Markers
from bench.rig import Rig
from bench.standard_plans import table_one_plan
from stiffness.regression.splits import subsample_poses


def test_long_recording_is_sampled_by_pose_the_same_way_again_and_says_so(kr10):
    whole = record(
        Rig(kr10), table_one_plan(poses=20), Instruments(markers=Markers("flange")), 1
    )
    some, note = subsample_poses(whole, most=8)
    assert "8 of 20 poses" in note
    chosen = np.unique(some.posture_id)
    assert len(chosen) == 8
    assert len(some.time) == np.isin(whole.posture_id, chosen).sum()
    again, _ = subsample_poses(whole, most=8)
    assert np.array_equal(np.unique(again.posture_id), chosen)
    other, _ = subsample_poses(replace(whole, time=whole.time + 1.0), most=8)
    assert not np.array_equal(np.unique(other.posture_id), chosen)


def test_usual_recording_is_looked_at_whole(kr10):
    whole = record(
        Rig(kr10), table_one_plan(poses=5), Instruments(markers=Markers("flange")), 1
    )
    assert subsample_poses(whole) == (whole, "")
