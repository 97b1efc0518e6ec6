"""Base classes of effects: one physical deviation from the data sheet each.

The kind of an effect is where its physics happens:

- `ModelEffect`: in the arm, as springs, masses and shapes of the MuJoCo model;
- `CommandEffect`: between the controller's angle and the gear's input;
- `RopeEffect`: between the weight on the hook and the tension of the rope;
- `InstrumentEffect`: in the reading of an instrument.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar, TypeVar

import mujoco
import numpy as np
from jaxtyping import Float

from bench.instruments import Instruments
from bench.kinematic_chain import Anatomy
from bench.shared.effect_catalogue import CATALOGUE
from bench.shared.errors import refuse
from bench.shared.recording import LastMoves

# --- Fields of an effect --------------------------------------------------------------

T = TypeVar("T")
Number = int | float
UNBOUNDED = (-math.inf, math.inf)


def size(
    usual: T, least: Number = -math.inf, most: Number = math.inf, off: float = 0.0
) -> T:
    """Return a field that switches the effect off: a size, as a plain number is.

    Beyond its bounds the model breaks down or memory runs out; upper bounds are chosen,
    far beyond all catalogues.
    """
    return field(default=usual, metadata={"bounds": (least, most), "off": off})


def form(usual: T, least: Number = -math.inf, most: Number = math.inf) -> T:
    """Return a field that keeps its value when the effect is switched off."""
    return field(default=usual, metadata={"bounds": (least, most), "off": None})


def optional(usual: T, least: Number = -math.inf, most: Number = math.inf) -> T:
    """Return a field of a form that is no parameter where it has its default."""
    kept = {"bounds": (least, most), "off": None, "optional": True}
    return field(default=usual, metadata=kept)


def assumed(usual: T, least: Number = -math.inf, most: Number = math.inf) -> T:
    """Return a field of the mechanism that the vocabulary does not have."""
    kept = {"bounds": (least, most), "off": None, "assumed": True}
    return field(default=usual, metadata=kept)


# --- Effects --------------------------------------------------------------------------


@dataclass(frozen=True)
class Effect(ABC):
    """One physical cause of a difference between reading and nominal arm.

    Three promises are tested for every effect: switched `off()` it changes nothing,
    to the last bit; it adds to what is there and never overwrites, so order does not
    matter; an example of it moves the readings.

    Attributes:
        name: Its name in the diagnosis' vocabulary.
        places: Kinds of parts it can sit in, see `bench.effects.places`; those of the
            catalogue, where that has the name.
        where: The part it sits in: an axis `a1` …, a link `link_k` (between axes k
            and k+1), `arm`, `base`, `flange`, `tool`, `rig`, `tracker`,
            `wrench_sensor` or `marker:<name>`.
    """

    name: ClassVar[str]
    places: ClassVar[tuple[str, ...]]
    where: str

    def __init_subclass__(cls):
        """Take the places from the catalogue."""
        name = getattr(cls, "name", "")
        if name in CATALOGUE:
            cls.places = CATALOGUE[name].sites

    def __post_init__(self):
        """Check the sizes, naming every fault."""
        faults = []
        for name, (least, most) in self.bounds().items():
            value = getattr(self, name)
            if (least, most) != UNBOUNDED and not least <= value <= most:
                most_of_all = "" if math.isinf(most) else f" and at most {most}"
                faults.append(
                    f"{name} is {value}, expected at least {least}{most_of_all}."
                )
        refuse(f"Effect {self.name!r} at {self.where!r}", faults)

    @classmethod
    def bounds(cls) -> Mapping[str, tuple[Number, Number]]:
        """Return the least and the most that each of its numbers may be."""
        own = fields(cls)[1:]
        return {f.name: f.metadata.get("bounds", UNBOUNDED) for f in own}

    def off(self) -> "Effect":
        """Return the same effect with size zero."""
        sizes = {f.name: f.metadata.get("off", 0.0) for f in fields(self)[1:]}
        return replace(self, **{n: v for n, v in sizes.items() if v is not None})

    @classmethod
    def shapes(cls) -> frozenset[str]:
        """Return the parameters that are no sizes."""
        own = [f for f in fields(cls)[1:] if not f.metadata.get("assumed")]
        kept = (f.name for f in own if f.metadata.get("off", 0.0) is None)
        return frozenset(name.removesuffix("_axis") for name in kept)

    def parameters(self) -> Mapping[str, Any]:
        """Return its parameters in SI under the names of the diagnosis' vocabulary.

        Numbers, and names of other parts.
        """
        own = (f for f in fields(self)[1:] if not f.metadata.get("assumed"))
        every = ((f, getattr(self, f.name)) for f in own)
        return {
            f.name: value
            for f, value in every
            if value != f.default or not f.metadata.get("optional")
        }


class ModelEffect(Effect):
    """Effect in the arm: springs, masses, shapes."""

    @abstractmethod
    def build(self, spec: mujoco.MjSpec, arm: Anatomy) -> None:
        """Change the model, once, before it is compiled, where it is not switched off.

        Lengths are in m, angles in rad; the arm has its seats.
        """


@dataclass(frozen=True)
class Command:
    """Command to the gears, for every visit.

    Attributes:
        reference: Angle of each axis at which its spring is slack, in rad.
        stiffness: Stiffness of each axis' spring, in N m/rad.
        moves: How each axis arrived; None: it is not known.
        sag: Works out how far the weights of arm and tool turn each axis by the data
            sheet, in rad (visits, axes); None: it is not asked for.
    """

    reference: Float[np.ndarray, "visits axes"]
    stiffness: Float[np.ndarray, "visits axes"]
    moves: LastMoves | None = None
    sag: Callable[[], np.ndarray] | None = None


class CommandEffect(Effect):
    """Effect in the drive that depends on the angle that the controller reports."""

    @abstractmethod
    def command(
        self, posture: Float[np.ndarray, "visits axes"], nominal: Command, arm: Anatomy
    ) -> Command:
        """Return what this effect adds to the nominal command.

        The controller reports the posture, in rad; the nominal command is that without
        any effect.
        """


class RopeEffect(Effect):
    """Effect between the weight on the hook and the rope's tension."""

    @abstractmethod
    def tension(
        self, weight: Float[np.ndarray, " rows"], direction: Float[np.ndarray, " rows"]
    ) -> Float[np.ndarray, " rows"]:
        """Return what this effect adds to the tension, in N.

        The weight on the hook is in N; the direction +1 where the load last grew, -1
        where it last fell.
        """


class InstrumentEffect(Effect):
    """Effect in the reading of an instrument."""

    @abstractmethod
    def fault(self, instruments: Instruments) -> Instruments:
        """Return the instruments with this fault added to those they have."""


def plus(a: tuple[float, ...], b: tuple[float, ...]) -> tuple[float, ...]:
    """Add two vectors, entry by entry."""
    return tuple(float(x) for x in np.add(a, b))
