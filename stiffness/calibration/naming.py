"""What was believed gets a name where it is clearly there, however many were tried.

==========  ==========================================================================
Equation    a number is clear where |value| > half t(1 - a / 2m) / t(1 - a / 2), half
            its interval's half width, a = 5 %, m units tried, R - 1 freedoms; a name
            needs a clear number and a loss of more than two standard errors; a table
            needs a wave that is not zero, and that it or its loss be clear
Source      Dunn 1961, "Multiple comparisons among means", JASA 56, 52
Valid       ten regions or more
Ignores     what of it is common to several names: they are fitted together
==========  ==========================================================================
"""

from collections.abc import Iterator, Mapping

from scipy.stats import norm
from scipy.stats import t as student

from stiffness.calibration.alike import MARGIN
from stiffness.calibration.blocks import Key
from stiffness.calibration.claims import Wave
from stiffness.calibration.intervals import LEVEL, Estimate
from stiffness.calibration.selection import Selected


def named(
    chosen: Selected,
    estimates: Mapping[Key, Mapping[str, Estimate]],
    waves: Mapping[str, Wave],
    regions: int,
) -> Iterator[Key]:
    """Yield what was believed and is clearly there, the one that matters most first.

    Args:
        chosen: What was believed, and what was tried.
        estimates: Numbers with their intervals.
        waves: Of each table the largest wave that is clearly there.
        regions: How many regions were fitted.
    """
    tried = max(len({(s.key, s.parameters) for s in chosen.steps}), 1)
    tail = (1.0 - LEVEL) / 2
    wider = float(student.isf(tail / tried, regions - 1))
    wider /= float(student.isf(tail, regions - 1))
    for key, (loss, error) in sorted(chosen.budget.items(), key=lambda one: -one[1][0]):
        if loss <= MARGIN * error:
            continue
        if key[0] == "transmission_error":
            wave = waves[key[1]]
            sure = loss > norm.isf(2.0 * tail / tried) * error
            if wave.clear and (sure or wave.size > wider * wave.half):
                yield key
        elif any(_clear(e, wider) for e in estimates.get(key, {}).values()):
            yield key


def _clear(found: Estimate, wider: float) -> bool:
    return bool(abs(found.value) > wider * (found.high - found.low) / 2.0)
