"""The arm stands as it stood, each body as warm as its marks are wrong."""

import numpy as np
import rerun as rr
from jaxtyping import Float

from bench.proof import Proof
from bench.shapes import shapes

COLD, WARM, HOT = (196, 200, 204), (240, 100, 0), (150, 20, 30)


def bodies(
    stream: rr.RecordingStream,
    simulated: Proof,
    rows: np.ndarray,
    heat: dict[str, np.ndarray],
    times: list[rr.TimeColumn],
) -> None:
    """Log the bodies, where they stand and how warm they are.

    Args:
        stream: Where to.
        simulated: What is shown.
        rows: One of each visit.
        heat: Of each body with marks, 0 to 1.
        times: Of the rows.
    """
    states = simulated.world.see(simulated.patched).states
    base, turn = simulated.world.base
    placed = set()
    for i, shape in enumerate(shapes(simulated.patched.rig.nominal)):
        if shape.body not in states.bodies:
            continue
        path, b = f"/cell/arm/{shape.body}", states.bodies.index(shape.body)
        if shape.body not in placed:
            placed.add(shape.body)
            stream.send_columns(
                path,
                indexes=times,
                columns=rr.Transform3D.columns(
                    translation=((states.position[rows, b] - base) @ turn).astype(
                        np.float32
                    ),
                    mat3x3=(turn.T @ states.rotation[rows, b]).astype(np.float32),
                ),
            )
        flat = shape.vertex[shape.face].reshape(-1, 3).astype(np.float32)
        normal = np.cross(flat[1::3] - flat[::3], flat[2::3] - flat[::3])
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        mesh = rr.Mesh3D(
            vertex_positions=flat,
            vertex_normals=np.repeat(normal, 3, axis=0).astype(np.float32),
        )
        stream.log(f"{path}/shape_{i}", mesh, static=True)
        if shape.body in heat:
            colours = _colours(heat[shape.body])
            columns = rr.Mesh3D.columns(albedo_factor=colours)
            stream.send_columns(f"{path}/shape_{i}", indexes=times, columns=columns)
        else:
            plain = rr.Mesh3D.from_fields(
                albedo_factor=rr.components.AlbedoFactor((*COLD, 255))
            )
            stream.log(f"{path}/shape_{i}", plain, static=True)


def heat_of(simulated: Proof, left: np.ndarray) -> dict[str, np.ndarray]:
    """Return the error of every body visit by visit, 0 at the noise, 1 at the worst."""
    world = simulated.world
    visit, noise = world.replay.visit, simulated.gauge.sigma * np.sqrt(3.0)
    square = np.sum(left**2, axis=2)
    found = {}
    for body in dict.fromkeys(world.body):
        own = square[:, [name == body for name in world.body]]
        total = np.bincount(visit, np.nansum(own, axis=1))
        number = np.bincount(visit, np.isfinite(own).sum(axis=1))
        found[body] = np.sqrt(total / np.maximum(number, 1))
    worst = max(np.quantile(np.concatenate(list(found.values())), 0.98), 2.0 * noise)
    return {
        body: np.clip((values - noise) / (worst - noise), 0.0, 1.0)
        for body, values in found.items()
    }


def _colours(heat: Float[np.ndarray, " rows"]) -> np.ndarray:
    stops = np.array([COLD, WARM, HOT], dtype=float)
    rgb = np.stack([np.interp(heat, [0.0, 0.6, 1.0], stops[:, c]) for c in range(3)], 1)
    packed = rgb.round().astype(np.uint32)
    return (packed[:, 0] << 24) | (packed[:, 1] << 16) | (packed[:, 2] << 8) | 255
