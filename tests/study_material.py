"""A small experiment on a few effects, and methods within and against contract.

Run as a program it is the command `scenarios.study` on those effects.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from unittest import mock

import numpy as np
from asked_once import once
from typing_extensions import override

from bench.effects.bearing_tilt import BearingTilt
from bench.effects.hysteresis import Hysteresis
from bench.study_arm import Truth, default_truth
from scenarios.report.command_line import run
from scenarios.studies.paper import experiment as paper_experiment
from scenarios.studies.paper import floor as paper_floor
from scenarios.studies.paper.experiment import Experiment, Material, carry_out, unseen
from scenarios.study import Settings, main
from stiffness.diagnosis.diagnose import diagnose
from stiffness.diagnosis.result import Diagnosis
from stiffness.effects.bearing_tilt import BearingTilt as Tilt
from stiffness.effects.hysteresis import Hysteresis as OnPaper
from stiffness.methods import named_physics
from stiffness.methods.method import Fitted, Method
from stiffness.methods.vjm import Vjm
from stiffness.robot.arm import Arm

POSES = 40
"""The fewest that identify every spring, also from four fifths of them."""


FEW = ((Hysteresis, "a2"), (BearingTilt, "a3"))


LAWS = (OnPaper(), Tilt())
"""Among which the diagnosis looks for them."""


@contextmanager
def few_effects() -> Iterator[None]:
    """Give the study's arm two of its effects, and the diagnosis their laws alone.

    To name all takes half a minute, and to look among all laws four times as long.
    """
    whole = default_truth()
    kept = [e for e in whole.effects if (type(e), e.where) in FEW]
    few = Truth(tuple(kept), whole.stiffness)
    with (
        mock.patch.object(paper_experiment, "default_truth", lambda: few),
        mock.patch.object(paper_floor, "default_truth", lambda: few),
        few_laws(),
    ):
        yield


_among_few = once(partial(diagnose, hypotheses=LAWS))


def few_laws() -> "mock._patch[Callable[..., Diagnosis]]":
    """Have named physics look among a few laws, once in a recording; a context."""
    return mock.patch.object(named_physics, "diagnose", _among_few)


def small_experiment() -> tuple[Experiment, Material]:
    """Return the experiment on a few postures, and its material with fresh ones."""
    with few_effects():
        experiment = carry_out(0, POSES)
    fresh = unseen(experiment.rig, experiment.arm, 12, 0)
    return experiment, Material.of(experiment, fresh)


class Mean(Method):
    """A user's method that keeps to the contract: fits six springs."""

    def __init__(self, arm: Arm):
        """Store the arm."""
        self.arm = arm

    def __repr__(self) -> str:
        """Return the class' name."""
        return type(self).__name__

    @override
    def fit(self, recording) -> Fitted:
        return Vjm(self.arm).fit(recording)


class Careless(Method, Fitted):
    """Breaks the contract: changes in `fit`, depends on other cases and on chance."""

    def __init__(self, arm: Arm):
        """Ignore the arm."""
        self.seen = 0

    def __repr__(self) -> str:
        """Return a name that changes with each fit."""
        return f"Careless({self.seen})"

    @override
    def fit(self, recording) -> Fitted:
        self.seen += len(recording.time)
        return self

    @override
    def predict(self, cases):
        noise = np.random.default_rng().standard_normal((len(cases), 3))
        return 1e-6 * (cases.wrench_in_base[:, :3].mean(axis=0) + noise)

    @property
    @override
    def parameters(self):
        return ()


class Misshapen(Careless):
    """Breaks the contract: predicts too few numbers."""

    @override
    def predict(self, cases):
        return np.zeros(len(cases))


NOT_A_CLASS = 3


if __name__ == "__main__":
    with few_effects():
        run(main, Settings)
