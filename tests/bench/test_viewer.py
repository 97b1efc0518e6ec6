from dataclasses import replace

import mujoco
import numpy as np
import pytest
import rerun as rr
from hypothesis import given
from hypothesis import strategies as st
from saved_view import column, entities, identity, timeline
from scipy.spatial.transform import Rotation

from bench import viewer

ARM = """<mujoco><worldbody><body name="base">
  <geom name="foot" type="box" size="0.1 0.1 0.1"/>
  <body name="link_1" pos="0 0 0.3"><joint name="a1" axis="0 1 0"/>
    <geom type="capsule" size="0.05 0.2"/></body>
</body></worldbody></mujoco>"""
ROWS, FACTOR = 6, 100.0
small = st.floats(-1e-3, 1e-3)
vectors = st.tuples(small, small, small).map(np.array)
turns = st.tuples(*[st.floats(-3.0, 3.0)] * 3).map(np.array)


def transform(place, turn):
    """Return a transform of a place in m and a rotation vector in rad."""
    result = np.eye(4)
    result[:3, 3], result[:3, :3] = place, Rotation.from_rotvec(turn).as_matrix()
    return result


@pytest.fixture(scope="module")
def scene():
    """Two bodies that stand still while the second is seen to give way."""
    nominal = np.tile(np.eye(4), (ROWS, 2, 1, 1))
    nominal[:, 1, 2, 3] = 0.3
    actual = nominal.copy()
    actual[:, 1, 0, 3] = 1e-4 * np.arange(ROWS)
    return viewer.Scene(
        model=mujoco.MjModel.from_xml_string(ARM),
        bodies=("base", "link_1"),
        nominal=nominal,
        actual=actual,
        pose=np.repeat([0, 1], ROWS // 2),
        magnified=FACTOR,
        rope=np.tile(np.eye(3), (ROWS, 1, 1)),
        force=np.full((ROWS, 3), 30.0),
        markers=np.zeros((ROWS, 4, 3)),
    )


def save(scene, file):
    """Save a scene with one method's errors in its two poses."""
    stream = viewer.opened("trials", "trial-3", viewer.blueprint(), file)
    error_mm = {"vjm": np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]])}
    viewer.show(stream, scene, error_mm, np.array([1, 4]), "**words**")
    stream.flush()
    stream.disconnect()


@pytest.fixture(scope="module")
def file(scene, tmp_path_factory):
    """The scene as it was saved."""
    file = tmp_path_factory.mktemp("view") / "one.rrd"
    save(scene, file)
    return file


def test_any_name_of_a_body_is_one_step_of_its_path(scene, tmp_path):
    name = "link 1/a"
    model = mujoco.MjModel.from_xml_string(ARM.replace("link_1", name))
    save(replace(scene, model=model, bodies=("base", name)), tmp_path / "odd.rrd")
    assert r"/cell/arm/link\ 1\/a" in entities(tmp_path / "odd.rrd")


# --- Magnified deflections -----------------------------------------------------------


@given(vectors, turns, vectors, vectors, st.floats(0.0, 200.0))
def test_deflection_is_magnified_by_the_equation(place, turn, moved, turned, factor):
    """P + f (p' - p); the rotation vector of R' Rᵀ times f."""
    nominal = transform(place, turn)
    actual = transform(
        place + moved,
        (Rotation.from_rotvec(turned) * Rotation.from_rotvec(turn)).as_rotvec(),
    )
    seen = viewer.magnify(nominal, actual, factor)
    expected = transform(
        place + factor * moved,
        (
            Rotation.from_rotvec(factor * turned) * Rotation.from_rotvec(turn)
        ).as_rotvec(),
    )
    # the rotation vector of 1 mrad is found to 1e-16, times 200
    np.testing.assert_allclose(seen, expected, atol=1e-12)


@given(vectors, turns, vectors, vectors)
def test_factor_1_shows_the_arm_as_it_is_and_0_the_rigid_one(
    place, turn, moved, turned
):
    nominal = transform(place, turn)
    actual = transform(place + moved, turn + turned)
    for factor, expected in ((1.0, actual), (0.0, nominal)):
        np.testing.assert_allclose(
            viewer.magnify(nominal, actual, factor), expected, atol=1e-13
        )


def test_magnifying_leaves_its_input_and_keeps_rows_and_bodies(scene):
    before = scene.nominal.copy()
    larger = viewer.magnify(scene.nominal, scene.actual, FACTOR)
    assert larger.shape == scene.nominal.shape
    np.testing.assert_array_equal(scene.nominal, before)
    np.testing.assert_allclose(larger[:, 1, 0, 3], 1e-2 * np.arange(ROWS))


# --- Saved and live ------------------------------------------------------------------


def test_saved_recording_opens_on_the_timeline_of_readings(file):
    assert timeline(file) == viewer.READING == "reading"
    assert identity(file) == ("trials", "trial-3")


def test_everything_that_belongs_to_the_experiment_can_be_seen(file):
    seen = entities(file)
    assert seen >= {
        *(f"/cell/{arm}/{b}" for arm in ("arm", "ghost") for b in ("base", "link_1")),
        *(f"/cell/{part}" for part in ("rope", "force", "weight", "markers")),
        *(f"/error/{axis}/vjm" for axis in "xyz"),
        "/read_me",
    }


def test_arm_moves_by_the_magnified_deflection_and_its_ghost_stays(file, scene):
    name = "Transform3D:translation"
    ticks, arm = column(file, "/cell/arm/link_1", name)
    _, ghost = column(file, "/cell/ghost/link_1", name)
    np.testing.assert_array_equal(ticks, np.arange(ROWS))
    expected = FACTOR * scene.actual[:, 1, 0, 3]
    np.testing.assert_allclose(arm[:, 0, 0], expected, atol=1e-7)  # float32
    np.testing.assert_allclose(ghost[:, 0], np.tile([0, 0, 0.3], (ROWS, 1)), atol=1e-7)


def test_errors_stand_at_the_readings_they_belong_to(file):
    ticks, error = column(file, "/error/y/vjm", "Scalars:scalars")
    np.testing.assert_array_equal(ticks, [1, 4])
    np.testing.assert_allclose(error.ravel(), [0.2, 0.5])


def test_live_recording_goes_to_a_viewer_with_the_same_layout(monkeypatch):
    opened = []
    monkeypatch.setattr(
        rr.RecordingStream, "spawn", lambda self, **given: opened.append((self, given))
    )
    stream = viewer.opened("trials", "trial-3", viewer.blueprint(), None)
    ((spawned, given_),) = opened
    assert spawned is stream
    assert stream.get_recording_id() == "trial-3"
    assert isinstance(given_["default_blueprint"], type(viewer.blueprint()))
