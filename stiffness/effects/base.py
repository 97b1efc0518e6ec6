"""Base class of effects, and what they share about axes and bodies.

A hypothesis says what one physical effect would do to the readings if it were there.

It knows the law and its physical bounds, never how a simulator builds it. A law's
amplitudes enter linearly and are its *coefficients*; what bends its form (a knee, a
time constant, an order) is its *shape* and is searched. Each hypothesis is a file of
its own, with a table of Equation, Source, Valid and Ignores on top, and one frozen
dataclass; `hypotheses/__init__.py` lists them in a tuple that one can read.

An axis shows only what its springs, its torques and its turns let it show.

Whatever hangs on an axis goes where the axis takes it.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from jaxtyping import Float

from stiffness.effects.jacobian import EffectJacobian
from stiffness.experiment.static_state import StaticState

# --- Hypothesis -----------------------------------------------------------------------


class Hypothesis(ABC):
    """One effect of the vocabulary, at any place where it can sit.

    What is promised, and tested for every hypothesis:

    - the signature is per unit of coefficient, and absolute: it holds what the effect
      does in every row, unloaded rows and gravity included. The engine takes from it
      what the readings can show (differences within a visit, means of visits), and
      what fitted springs, unknown frames and marker places would explain as well;
    - it depends on the situation alone, and never on the readings of the markers;
    - coefficients have a natural scale: SI, so that a coefficient of a parameter
      within its limits moves the readings by less than a centimetre;
    - columns of one signature are not multiples of each other at any shape.

    Attributes:
        effect: Its name in the vocabulary.
        shape_names: What its shape parameters are called; empty where it has none.
        limits: Lowest and highest physical value of each reported parameter, in SI.
            Parameters beyond them are another physics: the name is then withdrawn. A
            limit is wide (what any arm could have), not what is likely.
        magnitudes: Parameters that are zero, or stiff without end, where the effect is
            not there: what may be so in all of them gets no name. Ratios, and what is
            no size, such as a phase, say nothing here.
        logarithmic: Parameters whose error is a factor rather than a difference.
        linear: Whether it gives way in proportion to the loads of a row, and to nothing
            else.
        log_prior: How much rarer than others it is, as a log; 0 where nothing is known.
    """

    effect: ClassVar[str]
    shape_names: ClassVar[tuple[str, ...]] = ()
    limits: ClassVar[Mapping[str, tuple[float, float]]]
    magnitudes: ClassVar[tuple[str, ...]] = ()
    logarithmic: ClassVar[tuple[str, ...]] = ()
    linear: ClassVar[bool] = False
    log_prior: ClassVar[float] = 0.0

    @abstractmethod
    def places(self, situation: StaticState) -> tuple[str, ...]:
        """Return where the effect could sit and could be seen, as `where` in an answer.

        Leave out a place where these rows cannot show it (creep where nothing waits,
        an axis without torque); what is left in must give a signature.
        """

    @abstractmethod
    def shapes(
        self, situation: StaticState, where: str
    ) -> Float[np.ndarray, "shapes parameters"]:
        """Return a coarse grid of shapes within their physical bounds, one a row.

        At most about eight: neighbours should have signatures with a cosine near 0.95.
        The engine refines between the grid's outermost values. Without shape
        parameters: one row with no entry, `np.zeros((1, 0))`.
        """

    @abstractmethod
    def jacobian(
        self,
        situation: StaticState,
        where: str,
        shape: Float[np.ndarray, " parameters"],
    ) -> EffectJacobian:
        """Return what one unit of each coefficient does."""

    @abstractmethod
    def variants(
        self,
        situation: StaticState,
        where: str,
        shape: Float[np.ndarray, " parameters"],
    ) -> EffectJacobian:
        """Return what other accepted forms of the same law add, once it is named.

        A gear's hardening is tabled in three pieces or written with a tanh: both are
        hardening. The residual test after naming does not hold these against the name.
        They never help to find the name, and must be too narrow to imitate another
        effect. Return `NOTHING` where the law has one form.
        """

    @abstractmethod
    def parameters(
        self,
        situation: StaticState,
        where: str,
        shape: Float[np.ndarray, " parameters"],
        coefficients: Float[np.ndarray, " columns"],
    ) -> Mapping[str, float]:
        """Turn a fit into the parameters of the vocabulary, in SI.

        `situation.compliance` is the one fitted together with the effect. The engine
        differentiates this function to carry intervals over, so keep it smooth.
        """

    def acting(
        self,
        situation: StaticState,
        where: str,
        shape: Float[np.ndarray, " parameters"],
        coefficients: Float[np.ndarray, " columns"],
    ) -> StaticState:
        """Return the situation as springs and other effects feel it with this in it.

        The same, unless overridden, as masses and a wrench that is read wrongly do:
        others move the arm, or what they change of its loads is left out.
        """
        return situation

    def limits_at(
        self, situation: StaticState, where: str
    ) -> Mapping[str, tuple[float, float]]:
        """Return the limits at a place; `limits` wherever it is, unless overridden."""
        return self.limits

    def grain(self, situation: StaticState) -> Mapping[str, float]:
        """Return by how much a parameter can change without changing any reading."""
        return {}


# --- Torques and angles of axes -------------------------------------------------------

ORDERS = np.array([1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0])
"""Periods per turn that are tried; chosen: postures of a bench, a radian or two apart,
cannot tell the hundreds of periods of a gear's teeth from chance."""
LEAST_PHASE = 1.0
"""How far a periodic law must go through its period to be one, in rad; chosen."""
LEAST_REVERSAL = 0.01
"""Torque of the weaker sign over the largest, from which on it counts; chosen."""


