"""Features of networks: encoding of angles and scaling to unit variance.

Encoding of angles as sines and cosines (`sine_and_cosine`):

==========  ==========================================================================
Equation    x_i = sin(q_i), y_i = cos(q_i)
Source      Wu et al. 2024, Eq. 5 and section 4.1
Valid       turning axes; a slide's coordinate in m is treated as an angle in rad
Ignores     units, which `Scaling` removes
==========  ==========================================================================

The paper wants "twelve neurons" in the input layer and sines and cosines as well, which
cannot both be: six angles as pairs and six components of the wrench are eighteen.
Chosen is `sine_and_cosine`: twelve quantities are encoded as eighteen inputs. The other
reading is `plain_angles`: twelve inputs and no sines.

Scaling to zero mean and unit variance (`Scaling`):

==========  ==========================================================================
Equation    z = (x - mean) / scale, scale = the standard deviation over the rows
Source      LeCun, Bottou, Orr, Müller 1998, "Efficient BackProp", section 4.3
Valid       rows of the same distribution as later ones
Ignores     correlation between columns
==========  ==========================================================================
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, TypeAlias

import numpy as np
from jaxtyping import Float

from bench.shared.errors import UnknownName

# --- Encoding of angles ---------------------------------------------------------------

Encoding: TypeAlias = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Function from postures in rad and wrenches in N and N m to a network's inputs."""


def sine_and_cosine(
    posture: Float[np.ndarray, "rows axes"], wrench: Float[np.ndarray, "rows 6"]
) -> Float[np.ndarray, "rows inputs"]:
    """Return sines, cosines, then the wrench: 18 inputs for six axes."""
    return np.hstack([np.sin(posture), np.cos(posture), wrench])


def plain_angles(
    posture: Float[np.ndarray, "rows axes"], wrench: Float[np.ndarray, "rows 6"]
) -> Float[np.ndarray, "rows inputs"]:
    """Return angles in rad, then the wrench: 12 inputs for six axes."""
    return np.hstack([posture, wrench])


ENCODINGS: Final[Mapping[str, Encoding]] = MappingProxyType(
    {"sine_and_cosine": sine_and_cosine, "plain_angles": plain_angles}
)
"""Both encodings, by the names that files give them."""


def encoding(name: str) -> Encoding:
    """Return an encoding by its name.

    Raises:
        UnknownName: Where there is none of that name.
    """
    if name not in ENCODINGS:
        raise UnknownName("encoding", name, ENCODINGS)
    return ENCODINGS[name]


# --- Scaling --------------------------------------------------------------------------

CONSTANT = 1e-9
"""Range below which a column is constant; chosen: rounding of sines is 1e-16."""


@dataclass(frozen=True)
class Scaling:
    """Standardisation of columns, and its inverse.

    A constant column has an infinite scale, so that it is always zero: the network
    has not learnt from it, and its prediction must not depend on it.

    Attributes:
        mean: Mean of each column.
        scale: Standard deviation of each column; infinite where it is constant.
    """

    mean: Float[np.ndarray, " columns"]
    scale: Float[np.ndarray, " columns"]

    @classmethod
    def of(cls, values: Float[np.ndarray, "rows columns"]) -> "Scaling":
        """Return the scaling by mean and standard deviation of each column."""
        scale = values.std(axis=0)
        return cls(values.mean(axis=0), np.where(scale > CONSTANT, scale, np.inf))

    def unitless(
        self, values: Float[np.ndarray, "rows columns"]
    ) -> Float[np.ndarray, "rows columns"]:
        """Return standardised values, without units."""
        return (values - self.mean) / self.scale

    def in_units(
        self, values: Float[np.ndarray, "rows columns"]
    ) -> Float[np.ndarray, "rows columns"]:
        """Return values in units; constant columns are at their mean."""
        return self.mean + values * np.where(np.isfinite(self.scale), self.scale, 0.0)
