"""The table for a controller against the models that it was read from."""

import csv
import io

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from bench.controller_table import _pose_rows, controller_table, geometry
from bench.mechanisms import offsets_of
from bench.patch import Mounted, Patch, PatchEffect, rig_of

ERRORS = (
    PatchEffect("encoder_offset", "a2", {"offset_rad": 0.01}),
    PatchEffect("geometry_error", "link_2", {"x_m": 1e-3, "z_m": 2e-3, "ry_rad": 1e-3}),
    PatchEffect("geometry_error", "link_4", {"y_m": 1e-3, "rx_rad": 2e-3}),
    PatchEffect("geometry_error", "link_6", {"x_m": 1e-3, "rz_rad": 2e-3}),
    PatchEffect("gravity_load", "link_3", {"mass_kg": 2.0, "com_x_m": 0.1}),
)
SLIDE = """<mujoco><worldbody><body name="base" euler="0 0 30"><body name="one"
  pos="0.1 0.2 0.3" euler="20 10 0"><joint name="a1" axis="0 1 1"/>
  <geom size="0.1" mass="1"/><body name="two" pos="0.3 0 0.1"><joint name="a2"
  type="slide" axis="1 0 0.2"/><geom size="0.1" mass="1"/><body name="three"
  pos="0 0.2 0"><joint name="a3" axis="1 0 0.2"/><geom size="0.1" mass="1"/></body>
  </body></body></body></worldbody></mujoco>"""


def rows(rig) -> dict[tuple[str, str], dict[str, str]]:
    text = controller_table(rig, offsets_of(rig, rig.anatomy))
    return {(r["part"], r["quantity"]): r for r in csv.DictReader(io.StringIO(text))}


def base_from_flange(model, arm, q) -> np.ndarray:
    data = mujoco.MjData(model)
    for axis, angle in zip(arm.axes, q, strict=True):
        data.joint(axis).qpos[:] = angle
    mujoco.mj_kinematics(model, data)
    frames = []
    for name in (arm.base, arm.flange):
        frame = np.eye(4)
        frame[:3, :3] = data.body(name).xmat.reshape(3, 3)
        frame[:3, 3] = data.body(name).xpos
        frames.append(frame)
    return np.linalg.inv(frames[0]) @ frames[1]


@pytest.mark.parametrize("arm", ["kr10_r1100_2", "ur10", "slide"])
def test_the_geometry_is_the_models_nominal_and_corrected(arm, root, tmp_path):
    """Both arms, at 5 postures, to a rounding error."""
    file = root / "mjcf" / arm / f"{arm}.xml"
    if arm == "slide":
        file = tmp_path / "slide.xml"
        file.write_text(SLIDE)
    rig = rig_of(Patch(effects=ERRORS[:2] if arm == "slide" else ERRORS), file)
    corrected = geometry(rig.model, rig.anatomy, rig.nominal)
    for model, table in (
        (rig.nominal, geometry(rig.nominal, rig.anatomy)),
        (rig.model, corrected),
    ):
        for q in np.random.default_rng(0).uniform(-1, 1, (5, len(rig.anatomy.axes))):
            found = table.base_from_flange(q)
            assert_allclose(found, base_from_flange(model, rig.anatomy, q), atol=1e-12)


def test_the_ur10_has_its_makers_parameters(root):
    """Universal Robots, "DH parameters for calculations of kinematics and dynamics".

    d1, a2, a3, d4, d5 in mm, alpha in degrees; a2 and a3 are counted the other way.
    """
    found = rows(rig_of(Patch(), root / "mjcf" / "ur10" / "ur10.xml"))
    for part, quantity, value in (
        ("a1", "d", 127.3), ("a2", "a", 612.0), ("a3", "a", 572.3),
        ("a4", "d", 163.941), ("a5", "d", 115.7), ("a1", "alpha", 90.0),
        ("a2", "alpha", 0.0),
    ):  # fmt: skip
        assert float(found[part, quantity]["nominal"]) == pytest.approx(value, abs=1e-6)


def test_only_what_was_corrected_differs(root):
    file = root / "mjcf" / "ur10" / "ur10.xml"
    mounted = Mounted(mass_kg=0.5, com_m=(0.0, 0.0, 0.1))  # is no correction
    nothing = rows(rig_of(Patch(mounted=mounted), file)).values()
    assert not any(float(row["change"] or 0.0) for row in nothing)
    found = rows(rig_of(Patch({"a1": 3e4}, ERRORS), file))
    offset = found["a2", "mastering_offset"]
    assert float(offset["change"]) == pytest.approx(np.degrees(0.01))
    assert float(found["link_3", "mass"]["change"]) == pytest.approx(2.0)
    assert float(found["a1", "stiffness"]["corrected"]) == 3e4
    assert found["a2", "stiffness"]["corrected"] == ""
    angles = [r for r in found.values() if r["unit"] == "deg"]
    assert max(abs(float(r["change"])) for r in angles) < 1.0


def test_a_turn_of_next_to_nothing_is_told_the_short_way_round():
    """And one near half a turn in the direction that the nominal one has."""
    for drawn, there in (
        ([0, 0, 1e-9], [-1e-9, 0, -2e-4]),
        ([0, 0, 179], [0, 0, -179]),
    ):
        old, new = (np.eye(4) for _ in range(2))
        old[:3, :3] = Rotation.from_rotvec(drawn, degrees=True).as_matrix()
        new[:3, :3] = Rotation.from_rotvec(there, degrees=True).as_matrix()
        told = [(b, a) for _, key, _, b, a in _pose_rows("flange", old, new)][3:]
        assert all(abs(after - before) < 3.0 for before, after in told)
        back = Rotation.from_rotvec([after for _, after in told], degrees=True)
        assert_allclose(back.as_matrix(), new[:3, :3], atol=1e-12)


def test_a_compliance_that_was_named_is_in_the_stiffness(root):
    """1/K + c: of an axis with a spring, which the named compliance adds to."""
    named = PatchEffect("joint_compliance", "a3", {"compliance_rad_per_nm": 1e-5})
    rig = rig_of(Patch(effects=(named,)), root / "mjcf/kr10_r1100_2/kr10_r1100_2.xml")
    own = rig.springs[2]
    told = float(rows(rig)["a3", "stiffness"]["corrected"])
    assert told == pytest.approx(1.0 / (1.0 / own + 1e-5))
