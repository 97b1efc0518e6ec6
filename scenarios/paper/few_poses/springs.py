"""Few poses may not show every axis; what they do not show, the model file says."""

import numpy as np

from bench.errors import NotIdentifiable
from bench.recording import Recording
from stiffness.arm import Arm
from stiffness.methods.vjm import Vjm, VjmFit


def few_of(recording: Recording, poses: int, draw: int) -> Recording:
    """Draw some poses of a recording, with all of their visits."""
    known = np.unique(recording.pose)
    order = np.random.default_rng([draw, len(known)]).permutation(known)
    return recording.take(np.isin(recording.pose, order[:poses]))


def springs_of(arm: Arm, few: Recording) -> tuple[VjmFit, tuple[str, ...]]:
    """Fit springs, holding as many axes as must be, and say which.

    Of the axes that a refusal names, the one furthest out is held, until none is named:
    its spring moves the tool by the shortest lever, so the model's value harms least.

    Raises:
        NotIdentifiable: Where no axis can be identified, the others held.
    """
    held: tuple[str, ...] = ()
    while True:
        try:
            return Vjm(arm, held).fit(few), held
        except NotIdentifiable as refusal:
            free = [axis for axis in arm.axes if axis not in held]
            if len(free) == 1:
                raise
            furthest = [axis for axis in free if axis in refusal.axes] or free
            held = tuple(a for a in arm.axes if a in (*held, furthest[-1]))
