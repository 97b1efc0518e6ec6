"""Experiment: carries out a plan on a rig and records what its instruments read.

The true states are not returned; a recording contains readings and the instruments'
specifications only.
"""

from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float

from bench.effects.effect import InstrumentEffect
from bench.instruments import Instruments
from bench.instruments.markers import Markers, Stuck
from bench.instruments.random_streams import streams
from bench.kinematic_chain import anatomy
from bench.rig import Memory, Rig, States
from bench.shared.plan import Plan
from bench.shared.recording import Recording

__all__ = ["Instruments", "faulty", "marks_in_base", "observed", "record"]


def record(
    rig: Rig,
    plan: Plan,
    instruments: Instruments | None = None,
    seed: int = 0,
    name: str = "",
    memory: Memory = "forgotten",
) -> Recording:
    """Carry out a plan and return the instruments' recording, named as the plan.

    Effects that sit in instruments act there; `memory` as in `Rig.carry_out`. The same
    seed gives the same numbers to the last digit.

    Raises:
        BenchError: Where no equilibrium is found.
        UnknownName: Where a mark that slips does not exist.
    """
    instruments = instruments or Instruments()
    encoders = faulty(instruments, rig).encoders
    arrival = encoders.arrive(plan.visits, plan.posture.shape[1], streams(seed))
    states = rig.carry_out(plan, arrival, memory)
    return observed(rig, plan, states, instruments, seed, name)


def observed(
    rig: Rig,
    plan: Plan,
    states: States,
    instruments: Instruments | None = None,
    seed: int = 0,
    name: str = "",
) -> Recording:
    """Return the recording of a plan that was carried out; see `record`."""
    instruments = faulty(instruments or Instruments(), rig)
    chance = streams(seed)
    stuck = instruments.markers.stick(rig.nominal, rig.anatomy, chance)
    encoders = instruments.encoders
    point, normal = marks_in_base(rig, states, stuck, instruments.markers, plan.time)
    points, frame = instruments.tracker.read(point, normal, plan.time, chance)
    sensor, frames = instruments.force_sensor, instruments.tracker.frames
    visit = plan.row_visit
    return Recording(
        name=name or plan.name,
        time=plan.time,
        posture_id=plan.posture_id[visit],
        visit=visit,
        posture=plan.posture[visit],
        load_time=plan.load_time,
        stage=plan.stage,
        slides=rig.anatomy.slides if any(rig.anatomy.slides) else (),
        wrench=sensor.read(states.wrench, visit, chance),
        load_mass=plan.row_mass,
        markers=tuple(s.marker for s in stuck),
        points=points,
        link_posture=encoders.read(states.axis_angle, rig.anatomy.slides, chance),
        frames=np.full(plan.rows, frames) if frames > 1 else None,
        base_from_tracker=frame,
        tracker=instruments.tracker.spec(),
        wrench_sensor=sensor.spec("flange", rig.mounted.sensor_position),
        encoder_repeatability=encoders.repeatability if encoders.link_side else None,
        tool=rig.mounted.payload,
        robot=Path(rig.arm_file).stem,
        axes=rig.axes or (rig.anatomy.axes if rig.anatomy.followers else ()),
        bodies=_hand_of(rig),
    )


def _hand_of(rig: Rig) -> dict[str, str]:
    """Return the flange's name where the model itself implies another one."""
    own = anatomy(rig.nominal).flange
    return {} if rig.anatomy.flange == own else {"flange": rig.anatomy.flange}


def faulty(instruments: Instruments, rig: Rig) -> Instruments:
    """Return the instruments with the faults among a rig's effects."""
    in_order = sorted(rig.effects, key=lambda e: (e.name, e.where, repr(e)))
    for effect in in_order:
        if isinstance(effect, InstrumentEffect):
            instruments = effect.fault(instruments)
    return instruments


def marks_in_base(
    rig: Rig,
    states: States,
    stuck: Sequence[Stuck],
    markers: Markers,
    time: Float[np.ndarray, " rows"],
) -> tuple[Float[np.ndarray, "rows markers 3"], Float[np.ndarray, "rows markers 3"]]:
    """Return the true positions of marks and their normals.

    The base's frame is the one of the model, where the base is without a load; a
    compliant base moves in it.

    Returns:
        Places in m and normals, in the base's frame.
    """
    data = mujoco.MjData(rig.nominal)
    mujoco.mj_kinematics(rig.nominal, data)
    base = data.body(rig.anatomy.base)
    turn = base.xmat.reshape(3, 3)  # world_from_base
    places, normals = [], []
    for mark in stuck:
        body = rig.anatomy.body(mark.marker.body)
        b = states.bodies.index(body)
        rotation = states.rotation[:, b]  # (rows, 3, 3) world_from_body
        in_body = mark.position + markers.slipped(mark.marker.name, time)
        in_world = rig.mark(states, body, in_body)
        places.append((in_world - base.xpos) @ turn)
        normals.append(rotation @ mark.normal @ turn)
    return np.stack(places, axis=1), np.stack(normals, axis=1)
