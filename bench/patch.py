"""Patch: effects and mounted masses as data, as a rig, and as an MJCF file.

A patch is what has to be true beyond the data sheet for the arm to do what it did; its
rig has nothing around it but what the recording says is mounted. `effect_of` is the
inverse of `Effect.parameters`: names of the vocabulary in SI go in, the mechanism comes
out. What no mechanism can have, such as a compliance below zero, is taken as its bound.

`patch.json` holds it exactly: effects by the vocabulary's names, fitted springs, laws
as tables, where the tracker stood and the markers sat, and the arm itself as plain
MJCF. `model.xml` beside it is the user's own file with the mechanisms in it, for
whoever wants to run it without us; see `bench.patched_model`.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import mujoco
import numpy as np
from jaxtyping import Float
from typing_extensions import override

from bench.cell import Cell
from bench.effects import EFFECTS
from bench.effects.effect import Effect
from bench.effects.gravity_load import GravityLoad
from bench.effects.places import misplaced
from bench.effects.tabled_law import TabledLaw
from bench.model_file import plain_mjcf
from bench.rig import RIGID, Memory, Rig
from bench.shared.effect_catalogue import is_stiffness, limit, on_slide
from bench.shared.errors import BenchError, UnknownName, Unusable, refuse
from bench.shared.format import json_text
from bench.shared.recording import Payload

# --- Effects by name ------------------------------------------------------------------

LIGHT = 1e-3
"""Mass in kg that stands for a first moment where the mass itself does not show;
chosen: too light to be felt by itself."""

GearMemory = Literal["forgotten", "carried", "unknown"]
"""What a gear brings to a visit."""

Value = float | str | None
"""A parameter as written: a number, a name, or null for one without end."""


@dataclass(frozen=True)
class PatchEffect:
    """One effect with its place and its parameters.

    Attributes:
        parameters: By the vocabulary's names, in SI; null is infinite.
        settings: What the mechanism needs beyond them, by its own names.
    """

    effect: str
    where: str
    parameters: dict[str, Value] = field(default_factory=dict)
    settings: dict[str, Value] = field(default_factory=dict)


def named(effect: Effect) -> PatchEffect:
    """Return an effect as it is written down, to the last bit."""
    known = dict(effect.parameters())
    inside = {f.name for f in fields(effect)} - {"where"}
    own = {_field(name) for name in known}
    settings = {name: getattr(effect, name) for name in sorted(inside - own)}
    return PatchEffect(effect.name, effect.where, _written(known), _written(settings))


def can_build(name: str) -> bool:
    """Return whether there is a mechanism of that name."""
    return any(kind.name == name for kind in EFFECTS)


def effect_of(found: PatchEffect) -> Effect:
    """Build the mechanism of a named effect; sizes that are not given are zero.

    Raises:
        UnknownName: Where no effect has that name.
        Unusable: Where a parameter is none of the effect's.
    """
    kinds = {kind.name: kind for kind in EFFECTS}
    if found.effect not in kinds:
        raise UnknownName("effect with a mechanism", found.effect, kinds)
    kind = kinds[found.effect]
    wanted = _read(found.parameters) | _read(found.settings)
    if found.effect == "gravity_load":
        wanted = _from_moments(wanted)
    known = {f.name: f for f in fields(kind) if f.name != "where"}
    along = {on_slide(kind.name, name): name for name in known}
    values, faults = {}, []
    for name, value in wanted.items():
        own = along.get(_field(name), _field(name))
        if own not in known:
            faults.append(str(UnknownName(f"parameter of {kind.name!r}", name, known)))
        elif isinstance(known[own].default, str):
            if isinstance(value, str):
                values[own] = value
            elif math.isfinite(value):
                values[own] = f"a{round(value)}"
            else:
                faults.append(f"{name} is {value}, expected an axis.")
        elif isinstance(value, str):
            faults.append(f"{name} is {value!r}, expected a number.")
        elif not math.isfinite(value) and not is_stiffness(kind.name, own):
            faults.append(f"{name} is {value}, expected a finite number.")
        else:
            values[own] = _possible(kind, own, value, known[own].default)
    refuse(f"Effect {found.effect!r} at {found.where!r}", faults)
    return replace(kind(where=found.where).off(), **values)


def _field(name: str) -> str:
    return "with_axis" if name == "with" else name


def _possible(kind: type[Effect], name: str, value: float, usual: object) -> object:
    """Return the nearest value that the mechanism can have."""
    if isinstance(usual, int):
        value = round(value)
    least, most = kind.bounds()[name]
    if value >= least:
        return type(value)(min(value, most))
    # a beam of less than no stiffness is one whose compliance came out below zero
    return math.inf if is_stiffness(kind.name, name) else type(value)(least)


def _from_moments(wanted: Mapping[str, float | str]) -> dict[str, float | str]:
    """Turn first moments without a mass into a light mass far out: it pulls alike."""
    moment = {
        name.replace("moment", "com").replace("_kg_m", "_m"): value
        for name, value in wanted.items()
        if name.startswith("moment_") and not isinstance(value, str)
    }
    rest = {k: v for k, v in wanted.items() if not k.startswith("moment_")}
    if not moment or "mass_kg" in rest:
        return rest
    zero = {"com_x_m": 0.0, "com_y_m": 0.0, "com_z_m": 0.0}
    far = {name: value / LIGHT for name, value in moment.items()}
    return {**zero, **far, "mass_kg": LIGHT}


def _written(values: Mapping[str, object]) -> dict[str, Value]:
    return {name: _plain(value) for name, value in values.items()}


def _plain(value: object) -> Value:
    if isinstance(value, str):
        return value
    number = float(value)  # type: ignore[arg-type]
    return None if math.isinf(number) else number


def _read(values: Mapping[str, Value]) -> dict[str, float | str]:
    return {k: math.inf if v is None else v for k, v in values.items()}


# --- Rig of a recording ---------------------------------------------------------------


@dataclass(frozen=True)
class BareCell(Cell):
    """Nothing around the arm but a sensor without mass, where a recording has it."""

    sensor_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    held: Payload = field(default_factory=Payload)

    @property
    @override
    def sensor_position(self) -> Float[np.ndarray, "3"]:
        return np.array(self.sensor_m)

    @property
    @override
    def payload(self) -> Payload:
        return self.held


@dataclass(frozen=True)
class WrittenRig(Rig):
    """A rig whose arm comes with the patch."""

    text: str = ""

    @cached_property
    @override
    def nominal(self) -> mujoco.MjModel:
        return mujoco.MjModel.from_xml_string(self.text)


# --- Patch ----------------------------------------------------------------------------

FILE, MODEL_FILE = "patch.json", "model.xml"
MAX_BYTES = 50_000_000
"""Bytes of a patch that are still read; chosen: a hundred times a usual one."""

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Law:
    """What an axis winds up beyond its spring, torque by torque, without a name.

    Attributes:
        torque_nm: Increasing, in N m.
        loading_rad: Extra wind-up where the load's torque grows, in rad.
        unloading_rad: The same where it falls; empty: the same law both ways.
    """

    where: str
    torque_nm: tuple[float, ...]
    loading_rad: tuple[float, ...]
    unloading_rad: tuple[float, ...] = ()


@dataclass(frozen=True)
class Mounted:
    """What a recording says is mounted on the flange.

    Attributes:
        sensor_m: The force sensor's origin in the flange's frame, in m.
        mass_kg: All that is mounted, sensor included.
        com_m: Its centre in the flange's frame, in m.
    """

    sensor_m: Triple = (0.0, 0.0, 0.0)
    mass_kg: float = 0.0
    com_m: Triple = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class AxisRange:
    """Where an axis stood, and what it carried, while a patch was fitted.

    Attributes:
        angle_rad: Low and high ends of the stretches in which it stood, increasing, in
            rad (m on a slide).
        torque_nm: Least and largest torque about it from weight and load, in N m.
    """

    angle_rad: Annotated[tuple[tuple[float, float], ...], msgspec.Meta(min_length=1)]
    torque_nm: tuple[float, float]


@dataclass(frozen=True)
class Patch:
    """Everything that a simulation needs beyond the model it was given.

    Attributes:
        stiffness_nm_per_rad: Of each axis' spring as fitted, by a1, a2 …; null is
            rigid, an axis that is left out has the model's own.
        laws: What was found and has no name.
        base_from_tracker: 4 x 4 as fitted, in m; null where nothing was tracked.
        markers: Their places in their bodies' frames as fitted, in m.
        axes: Joints of the model that move, the others held at zero; empty: all.
        hand: Body of the model that counts as the flange; empty: the model's own.
        arm: The nominal arm as plain MJCF.
        not_in_model: What of it `model.xml` cannot hold, in words.
        fitted: Range of each axis, by a1, a2 …, in the poses that it was fitted to;
            empty: not known.
        memory: Whether gears keep what slipped and crept from visit to visit.
        memories: The same of single axes' gears, where it differs; unknown: they arrive
            at each visit in a state that nothing tells.
        readings: Digests of some of the rows that it was fitted to; empty: not known.
    """

    stiffness_nm_per_rad: dict[str, float | None] = field(default_factory=dict)
    effects: tuple[PatchEffect, ...] = ()
    laws: tuple[Law, ...] = ()
    mounted: Mounted = Mounted()
    base_from_tracker: tuple[tuple[float, float, float, float], ...] | None = None
    markers: dict[str, Triple] = field(default_factory=dict)
    axes: tuple[str, ...] = ()
    hand: str = ""
    arm: str = ""
    schema: Literal[1] = 1
    not_in_model: tuple[str, ...] = ()
    fitted: dict[str, AxisRange] = field(default_factory=dict)
    memory: Memory = "forgotten"
    memories: dict[str, GearMemory] = field(default_factory=dict)
    readings: tuple[str, ...] = ()


def effects_of(patch: Patch) -> tuple[Effect, ...]:
    """Return the mechanisms of what was named and of what has only a table."""
    return (*map(effect_of, patch.effects), *map(_tabled, patch.laws))


def rig_of(patch: Patch, arm_file: Path | None = None) -> Rig:
    """Build the rig of a patch on the nominal arm, by default the one in the patch.

    Raises:
        BenchError: Where an effect has no mechanism, cannot be built, or sits at a
            place that the arm does not have.
    """
    held = patch.mounted
    cell = BareCell(
        pulley=np.zeros((0, 3)),
        sensor_mass=0.0,
        mount_mass=0.0,
        sensor_m=held.sensor_m,
        held=Payload(held.mass_kg, np.array(held.com_m)),
    )
    given = effects = effects_of(patch)
    if held.mass_kg:
        effects = (GravityLoad("flange", held.mass_kg, *held.com_m), *given)
    if arm_file is None:
        model = Path(MODEL_FILE)
        rig = WrittenRig(model, effects, cell=cell, hand=patch.hand, text=patch.arm)
    else:
        rig = Rig(arm_file, effects, cell=cell, axes=patch.axes, hand=patch.hand)
    springs = rig.nominal.jnt_stiffness.copy()
    known = list(rig.anatomy.axes)
    faults = [fault for effect in given for fault in misplaced(effect, rig.anatomy)]
    for name in (*patch.stiffness_nm_per_rad, *patch.memories):
        if rig.anatomy.axis(name) not in known:
            faults.append(f"no axis is called {name!r}; known: {known}.")
    refuse("Patch", faults)
    for name, value in patch.stiffness_nm_per_rad.items():
        axis = known.index(rig.anatomy.axis(name))
        springs[axis] = RIGID if value is None else value
    return replace(rig, stiffness=springs)


WAVES = ("order", "with")
"""Parameters in which two of an effect at one place differ: waves of a gear, and axes
that turn another. Others are given once, as one law."""
MOST_FAULTS = 20
"""Faults that are listed, chosen: what a screen shows; the others are counted."""


def faults_of(patch: Patch) -> list[str]:
    """Return every fault of a patch's effects, laws and springs."""
    faults, known = [], set()
    for number, one in enumerate(patch.effects, start=1):
        title = f"effect {number}, {one.effect} at {one.where}"
        try:
            effect_of(one)
        except Unusable as error:
            faults += [f"{title}: {fault}" for fault in error.faults]
        except UnknownName as error:
            faults.append(f"{title}: {error}")
        for name, value in one.parameters.items():
            most = limit(one.effect, name)
            if isinstance(value, float) and abs(value) > most:
                faults.append(
                    f"{title}: {name} is {value:g}, expected at most {most:g}."
                )
        own = (one.effect, one.where, *(one.parameters.get(wave) for wave in WAVES))
        if own in known:
            faults.append(f"{title}: it is given twice; add it up to one.")
        known.add(own)
    for law in patch.laws:
        try:
            _tabled(law)
        except Unusable as error:
            faults += [f"law at {law.where}: {fault}" for fault in error.faults]
    for axis, value in patch.stiffness_nm_per_rad.items():
        if value is not None and not value > 0.0:
            faults.append(f"spring of {axis}: {value:g}, expected above 0, or null.")
    if (more := len(faults) - MOST_FAULTS) > 0:
        faults = [*faults[:MOST_FAULTS], f"and {more} more like these."]
    return faults


