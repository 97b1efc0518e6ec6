"""Checks of the sizes in an instrument's settings: finite, bounded, not negative."""

from collections.abc import Mapping

import numpy as np

from bench.shared.errors import Unusable


def refuse(what: str, faults: list[str]) -> None:
    """Raise all faults at once, where there are any."""
    if faults:
        raise Unusable(what, faults)


MAX_SIZE = 1e6
"""Largest size of any setting, in SI; chosen: beyond it is no instrument."""


def not_sizes(sizes: Mapping[str, object]) -> list[str]:
    """Name every entry that is not from 0 to `MAX_SIZE`."""
    return [
        f"{name} is {value}, expected at least 0 and at most {MAX_SIZE:g}."
        for name, value in sizes.items()
        if not np.all(
            (np.asarray(value, float) >= 0.0) & (np.asarray(value) <= MAX_SIZE)
        )
    ]


def not_vectors(vectors: Mapping[str, tuple[float, ...]], length: int) -> list[str]:
    """Name every entry that is not a vector of this length within `MAX_SIZE`."""
    return [
        f"{name} is {value}, expected {length} numbers from {-MAX_SIZE:g} to "
        f"{MAX_SIZE:g}."
        for name, value in vectors.items()
        if len(value) != length or not np.all(np.abs(value) <= MAX_SIZE)
    ]
