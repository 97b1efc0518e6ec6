"""Rig: a simulated arm with its effects in a cell, and its true states under load.

A rig is an arm made real: what is on its data sheet, and everything that is not.
It answers one question: where does everything come to rest, row by row, when a plan is
carried out? What the instruments make of that is `bench.instruments`' business.
"""

from dataclasses import dataclass, field
from functools import cache, cached_property, partial
from pathlib import Path
from typing import Literal

import mujoco
import numpy as np
from jaxtyping import Float

from bench import equilibrium
from bench.cell import GRAVITY, Cell, cell_for, load_on_sensor, mount
from bench.effects.creep import creeping
from bench.effects.effect import Command, CommandEffect, Effect, ModelEffect, RopeEffect
from bench.effects.link_bending import Beam, LinkBending
from bench.kinematic_chain import (
    Anatomy,
    Statics,
    anatomy,
    pose_in,
    with_axes,
    with_seats,
    wraps_on_joints,
)
from bench.model_file import RIGID, load, plain_mjcf
from bench.shared.errors import BenchError, Unusable
from bench.shared.plan import Plan
from bench.shared.recording import LastMoves

# --- True states ----------------------------------------------------------------------

FURTHEST = 0.5
"""How far an axis may end beside its command, in rad (m); chosen: no arm would hold."""


@dataclass(frozen=True)
class States:
    """Where the arm truly was, row by row. This is truth: no method may see it.

    Attributes:
        position: Origins of the bodies in the base's world frame, in m.
        rotation: Their orientations; columns are the bodies' axes.
        axis_angle: Angle of each axis after the gear, in rad.
        wrench: What the world exerts on the robot about the sensor's origin, along the
            sensor's axes, in N and N m; the weight beyond the sensor taken off.
        residual: Largest torque left unbalanced, in N m.
        initial: What gears brought to each visit; None: nothing.
    """

    bodies: tuple[str, ...]
    position: Float[np.ndarray, "rows bodies 3"]
    rotation: Float[np.ndarray, "rows bodies 3 3"]
    axis_angle: Float[np.ndarray, "rows axes"]
    wrench: Float[np.ndarray, "rows 6"]
    residual: float
    initial: equilibrium.GearStates | None = None

    def point(
        self, body: str, place: Float[np.ndarray, "*rows 3"]
    ) -> Float[np.ndarray, "rows 3"]:
        """Return where a point of a body was, in the world's frame, in m."""
        b = self.bodies.index(body)
        away = (self.rotation[:, b] @ place[..., None])[..., 0]
        return away + self.position[:, b]

    def near(self, commanded: Float[np.ndarray, "rows axes"]) -> "States":
        """Return the states, where every axis stands about where it was told to.

        Raises:
            BenchError: Where an axis ends further off than `FURTHEST`, naming it.
        """
        off = np.nan_to_num(np.abs(self.axis_angle - commanded), nan=np.inf)
        row, axis = np.unravel_index(off.argmax(), off.shape)
        if off[row, axis] > FURTHEST:
            raise BenchError(
                f"In row {row} axis a{axis + 1} ends {off[row, axis]:.3g} rad beside "
                f"its command, more than {FURTHEST}. A spring is too soft for its "
                "load, or an effect too large."
            )
        return self


# --- Rig ------------------------------------------------------------------------------

Memory = Literal["forgotten", "carried"]
"""Whether gears begin each visit with nothing, or as the visit before left them."""
WAY_POINTS = 24
"""Points of a way between postures; chosen: 7.5° of half a turn, over which gravity's
torque hardly bends."""


