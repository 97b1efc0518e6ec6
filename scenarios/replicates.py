"""A pose visited twice shows the noise that the tracker really has."""

import numpy as np
from jaxtyping import Float

from bench.recording import Recording


def replicate_noise(recording: Recording) -> tuple[Float[np.ndarray, "3"], int] | None:
    """Compare rows of the same pose, load and place in the visit's course.

    Returns:
        Their standard deviation along x, y, z of the tracker, in m, pooled over
        markers, and how many degrees of freedom it has; None without replicates.
    """
    points, visits = recording.points, recording.visit
    if points is None:
        return None
    _, first = np.unique(visits, return_index=True)
    start = first[np.searchsorted(visits[first], visits)]
    if recording.displacement == "relative":
        points = points - points[start]
    load = recording.load_mass
    load = np.zeros(len(visits)) if load is None else load
    keys = np.stack([recording.pose, np.arange(len(visits)) - start, load], axis=1)
    _, group = np.unique(keys, axis=0, return_inverse=True)
    squares, freedom = np.zeros(3), 0
    for members in (points[group == g] for g in np.flatnonzero(np.bincount(group) > 1)):
        seen = members[:, np.isfinite(members).all(axis=(0, 2))]
        squares += np.sum((seen - seen.mean(axis=0)) ** 2, axis=(0, 1))
        freedom += (len(seen) - 1) * seen.shape[1]
    return (np.sqrt(squares / freedom), freedom) if freedom else None
