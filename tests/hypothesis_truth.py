"""A small experiment without noise, and marker displacements that Jacobians predict."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from bench.effects.effect import Effect
from bench.experiment import record
from bench.instruments import ForceSensor, Instruments, Tracker
from bench.rig import Memory, Rig
from bench.shared.plan import LoadStep, Plan, mixed_pulleys
from bench.shared.recording import Recording, WrenchSpec
from stiffness.effects import HYPOTHESES
from stiffness.effects.base import Hypothesis, point_of
from stiffness.effects.jacobian import (
    BodyTwist,
    EffectJacobian,
    JointRotation,
    MarkerDisplacement,
)
from stiffness.experiment.static_state import StaticState, static_state_of
from stiffness.robot.arm import Arm

KR10 = Path(__file__).parents[1] / "mjcf" / "kr10_r1100_2" / "kr10_r1100_2.xml"
BY_NAME = {hypothesis.effect: hypothesis for hypothesis in HYPOTHESES}
"""Hypothesis of each effect's name; of several the last, which is the more general."""
VISITS = 10
PATH = (
    *(LoadStep(mass) for mass in (0.0, 2.5, 5.0, 7.5, 10.0)),
    LoadStep(10.0, 120.0),
    *(LoadStep(mass) for mass in (5.0, 2.5, 0.0)),
)
SILENT = Instruments(
    tracker=Tracker(noise=0.0, frame_error=(0.0,) * 6),
    force_sensor=ForceSensor(noise=0.0),
)
"""Instruments without noise; the tracker's frame is stated."""


def plan() -> Plan:
    """Return a plan that loads every axis, up and down with a dwell."""
    low = np.deg2rad([-60, -120, 40, -120, -80, -150])
    high = np.deg2rad([60, -40, 120, 120, 80, 150])
    posture = np.random.default_rng(3).uniform(low, high, (VISITS, 6))
    visits = np.arange(VISITS)
    return Plan("a few poses", posture, visits, mixed_pulleys(VISITS), PATH)


@cache
def recording(*effects: Effect, memory: Memory = "forgotten") -> Recording:
    """Record the plan on a KR10 with these effects."""
    return record(Rig(KR10, effects), plan(), SILENT, memory=memory)


@cache
def situation() -> StaticState:
    """Return the static state of the nominal arm in the plan."""
    return situation_in(recording())


def situation_in(
    recording: Recording, rigid: tuple[int, ...] = (), file: Path = KR10
) -> StaticState:
    """Return the nominal arm's static state in a recording, some axes rigid."""
    arm = Arm.from_mjcf(file).for_recording(recording)
    stiffness = arm.stiffness.copy()
    stiffness[list(rigid)] = 0.0
    arm = replace(arm, stiffness=stiffness)
    compliance = np.zeros(len(stiffness))
    compliance[stiffness > 0.0] = 1.0 / stiffness[stiffness > 0.0]
    bodies = tuple(dict.fromkeys(marker.body for marker in recording.markers))
    return static_state_of(arm, recording, compliance, bodies)


def palletiser(folder: Path) -> StaticState:
    """Return the static state of an arm of three vertical axes and a slide."""
    mass = '<inertial mass="2" pos="0.1 0.01 0" diaginertia="0.1 0.1 0.1"/>'
    file = folder / "palletiser.xml"
    file.write_text(
        f"""<mujoco><compiler angle="radian"/><worldbody><body name="base">{mass}
        <body name="link_1" pos="0 0 0.3">{mass}<joint name="a1" stiffness="5e4"/>
        <body name="link_2" pos="0.3 0 0">{mass}<joint name="a2" stiffness="3e4"/>
        <body name="link_3" pos="0.25 0 0">{mass}
          <joint name="a3" type="slide" axis="0 0 -1" stiffness="1e6"/>
        <body name="link_4" pos="0 0 -0.1">{mass}<joint name="a4" stiffness="1e4"/>
        <body name="flange" pos="0 0 -0.05"/>
        </body></body></body></body></body></worldbody></mujoco>"""
    )
    posture = np.random.default_rng(3).uniform(-1.2, 1.2, (VISITS, 4))
    posture[:, 2] *= 0.1  # a slide, in m
    visits = np.arange(VISITS)
    poses = Plan("pallets", posture, visits, mixed_pulleys(VISITS), PATH)
    return situation_in(record(Rig(file), poses, SILENT), file=file)


