"""A hypothesis says what one physical effect would do to the readings if it were there.

It knows the law and its physical bounds, never how a simulator builds it. A law's
amplitudes enter linearly and are its *coefficients*; what bends its form (a knee, a
time constant, an order) is its *shape* and is searched. Each hypothesis is a file of
its own, with a table of Equation, Source, Valid and Ignores on top, and one frozen
dataclass; `hypotheses/__init__.py` lists them in a tuple that one can read.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from jaxtyping import Float

from stiffness.diagnosis.signature import Signature
from stiffness.diagnosis.situation import Situation


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
        sizes: Parameters that are zero, or stiff without end, where the effect is not
            there: what may be so in all of them gets no name. Ratios, and what is no
            size, such as a phase, say nothing here.
        logarithmic: Parameters whose error is a factor rather than a difference.
        linear: Whether it gives way in proportion to the loads of a row, and to nothing
            else.
        log_prior: How much rarer than others it is, as a log; 0 where nothing is known.
    """

    effect: ClassVar[str]
    shape_names: ClassVar[tuple[str, ...]] = ()
    limits: ClassVar[Mapping[str, tuple[float, float]]]
    sizes: ClassVar[tuple[str, ...]] = ()
    logarithmic: ClassVar[tuple[str, ...]] = ()
    linear: ClassVar[bool] = False
    log_prior: ClassVar[float] = 0.0

    @abstractmethod
    def places(self, situation: Situation) -> tuple[str, ...]:
        """Return where the effect could sit and could be seen, as `where` in an answer.

        Leave out a place where these rows cannot show it (creep where nothing waits,
        an axis without torque); what is left in must give a signature.
        """

    @abstractmethod
    def shapes(
        self, situation: Situation, where: str
    ) -> Float[np.ndarray, "shapes parameters"]:
        """Return a coarse grid of shapes within their physical bounds, one a row.

        At most about eight: neighbours should have signatures with a cosine near 0.95.
        The engine refines between the grid's outermost values. Without shape
        parameters: one row with no entry, `np.zeros((1, 0))`.
        """

    @abstractmethod
    def signature(
        self, situation: Situation, where: str, shape: Float[np.ndarray, " parameters"]
    ) -> Signature:
        """Return what one unit of each coefficient does."""

    @abstractmethod
    def variants(
        self, situation: Situation, where: str, shape: Float[np.ndarray, " parameters"]
    ) -> Signature:
        """Return what other accepted forms of the same law add, once it is named.

        A gear's hardening is tabled in three pieces or written with a tanh: both are
        hardening. The residual test after naming does not hold these against the name.
        They never help to find the name, and must be too narrow to imitate another
        effect. Return `NOTHING` where the law has one form.
        """

    @abstractmethod
    def parameters(
        self,
        situation: Situation,
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
        situation: Situation,
        where: str,
        shape: Float[np.ndarray, " parameters"],
        coefficients: Float[np.ndarray, " columns"],
    ) -> Situation:
        """Return the situation as springs and other effects feel it with this in it.

        The same, unless overridden, as masses and a wrench that is read wrongly do:
        others move the arm, or what they change of its loads is left out.
        """
        return situation

    def limits_at(
        self, situation: Situation, where: str
    ) -> Mapping[str, tuple[float, float]]:
        """Return the limits at a place; `limits` wherever it is, unless overridden."""
        return self.limits

    def grain(self, situation: Situation) -> Mapping[str, float]:
        """Return by how much a parameter can change without changing any reading."""
        return {}
