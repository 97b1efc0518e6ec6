"""A small experiment on the default truth, and methods within and against contract."""

import numpy as np
from typing_extensions import override

from scenarios.studies.paper.experiment import Experiment, Material, carry_out, unseen
from stiffness.methods.method import Fitted, Method
from stiffness.methods.vjm import Vjm
from stiffness.robot.arm import Arm

POSES = 40
"""The fewest that identify every spring, also from four fifths of them."""


def small_experiment() -> tuple[Experiment, Material]:
    """Return the experiment on a few postures, and its material with fresh ones."""
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
