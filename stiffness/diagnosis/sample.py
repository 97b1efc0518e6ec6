"""Beyond some number of poses more of them say nothing new: a sample is looked at.

Time and memory then stay where they are, however long a recording is.
"""

import numpy as np

from bench.recording import Recording
from stiffness.diagnosis.split import seed_of

MOST = 800
"""Poses that are looked at; chosen: five times the paper's, about 30 s on one core. An
effect of a twentieth of one reading's noise still has a whitened square of hundreds."""


def sample_of(recording: Recording, most: int = MOST) -> tuple[Recording, str]:
    """Draw the poses that are looked at, from a hash of the recording.

    Args:
        recording: The whole.
        most: How many poses at most.

    Returns:
        The recording of these poses, and a sentence that says so; empty where all are
        looked at.
    """
    poses = np.unique(recording.pose)
    if len(poses) <= most:
        return recording, ""
    random = np.random.default_rng(seed_of(recording))
    chosen = random.permutation(poses)[:most]
    note = (
        f"{most} of {len(poses)} poses are looked at, drawn at random; "
        "all numbers below are theirs."
    )
    return recording.take(np.isin(recording.pose, chosen)), note
