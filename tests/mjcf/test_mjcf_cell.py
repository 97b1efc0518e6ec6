"""The cell that a person opens carries the same arm, and its rope pulls as told."""

from importlib import import_module
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

FOLDER = Path(__file__).parents[2] / "mjcf" / "kr10_r1100_2"
KUKA = FOLDER / "kr10_r1100_2.xml"
SCENE = FOLDER / "scene.xml"
MICROMETRE = 1e-6
ARM = ("base", *(f"link_{k}" for k in range(1, 7)))


@pytest.fixture
def kuka() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(KUKA))


@pytest.fixture
def scene() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(SCENE))


def at(model: mujoco.MjModel, posture) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.qpos[:] = posture
    mujoco.mj_forward(model, data)
    return data


def test_scene_holds_its_home_posture_against_no_spring(scene):
    home = scene.key("home").qpos
    np.testing.assert_array_equal(scene.qpos_spring, home)
    np.testing.assert_allclose(np.degrees(home), [0, -90, 90, 0, 0, 90], atol=1e-12)


def test_scene_carries_the_same_arm(kuka, scene):
    for posture in np.random.default_rng(1).uniform(*kuka.jnt_range.T, size=(5, 6)):
        alone, mounted = at(kuka, posture), at(scene, posture)
        for name in (*ARM, "flange"):
            np.testing.assert_array_equal(
                alone.body(name).xpos, mounted.body(name).xpos
            )
            np.testing.assert_array_equal(kuka.body(name).mass, scene.body(name).mass)
    np.testing.assert_array_equal(kuka.jnt_stiffness, scene.jnt_stiffness)


def test_scene_is_what_its_script_writes(monkeypatch):
    monkeypatch.syspath_prepend(SCENE.parent)
    make_scene = import_module("make_scene")
    written = ElementTree.tostring(make_scene.scene(), encoding="unicode")
    assert ElementTree.canonicalize(written, strip_text=True) == (
        ElementTree.canonicalize(SCENE.read_text(), strip_text=True)
    )


def test_hook_stands_beside_the_last_axis_and_before_the_sensor(scene):
    data = at(scene, scene.key("home").qpos)
    flange = data.body("flange")
    axes = flange.xmat.reshape(3, 3)
    hook = axes.T @ (data.site("hook").xpos - flange.xpos)
    face = axes.T @ (data.site("sensor").xpos - flange.xpos)
    np.testing.assert_allclose(np.linalg.norm(hook[:2]), 0.050, atol=1e-12)
    np.testing.assert_allclose(hook[2] - face[2], 0.040, atol=1e-12)


@pytest.mark.parametrize("tension", [20.0, 98.1])
def test_sensor_feels_the_ropes_tension_at_rest(scene, tension):
    scene.opt.timestep = 1.0  # with the discrete integrator: one Newton step each
    data = mujoco.MjData(scene)
    mujoco.mj_resetDataKeyframe(scene, data, 0)
    data.ctrl[:] = tension
    mujoco.mj_step(scene, data, nstep=40)
    mujoco.mj_forward(scene, data)
    assert np.abs(data.qvel).max() < 1e-12, "at rest"
    assert not any(warning.number for warning in data.warning)
    site = data.site("sensor").xmat.reshape(3, 3)
    weight = scene.body("sensor_far_side").mass * scene.opt.gravity
    load = -site @ data.sensor("force").data - weight
    rope = data.wrap_xpos.reshape(-1, 3)
    along = (rope[1] - rope[0]) / np.linalg.norm(rope[1] - rope[0])
    np.testing.assert_allclose(rope[0], data.site("hook").xpos)
    np.testing.assert_allclose(load, tension * along, atol=1e-7)


def test_covers_are_what_their_script_writes_and_stay_small(monkeypatch):
    monkeypatch.syspath_prepend(KUKA.parent)
    make_meshes = import_module("make_meshes")
    files = {path.stem: path for path in (KUKA.parent / "meshes").glob("*.stl")}
    covers = make_meshes.covers()
    assert covers.keys() == files.keys()
    assert sum(path.stat().st_size for path in files.values()) < 500_000
    for name, skin in covers.items():
        triangles = files[name].read_bytes()[84:]
        stored: np.ndarray = np.frombuffer(triangles, make_meshes.STL)
        np.testing.assert_allclose(stored["corners"], skin, atol=MICROMETRE)


def test_a_loft_is_closed_and_faces_outwards(monkeypatch):
    monkeypatch.syspath_prepend(KUKA.parent)
    make_meshes = import_module("make_meshes")
    radius, height = 10.0, 30.0
    skin = make_meshes.turned("z", 100.0, 50.0, (0.0, radius), (height, radius))
    area = np.cross(skin[:, 1] - skin[:, 0], skin[:, 2] - skin[:, 0]) / 2
    np.testing.assert_allclose(area.sum(axis=0), 0, atol=1e-9)  # closed
    volume = np.einsum("ni,ni->", skin[:, 0], area) / 3
    assert 0.98 < volume / (np.pi * radius**2 * height) < 1.0  # a polygon inside it


@pytest.mark.parametrize("power", [2.0, 4.0, 9.0])
def test_rounded_outline_is_a_superellipse(monkeypatch, power):
    monkeypatch.syspath_prepend(KUKA.parent)
    make_meshes = import_module("make_meshes")
    _, curve = make_meshes.rounded(0.0, (-3.0, 5.0), (10.0, 12.0), power)
    x, y = np.abs(curve - [1.0, 11.0]).T
    np.testing.assert_allclose((x / 4) ** power + (y / 1) ** power, 1.0, rtol=1e-12)
