"""Base class of effects, with functions on axes and bodies that they share.

A `Hypothesis` predicts what one physical effect would do to the readings. It contains
the law and its physical bounds, never how a simulator builds it. A law's amplitudes
enter linearly and are its *coefficients*; its nonlinear parameters (a knee, a time
constant, an order) are its *shape* and are searched. Each hypothesis is a file of its
own, with a table of Equation, Source, Valid and Ignores on top, and one frozen
dataclass; `stiffness/effects/__init__.py` lists them in a tuple.

`sprung`, `reversing`, `orders` and the like select the axes at which an effect can be
visible; `axes_of`, `point_of` and the like return where bodies and markers are.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import ClassVar

import numpy as np
from jaxtyping import Float

from bench.shared.effect_catalogue import usual
from stiffness.effects.jacobian import NOTHING, EffectJacobian
from stiffness.experiment.static_state import StaticState

Shape = Float[np.ndarray, " parameters"]
"""Nonlinear parameters of a law, see `Hypothesis`."""
Shapes = Float[np.ndarray, "shapes parameters"]
"""Several of them, one a row."""
Coeffs = Float[np.ndarray, " columns"]
"""Amplitudes of a law's columns: its coefficients."""
WIDE = 3.0
"""One sigma of a coefficient over its usual largest size; chosen: what is three times
as large as usual loses half a unit of log evidence."""

# --- Hypothesis -----------------------------------------------------------------------


