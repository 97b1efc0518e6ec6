"""A small experiment on the default truth, and methods good and bad."""

import numpy as np
from typing_extensions import override

from scenarios.studies.paper.experiment import Experiment, Material, carry_out
from scenarios.studies.paper.fresh_postures import unseen
from stiffness.methods.method import Fitted, Method
from stiffness.methods.vjm import Vjm
from stiffness.robot.arm import Arm

POSES = 40
"""As few as still show every spring, four fifths of them too."""


def small_experiment() -> tuple[Experiment, Material]:
    """Carry out the experiment on a few postures, and simulate a few fresh ones."""
    experiment = carry_out(0, POSES)
    fresh = unseen(experiment.rig, experiment.arm, 12, 0)
    return experiment, Material.of(experiment, fresh)


class Mean(Method):
    """Predicts what springs do: a method of one's own that keeps to the contract."""

    def __init__(self, arm: Arm):
        """Keep the arm."""
        self.arm = arm

    def __repr__(self) -> str:
        """Say its name."""
        return type(self).__name__

    @override
    def fit(self, recording) -> Fitted:
        return Vjm(self.arm).fit(recording)


class Careless(Method, Fitted):
    """Changes itself, depends on what else is asked, and on chance."""

    def __init__(self, arm: Arm):
        """Forget the arm."""
        self.seen = 0

    def __repr__(self) -> str:
        """Say what it has seen."""
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
    """Predicts too few numbers."""

    @override
    def predict(self, cases):
        return np.zeros(len(cases))


NOT_A_CLASS = 3
