"""A patch is what has to be true beyond the data sheet for the arm to do what it did.

`patch.json` holds it exactly: effects by the vocabulary's names, fitted springs, laws
as tables, where the tracker stood and the markers sat, and the arm itself as plain
MJCF. `model.xml` beside it is the simulator's model with the mechanisms in it, for
whoever wants to run it without us.
"""

from dataclasses import dataclass, field, replace
from pathlib import Path

import msgspec
import numpy as np

from bench.effects.effect import Effect
from bench.effects.gravity_load import GravityLoad
from bench.effects.tabled_law import TabledLaw
from bench.errors import BenchError, Unusable
from bench.model_file import plain_mjcf
from bench.patch_effects import Named, effect_of
from bench.patch_rig import BareCell, WrittenRig
from bench.recording import Payload
from bench.rig import RIGID, Rig

FILE, MODEL_FILE = "patch.json", "model.xml"
LARGEST = 50_000_000
"""Bytes of a patch that are still read; chosen: a hundred times a usual one."""

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Law:
    """What an axis winds up beyond its spring, torque by torque, without a name.

    Attributes:
        where: The axis.
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
class Patch:
    """Everything that a simulation needs beyond the model it was given.

    Attributes:
        stiffness_nm_per_rad: Of each axis' spring as fitted, by a1, a2 …; null is
            rigid, an axis that is left out has the model's own.
        effects: What was named.
        laws: What was found and has no name.
        mounted: On the flange.
        base_from_tracker: 4 x 4 as fitted, in m; null where nothing was tracked.
        markers: Their places in their bodies' frames as fitted, in m.
        axes: Joints of the model that move, the others held at zero; empty: all.
        arm: The nominal arm as plain MJCF.
        schema: Of this file.
    """

    stiffness_nm_per_rad: dict[str, float | None] = field(default_factory=dict)
    effects: tuple[Named, ...] = ()
    laws: tuple[Law, ...] = ()
    mounted: Mounted = Mounted()
    base_from_tracker: tuple[tuple[float, float, float, float], ...] | None = None
    markers: dict[str, Triple] = field(default_factory=dict)
    axes: tuple[str, ...] = ()
    arm: str = ""
    schema: int = 1


def effects_of(patch: Patch) -> tuple[Effect, ...]:
    """Return the mechanisms of what was named and of what has only a table."""
    return (*map(effect_of, patch.effects), *map(_tabled, patch.laws))


def rig_of(patch: Patch, arm_file: Path | None = None) -> Rig:
    """Build the rig of a patch.

    Args:
        patch: What is true.
        arm_file: The nominal arm, MJCF or URDF; None: the one in the patch.

    Raises:
        BenchError: Where an effect has no mechanism or cannot be built.
    """
    held = patch.mounted
    cell = BareCell(
        pulley=np.zeros((0, 3)),
        sensor_mass=0.0,
        mount_mass=0.0,
        sensor_m=held.sensor_m,
        held=Payload(held.mass_kg, np.array(held.com_m)),
    )
    effects = effects_of(patch)
    if held.mass_kg:
        effects = (*effects, GravityLoad("flange", held.mass_kg, *held.com_m))
    if arm_file is None:
        rig = WrittenRig(Path(MODEL_FILE), effects, cell=cell, text=patch.arm)
    else:
        rig = Rig(arm_file, effects, cell=cell, axes=patch.axes)
    springs = rig.nominal.jnt_stiffness.copy()
    known = list(rig.anatomy.axes)
    for name, value in patch.stiffness_nm_per_rad.items():
        axis = rig.anatomy.axis(name)
        if axis not in known:
            raise Unusable("Patch", [f"no axis is called {name!r}; known: {known}."])
        springs[known.index(axis)] = RIGID if value is None else value
    return replace(rig, stiffness=springs)


def with_arm(patch: Patch, rig: Rig) -> Patch:
    """Return the patch with the nominal arm of a rig in it."""
    return replace(patch, arm=plain_mjcf(rig.nominal))


def text_of(patch: Patch) -> str:
    """Return patch.json; numbers read back to the last bit."""
    return msgspec.json.format(msgspec.json.encode(patch), indent=1).decode() + "\n"


def read(file: Path) -> Patch:
    """Read patch.json.

    Raises:
        BenchError: Where there is none.
        Unusable: Where it is none.
    """
    if not file.is_file() or file.stat().st_size > LARGEST:
        raise BenchError(f"There is no {FILE} at {str(file)!r}, or it is too large.")
    try:
        return msgspec.json.decode(file.read_bytes(), type=Patch)
    except msgspec.MsgspecError as error:
        raise Unusable(f"Patch {str(file)!r}", [f"{error}."]) from None


def load(folder: Path | str) -> Rig:
    """Rebuild the patched rig from what a diagnosis left in a folder.

    Its instruments' faults are among the effects, as in any rig.

    Raises:
        BenchError: Where the folder holds no patch, or one that cannot be built.
    """
    return rig_of(read(Path(folder) / FILE))


def _tabled(law: Law) -> TabledLaw:
    loading = np.array(law.loading_rad)
    back = np.array(law.unloading_rad) if law.unloading_rad else loading
    if len(back) != len(loading):
        raise Unusable(f"Law at {law.where!r}", ["its two branches differ in length."])
    middle = (loading + back) / 2
    apart = float(np.interp(0.0, law.torque_nm, back - loading))
    return TabledLaw(law.where, law.torque_nm, tuple(middle.tolist()), max(apart, 0.0))
