"""A load path is what hangs on the hook during one visit, step after step."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from bench.errors import Unusable
from bench.recording import LOADED, LOADING, UNLOADED, UNLOADING

HOLD = 20.0  # s; chosen: creep of a minute is under way, instruments have settled
DWELL = 120.0  # s; chosen: longer than the fast part of a gear's after-effect


@dataclass(frozen=True)
class LoadStep:
    """A mass on the hook, and how long it hangs before it is read.

    Attributes:
        mass: In kg; what hung before is replaced, not added to.
        hold: From the change of load to the reading, in s.

    Raises:
        Unusable: Where either is negative or not finite.
    """

    mass: float
    hold: float = HOLD

    def __post_init__(self):
        """Check the mass and the time, naming every fault."""
        faults = [
            f"{name} is {value} {unit}, expected a finite number of at least 0."
            for name, value, unit in (
                ("mass", self.mass, "kg"),
                ("hold", self.hold, "s"),
            )
            if not (np.isfinite(value) and value >= 0)
        ]
        if faults:
            raise Unusable("Load step", faults)


DEFAULT_PATH = (
    *(LoadStep(mass) for mass in (0.0, 2.5, 5.0, 7.5, 10.0)),
    LoadStep(10.0, DWELL),
    *(LoadStep(mass) for mass in (5.0, 2.5, 0.0)),
)
"""Up to the arm's payload of 10 kg, a long wait that shows creep, and down again.

The payload is the paper's (Wu et al. 2024, section 3.1); the nine steps are chosen: it
does not give its own. Up and down pass the same masses, so that history shows.
"""


def parse_path(text: str, hold: float = HOLD) -> tuple[LoadStep, ...]:
    """Read a load path such as `0,5,10,10@120,5,0`.

    Args:
        text: Masses in kg, separated by commas; `mass@seconds` has its own hold.
        hold: Of the steps that give none, in s.

    Raises:
        Unusable: Naming every step that is not a mass, and a loaded start.
    """
    steps, faults = [], []
    for number, item in enumerate(text.split(","), start=1):
        mass, _, seconds = item.partition("@")
        try:
            steps.append(LoadStep(float(mass), float(seconds) if seconds else hold))
        except ValueError:
            faults.append(
                f"step {number} is {item.strip()!r}, expected a mass in kg or "
                "mass@seconds, such as 5 or 10@120."
            )
        except Unusable as error:
            faults += [f"step {number}: {fault}" for fault in error.faults]
    if faults := faults or path_faults(steps):
        raise Unusable(f"Load path {text!r}", faults)
    return tuple(steps)


def stages(path: Sequence[LoadStep]) -> np.ndarray:
    """Return one of `bench.recording.STAGES` for each step.

    No mass: unloaded. The path's largest mass: loaded. Between them the last change
    decides: a mass put on is loading, one taken off is unloading.
    """
    largest = max(step.mass for step in path)
    found, mass = [], 0.0
    for step in path:
        if step.mass == 0.0:
            found.append(UNLOADED)
        elif step.mass == largest:
            found.append(LOADED)
        elif step.mass == mass:
            found.append(found[-1])
        else:
            found.append(LOADING if step.mass > mass else UNLOADING)
        mass = step.mass
    return np.array(found)


def path_faults(path: Sequence[LoadStep]) -> list[str]:
    """Return what is wrong with a path as a whole."""
    if not path:
        return ["the path has no step; start with 0 kg, the unloaded reading."]
    if path[0].mass != 0.0:
        return [
            f"the path starts with {path[0].mass:g} kg; start with 0 kg, the unloaded "
            "reading that deflections are measured from."
        ]
    return []


def directions(path: tuple[LoadStep, ...]) -> Float[np.ndarray, " steps"]:
    """Return +1 for each step whose load last grew, -1 where it last fell."""
    change = np.sign(np.diff([step.mass for step in path], prepend=0.0))
    last = np.maximum.accumulate(np.where(change != 0, np.arange(len(change)), 0))
    return np.where(change[last] < 0, -1.0, 1.0)
