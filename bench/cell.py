"""Cell: floor, pulleys, rope and the force sensor with its hook on the flange.

On any arm: a disc-shaped sensor on the flange, a plate with a hook beside the last
axis, and pulleys around the arm whose ropes span all directions of force. Only one
rope is tight at a time; its tension is a motor's control, in N.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float

from bench.kinematic_chain import Anatomy, pose_in
from bench.shared.errors import BenchError
from bench.shared.recording import Payload

GRAVITY = 9.81
"""m/s²; MuJoCo's default, and what a nominal mass on the hook is turned into N by."""

LEAST_REACH = 0.3
"""In m; chosen: a cell around a shorter arm would have no room for the hook."""

MOUNT, LOAD_POINT = "sensor_far_side", "load_point"
SENSOR_SITE = "sensor"
HOOK_SITE = "hook"


def _places() -> np.ndarray:
    return np.array(
        [
            [0.90, 0.15, -0.30],
            [0.55, 1.30, 0.60],
            [0.45, -1.30, 1.00],
            [-1.00, 0.70, 1.70],
            [0.60, 0.10, 2.50],
            [1.20, -0.90, 1.90],
        ]
    )


@dataclass(frozen=True)
class Cell:
    """What is mounted around an arm.

    Attributes:
        pulley: Centre of each pulley in the base's frame, in m. Chosen: around the
            postures of the experiment, low, high, before, beside and behind the arm,
            so that the pulls span space.
        pulley_radius: In m; chosen, a 40 mm ball-bearing pulley.
        sensor_mass: In kg; an ATI Axia80 weighs about 0.3 kg (from memory).
        sensor_height: In m; 25.4 mm, the height of an Axia80 (from memory).
        mount_mass: Plate and hook beyond the sensor, in kg; chosen.
        hook: Place of the hook from the sensor's far face, in m. Chosen: 50 mm beside
            the axis, so that A4 and A6 carry torque; 10 kg stay below the 8 N m of the
            Axia80-M8.
    """

    pulley: Float[np.ndarray, "pulleys 3"]
    pulley_radius: float = 0.02
    sensor_mass: float = 0.3
    sensor_height: float = 0.0254
    mount_mass: float = 0.2
    hook: tuple[float, float, float] = (0.05, 0.0, 0.04)

    @property
    def sensor_position(self) -> Float[np.ndarray, "3"]:
        """The sensor's origin, its far face, in the flange's frame, in m."""
        return np.array([0.0, 0.0, self.sensor_height])

    @property
    def payload(self) -> Payload:
        """Everything mounted beyond the flange, sensor included."""
        mass = self.sensor_mass + self.mount_mass
        moment = self.sensor_mass * self.sensor_height / 2
        moment += self.mount_mass * (self.sensor_height + self._mount_height)
        return Payload(mass=mass, com=np.array([0.0, 0.0, moment / mass]))

    @property
    def _mount_height(self) -> float:
        return self.hook[2] / 2


def cell_for(model: mujoco.MjModel, arm: Anatomy) -> Cell:
    """Return a cell in proportion to the arm's length."""
    return Cell(pulley=_places() * reach(model, arm) / 1.19)


def reach(model: mujoco.MjModel, arm: Anatomy) -> float:
    """Return the sum of the links' lengths from the second axis to the flange, in m.

    For the KR10 R1100-2 this is near its 1.19 m from A1 to the flange stretched out. An
    arm of one axis reaches from that one; at least `LEAST_REACH`.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    chain = [arm.axes[k] for k in arm.chain]
    points = [data.joint(axis).xanchor for axis in chain[1:] or chain]
    points.append(data.body(arm.flange).xpos)
    links = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return max(float(sum(links)), LEAST_REACH)


def mount(spec: mujoco.MjSpec, arm: Anatomy, cell: Cell) -> None:
    """Put sensor, hook, pulleys and ropes on an arm that stands on its base."""
    own = {MOUNT, LOAD_POINT} & {body.name for body in spec.bodies}
    if own:
        raise BenchError(
            f"The model already has a body {own.pop()!r}, a part of this bench's cell: "
            "give the file of the arm alone, without force sensor and ropes."
        )
    flange = spec.body(arm.flange)
    near = flange.add_body(name="sensor_near_side", pos=[0, 0, cell.sensor_height / 2])
    _disc(near, cell.sensor_mass)
    far = flange.add_body(name=MOUNT, pos=cell.sensor_position)
    _disc(far, cell.mount_mass, height=cell._mount_height)
    far.add_body(name=LOAD_POINT)  # without mass, so that a wrench on it acts here
    far.add_site(name=SENSOR_SITE)
    far.add_site(name=HOOK_SITE, pos=np.asarray(cell.hook))
    kinds = mujoco.mjtSensor.mjSENS_FORCE, mujoco.mjtSensor.mjSENS_TORQUE
    for kind, label in zip(kinds, ("force", "torque"), strict=True):
        spec.add_sensor(
            name=label, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=SENSOR_SITE
        )
    base = spec.body(arm.base)
    turn, origin = pose_in(base, spec.worldbody)
    for p, place in enumerate(cell.pulley):
        _rope(spec, p, origin, turn @ place, cell.pulley_radius)


def load_on_sensor(
    model: mujoco.MjModel,
    reading: Float[np.ndarray, "rows 6"],
    rotation: Float[np.ndarray, "rows bodies 3 3"],
) -> Float[np.ndarray, "rows 6"]:
    """Turn the sensor's reaction into the load, without the mount's weight.

    Its force and torque sensors read minus what they carry, in N and N m.

    Returns:
        What the world exerts about the sensor's origin, along its axes, in N and N m.
    """
    far = model.body(MOUNT)
    to_sensor = rotation[:, far.id].transpose(0, 2, 1)
    weight = to_sensor @ (far.mass[0] * model.opt.gravity)
    return -reading - np.hstack([weight, np.cross(far.ipos, weight)])


def _rope(
    spec: mujoco.MjSpec, p: int, origin: np.ndarray, place: np.ndarray, radius: float
) -> None:
    """Lead a rope over a pulley at a place from the base's origin, along the world."""
    gravity = np.asarray(spec.option.gravity, float)
    pull = np.linalg.norm(gravity)
    up = -gravity / pull if pull else np.eye(3)[2]
    centre, outward = origin + place, place - (place @ up) * up
    outward /= max(np.linalg.norm(outward), 1e-9)
    world = spec.worldbody
    world.add_geom(
        name=f"pulley_{p}",
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[radius, 0, 0],
        pos=centre,
        contype=0,
        conaffinity=0,
    )
    side = centre + 1.5 * radius * up
    world.add_site(name=f"pulley_{p}_side", pos=side)
    world.add_site(name=f"weight_{p}", pos=centre + radius * outward - 0.3 * up)
    rope = spec.add_tendon(name=f"rope_{p}")
    rope.wrap_site(HOOK_SITE)
    rope.wrap_geom(f"pulley_{p}", f"pulley_{p}_side")
    rope.wrap_site(f"weight_{p}")
    motor = spec.add_actuator(
        name=f"weight_{p}", target=f"rope_{p}", trntype=mujoco.mjtTrn.mjTRN_TENDON
    )
    motor.gear = np.array([-1.0, 0, 0, 0, 0, 0])


def _disc(
    body: mujoco.MjsBody, mass: float, height: float = 0.0, radius: float = 0.041
) -> None:
    body.mass = mass
    body.ipos = np.array([0.0, 0.0, height])
    body.inertia = mass * radius**2 * np.array([0.25, 0.25, 0.5])
    body.explicitinertial = True
