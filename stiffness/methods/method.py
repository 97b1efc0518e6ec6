"""A method is a way to learn how an arm deflects; what it learns is another thing."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from bench.recording import Recording
from stiffness.load_cases import LoadCases


@dataclass(frozen=True)
class Parameter:
    """One number that a method has found, and how sure it is.

    Attributes:
        name: What it is called.
        value: In `unit`.
        sigma: Standard deviation if the stated noise were all that errs, in `unit`.
        unit: Its unit.
        low: Lower end of the 95 % interval that also carries the model's own error.
        high: Upper end.
    """

    name: str
    value: float
    sigma: float
    unit: str
    low: float
    high: float


class Fitted(ABC):
    """What a method has learnt from a recording."""

    @abstractmethod
    def predict(self, cases: LoadCases) -> Float[np.ndarray, "cases 3"]:
        """Predict how far the end-effector point of each case moves.

        Args:
            cases: What is done to the arm.

        Returns:
            Loaded minus unloaded, along the base's axes, in m.
        """

    @property
    @abstractmethod
    def parameters(self) -> tuple[Parameter, ...]:
        """The numbers found; none where a method has none that mean anything."""


class Method(ABC):
    """A way to learn; built from a nominal arm and settings, never from data."""

    @abstractmethod
    def fit(self, recording: Recording) -> Fitted:
        """Learn from what the instruments saw; the method itself stays as it was.

        Args:
            recording: One experiment.

        Returns:
            What was learnt, as a new object.

        Raises:
            Unusable: Where the recording cannot be used, with all faults.
            NotIdentifiable: Where it does not show what the method must find.
        """
