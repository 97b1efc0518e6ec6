"""What is left where a name stands may be its own law's, for laws are only so true."""

from collections.abc import Sequence

import numpy as np

from stiffness.diagnosis.case import Case
from stiffness.diagnosis.detect import ALARM, Found
from stiffness.diagnosis.member import SetFit, fit_set

CONTRADICTS = 0.002
"""Share of what a name explains that may be left over beside it, where the residual
test rejects, before the name is taken back; nor does that little earn another name at
its place. Chosen: rightly named effects leave nothing that the test rejects, wrong ones
of the same place a hundredth and more."""


def alone(case: Case, fit: SetFit) -> list[float]:
    """Return what each member explains that the others do not."""
    gains = []
    for k in range(len(fit.members)):
        others = [m for i, m in enumerate(fit.members) if i != k]
        less = fit_set(case.data, case.situation, case.nominal, others, case.split)
        gains.append(max(fit.gain - less.gain, 0.0))
    return gains


def is_own(left: Found, fit: SetFit, gains: Sequence[float]) -> bool:
    """Return whether all that speaks is slight and stands where a member does.

    Args:
        left: The test of what is left.
        fit: The set that was taken out.
        gains: What each member explains that the others do not.
    """
    allowed = {"": CONTRADICTS * max(gains, default=0.0)}  # of the whole map
    for member, gain in zip(fit.members, gains, strict=True):
        allowed[member.where] = max(allowed.get(member.where, 0.0), CONTRADICTS * gain)
    loud = np.flatnonzero(left.tested.together < ALARM)
    excess = left.tested.captured - left.tested.freedom
    return len(loud) > 0 and all(
        excess[at] <= allowed.get(left.where[at], -1.0) for at in loud
    )
