"""A size of an instrument is a finite number, and most sizes are not negative."""

from collections.abc import Mapping

import numpy as np

from bench.errors import Unusable


def refuse(what: str, faults: list[str]) -> None:
    """Raise all faults at once, where there are any."""
    if faults:
        raise Unusable(what, faults)


def not_sizes(sizes: Mapping[str, object]) -> list[str]:
    """Name every entry that is not finite and at least 0."""
    return [
        f"{name} is {value}, expected finite and at least 0."
        for name, value in sizes.items()
        if not np.all(np.isfinite(np.asarray(value, float)))
        or np.any(np.asarray(value, float) < 0.0)
    ]


def not_vectors(vectors: Mapping[str, tuple[float, ...]], length: int) -> list[str]:
    """Name every entry that is not so many finite numbers."""
    return [
        f"{name} is {value}, expected {length} finite numbers."
        for name, value in vectors.items()
        if len(value) != length or not np.all(np.isfinite(value))
    ]