@cache
def swinging(late: float = 0.0, channel: str = "") -> StaticState:
    """Return the static state in a stream of slow swings under a changing force.

    Args:
        late: Delay of a channel, in s.
        channel: `wrench_sensor`, or an axis counted from 0.
    """
    time = np.linspace(0.0, 20.0, 401)
    pace = 0.3 * np.arange(1, 7)
    centre = np.array([0.2, -1.4, 1.3, 0.4, 0.7, 0.3])

    def swing(at: np.ndarray) -> np.ndarray:
        return centre + 0.2 * np.sin(np.outer(at, pace))

    posture = swing(time)
    if channel.isdigit():
        posture[:, int(channel)] = swing(time - late)[:, int(channel)]
    felt = time - late * (channel == "wrench_sensor")
    pull = np.array([50.0, 30.0, -40.0, 2.0, -1.0, 1.5])
    stream = Recording(
        name="a stream",
        time=time,
        posture_id=np.zeros(401, dtype=int),
        visit=np.zeros(401, dtype=int),
        posture=posture,
        load_time=time,
        stage=np.full(401, "loaded"),
        wrench=np.sin(0.7 * felt)[:, None] * pull,
        markers=recording().markers,
        points=np.zeros((401, len(recording().markers), 3)),
        wrench_sensor=WrenchSpec(0.04, 0.002, frame="base"),
        rows="stream",
    )
    return situation_in(stream)


@cache
def showing(effect: str) -> StaticState:
    """Return a static state in which an effect has a site."""
    if effect == "joint_compliance":
        return situation_in(recording(), rigid=(1, 3))
    return swinging() if effect == "channel_delay" else situation()


def middle(situation: StaticState, hypothesis: Hypothesis, where: str) -> np.ndarray:
    """Return the middle one of a hypothesis' shape parameters at a site."""
    shapes = hypothesis.shapes(situation, where)
    return shapes[len(shapes) // 2]


def expected(situation: StaticState) -> np.ndarray:
    """Return the nominal arm's marker positions, (rows, markers, 3), in m."""
    standing = situation.arm.at(situation.rest)
    places = []
    for marker in situation.recording.markers:
        assert marker.position is not None
        places.append(standing.point(marker.body, marker.position))
    return np.stack(places, axis=1)


def moved(situation: StaticState, signature: EffectJacobian) -> np.ndarray:
    """Return an effect Jacobian at the markers, (rows, markers, 3, columns)."""
    places = []
    for marker in situation.recording.markers:
        assert marker.position is not None
        places.append(point_of(situation, marker.body, marker.position))
    point = np.stack(places, axis=1)
    total = np.zeros((*point.shape, signature.columns))
    for m, marker in enumerate(situation.recording.markers):
        carried = situation.carried[:, situation.bodies.index(marker.body)]
        for part in signature.parts:
            if isinstance(part, JointRotation):
                screw = situation.screw[:, part.axis] * carried[part.axis + 1]
                twist = screw[:, :, None] * part.law[:, None]
                total[:, m] += at_point(twist, point[:, m])
            elif isinstance(part, BodyTwist):
                total[:, m] += carried[part.site] * at_point(part.twist, point[:, m])
            elif isinstance(part, MarkerDisplacement) and part.marker == m:
                total[:, m] += part.displacement
    return total


def at_point(twist: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Return the displacements of points by twists, (rows, 3, columns), in m."""
    return twist[:, :3] + np.cross(twist[:, 3:], point[:, :, None], axis=1)


def unexplained(recording: Recording) -> np.ndarray:
    """Return the readings less the nominal positions under the read wrench, in m."""
    return in_base(recording) - expected(situation_in(recording))


def in_base(recording: Recording) -> np.ndarray:
    """Return the readings along the base's axes by the stated frame, in m."""
    assert recording.points is not None and recording.base_from_tracker is not None
    frame = recording.base_from_tracker
    return recording.points @ frame[:3, :3].T + frame[:3, 3]
