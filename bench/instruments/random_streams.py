"""Independent random streams, one for each cause of randomness."""

from collections.abc import Mapping

import numpy as np

from bench.shared.errors import Unusable

CAUSES = (
    "tracker_frame",
    "tracker_noise",
    "tracker_field",
    "occlusions",
    "placement",
    "wrench_noise",
    "wrench_turn",
    "arrival",
    "link_encoders",
)
"""Names of the streams. The order is fixed, since it determines seeds; append new
ones."""

Streams = Mapping[str, np.random.Generator]


def streams(seed: int) -> Streams:
    """Return a generator of random numbers for each cause.

    A cause draws the same numbers whatever the others do and however large it is: sizes
    multiply the draws, also a size of zero.

    Raises:
        Unusable: Where the seed is negative.
    """
    if seed < 0:
        raise Unusable("Seed", [f"it is {seed}, expected at least 0."])
    children = np.random.SeedSequence(seed).spawn(len(CAUSES))
    return dict(zip(CAUSES, map(np.random.default_rng, children), strict=True))
