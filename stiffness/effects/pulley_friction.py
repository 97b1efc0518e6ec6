"""Friction of the pulley: a share of the weight is lost while the rope moves.

==========  ==========================================================================
Equation    tension = weight exp(-ratio d) ≈ weight (1 - ratio d), d = 1 where the load
            last grew, -1 where it last fell; ratio = μ x angle of wrap
Source      belt friction: Eytelwein 1808, to first order
Valid       a wrench computed from the weight on the hook and not measured: its force
            equals the weight to less than the noise; loads changed step by step
Ignores     a rope at rest on the pulley; the change of wrap with the posture
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.effects.base import Hypothesis, Shape, sprung
from stiffness.effects.jacobian import EffectJacobian
from stiffness.effects.statics import wind_up
from stiffness.experiment.static_state import StaticState

ROUNDED = 0.5
"""Largest distance of a force from its weight, over the sensor's sigma; chosen: noise
of one sigma exceeds it in nearly every second of the rows."""


@dataclass(frozen=True)
class PulleyFriction(Hypothesis):
    """Rope whose tension is below the weight as it rises, and above it as it falls."""

    effect: ClassVar[str] = "pulley_friction"
    neutral: ClassVar[Mapping[str, float]] = {"ratio": 0.0}
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        "ratio": (0.0, 0.5),
    }

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        return ("rig",) if from_hook(situation) and sprung(situation) else ()

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        missing = -direction(situation)[:, None] * situation.load_torque
        return wind_up(situation, missing[:, :, None])


def from_hook(situation: StaticState) -> bool:
    """Return whether every force equals the weight on the hook, so is not measured."""
    recording = situation.recording
    mass, spec = recording.load_mass, recording.wrench_sensor
    if recording.wrench is None or spec is None or mass is None or not np.any(mass):
        return False
    force = np.linalg.norm(recording.wrench[:, :3], axis=1)
    gravity = float(force @ mass / (mass @ mass))
    beside = np.max(np.abs(force - gravity * mass))
    return bool(beside < ROUNDED * spec.accuracy_force)


def direction(situation: StaticState) -> Float[np.ndarray, " rows"]:
    """Return +1 where the weight on the hook last grew and -1 where it last fell."""
    assert situation.recording.load_mass is not None
    mass = situation.recording.load_mass[situation.steps]
    change = np.sign(np.diff(mass, axis=1, prepend=mass[:, :1]))
    change[:, 0] = 1.0  # what hangs there at first was put on
    for step in range(1, change.shape[1]):
        still = change[:, step] == 0.0
        change[still, step] = change[still, step - 1]
    return situation.from_steps(change)
