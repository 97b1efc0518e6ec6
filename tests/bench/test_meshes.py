import mujoco
import numpy as np
import pytest

from bench.meshes import SIDES, shapes

FIVE_KINDS = """<mujoco><worldbody>
  <geom name="floor" type="plane" size="1 1 1"/>
  <body name="one" pos="1 2 3" quat="1 1 0 0">
    <geom type="box" size="0.1 0.2 0.3" rgba="1 0 0 1"/>
    <geom type="cylinder" size="0.1 0.3" pos="0 0 1"/>
    <body name="two"><geom type="capsule" size="0.1 0.3" euler="30 40 50"/></body>
    <body name="three"><geom type="sphere" size="0.2"/></body>
    <body name="four"><geom type="ellipsoid" size="0.1 0.2 0.3"/></body>
  </body>
</worldbody></mujoco>"""
PI = np.pi
VOLUMES = {
    "box": 8 * 0.1 * 0.2 * 0.3,
    "cylinder": PI * 0.1**2 * 0.6,
    "capsule": PI * 0.1**2 * 0.6 + 4 / 3 * PI * 0.1**3,
    "sphere": 4 / 3 * PI * 0.2**3,
    "ellipsoid": 4 / 3 * PI * 0.1 * 0.2 * 0.3,
}
"""Of the shapes above in their order, in m³, by the formulas of school."""
INSCRIBED = 0.05
"""A solid with 24 corners around and 12 up lacks 1.1 % around and up to 2 % up."""


@pytest.fixture(scope="module")
def five():
    """One shape of each kind."""
    return dict(
        zip(VOLUMES, shapes(mujoco.MjModel.from_xml_string(FIVE_KINDS)), strict=True)
    )


@pytest.fixture(scope="module")
def kuka(kr10):
    """The model of the KR10."""
    return mujoco.MjModel.from_xml_path(str(kr10))


def area_vectors(shape):
    """Return half the cross product of each triangle's sides, in m²."""
    a, b, c = shape.vertex[shape.face].swapaxes(0, 1)
    return np.cross(b - a, c - a) / 2


def volume(shape):
    """Return the enclosed volume by Gauss, in m³; negative with faces inwards."""
    return np.einsum("fi,fi->", shape.vertex[shape.face[:, 0]], area_vectors(shape)) / 3


@pytest.mark.parametrize("kind", VOLUMES)
def test_surface_is_closed(five, kind):
    """The outward areas of a closed surface cancel (Gauss)."""
    areas = area_vectors(five[kind])
    assert np.abs(areas).sum() > 0.01
    np.testing.assert_allclose(areas.sum(axis=0), 0.0, atol=1e-12)


@pytest.mark.parametrize("kind", VOLUMES)
def test_surface_encloses_the_volume_of_its_solid_and_faces_outwards(five, kind):
    expected = VOLUMES[kind]
    lacks = 1e-9 if kind == "box" else INSCRIBED
    assert (1 - lacks) * expected <= volume(five[kind]) <= (1 + 1e-9) * expected


def test_shapes_belong_to_the_bodies_that_carry_them_and_planes_are_left_out(five):
    bodies = [shape.body for shape in five.values()]
    assert bodies == ["one", "one", "two", "three", "four"]


def test_vertices_are_in_the_frame_of_the_body(five):
    """Where the body itself stands does not show; where the shape sits on it does."""
    low, high = (getattr(five["box"].vertex, end)(axis=0) for end in ("min", "max"))
    np.testing.assert_allclose([low, high], np.outer([-1, 1], [0.1, 0.2, 0.3]))
    height = five["cylinder"].vertex[:, 2]
    np.testing.assert_allclose([height.min(), height.max()], [0.7, 1.3])


def test_colour_is_the_shapes_own(five):
    np.testing.assert_array_equal(five["box"].rgba, [1, 0, 0, 1])


def test_round_shapes_touch_their_size_nowhere_beyond_it(five):
    along = np.linalg.norm(five["sphere"].vertex, axis=1)
    np.testing.assert_allclose(along, 0.2, rtol=1e-12)
    scaled = five["ellipsoid"].vertex / [0.1, 0.2, 0.3]
    np.testing.assert_allclose(np.linalg.norm(scaled, axis=1), 1.0, rtol=1e-12)
    around = np.unique(np.round(five["cylinder"].vertex[:, :2], 9), axis=0)
    assert len(around) == SIDES + 1  # and the middle of the lids


def test_arm_is_covered_from_base_to_flange_in_the_colours_of_its_model(kuka):
    covers = shapes(kuka)
    assert {s.body for s in covers} >= {"base", *(f"link_{k}" for k in range(1, 7))}
    orange = [s for s in covers if s.rgba[0] > 0.8 and 0.2 < s.rgba[1] < 0.6]
    assert orange
    assert all(s.face.max() < len(s.vertex) for s in covers)


def test_cover_stands_where_the_simulator_puts_it(kuka):
    """Mesh vertices against the engine's own place of the mesh in the world."""
    data = mujoco.MjData(kuka)
    data.qpos[:] = [0.3, -1.1, 1.4, 0.4, 0.8, -0.5]
    mujoco.mj_kinematics(kuka, data)
    visible = [
        g for g in range(kuka.ngeom) if kuka.geom_type[g] != mujoco.mjtGeom.mjGEOM_PLANE
    ]
    for g, shape in zip(visible, shapes(kuka), strict=True):
        if kuka.geom_type[g] != mujoco.mjtGeom.mjGEOM_MESH:
            continue
        first = kuka.mesh_vertadr[kuka.geom_dataid[g]]
        own = kuka.mesh_vert[first : first + len(shape.vertex)]
        world = own @ data.geom_xmat[g].reshape(3, 3).T + data.geom_xpos[g]
        body = data.body(shape.body)
        ours = shape.vertex @ body.xmat.reshape(3, 3).T + body.xpos
        np.testing.assert_allclose(ours, world, atol=1e-6)  # covers are float32
