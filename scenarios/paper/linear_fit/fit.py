"""Six linear springs are fitted to the experiment, and scored, as the paper does."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from scenarios.paper.experiment import Experiment
from stiffness.deflections import one_per_pose
from stiffness.methods.method import Fitted
from stiffness.methods.rigid import Rigid
from stiffness.methods.vjm import Vjm, VjmFit
from stiffness.score import Score, scores


@dataclass(frozen=True)
class LinearFit:
    """What was fitted and how far it is off.

    Attributes:
        fitted: The VJM.
        predicted: By each method, in m, along the base's axes.
        scores: Of each method.
        floor: Of the instruments alone: measured against true deflections.
    """

    fitted: VjmFit
    predicted: dict[str, Float[np.ndarray, "rows 3"]]
    scores: dict[str, tuple[Score, ...]]
    floor: tuple[Score, ...]


def fit(experiment: Experiment, seed: int) -> LinearFit:
    """Fit the springs to the experiment and score them on it, as the paper does."""
    recording, measured = experiment.recording, experiment.measured
    springs = Vjm(experiment.arm, select=one_per_pose).fit(recording)
    methods: dict[str, Fitted] = {
        "rigid": Rigid(experiment.arm).fit(recording),
        "vjm": springs,
    }
    predicted = {name: m.predict(measured.cases) for name, m in methods.items()}
    return LinearFit(
        fitted=springs,
        predicted=predicted,
        scores={
            name: scores(deflection, measured.deflection, measured.pose, seed)
            for name, deflection in predicted.items()
        },
        floor=scores(
            experiment.true_deflection, measured.deflection, measured.pose, seed
        ),
    )
