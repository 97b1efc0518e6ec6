"""What splits and samples of poses promise: what they depend on, and what not."""

from dataclasses import replace

import numpy as np
import pytest

from bench.experiment import record
from bench.instruments import Instruments, Markers
from bench.rig import Rig
from bench.standard_plans import table_one_plan
from stiffness.regression.splits import (
    CROSS_VALIDATED,
    Split,
    k_means,
    other_splits,
    seed_of,
    split_of,
    subsample_poses,
)


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


def test_split_does_not_depend_on_the_last_digits_of_a_processor(kr10):
    """Two libraries of linear algebra simulate places that differ by 1e-15 m."""
    made = record(
        Rig(kr10), table_one_plan(poses=20), Instruments(markers=Markers("flange")), 1
    )
    assert made.points is not None
    points = made.points.copy()
    points[0, 0] = np.nan
    missed = replace(made, points=points)
    digits = np.random.default_rng(0).uniform(-1e-15, 1e-15, points.shape)
    assert not np.array_equal(points + digits, points, equal_nan=True)
    other = replace(missed, points=points + digits, posture=made.posture - 1e-17)
    assert seed_of(other) == seed_of(missed) != seed_of(made)
    assert np.array_equal(split_of(other).fold, split_of(missed).fold)
    assert seed_of(replace(missed, points=points + 2e-6)) != seed_of(missed)


def drawn(kr10, poses: int) -> Split:
    flange = Instruments(markers=Markers("flange"))
    return split_of(record(Rig(kr10), table_one_plan(poses=poses), flange, 1))


@pytest.mark.parametrize("poses", [12, 20, 40])
def test_each_pose_of_a_small_experiment_is_held_out_once_with_its_cluster(kr10, poses):
    first = drawn(kr10, poses)
    others = list(other_splits(first))
    out = np.array([split.held_out for split in (first, *others)])
    assert np.all(out.sum(axis=0) == 1)
    assert len(others) <= 4 and out.any(axis=1).all()
    for split in others:
        for cluster in np.unique(split.cluster):
            assert len(np.unique(split.fold[split.cluster == cluster])) == 1


def test_clusters_may_come_out_empty_without_a_word(kr10, recwarn):
    same = np.repeat([[0.0, 1.0], [2.0, 3.0]], 9, axis=0)
    centre, label = k_means(same, same[:4])
    assert len(centre) == 4 and set(label) <= {0, 1}
    flange = Instruments(markers=Markers("flange"))
    made = record(Rig(kr10), table_one_plan(poses=20), flange, 1)
    split_of(replace(made, posture=0.0 * made.posture))
    assert [str(w.message) for w in recwarn] == []


def test_many_poses_and_a_handful_have_one_split(kr10):
    assert list(other_splits(drawn(kr10, 6))) == []
    fold = np.arange(CROSS_VALIDATED) % 9
    assert list(other_splits(Split(fold, 8, fold))) == []