class Hypothesis(ABC):
    """One effect of the vocabulary, at any site where it can occur.

    Promises, tested for every hypothesis:

    - the Jacobian is per unit of coefficient, and absolute: it holds the effect's
      displacement in every row, unloaded rows and gravity included. The engine reduces
      it to what the readings can show (differences within a visit, means of visits)
      and projects out fitted springs, unknown frames and marker places;
    - it depends on the `StaticState` alone, and never on the readings of the markers;
    - coefficients have a natural scale: SI, so that a coefficient of a parameter
      within its limits moves the readings by less than a centimetre;
    - columns of one Jacobian are not multiples of each other at any shape.

    Attributes:
        effect: Its name in the vocabulary.
        shape_names: Names of its shape parameters; empty where it has none.
        limits: Lowest and highest physical value of each reported parameter, in SI.
            Parameters beyond them imply another cause: the effect is then rejected. A
            limit is wide (possible for any arm), not a range of likely values.
        magnitudes: Parameters that are zero, or of infinite stiffness, where the effect
            is
            absent: if all of them may be so, the effect is not named. Ratios and
            parameters that are no size, such as a phase, are not listed.
        neutral: Values at which other parameters do nothing, as ratios: an effect may
            be nothing where all these and all magnitudes may.
        logarithmic: Parameters whose error is a factor rather than a difference.
        linear: Whether its displacement is proportional to the loads of a row, but for
            springs that are curved, and depends on nothing else.
        turns_load: Whether its Jacobian holds what the load winds up that turns with
            the sensor.
        size_of_variants: What a unit of any of its `variants` adds to the coefficient
            of a law of one column; None: a variant is no other form of the same size.
        is_sum: Whether its shape may repeat its shape parameters, once for each part of
            a sum.
        log_prior: Log of its prior odds against others; 0 where nothing is known.
        shares_rate_with: Another effect that is of one kind with it, if any: where one
            is, the other is as likely elsewhere on the arm, and about as large.
        quotients: Parameters that are one of the others over another.
        sized_by: Parameter whose usual largest size is that of each coefficient, too,
            over the axis' compliance where it is a ratio; empty: no prior follows.
    """

    effect: ClassVar[str]
    shape_names: ClassVar[tuple[str, ...]] = ()
    limits: ClassVar[Mapping[str, tuple[float, float]]]
    magnitudes: ClassVar[tuple[str, ...]] = ()
    neutral: ClassVar[Mapping[str, float]] = {}
    logarithmic: ClassVar[tuple[str, ...]] = ()
    linear: ClassVar[bool] = False
    turns_load: ClassVar[bool] = False
    size_of_variants: ClassVar[float | None] = None
    is_sum: ClassVar[bool] = False
    log_prior: ClassVar[float] = 0.0
    shares_rate_with: ClassVar[str] = ""
    quotients: ClassVar[Mapping[str, tuple[str, str]]] = {}
    sized_by: ClassVar[str] = ""

    @property
    def counted_as(self) -> str:
        """The effect that stands for all that share its rate."""
        return self.shares_rate_with or self.effect

    @property
    def nothing(self) -> dict[str, float]:
        """The value of each size at which there is no effect."""
        return {name: 0.0 for name in self.magnitudes} | dict(self.neutral)

    @abstractmethod
    def places(self, situation: StaticState) -> tuple[str, ...]:
        """Return the sites where the effect could occur and be seen, as in answers.

        Leave out a site where these rows cannot show it (creep without waiting times,
        an axis without torque); each site returned must give a Jacobian.
        """

    def shapes(self, situation: StaticState, where: str) -> Shapes:
        """Return a coarse grid of shapes within their physical bounds, one a row.

        At most about a dozen: neighbours should have Jacobians with a cosine near 0.95.
        The engine refines between the grid's outermost values. One row with no entry,
        unless overridden: the law has no shape parameters.
        """
        return np.zeros((1, 0))

    def joined(
        self, shapes: Sequence[Float[np.ndarray, " _"]]
    ) -> Float[np.ndarray, " joined"] | None:
        """Return the shape of one law that does what several of its shapes do.

        None: the law has one shape. The parts of a sum are waves unless overridden;
        `MOST_PARTS` are kept.

        Args:
            shapes: What explains most comes first.
        """
        if not self.is_sum:
            return None
        orders = apart(np.concatenate([*shapes]), ORDERS_APART)
        return np.array(orders[:MOST_PARTS])

    def further(
        self, found: Mapping[str, float], shape: Shape, coefficients: Coeffs
    ) -> list[dict[str, float]]:
        """Return the parameters of what a law that is a sum has beside what it reports.

        Nothing, unless overridden: the law is no sum.

        Args:
            found: The parameters that are reported.
            shape: Of all its parts.
            coefficients: The same.
        """
        return []

    @abstractmethod
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        """Return the displacement per unit of each coefficient."""

    def variants(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        """Return the Jacobian that other accepted forms of the same law add.

        A gear's hardening is tabled in three pieces or written with a tanh: both are
        hardening. The residual test after naming projects them out. They are used
        once the effect is named, never to find it, and must be too narrow to mimic
        another one. Nothing, unless overridden: the law has one form.
        """
        return NOTHING

    def assumed(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        """Return what constants that the law assumes change of its first column.

        A column is of one prior standard deviation of a constant, per unit of the law's
        first coefficient; intervals allow for it. Nothing, unless overridden: the law
        assumes no number.
        """
        return NOTHING

    def parameters(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[str, float]:
        """Turn a fit into the parameters of the vocabulary, in SI.

        The coefficients, by the names in `limits`, unless overridden. The compliance of
        `situation` is the one fitted together with the effect. The engine
        differentiates this function to carry intervals over, so keep it smooth.
        """
        return dict(zip(self.limits, coefficients, strict=True))

    def acting(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> StaticState:
        """Return the static state that springs and other effects see with this effect.

        Unchanged, unless overridden, as by masses and errors of the wrench, or by what
        curves a spring that other laws act through. Others move the arm, and their
        change of its loads is neglected, or carry a part of one gear's torque: see
        `parallel_torque`.
        """
        return situation

    def parallel_torque(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[int, Float[np.ndarray, " rows"]]:
        """Return the torque that the law carries beside springs of axes, in N m.

        Other laws of these gears act on the rest of it. Nothing, unless overridden: the
        law is no part of a gear, or sits in series with its spring.
        """
        return {}

    def arrival_turns(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[int, Float[np.ndarray, "rows states"]]:
        """Return turns of axes, one sigma, by states of gears that nothing tells.

        In rad, of each state in which a visit may begin. Nothing, unless overridden:
        the law has no memory.
        """
        return {}

    def mean_softening(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[int, float]:
        """Return the compliance that the law adds to springs of axes on average.

        In rad/(N m), over the rows. Other laws act through springs that are softer by
        it. Nothing, unless overridden: the law leaves a spring's mean to the spring.
        """
        return {}

    def prior_sigma(
        self, situation: StaticState, where: str
    ) -> Float[np.ndarray, " columns"] | None:
        """Return one sigma of each coefficient before any reading; one for all alike.

        `WIDE` times what is usual by `sized_by`, unless overridden; None: nothing is
        known, as of a slide, whose sizes are in other units. What readings hardly hold,
        alone or against springs and loads, stays within it.
        """
        known = usual(self.effect, self.sized_by)
        if known is None or situation.arm.slides[situation.axis(where)]:
            return None
        size = WIDE * self.coefficient_of(known.high)
        if self.sized_by in self.neutral:
            size *= float(situation.compliance[situation.axis(where)])
        return np.array([size])

    def coefficient_of(self, size: float) -> float:
        """Return the coefficient at a value of `sized_by`.

        Over the axis' compliance where that is a ratio. How far the value is from where
        it does nothing, unless overridden.
        """
        return size - self.nothing[self.sized_by]

    def limits_at(
        self, situation: StaticState, where: str
    ) -> Mapping[str, tuple[float, float]]:
        """Return the limits at a site; `limits` at every site, unless overridden."""
        return self.limits

    def grain(self, situation: StaticState) -> Mapping[str, float]:
        """Return the change of a parameter below which no reading changes."""
        return {}


# --- Torques and angles of axes -------------------------------------------------------

ORDERS = np.array([1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0])
"""Periods per turn that are tried; chosen: postures of a bench, a radian or two apart,
cannot distinguish the hundreds of periods of a gear's teeth from chance."""
LEAST_PHASE = 1.0
"""Minimum range of phase that the postures must cover for a periodic law, in rad;
chosen."""
LEAST_REVERSAL = 0.01
"""Minimum ratio of the largest torques of either sign for a reversal to count;
chosen."""


def sprung(situation: StaticState) -> tuple[str, ...]:
    """Return the axes whose spring is fitted as a nuisance parameter."""
    soft = situation.compliance > 0.0
    return tuple(a for a, s in zip(situation.axes, soft, strict=True) if s)


def reversing(situation: StaticState) -> tuple[str, ...]:
    """Return the axes whose torque takes either sign."""
    high, low = situation.torque.max(axis=0), situation.torque.min(axis=0)
    both = np.minimum(high, -low) > LEAST_REVERSAL * np.maximum(high, -low)
    return tuple(a for a, b in zip(situation.axes, both, strict=True) if b)


def orders(situation: StaticState, axis: int) -> Float[np.ndarray, " orders"]:
    """Return the periods per turn of which an axis' postures cover enough.

    None for a slide, which has no turn.
    """
    if situation.arm.slides[axis]:
        return ORDERS[:0]
    span = np.ptp(situation.recording.posture[:, axis])
    return ORDERS[ORDERS * span >= LEAST_PHASE]


MOST_PARTS, ORDERS_APART = 3, 0.75
"""Parts of a law that is a sum, and how far apart the orders of waves are at least;
chosen: postures a radian or two apart show no more."""


def apart(
    some: Iterable[float],
    least: float,
    given: Iterable[float] = (),
    scale: Callable[[float], float] = float,
) -> list[float]:
    """Return values that are apart from given ones and from each other.

    Args:
        some: The values; what comes first is kept.
        least: By how much, on the scale.
        given: Values that are there already.
        scale: On which values are compared, such as a logarithm.
    """
    first = [*given]
    found = [*first]
    for value in some:
        if all(abs(scale(value) - scale(other)) >= least for other in found):
            found.append(float(value))
    return found[len(first) :]


def still(situation: StaticState, axis: int) -> bool:
    """Return whether a hinge hardly turns, so that a law of its angle is constant."""
    return not situation.arm.slides[axis] and not len(orders(situation, axis))


def absolute(situation: StaticState) -> bool:
    """Return whether displacements that are constant throughout a visit can be seen."""
    return situation.recording.displacement == "absolute"


# --- Bodies and their markers ---------------------------------------------------------


def axes_of(situation: StaticState, body: str) -> Float[np.ndarray, "rows 3 3"]:
    """Return a body's axes as columns along the base's."""
    place = situation.arm.attachment(body)
    return situation.frame[:, place.axis + 1] @ place.placement[:3, :3]


def point_of(
    situation: StaticState, body: str, position: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "rows 3"]:
    """Return the position of a point of a body, in the base's frame, in m.

    Args:
        situation: Static state of the arm.
        body: Which body.
        position: The point in the body's frame, in m.
    """
    axis, inside = (
        situation.arm.attachment(body).axis,
        inside_of(situation, body, position),
    )
    return situation.origin[:, axis + 1] + situation.frame[:, axis + 1] @ inside


def marked_point(situation: StaticState, m: int) -> Float[np.ndarray, "rows 3"]:
    """Return the position of a marker, or its body's origin if not stated."""
    marker = situation.recording.markers[m]
    place = np.zeros(3) if marker.position is None else marker.position
    return point_of(situation, marker.body, place)


def inside_of(
    situation: StaticState, body: str, position: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3"]:
    """Return a point of a body in the frame of the body that carries it, in m."""
    placement = situation.arm.attachment(body).placement
    return placement[:3, :3] @ position + placement[:3, 3]


# --- Sites ---------------------------------------------------------------------------

OFF_THE_ARM = 99
"""Number of a site that is no axis, link or base; beyond any axis."""


def are_neighbours(one: str, other: str) -> bool:
    """Return whether two sites are the same, or neighbours along the arm."""
    on_arm = max(*_axes_at(one), *_axes_at(other)) < OFF_THE_ARM
    return one == other or (on_arm and are_near(one, other))


def are_near(one: str, other: str) -> bool:
    """Return whether two sites are neighbours, or both are no axis, link or base."""
    pairs = ((a, b) for a in _axes_at(one) for b in _axes_at(other))
    return min(abs(a - b) for a, b in pairs) <= 1


def _axes_at(where: str) -> tuple[int, ...]:
    """Return the numbers of the axes at a site: both of a link, 0 for the base."""
    last = site_number(where)
    return (last - 1, last) if where.startswith("link_") else (last,)


def site_number(where: str) -> int:
    """Return the place of the map where something shows: of a link, the axis after.

    0 for the base, far for a tool and for instruments.
    """
    digits = where.removeprefix("link_").removeprefix("a")
    number = int(digits) if digits.isdigit() else 0 if where == "base" else OFF_THE_ARM
    return number + where.startswith("link_")
