"""Base class of effects in the instruments instead of the arm."""

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np

from bench.effects.effect import Effect
from bench.instruments import Instruments


@dataclass(frozen=True)
class InstrumentEffect(Effect):
    """Effect in the reading of an instrument."""

    @abstractmethod
    def fault(self, instruments: Instruments) -> Instruments:
        """Return the instruments with this fault added to those they have."""


def plus(a: tuple[float, ...], b: tuple[float, ...]) -> tuple[float, ...]:
    """Add two vectors, entry by entry."""
    return tuple(float(x) for x in np.add(a, b))
