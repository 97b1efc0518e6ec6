"""What the best names of the library leave of an effect is what makes it strange.

The library here is the diagnosis' own, for it is its names that must not be given; its
search runs over all sets of up to three names. It runs on an effect so large that what
chance adds, some fifty at most, is little. How large the effect is at all is weighed
elsewhere, without the diagnosis.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from bench.effects.effect import Effect
from bench.recording import Recording
from scenarios.nominal import arm_of
from scenarios.trials.sizes import OutOfReach, as_large_as
from scenarios.trials.weight import Weight
from stiffness.diagnosis.diagnose import case_of
from stiffness.diagnosis.hypotheses import HYPOTHESES
from stiffness.diagnosis.prepare import prepare
from stiffness.diagnosis.sets import ranked, white_candidates

PROBE = 4000.0
"""χ² of the effect that the library is tried on; chosen: chance adds about 1 %."""
LARGEST = 40_000.0
"""χ² beyond which an effect is taken to be explained by the library; chosen."""
LEFT = 1.3
"""Least that is left over what is asked, for the search's grid of shapes is coarse."""
SPAN = 4.0
"""Largest that is left over the least; chosen."""


def explained(recording: Recording, model: Path, without: Sequence[str]) -> float:
    """Return the χ² that the best set of up to three names of the library explains.

    Args:
        recording: With the effect.
        model: Of the nominal arm.
        without: Names that are left out.
    """
    arm = arm_of(model).for_recording(recording)
    names = [h for h in HYPOTHESES if h.effect not in without]
    prepared = prepare(recording, arm)
    case = case_of(prepared, names)
    white = white_candidates(case.library, case.evidence)
    sets = ranked(case.library, white, len(np.unique(recording.pose)), 1.0)
    return float(np.max(sets.gain))


def as_strange_as(
    effect: Effect,
    least: float,
    weigh: Callable[[Effect], Weight],
    captured: Callable[[Effect], float],
    draw: np.random.Generator,
) -> tuple[Effect, Weight]:
    """Find a size of which the library's best names leave at least a given χ².

    Args:
        effect: Of a catalogue's size.
        least: The χ² that has to be left.
        weigh: Simulates an effect and weighs what it changes.
        captured: Simulates an effect and returns what the library explains of it.
        draw: How much more than the least is left.

    Raises:
        OutOfReach: Where the library explains nearly all of it, or no size will do.
    """
    probe, weight = as_large_as(effect, PROBE, weigh)
    share = 1.0 - captured(probe) / (weight.within + weight.between)
    wanted = LEFT * least * SPAN ** draw.uniform(0.0, 1.0)
    if share * LARGEST < wanted:
        raise OutOfReach(f"The library explains {effect.name} at {effect.where}.")
    larger, weight = as_large_as(probe, wanted / share, weigh)
    return larger, replace(weight, left=share * weight.chi2)