def with_arm(patch: Patch, rig: Rig) -> Patch:
    """Return the patch with the nominal arm of a rig in it."""
    return replace(patch, arm=plain_mjcf(rig.nominal))


def text_of(patch: Patch) -> str:
    """Return patch.json; numbers read back to the last bit."""
    return json_text(patch, indent=1)


def read(file: Path) -> Patch:
    """Read patch.json.

    Raises:
        BenchError: Where there is none.
        Unusable: Where it is none.
    """
    if not file.is_file() or file.stat().st_size > MAX_BYTES:
        raise BenchError(f"There is no {FILE} at {str(file)!r}, or it is too large.")
    what = f"Patch {str(file)!r}"
    try:
        patch = msgspec.json.decode(file.read_bytes(), type=Patch)
    except msgspec.MsgspecError as error:
        raise Unusable(what, [f"{error}."]) from None
    refuse(what, faults_of(patch))
    return patch


def _tabled(law: Law) -> TabledLaw:
    loading = np.array(law.loading_rad)
    back = np.array(law.unloading_rad) if law.unloading_rad else loading
    if not 2 <= len(law.torque_nm) == len(loading) == len(back):
        fault = "its torques and branches differ in length, or are fewer than two."
        raise Unusable(f"Law at {law.where!r}", [fault])
    middle = (loading + back) / 2
    apart = float(np.interp(0.0, law.torque_nm, back - loading))
    return TabledLaw(law.where, law.torque_nm, tuple(middle.tolist()), max(apart, 0.0))
