"""Gravity load: mass or centre of mass of a part differs from its data sheet.

==========  ==========================================================================
Equation    torque_k = l_k . m g + a_k . (m c x g + o x m g), (l, a) the screw of axis
            k, o the body's origin, m c the first moment along the body's axes
Source      linear in mass and first moments: Gautier, Khalil 1990, "Direct calculation
            of minimum set of inertial parameters of serial robots"
Valid       sprung axes; postures without load too
Ignores     compliance besides the axes' own springs, except for named effects (its
            variant)
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.effects.base import (
    Coeffs,
    Hypothesis,
    Shape,
    absolute,
    axes_of,
    point_of,
)
from stiffness.effects.jacobian import EffectJacobian
from stiffness.effects.statics import CarriedLoads, carried_loads, given_way, wind_up
from stiffness.experiment.static_state import StaticState

NAMES = ("mass_kg", "x", "y", "z")
LENGTH = 0.1
"""Length that scales first moments to masses, in m; chosen: a link's breadth."""
ARM_LENGTH = 0.5
"""Lever of the prior of first moments, in m; chosen: half the length of a long link."""
LEAST_MASS = 1.0
"""Least standard deviation of a mass before any reading, in kg; chosen: models whose
links have masses for show."""
MOST_TAKEN = 0.9
"""Share of a body's mass that may be missing; chosen: nothing weighs nothing."""
UNSEEN = 1e-6
"""Below this share of the largest possible wind-up a column is rounding; chosen."""


@dataclass(frozen=True)
class GravityLoad(Hypothesis):
    """Mass added to a body, or removed from it, anywhere on it.

    Only those of mass and first moments are coefficients that these postures make
    identifiable: on a link that turns about a horizontal axis the moments across it,
    and not the mass. Where the mass is identifiable, `mass_kg` and `com_x_m` … are
    reported beside the moments `moment_x_kg_m` …; beside another load these may be all
    that readings hold.
    """

    effect: ClassVar[str] = "gravity_load"
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        "mass_kg": (-100.0, 100.0),
        **{f"com_{axis}_m": (-np.inf, np.inf) for axis in "xyz"},
        **{f"moment_{axis}_kg_m": (-100.0, 100.0) for axis in "xyz"},
    }
    magnitudes: ClassVar[tuple[str, ...]] = (
        "mass_kg",
        *(f"moment_{axis}_kg_m" for axis in "xyz"),
    )

    quotients: ClassVar[Mapping[str, tuple[str, str]]] = {
        f"com_{axis}_m": (f"moment_{axis}_kg_m", "mass_kg") for axis in "xyz"
    }

    @override
    def limits_at(
        self, situation: StaticState, where: str
    ) -> Mapping[str, tuple[float, float]]:
        """Return limits that leave each body some of its mass."""
        highest = self.limits["mass_kg"][1]
        least = -MOST_TAKEN * mass_at(situation, where)
        return {**self.limits, "mass_kg": (least, highest)}

    @override
    def prior_sigma(
        self, situation: StaticState, where: str
    ) -> Float[np.ndarray, " columns"]:
        """Return the body's own mass, and that mass at half a metre.

        A mass at the end of a link and a moment of that link pull alike: of two that
        were found, readings hold the sum alone.
        """
        mass = max(mass_at(situation, where), LEAST_MASS)
        sigma = mass * np.array([1.0, ARM_LENGTH, ARM_LENGTH, ARM_LENGTH])
        return sigma[seen(situation, where)]

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        sensor = situation.recording.wrench_sensor
        weighed = sensor is not None and sensor.includes_tool_weight
        last = situation.arm.attachment("flange").axis
        links = (f"link_{k + 1}" for k in range(len(situation.axes)) if k != last)
        bodies = links if weighed else (*links, "tool")
        if not absolute(situation):
            return ()
        return tuple(b for b in bodies if seen(situation, b))

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        torque = carried_weight(situation, where).torque
        return wind_up(situation, torque[:, :, seen(situation, where)])

    @override
    def variants(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        return given_way(
            situation, [partial(weighed_down, body=where, size=s) for s in np.eye(4)]
        )

    @override
    def parameters(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[str, float]:
        names = [NAMES[i] for i in seen(situation, where)]
        found = dict(zip(names, coefficients, strict=True))
        mass = found.pop("mass_kg", None)
        moments = {f"moment_{axis}_kg_m": value for axis, value in found.items()}
        if mass is None:
            return moments
        centre = {f"com_{axis}_m": value / mass for axis, value in found.items()}
        return {"mass_kg": mass, **centre, **moments}

    @override
    def acting(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> StaticState:
        size = np.zeros(4)
        size[seen(situation, where)] = coefficients
        return weighed_down(situation, where, size)


def weighed_down(
    situation: StaticState, body: str, size: Float[np.ndarray, "4"]
) -> StaticState:
    """Return the state under an added mass in kg and first moments in kg m."""
    return carried_weight(situation, body).added_to(situation, size)


def mass_at(situation: StaticState, body: str) -> float:
    """Return the model's mass in kg of what moves with a body, a stated tool too."""
    arm, tool = situation.arm, situation.recording.tool
    axis = arm.attachment(body).axis
    mass = float(arm.chain.mass[axis])
    if tool is not None and axis == arm.attachment("flange").axis:
        mass += tool.mass
    return mass


def carried_weight(situation: StaticState, body: str) -> CarriedLoads:
    """Return what a kg of mass and a kg m of first moment along x, y, z exert."""
    key = ("weight", body)
    return situation.once_standing(key, lambda: _carried_weight(situation, body))


def _carried_weight(situation: StaticState, body: str) -> CarriedLoads:
    gravity = situation.arm.chain.gravity
    turned = np.cross(axes_of(situation, body), gravity[None, :, None], axis=1)
    none = np.zeros((situation.rows, 3, 1))
    weight = np.broadcast_to(gravity[:, None], none.shape)
    force = np.concatenate([weight, np.zeros_like(turned)], axis=2)
    moment = np.concatenate([none, turned], axis=2)
    at = point_of(situation, body, np.zeros(3))
    return carried_loads(situation, body, force, moment, at)


def seen(situation: StaticState, body: str) -> list[int]:
    """Return which of mass and moments are identifiable beyond those before."""
    key = ("seen weight", body)
    return situation.once_standing(key, lambda: _seen(situation, body))


def _seen(situation: StaticState, body: str) -> list[int]:
    torque = carried_weight(situation, body).torque
    compliance = situation.arm.compliance  # the model's: whatever is fitted, the same
    wound = torque * compliance[:, None] / [1.0, LENGTH, LENGTH, LENGTH]
    wound = np.asarray(np.linalg.qr(wound.reshape(-1, 4), mode="r"))
    most = np.linalg.norm(situation.arm.chain.gravity) * compliance.max()
    least = UNSEEN * most * np.sqrt(situation.rows)
    kept: list[int] = []
    for i in range(4):
        rank = np.linalg.matrix_rank(wound[:, [*kept, i]], tol=least)
        kept += [i] if rank > len(kept) else []
    return kept
