"""Every size of the default truth lies in the range that its source states."""

import math
from collections import Counter

import numpy as np
import pytest

from bench.effects.effect import InstrumentEffect
from bench.rig import Rig
from bench.study_arm import default_truth

AXES = tuple(f"a{k}" for k in range(1, 7))
ARCMIN = math.pi / 180 / 60

CATALOGUE = {
    # size: T1, T2 in N m; K1, K2, K3 in kN m/rad at ratio 50, then above 50
    14: ((2, 6.9), (3.4, 4.7, 5.7), (4.7, 6.1, 7.1)),
    17: ((3.9, 12), (8.1, 11, 13), (10, 14, 16)),
    20: ((7, 25), (13, 18, 23), (16, 25, 29)),
    25: ((14, 48), (25, 34, 44), (31, 50, 57)),
    32: ((29, 108), (54, 78, 98), (67, 110, 120)),
    40: ((54, 196), (100, 140, 180), (130, 200, 230)),
}
"""Harmonic Drive, CHA engineering data 1018854: torsional stiffness of its gears."""
TILT = {"a1": 539e3, "a2": 539e3, "a3": 242e3, "a4": 44e3, "a5": 44e3, "a6": 44e3}
"""N m/rad, the least a cross-roller bearing of that axis has, by the CSF-2UH list."""


@pytest.fixture(scope="module")
def truth():
    return default_truth()


def of(truth, name):
    """Return the effects of one name by their places."""
    return {effect.where: effect for effect in truth.effects if effect.name == name}


def gear(truth, axis):
    """Return T1, T2 in N m and K1, K2, K3 in kN m/rad of an axis, from its effect."""
    law = of(truth, "hardening")[axis]
    k1 = truth.stiffness[AXES.index(axis)]
    k3 = law.stiffness_ratio * k1
    k2 = k1 + law.middle_share * (k3 - k1)
    torques = (law.torque_nm, law.second_torque * law.torque_nm)
    return torques, (k1 / 1e3, k2 / 1e3, k3 / 1e3)


def test_default_truth_builds_with_every_effect(truth, kr10):
    rig = Rig(kr10, truth.effects, truth.stiffness)
    assert rig.model.nv > 6
    np.testing.assert_array_equal(rig.springs, truth.stiffness)


def test_default_truth_is_made_of_mechanisms_and_the_same_every_time(truth):
    assert not any(isinstance(e, InstrumentEffect) for e in truth.effects)
    assert default_truth().effects == truth.effects
    assert max(Counter((e.name, e.where) for e in truth.effects).values()) == 1
    assert all(effect != effect.off() for effect in truth.effects)


def test_every_axis_hardens_slips_creeps_ripples_and_tilts(truth):
    each = ("hardening", "hysteresis", "creep", "angle_dependent_stiffness")
    for name in (*each, "bearing_tilt"):
        assert set(of(truth, name)) == set(AXES)
    assert set(of(truth, "base_compliance")) == {"base"}
    assert set(of(truth, "link_bending")) == {"link_2", "link_4"}


def sizes(truth, axis):
    """Return the catalogue's sizes that have an axis' torques and stiffnesses."""
    torques, stiffness = gear(truth, axis)
    return [
        size
        for size, (limits, *ratios) in CATALOGUE.items()
        for k in ratios
        if np.allclose([*torques, *stiffness], [*limits, *k], rtol=1e-9)
    ]


def test_every_gear_is_one_of_the_catalogue_and_none_is_larger_than_the_one_before(
    truth,
):
    found = [sizes(truth, axis) for axis in AXES]
    assert all(len(size) == 1 for size in found)
    assert found == sorted(found, reverse=True)


def test_hysteresis_is_below_an_arcminute(truth):
    widths = [effect.width_rad for effect in of(truth, "hysteresis").values()]
    assert 0.1 * ARCMIN < min(widths)
    assert max(widths) < 1.0 * ARCMIN  # the catalogue's limit


def test_stiffness_ripples_by_3_to_10_percent(truth):
    ratios = [e.ratio for e in of(truth, "angle_dependent_stiffness").values()]
    assert 0.03 <= min(ratios) <= max(ratios) <= 0.10


def test_creep_is_1_to_5_percent_within_a_minute(truth):
    for effect in of(truth, "creep").values():
        assert 0.01 <= effect.ratio <= 0.05
        assert 5.0 <= effect.time_s <= 60.0


@pytest.mark.parametrize("axis", AXES)
def test_bearing_is_as_stiff_as_a_cross_roller_of_its_axis(truth, axis):
    tilt = of(truth, "bearing_tilt")[axis]
    assert tilt.u_rad_per_nm == tilt.v_rad_per_nm
    # main bearings are larger than a gear's own: up to twice the list's largest
    assert TILT[axis] <= 1 / tilt.u_rad_per_nm <= 2 * 910e3


def test_foot_stands_between_an_aluminium_table_and_a_steel_pedestal(truth):
    foot = of(truth, "base_compliance")["base"]
    for compliance in (foot.rx_rad_per_nm, foot.ry_rad_per_nm):
        assert 2e5 <= 1 / compliance <= 1e7


@pytest.mark.parametrize(
    ("link", "outer", "wall"), [("link_2", 0.150, 0.008), ("link_4", 0.120, 0.006)]
)
def test_link_is_an_aluminium_tube_of_the_stated_size(truth, link, outer, wall):
    """I = π/64 (D⁴ - d⁴), J = 2 I; E = 70 GPa, G = 26 GPa."""
    bending = of(truth, "link_bending")[link]
    inertia = math.pi / 64 * (outer**4 - (outer - 2 * wall) ** 4)  # m⁴
    # two digits are given, and a tube is a guess at a cast link
    assert bending.bending_nm2 == pytest.approx(70e9 * inertia, rel=0.1)
    assert bending.torsion_nm2 == pytest.approx(26e9 * 2 * inertia, rel=0.1)
