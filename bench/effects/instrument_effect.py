"""Some of what seems to happen in an arm happens in the instruments that watch it."""

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np

from bench.effects.effect import Effect
from bench.instruments import Instruments


@dataclass(frozen=True)
class InstrumentEffect(Effect):
    """Happens in what an instrument makes of the world."""

    @abstractmethod
    def fault(self, instruments: Instruments) -> Instruments:
        """Return the instruments with this fault added to those they have.

        Args:
            instruments: Whatever faults they have already.
        """


def plus(a: tuple[float, ...], b: tuple[float, ...]) -> tuple[float, ...]:
    """Add two vectors, entry by entry."""
    return tuple(float(x) for x in np.add(a, b))
