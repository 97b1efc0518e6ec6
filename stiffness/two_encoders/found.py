"""What was found between the encoders of an axis, and how it came to be believed."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from stiffness.two_encoders.fitting import columns
from stiffness.two_encoders.motions import Motion
from stiffness.two_encoders.terms import Term


@dataclass(frozen=True)
class Trial:
    """A term that was tried.

    Attributes:
        term: The term.
        coefficients: In SI, fitted together with what was believed.
        gain: Mean over stretches of motions left out.
        error: Its standard error.
        reason: Why it was refused; empty: it was believed.
        beside: What was tried together with it.
    """

    term: Term
    coefficients: tuple[float, ...]
    gain: float
    error: float
    reason: str
    beside: tuple[Term, ...] = ()


@dataclass(frozen=True)
class Between:
    """What lies between the encoders of an axis.

    Attributes:
        terms: What was believed, in that order.
        x: Their coefficients, term by term, in SI.
        half: Half the width of their 95 % intervals.
        refused: What was tried last and not believed.
        believed: How each was believed.
        delay: By how much the second encoder tells late, in s.
        creeps: Whether it only lags in proportion to speed; see `Motion.later`.
        late: How that was believed; None: there is no delay.
        late_half: Half the width of its 95 % interval.
        at_least: Whether it may be longer, since friction hides it on every axis.
    """

    terms: tuple[Term, ...]
    x: Float[np.ndarray, " columns"]
    half: Float[np.ndarray, " columns"]
    refused: tuple[Trial, ...]
    believed: tuple[Trial, ...]
    delay: float = 0.0
    creeps: bool = False
    late: "Trial | None" = None
    late_half: float = 0.0
    at_least: bool = False

    def left(self, motion: Motion) -> Float[np.ndarray, " rows"]:
        """Return what stays unexplained of a motion, its own constant taken off."""
        then = self.then(motion)
        return then.apart - columns(self.terms, then) @ self.x

    def then(self, motion: Motion) -> Motion:
        """Return the motion that the second encoder tells of."""
        return motion.later(self.delay, self.creeps)

    def value(self, effect: str, parameter: str) -> float:
        """Return the sum of a parameter's coefficients; 0 where there is none."""
        return float(
            sum(x for e, p, x in self.known() if (e, p) == (effect, parameter))
        )

    def known(self) -> list[tuple[str, str, float]]:
        """Return effect, parameter and coefficient of every column."""
        names = [(t.effect, p) for t in self.terms for p in t.parameters]
        return [(e, p, float(v)) for (e, p), v in zip(names, self.x, strict=True)]