@dataclass(frozen=True)
class Rig:
    """An arm, what makes it real, and the cell around it.

    Attributes:
        arm_file: MJCF or URDF of the arm alone.
        effects: Everything that is true of it beyond its data sheet.
        stiffness: True stiffness of the axes' springs (K1 where they harden), in
            N m/rad; None: the model's own.
        cell: What is mounted around it; None: a cell in proportion.
        axes: Joints that move, the others held at zero; empty: all.
        hand: Body that the ropes pull; empty: the model's flange.
    """

    arm_file: Path | str
    effects: tuple[Effect, ...] = ()
    stiffness: Float[np.ndarray, " axes"] | None = None
    cell: Cell | None = None
    axes: tuple[str, ...] = ()
    hand: str = ""
    _sorted: tuple[Effect, ...] = field(init=False, repr=False)

    def __post_init__(self):
        """Sort the effects, so that their order cannot matter to the last bit."""
        ordered = sorted(self.effects, key=lambda e: (e.name, e.where, repr(e)))
        object.__setattr__(self, "_sorted", tuple(ordered))

    @cached_property
    def nominal(self) -> mujoco.MjModel:
        """The arm alone, as on its data sheet."""
        model = load(self.arm_file)
        return with_axes(model, self.axes) if self.axes else model

    @cached_property
    def anatomy(self) -> Anatomy:
        """The names of its parts."""
        return anatomy(self.nominal, self.hand)

    @cached_property
    def mounted(self) -> Cell:
        """The cell around it."""
        return self.cell or cell_for(self.nominal, self.anatomy)

    @cached_property
    def springs(self) -> Float[np.ndarray, " axes"]:
        """Stiffness of the axes' springs without command effects, in N m/rad."""
        own = self.nominal.jnt_stiffness
        springs = own if self.stiffness is None else self.stiffness
        return np.where(springs > 0, springs, RIGID)

    @cached_property
    def spec(self) -> mujoco.MjSpec:
        """The arm with its effects and its cell, editable."""
        spec = mujoco.MjSpec.from_string(
            with_seats(plain_mjcf(self.nominal), self.anatomy)
        )
        for axis, stiffness in zip(self.anatomy.axes, self.springs, strict=True):
            spec.joint(axis).stiffness = [stiffness, 0.0, 0.0]
            spec.joint(axis).springref = 0.0  # else springs beside it are off centre
        mount(spec, self.anatomy, self.mounted)
        for effect in self._sorted:
            if isinstance(effect, ModelEffect) and effect != effect.off():
                effect.build(spec, self.anatomy)
        return spec

    @cached_property
    def model(self) -> mujoco.MjModel:
        """The compiled truth."""
        try:
            return self.spec.compile()
        except ValueError as error:
            raise Unusable("The rig's model", [" ".join(str(error).split())]) from None

    def carry_out(
        self,
        plan: Plan,
        arrival: Float[np.ndarray, "visits axes"] | None = None,
        memory: Memory = "forgotten",
    ) -> States:
        """Carry out a plan with ropes and weights, and return where everything was.

        `arrival`: how far beyond its report each motor stops, in rad. `memory`: whether
        gears keep what slipped and crept from visit to visit, and feel gravity's torque
        on the way, straight from posture to posture.

        Raises:
            BenchError: Where the arm finds no rest, or none near what was planned.
        """
        steps = len(plan.path)
        tension = weight = GRAVITY * plan.row_mass
        direction = plan.row_direction
        for effect in self._sorted:
            if isinstance(effect, RopeEffect):
                tension = tension + effect.tension(weight, direction)
        ropes = np.zeros((len(plan.posture_id), steps, len(self.mounted.pulley)))
        pulley = plan.pulley[:, None, None] % ropes.shape[2]
        np.put_along_axis(ropes, pulley, tension.reshape(-1, steps, 1), axis=2)
        hold = np.array([step.hold for step in plan.path])
        arrival = np.zeros(plan.posture.shape) if arrival is None else arrival
        command, ways = self.command(plan.posture), None
        if memory == "carried":
            time = np.full(len(plan.posture_id), plan.move_time)
            ways = self._ways(plan.posture, arrival, time)
        schedule = equilibrium.Schedule(
            command.reference + arrival,
            command.stiffness,
            ropes,
            np.zeros((len(plan.posture_id), steps, 6)),
            np.broadcast_to(hold, (len(plan.posture_id), steps)),
        )
        states = self._rest(schedule, ways)
        return states.near(plan.posture[plan.row_visit])

    def respond(
        self,
        posture: Float[np.ndarray, "visits axes"],
        wrench: Float[np.ndarray, "visits steps 6"],
        hold: Float[np.ndarray, "visits steps"],
        way: Float[np.ndarray, " visits"] | None = None,
        moves: LastMoves | None = None,
        initial: equilibrium.GearStates | None = None,
    ) -> States:
        """Apply wrenches at the sensor's origin along the base's axes, step by step.

        Postures are in rad, wrenches in N and N m; each is held for some s before its
        row is read. The way to each visit takes some s where gears remember the visit
        before; else they begin with what arrives, by default nothing. Moves say how
        each axis arrived, by default from the visit before.

        Returns:
            Where everything was; rows run over visits, then steps.
        """
        ropes = np.zeros((*hold.shape, len(self.mounted.pulley)))
        turn = pose_in(self.spec.body(self.anatomy.base), self.spec.worldbody)[0]
        wrench = (wrench.reshape(-1, 3) @ turn.T).reshape(wrench.shape)
        command, none = self.command(posture, moves), np.zeros(posture.shape)
        ways = None if way is None else self._ways(posture, none, way)
        schedule = equilibrium.Schedule(
            command.reference, command.stiffness, ropes, wrench, hold
        )
        return self._rest(schedule, ways, initial)

    def command(
        self, posture: Float[np.ndarray, "visits axes"], moves: LastMoves | None = None
    ) -> Command:
        """Return what the gears are asked to hold, command effects included.

        The controller reports the posture, in rad; moves say how each axis arrived, by
        default from the row before.
        """
        moves = LastMoves.of(posture) if moves is None else moves
        springs = np.broadcast_to(self.springs, posture.shape)
        sag = cache(partial(self.sag, posture))  # once for all axes, if any asks
        total = nominal = Command(posture, springs, moves, sag)
        for effect in self._sorted:
            if isinstance(effect, CommandEffect):
                added = effect.command(posture, nominal, self.anatomy)
                total = Command(
                    total.reference + added.reference, total.stiffness + added.stiffness
                )
        return total

    def sag(
        self, posture: Float[np.ndarray, "visits axes"]
    ) -> Float[np.ndarray, "visits axes"]:
        """Return how far weights turn each axis by the data sheet, in rad (m).

        Those of the arm and the tool in a posture, in rad; 0 where an axis is rigid.
        """
        springs, tool = self.nominal.jnt_stiffness, self.mounted.payload
        statics = Statics(self.nominal, self.anatomy)
        gravity, torque = self.nominal.opt.gravity, np.zeros(posture.shape)
        for v, own in enumerate(posture):
            weight, jacobian = statics.at(own, tool.com)
            torque[v] = weight + tool.mass * gravity @ jacobian
        return np.where(springs > 0, torque / np.maximum(springs, mujoco.mjMINVAL), 0.0)

    def _rest(
        self,
        schedule: equilibrium.Schedule,
        ways: equilibrium.Ways | None,
        initial: equilibrium.GearStates | None = None,
    ) -> States:
        model = self.model
        axes = np.array([model.joint(axis).id for axis in self.anatomy.axes])
        creep = creeping(self._sorted, model, self.anatomy)
        if ways is None or not (model.nplastic or creep):  # nothing to remember
            rest = equilibrium.solve_in_blocks(model, axes, creep, schedule, initial)
        else:
            rest = equilibrium.solve_in_turn(model, axes, creep, schedule, ways)
        rows = schedule.hold.size
        rotation = rest.rotation.reshape(rows, model.nbody, 3, 3)
        joint = rest.joint.reshape(rows, -1)
        return States(
            bodies=tuple(model.body(b).name for b in range(model.nbody)),
            position=rest.position.reshape(rows, model.nbody, 3),
            rotation=rotation,
            axis_angle=joint @ self._about_axes,
            wrench=load_on_sensor(model, rest.force.reshape(rows, -1), rotation),
            residual=rest.residual,
            initial=rest.initial,
        )

    def _ways(
        self,
        posture: Float[np.ndarray, "visits axes"],
        arrival: Float[np.ndarray, "visits axes"],
        time: Float[np.ndarray, " visits"],
    ) -> equilibrium.Ways:
        """Return the ways between postures, all axes moving evenly from end to end."""
        share = np.arange(1, WAY_POINTS + 1)[:, None] / WAY_POINTS
        both = np.stack([posture, posture + arrival])
        before = np.concatenate([both[:, :1], both[:, :-1]], axis=1)[:, :, None]
        told, reached = before + share * (both[:, :, None] - before)
        command = self.command(told.reshape(-1, posture.shape[1]))
        return equilibrium.Ways(
            command.reference.reshape(told.shape) + (reached - told),
            command.stiffness.reshape(told.shape),
            time,
        )

    def mark(
        self, states: States, body: str, place: Float[np.ndarray, "*rows 3"]
    ) -> Float[np.ndarray, "rows 3"]:
        """Return where a mark on a body was, in the world's frame, in m.

        Its place is in the body's frame; on a link whose marks bend with it
        (`LinkBending.marks_bend`), where it is without a load.
        """
        b, model = states.bodies.index(body), self.model
        at = states.point(body, place)
        for beam in self._beams:
            own, far = (states.bodies.index(name) for name in (beam.link, beam.end))
            if model.body_weldid[own] != model.body_weldid[b]:
                continue
            turn = states.rotation[:, own]
            to_link = turn.swapaxes(1, 2)
            spot, end = (
                (to_link @ (p - states.position[:, own])[..., None])[..., 0]
                for p in (at, states.position[:, far])
            )
            bent = beam.displacement(to_link @ states.rotation[:, far], end, spot)
            at = at + (turn @ bent[..., None])[..., 0]
        return at

    @cached_property
    def _beams(self) -> tuple[Beam, ...]:
        """Links whose marks bend with them."""
        return tuple(
            Beam.of(effect, self.model, self.anatomy)
            for effect in self._sorted
            if isinstance(effect, LinkBending)
            if effect.marks_bend and effect != effect.off()
        )

    @cached_property
    def slipping(self) -> dict[str, tuple[str, ...]]:
        """Names of the tendons that slip in gears, by axis; axes without are none."""
        model, found = self.model, dict[str, tuple[str, ...]]()
        for tendon in np.flatnonzero(model.tendon_plasticadr >= 0).tolist():
            for wrap in wraps_on_joints(model, tendon):
                axis = model.joint(model.wrap_objid[wrap]).name
                found[axis] = (*found.get(axis, ()), model.tendon(tendon).name)
        return {axis: found[axis] for axis in self.anatomy.axes if axis in found}

    @cached_property
    def remembering(self) -> dict[str, tuple[str, ...]]:
        """Names of what slips and what creeps in gears, by axis."""
        creep = creeping(self._sorted, self.model, self.anatomy)
        names = [self.model.joint(joint).name for joint in creep]
        found = {
            axis: (
                *self.slipping.get(axis, ()),
                *(name for name in names if name.startswith(f"{axis}_creep")),
            )
            for axis in self.anatomy.axes
        }
        return {axis: own for axis, own in found.items() if own}

    @cached_property
    def _about_axes(self) -> Float[np.ndarray, "joints axes"]:
        """1 where a joint turns its axis: the axis' own, and all in series with it."""
        model = self.model
        about = np.zeros((model.njnt, len(self.anatomy.axes)))
        for k, axis in enumerate(self.anatomy.axes):
            own = model.joint(axis)
            seat = model.body(self.anatomy.seat(axis)).id
            for j in range(model.njnt):
                if model.jnt_bodyid[j] in (seat, own.bodyid[0]):
                    along = abs(model.jnt_axis[j] @ own.axis) > 1 - 1e-12
                    about[j, k] = along and model.jnt_type[j] == own.type[0]
        return about
