"""Two effects that move the markers alike cannot be told apart by any method.

==========  ==========================================================================
Equation    cosine of two signatures after the nominal columns are projected out; for
            several columns the largest over directions (first canonical correlation)
            of the smaller signature's fitted direction
Source      Hotelling 1936, "Relations between two sets of variates"
Valid       at the shapes that were found
Ignores     that a third effect may confound two
==========  ==========================================================================
"""

import numpy as np

from stiffness.diagnosis.diagnosis import Name
from stiffness.diagnosis.library import Library
from stiffness.diagnosis.sets import White

TOO_ALIKE = 0.95
"""The rule of the answer's goals: pairs above this cosine are confounded."""


def confounded_with(
    library: Library, white: White, names: set[tuple[str, str]]
) -> tuple[tuple[Name, Name], ...]:
    """Return the pairs with a named effect that these data hardly tell apart."""
    pairs = []
    for i, candidate in enumerate(library.candidates):
        if candidate.name not in names or not len(white.owned[i]):
            continue
        own = white.owned[i]
        direction = white.score[own]
        size = np.linalg.norm(direction)
        if size == 0.0:
            continue
        for j, other in enumerate(library.candidates):
            if other.name == candidate.name or not len(white.owned[j]):
                continue
            seen = white.product[np.ix_(white.owned[j], own)] @ (direction / size)
            if np.linalg.norm(seen) > TOO_ALIKE:
                pairs.append((Name(*candidate.name), Name(*other.name)))
    once = {
        frozenset(((a.effect, a.where), (b.effect, b.where))): (a, b) for a, b in pairs
    }
    return tuple(once.values())
