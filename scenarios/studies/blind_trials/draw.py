"""Draws blind trials and the errors of their instruments from seeds.

A trial follows from the sweep's seed, its stratum and its number alone, so trial 7 of a
stratum is the same however many are asked for, and whatever was run before. Trials with
a mechanism outside the vocabulary in a whole arm have the arms of the stratum without.

Every trial has the usual nuisance: an unknown tracker frame, markers beside their
nominal positions, noise and hidden readings. The stratum `null_nuisance` has the worst
instruments of a good cell, in turn; all errors are within what the recording states.
"""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from bench.effects import EFFECTS, OTHER_LAWS
from bench.effects.effect import Effect
from bench.effects.out_of_library import OUT_OF_LIBRARY_EFFECTS
from bench.instruments import Encoders, ForceSensor, Instruments, Markers, Tracker
from bench.instruments.encoders import ARRIVAL
from bench.instruments.force_sensor import SIZE, TURN
from scenarios.studies.blind_trials.arms import THE_KR10, Arm
from scenarios.studies.blind_trials.strata import STRATA, Stratum

# --- Instruments ----------------------------------------------------------------------

PLACEMENT, OCCLUSIONS = 5e-4, 0.02
"""One sigma of a marker's position error, in m; share of readings that are hidden."""
FIELD = 1.5e-5
"""Spatially correlated error of the tracker in m, in the stratum that has one."""
DEPTH = (1e-5, 1e-5, 2.5e-5)
"""Noise of a tracker that is worst in depth, along its axes, in m."""


def instruments_of(stratum: Stratum, number: int) -> Instruments:
    """Return instruments with the usual nuisance, or one of the worst in turn."""
    usual = Instruments(
        tracker=Tracker(occlusions=OCCLUSIONS),
        markers=Markers(
            "flange" if stratum.targets == "flange" else "all", placement=PLACEMENT
        ),
    )
    if stratum.name != "null_nuisance":
        return usual
    tracker = usual.tracker
    worst = (
        replace(usual, force_sensor=ForceSensor(turn=TURN, size=SIZE)),
        replace(usual, tracker=replace(tracker, repeatability=DEPTH)),
        replace(usual, tracker=replace(tracker, field=FIELD)),
        replace(usual, encoders=Encoders(arrival=ARRIVAL)),
        replace(
            usual,
            tracker=replace(tracker, repeatability=DEPTH, field=FIELD),
            force_sensor=ForceSensor(turn=TURN, size=SIZE),
            encoders=Encoders(arrival=ARRIVAL),
        ),
    )
    return worst[number % len(worst)]


# --- Trials ---------------------------------------------------------------------------

SPREAD = 3.0
"""True stiffness over the model's: up to this factor either way, by the bars' rule."""


@dataclass(frozen=True)
class BlindTrial:
    """The draws of one trial that precede any simulation.

    Attributes:
        stratum: Kind of trial.
        robot: Model file of the arm.
        number: Number within its stratum, from 0.
        name: Name that does not disclose stratum and number; used for files.
        seed: Of the instruments.
        stiffness: True stiffness over the model's, axis by axis.
        instruments: Instruments that record it.
        chance: Seed sequence of all further draws.
    """

    stratum: Stratum
    robot: Path
    number: int
    name: str
    seed: int
    stiffness: Float[np.ndarray, " axes"]
    instruments: Instruments
    chance: np.random.SeedSequence

    @property
    def label(self) -> str:
        """Stratum and number, for logs and reports."""
        return f"{self.stratum.name} {self.number}"


def trials_of(
    seed: int, strata: Sequence[str], first: int, beyond: int, arm: Arm = THE_KR10
) -> Iterator[BlindTrial]:
    """Draw trials, one of each stratum in turn.

    Args:
        seed: Of the sweep.
        strata: Names of the strata.
        first: Number of the first of each stratum.
        beyond: Number after the last.
        arm: Arm of the trials.
    """
    for number in range(first, beyond):
        for name in strata:
            yield trial_of(seed, name, number, arm)


def trial_of(seed: int, stratum: str, number: int, arm: Arm = THE_KR10) -> BlindTrial:
    """Draw one trial.

    Args:
        seed: Of the sweep.
        stratum: Name of its stratum.
        number: Number within its stratum.
        arm: Arm of the trial.
    """
    kind = list(STRATA).index(STRATA[stratum].arm_of or stratum)
    chance = np.random.SeedSequence(seed, spawn_key=(kind, number))
    nuisance, further = chance.spawn(2)
    draw = np.random.default_rng(nuisance)
    return BlindTrial(
        stratum=STRATA[stratum],
        robot=arm.file,
        number=number,
        name=name_of(seed, stratum, number),
        seed=int(draw.integers(2**31)),
        stiffness=SPREAD ** draw.uniform(-1.0, 1.0, arm.axes),
        instruments=instruments_of(STRATA[stratum], number),
        chance=further,
    )


def name_of(seed: int, stratum: str, number: int) -> str:
    """Return a trial's name, which does not disclose what it is."""
    return hashlib.sha256(f"{seed}/{stratum}/{number}".encode()).hexdigest()[:12]


def kinds_of(
    trial: BlindTrial, draw: np.random.Generator, attempt: int
) -> list[type[Effect]]:
    """Return the kinds of effects of a trial, in turn, so that all are as frequent.

    Args:
        trial: The trial.
        draw: Random numbers, for the second effect.
        attempt: Counts from 0; every fourth goes on to the next kind.
    """
    if not trial.stratum.least:
        return []
    pool = pool_of(trial.stratum)
    turn = trial.number + attempt // 4
    first = pool[turn % len(pool)]
    if len(trial.stratum.least) == 1:
        return [first]
    others = [kind for kind in pool if kind is not first]
    return [first, others[int(draw.integers(len(others)))]]


def pool_of(stratum: Stratum) -> list[type[Effect]]:
    """Return the mechanisms that the trials of a stratum conceal, in turn."""
    mechanisms = {
        "vocabulary": EFFECTS,
        "other_laws": OTHER_LAWS,
        "outside": OUT_OF_LIBRARY_EFFECTS,
    }[stratum.mechanisms]
    by_name = {kind.name: kind for kind in mechanisms}
    return [by_name[name] for name in stratum.pool]
