"""A network is shown angles either as they are or as their sines and cosines.

==========  ==========================================================================
Equation    x_i = sin(q_i), y_i = cos(q_i)
Source      Wu et al. 2024, Eq. 5 and section 4.1
Valid       turning axes; a slide's coordinate in m passes for an angle in rad
Ignores     units: `stiffness.networks.scaling` takes them away
==========  ==========================================================================

The paper wants "twelve neurons" in the input layer and sines and cosines as well, which
cannot both be: six angles as pairs and six components of the wrench are eighteen.
Taken is `sine_and_cosine`: twelve quantities go in, eighteen numbers reach the network.
The other reading is `plain_angles`: twelve and no sines.
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final, TypeAlias

import numpy as np
from jaxtyping import Float

from bench.errors import UnknownName

Encoding: TypeAlias = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Turns postures in rad and wrenches in N and N m into a network's inputs."""


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
"""Both readings, by the names that files give them."""


def encoding(name: str) -> Encoding:
    """Return an encoding by its name.

    Raises:
        UnknownName: Where there is none of that name.
    """
    if name not in ENCODINGS:
        raise UnknownName("encoding", name, ENCODINGS)
    return ENCODINGS[name]
