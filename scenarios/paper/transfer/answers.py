"""What was learnt is asked for poses it has seen, poses held out, and fresh ones."""

import numpy as np

from scenarios.paper.material import Material
from stiffness.deflections import every_plateau
from stiffness.methods.ft_mlp import FtMlpFit
from stiffness.methods.method import Fitted


def answers(
    name: str, fitted: Fitted, material: Material, seed: int
) -> dict[str, np.ndarray]:
    """Return errors in mm on fresh poses, on poses held out and on the experiment."""
    measured = material.measured
    out = np.isin(measured.pose, material.held_out(seed))
    unseen = material.unseen
    error = 1e3 * (fitted.predict(measured.cases) - measured.deflection)
    return {
        f"{name}/unseen": 1e3 * (fitted.predict(unseen.cases) - unseen.deflection),
        f"{name}/held_out": error[out],
        f"{name}/experiment": error,
    }


def learnt(fit: FtMlpFit, material: Material, seed: int) -> np.ndarray:
    """Return MAE and STDE, Eqs 7 and 8, in mm, on training and on choosing poses."""
    data = every_plateau(fit.springs.arm, material.training(seed))
    error = 1e3 * np.abs(fit.predict(data.cases) - data.deflection)
    chose = np.isin(data.pose, fit.tuned.held_back)
    return np.array([[e.mean(), e.std()] for e in (error[~chose], error[chose])])
