"""Set-up of the simulation: bodies, axes and tools of recording and model matched."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from bench.effects.creep import Creep
from bench.kinematic_chain import Anatomy, moving
from bench.model_file import load
from bench.patch import Mounted, Patch, PatchEffect, rig_of
from bench.proof.simulation import ReplaySimulation, replay_of
from bench.rig import Rig, States
from bench.shared.errors import BenchError, UnknownName, Unusable
from bench.shared.recording import Recording

STANDS = 1e-5
"""Change of the sensor's axes that is none; chosen: the next is a hundredth of it."""
MATTERS = 1e-3
"""Change of the sensor's axes below which it may stay; chosen: a thousandth of the load
is less than force sensors are true to, and gears that rub need not come closer."""
ROUNDS = 20
"""Most rounds until the sensor stands; chosen: enough where each changes by three
quarters of the last."""


def mounted_on(recording: Recording, rig: Rig) -> Mounted:
    """Return what a recording says is mounted, in the frame of the arm's flange."""
    data = mujoco.MjData(rig.nominal)
    mujoco.mj_kinematics(rig.nominal, data)
    flange = data.body(rig.anatomy.flange)
    turn = flange.xmat.reshape(3, 3)

    def in_flange(body: str, place: np.ndarray) -> tuple[float, float, float]:
        own = data.body(model_body(recording, rig, body))
        at = (own.xmat.reshape(3, 3) @ place + own.xpos - flange.xpos) @ turn
        return (float(at[0]), float(at[1]), float(at[2]))

    sensor, tool = recording.wrench_sensor, recording.tool
    return Mounted(
        sensor_m=(0.0, 0.0, 0.0)
        if sensor is None
        else in_flange(sensor.body, np.asarray(sensor.position, float)),
        mass_kg=0.0 if tool is None else float(tool.mass),
        com_m=(0.0, 0.0, 0.0)
        if tool is None
        else in_flange("flange", np.asarray(tool.com, float)),
    )


def model_body(recording: Recording, rig: Rig, name: str) -> str:
    """Return the model's name of a body of a recording.

    Raises:
        UnknownName: Where the model has none of that name.
    """
    found = rig.anatomy.body(recording.bodies.get(name, name))
    known = [rig.nominal.body(b).name for b in range(rig.nominal.nbody)]
    if found not in known:
        if name == "tool":  # what a manifest calls tool, on an arm without one
            return rig.anatomy.flange
        raise UnknownName("body of the model", name, known)
    return found


def for_simulator(recording: Recording, patch: Patch, arm_file: Path) -> Patch:
    """Return a patch with the axes that a recording moves, its hand and its tool.

    Axes and links of the patch are counted as in the recording; axes that the recording
    lacks are held at zero.

    Raises:
        BenchError: Where the model lacks an axis or a body of the recording.
    """
    axes, hand = moving(recording, load(arm_file))
    bare = rig_of(Patch(axes=axes, hand=hand), arm_file)
    patch = in_model(recording, replace(patch, axes=axes, hand=hand), bare.anatomy)
    return replace(patch, mounted=mounted_on(recording, bare))


def why_not_simulated(recording: Recording, arm_file: Path) -> str:
    """Return why the simulator cannot replay a recording; empty where it can.

    Builds the nominal arm and lets it come to rest in the first posture, which takes
    some hundredths of a second: what would fail after a long fit fails here.
    """
    try:
        rig = rig_of(for_simulator(recording, Patch(), arm_file), arm_file)
        order = [rig.anatomy.axes.index(n) for n in recording.axes or rig.anatomy.axes]
        for marker in recording.markers:
            model_body(recording, rig, marker.body)
        posture = np.zeros((1, len(order)))
        posture[:, order] = recording.posture[:1]
        rig.respond(posture, np.zeros((1, 1, 6)), np.ones((1, 1)))
    except BenchError as error:
        return str(error)
    return ""


def in_model(recording: Recording, patch: Patch, arm: Anatomy) -> Patch:
    """Return a patch whose axes count as the model's where a recording's differ."""
    if not recording.axes:
        return patch
    number = {k + 1: arm.axes.index(axis) + 1 for k, axis in enumerate(recording.axes)}
    known = {
        f"{kind}{k}": f"{kind}{n}" for kind in ("a", "link_") for k, n in number.items()
    }

    def joint(where: str) -> str:
        return ":".join(known.get(part, part) for part in where.split(":"))

    def renamed(effect: PatchEffect) -> PatchEffect:
        partner = effect.parameters.get("with")
        parameters = dict(effect.parameters)
        if isinstance(partner, str):
            parameters["with"] = joint(partner)
        return replace(effect, where=joint(effect.where), parameters=parameters)

    springs = {joint(a): k for a, k in patch.stiffness_nm_per_rad.items()}
    return replace(
        patch,
        stiffness_nm_per_rad=springs,
        effects=tuple(map(renamed, patch.effects)),
        laws=tuple(replace(law, where=joint(law.where)) for law in patch.laws),
        fitted={joint(a): known for a, known in patch.fitted.items()},
        memories={joint(a): kind for a, kind in patch.memories.items()},
    )