def sprung(situation: StaticState) -> tuple[str, ...]:
    """Return the axes with a spring that is fitted silently."""
    soft = situation.compliance > 0.0
    return tuple(a for a, s in zip(situation.axes, soft, strict=True) if s)


def reversing(situation: StaticState) -> tuple[str, ...]:
    """Return the axes whose torque comes with either sign."""
    high, low = situation.torque.max(axis=0), situation.torque.min(axis=0)
    both = np.minimum(high, -low) > LEAST_REVERSAL * np.maximum(high, -low)
    return tuple(a for a, b in zip(situation.axes, both, strict=True) if b)


def orders(situation: StaticState, axis: int) -> Float[np.ndarray, " orders"]:
    """Return the periods per turn that an axis' postures go through far enough.

    None for a slide, which has no turn.
    """
    if situation.arm.slides[axis]:
        return ORDERS[:0]
    span = np.ptp(situation.recording.posture[:, axis])
    return ORDERS[ORDERS * span >= LEAST_PHASE]


def still(situation: StaticState, axis: int) -> bool:
    """Return whether a hinge hardly turns, so that a law of its angle has one value."""
    return not situation.arm.slides[axis] and not len(orders(situation, axis))


def middle_angle(situation: StaticState, axis: int) -> float:
    """Return the mean reported angle of an axis, in rad."""
    return float(np.mean(situation.recording.posture[:, axis]))


def absolute(situation: StaticState) -> bool:
    """Return whether what stays the same throughout a visit can be seen."""
    return situation.recording.displacement == "absolute"


# --- Bodies and their markers ---------------------------------------------------------


def axes_of(situation: StaticState, body: str) -> Float[np.ndarray, "rows 3 3"]:
    """Return a body's axes as columns along the base's."""
    place = situation.arm.attachment(body)
    return situation.frame[:, place.axis + 1] @ place.placement[:3, :3]


def point_of(
    situation: StaticState, body: str, position: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "rows 3"]:
    """Return where a point of a body is, in the base's frame, in m.

    Args:
        situation: Where the axes are.
        body: Which body.
        position: The point in the body's frame, in m.
    """
    axis, inside = (
        situation.arm.attachment(body).axis,
        inside_of(situation, body, position),
    )
    return situation.origin[:, axis + 1] + situation.frame[:, axis + 1] @ inside


def marked_point(situation: StaticState, m: int) -> Float[np.ndarray, "rows 3"]:
    """Return where a marker is, or its body's origin where its place is not stated."""
    marker = situation.recording.markers[m]
    place = np.zeros(3) if marker.position is None else marker.position
    return point_of(situation, marker.body, place)


def inside_of(
    situation: StaticState, body: str, position: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3"]:
    """Return a point of a body in the frame of the place that carries it, in m."""
    placement = situation.arm.attachment(body).placement
    return placement[:3, :3] @ position + placement[:3, 3]
