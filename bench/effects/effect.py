"""Base classes of effects: one physical deviation from the data sheet each.

The kind of an effect is where its physics happens:

- `ModelEffect`: in the arm, as springs, masses and shapes of the MuJoCo model;
- `CommandEffect`: between the controller's angle and the gear's input;
- `RopeEffect`: between the weight on the hook and the tension of the rope;
- `InstrumentEffect`: in the reading of an instrument.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar

import mujoco
import numpy as np
from jaxtyping import Float

from bench.kinematic_chain import Anatomy
from bench.shared.errors import refuse
from bench.shared.recording import LastMoves


@dataclass(frozen=True)
class Effect(ABC):
    """One physical cause of a difference between reading and nominal arm.

    Three promises are tested for every effect: switched `off()` it changes nothing,
    to the last bit; it adds to what is there and never overwrites, so order does not
    matter; an example of it moves the readings.

    Attributes:
        name: Its name in the diagnosis' vocabulary.
        places: Kinds of parts it can sit in, see `bench.effects.places`.
        at_least: Lower bound of each parameter that has one.
        at_most: Upper bound of each parameter beyond which the model breaks down or
            memory runs out; chosen, far beyond all catalogues.
        absent: Parameters at which it is switched off; empty: all of them at zero.
        assumed: Fields of its mechanism that the vocabulary does not have.
        where: The part it sits in: an axis `a1` …, a link `link_k` (between axes k
            and k+1), `arm`, `base`, `flange`, `tool`, `rig`, `tracker`,
            `wrench_sensor` or `marker:<name>`.
    """

    name: ClassVar[str]
    places: ClassVar[tuple[str, ...]]
    at_least: ClassVar[Mapping[str, float]] = {}
    at_most: ClassVar[Mapping[str, float]] = {}
    absent: ClassVar[Mapping[str, float]] = {}
    assumed: ClassVar[tuple[str, ...]] = ()
    where: str

    def __post_init__(self):
        """Check the sizes, naming every fault."""
        faults = []
        for name in {**self.at_least, **self.at_most}:
            value = getattr(self, name)
            least = self.at_least.get(name, -math.inf)
            most = self.at_most.get(name, math.inf)
            if not least <= value <= most:
                most_of_all = "" if math.isinf(most) else f" and at most {most}"
                faults.append(
                    f"{name} is {value}, expected at least {least}{most_of_all}."
                )
        refuse(f"Effect {self.name!r} at {self.where!r}", faults)

    def off(self) -> "Effect":
        """Return the same effect with size zero."""
        return replace(self, **(self.absent or dict.fromkeys(self.parameters(), 0.0)))

    def parameters(self) -> Mapping[str, Any]:
        """Return its parameters in SI under the names of the diagnosis' vocabulary.

        Numbers, and names of other parts.
        """
        shown = (f.name for f in fields(self)[1:] if f.name not in self.assumed)
        return {name: getattr(self, name) for name in shown}


class ModelEffect(Effect):
    """Effect in the arm: springs, masses, shapes."""

    @abstractmethod
    def build(self, spec: mujoco.MjSpec, arm: Anatomy) -> None:
        """Change the model, once, before it is compiled.

        Lengths are in m, angles in rad; the arm has its seats.
        """


@dataclass(frozen=True)
class Command:
    """Command to the gears, for every visit.

    Attributes:
        reference: Angle of each axis at which its spring is slack, in rad.
        stiffness: Stiffness of each axis' spring, in N m/rad.
        moves: How each axis arrived; None: it is not known.
    """

    reference: Float[np.ndarray, "visits axes"]
    stiffness: Float[np.ndarray, "visits axes"]
    moves: LastMoves | None = None


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