def replay_simulation_of(
    recording: Recording, assumed: Rig, effects: tuple = ()
) -> ReplaySimulation:
    """Lay out a recording for the simulator.

    The arm is assumed as it is best known, with what is mounted on it: how it gives way
    turns the force sensor, and so what the readings mean. Where an effect that will be
    tried creeps, waiting counts.
    """
    arm = assumed.anatomy
    names = recording.axes or arm.axes
    order = np.array([arm.axes.index(name) for name in names])
    waits = any(isinstance(effect, Creep) for effect in effects)
    replay = replay_of(recording, waits)
    rows = replay.rows
    simulation = ReplaySimulation(
        recording=recording,
        replay=replay,
        order=order,
        body=tuple(model_body(recording, assumed, m.body) for m in recording.markers),
        sensor_axes=np.tile(np.eye(3), (rows, 1, 1)),
        weight=np.zeros((rows, 6)),
        base=base_of(assumed),
    )
    spec = recording.wrench_sensor
    if spec is None or recording.wrench is None:
        return simulation
    unloaded = replace(recording, wrench=np.zeros((rows, 6)))
    turned = _sensor_turned(replace(simulation, recording=unloaded), assumed)
    return _with_resting_sensor(replace(turned, recording=recording), assumed)


def _with_resting_sensor(
    simulation: ReplaySimulation, assumed: Rig
) -> ReplaySimulation:
    """Return a world whose sensor stands as what it reads there turns the arm.

    Raises:
        Unusable: Where rounds end while its axes still change by more than matters.
    """
    step = np.inf
    for _ in range(ROUNDS):
        turned, before = _sensor_turned(simulation, assumed), step
        step = float(
            np.abs(turned.sensor_axes - simulation.sensor_axes).max(initial=0.0)
        )
        simulation = turned
        if step <= STANDS or not step < before:
            break
    if step <= MATTERS:
        return simulation
    fault = (
        f"the simulated arm and its force sensor find no rest, each still turns the "
        f"other by {step:.2g} rad: check wrench and stiffness."
        if np.isfinite(step)
        else "the simulated arm has no finite position under load: check the wrench."
    )
    raise Unusable(f"Recording {simulation.recording.name!r}", [fault])


def _sensor_turned(simulation: ReplaySimulation, assumed: Rig) -> ReplaySimulation:
    """Return a world whose sensor is turned as what it reads there turns the arm."""
    recording, spec = simulation.recording, simulation.recording.wrench_sensor
    assert spec is not None
    states = replace(simulation, _known={}).states(assumed)
    body = states.bodies.index(model_body(recording, assumed, spec.body))
    mounting = Rotation.from_quat(spec.quaternion_wxyz, scalar_first=True)
    axes = simulation.base[1].T @ states.rotation[:, body] @ mounting.as_matrix()
    at = states.position[:, body] + states.rotation[:, body] @ spec.position
    weight = _held(recording, assumed, states, at)
    return replace(simulation, sensor_axes=axes, weight=weight)


def base_of(rig: Rig) -> tuple[np.ndarray, np.ndarray]:
    """Return where the base stands in the world and how it is turned."""
    data = mujoco.MjData(rig.nominal)
    mujoco.mj_kinematics(rig.nominal, data)
    base = data.body(rig.anatomy.base)
    return base.xpos.copy(), base.xmat.reshape(3, 3).copy()


def point_in_base(
    rig: Rig, states: States, body: str, position: np.ndarray
) -> np.ndarray:
    """Return where a point of a body was, (rows, 3) in the base's frame, in m."""
    origin, turn = base_of(rig)
    return (states.point(rig.anatomy.body(body), position) - origin) @ turn


def _held(recording, nominal, states, sensor) -> np.ndarray:
    """Return the weight beyond the sensor that readings still hold; usually none."""
    tool, spec = recording.tool, recording.wrench_sensor
    weight = np.zeros((len(sensor), 6))
    if tool is None or not tool.mass or not spec.includes_tool_weight:
        return weight
    flange = states.bodies.index(nominal.anatomy.flange)
    at = states.position[:, flange] + states.rotation[:, flange] @ tool.com
    weight[:, :3] = tool.mass * nominal.nominal.opt.gravity
    weight[:, 3:] = np.cross(at - sensor, weight[:, :3])
    turn = base_of(nominal)[1]  # world_from_base
    return (weight.reshape(-1, 3) @ turn).reshape(weight.shape)
