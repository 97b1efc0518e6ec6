"""Visible geometry of a MuJoCo model as meshes."""

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

SIDES = 24
"""Number of corners of a round shape; chosen: smooth at arm's length, small on disk."""


@dataclass(frozen=True)
class Shape:
    """One visible surface of a body.

    Attributes:
        vertex: Vertices in the body's frame, in m.
        face: Indices of the corners of each triangle.
        rgba: Colour, 0 to 1.
    """

    body: str
    vertex: Float[np.ndarray, "vertices 3"]
    face: Int[np.ndarray, "faces 3"]
    rgba: Float[np.ndarray, "4"]


def shapes(model: mujoco.MjModel) -> tuple[Shape, ...]:
    """Return the visible shapes of all bodies; planes are left out."""
    found = []
    for g in range(model.ngeom):
        mesh = _mesh(model, g)
        if mesh is None:
            continue
        vertex, face = mesh
        rotation = Rotation.from_quat(model.geom_quat[g], scalar_first=True).as_matrix()
        material = model.geom_matid[g]
        found.append(
            Shape(
                body=model.body(model.geom_bodyid[g]).name,
                vertex=vertex @ rotation.T + model.geom_pos[g],
                face=face,
                rgba=model.mat_rgba[material] if material >= 0 else model.geom_rgba[g],
            )
        )
    return tuple(found)


def _mesh(model: mujoco.MjModel, g: int) -> tuple[np.ndarray, np.ndarray] | None:
    kind, size = mujoco.mjtGeom(model.geom_type[g]), model.geom_size[g]
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        m = model.geom_dataid[g]
        vertices = slice(
            model.mesh_vertadr[m], model.mesh_vertadr[m] + model.mesh_vertnum[m]
        )
        faces = slice(
            model.mesh_faceadr[m], model.mesh_faceadr[m] + model.mesh_facenum[m]
        )
        return model.mesh_vert[vertices].copy(), model.mesh_face[faces].copy()
    return _lathe(*_PROFILE[kind](size)) if kind in _PROFILE else None


def _capsule(size: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    profile = size[0] * _BALL
    profile[:, 1] += np.sign(profile[:, 1]) * size[1]
    return profile, np.ones(3), SIDES


_RISE = np.linspace(-np.pi / 2, np.pi / 2, SIDES // 2)
_BALL = np.stack([np.cos(_RISE), np.sin(_RISE)], axis=1)
_DISC = np.array([[0.0, -1.0], [1.0, -1.0], [1.0, 1.0], [0.0, 1.0]])
_PROFILE = {
    mujoco.mjtGeom.mjGEOM_BOX: lambda size: (_DISC * [np.sqrt(2), 1], size, 4),
    mujoco.mjtGeom.mjGEOM_CYLINDER: lambda size: (_DISC, size[[0, 0, 1]], SIDES),
    mujoco.mjtGeom.mjGEOM_CAPSULE: _capsule,
    mujoco.mjtGeom.mjGEOM_SPHERE: lambda size: (_BALL, size[[0, 0, 0]], SIDES),
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: lambda size: (_BALL, size, SIDES),
}
"""Radius and height of each kind's outline, its scale, and its number of corners."""


def _lathe(
    profile: Float[np.ndarray, "points 2"], scale: np.ndarray, sides: int
) -> tuple[np.ndarray, np.ndarray]:
    """Turn a profile of (radius, height) about z; four sides make a box."""
    turn = np.arange(sides) * 2 * np.pi / sides + np.pi / sides
    radius, height = profile[:, 0, None], profile[:, 1, None]
    vertex = np.stack(
        [radius * np.cos(turn), radius * np.sin(turn), height + 0 * turn], axis=-1
    )
    rings = len(profile)
    ring, side = np.meshgrid(np.arange(rings - 1), np.arange(sides), indexing="ij")
    a, b = ring * sides + side, ring * sides + (side + 1) % sides
    face = np.stack([a, b, b + sides, a, b + sides, a + sides], axis=-1)
    return (vertex * scale).reshape(-1, 3), face.reshape(-1, 3)
