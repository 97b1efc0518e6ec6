"""Cells in which networks of several shapes learn what six springs predict."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from scenarios.studies.paper.budget import Budget
from scenarios.studies.paper.cells import Cell, CellResult
from scenarios.studies.paper.experiment import Material
from stiffness.experiment.deflections import every_plateau
from stiffness.methods.transferred_networks import domain_of
from stiffness.methods.vjm import Vjm
from stiffness.networks.model import Mlp
from stiffness.networks.pretraining import Pretrained, Pretraining, pretrain, split
from stiffness.networks.source_domain import (
    SourcePlan,
    spanning_plan,
    table_4_postures,
    table_5_plan,
)
from stiffness.networks.training import Training

PLAN = "table 5"
"""Source plan of the sweep: the paper's own."""
CURVE = 200
"""Number of points kept of a loss curve; each is a mean over an interval of steps."""
SECONDS_A_WEIGHT = 4e-8
"""Time of a step of 256 rows per weight of the network, to which 2 ms are added."""


@dataclass(frozen=True)
class Imitation(Cell):
    """A network that is pre-trained on the springs of the whole experiment.

    Attributes:
        shape: Shape of the network.
        plan: Name of the source plan.
        steps: Training steps.
        seed: Of weights, split and order.
        every: Every how many of Table 4's postures are in the source plan.
    """

    shape: Mlp
    plan: str
    steps: int
    seed: int
    every: int = 1

    @property
    @override
    def cost(self) -> float:
        return step_cost(self.shape) * self.steps + 4.0

    @override
    def work(self, material: Material, scratch: Path) -> CellResult:
        arm, recording = material.arm, material.recording
        springs = Vjm(arm).fit(recording)
        data = every_plateau(arm, recording, springs.compliance)
        settings = Pretraining(
            self.shape, training=Training(steps=self.steps), seed=self.seed
        )
        domain = domain_of(springs, source_plan(self.plan, self.every), data)
        return imitated(pretrain(domain, settings, scratch))


def cells(budget: Budget, seed: int) -> list[Imitation]:
    """Return every cell of Tables 6 and 7 and Fig. 5, without repetitions."""
    found = [
        *(cell for row in depth_cells(budget).values() for cell in row),
        *(cell for row in longer_cells(budget).values() for cell in row),
        *(cell for row in activation_cells(budget).values() for cell in row),
        *width_cells(budget, seed).values(),
    ]
    return list(dict.fromkeys(found))


def depth_cells(budget: Budget) -> dict[int, list[Imitation]]:
    """Return the cells of Table 6, all seeds, by hidden layers."""
    return {
        depth: _seeds(budget, Mlp(depth, 100), budget.sweep.depth_steps)
        for depth in budget.sweep.depths
    }


def longer_cells(budget: Budget) -> dict[int, list[Imitation]]:
    """Return cells of four layers of 100, by number of steps."""
    return {
        steps: _seeds(budget, Mlp(4, 100), steps) for steps in budget.sweep.convergence
    }


def activation_cells(budget: Budget) -> dict[str, list[Imitation]]:
    """Return the cells of Table 7, all seeds, by activation."""
    chosen, steps = budget.sweep.chosen, budget.sweep.activation_steps
    return {
        name: _seeds(budget, Mlp(chosen.hidden, chosen.width, name), steps)
        for name in ("sigmoid", "tanh", "relu")
    }


def width_cells(budget: Budget, seed: int) -> dict[tuple[int, int], Imitation]:
    """Return the cells of Fig. 5, one seed, by hidden layers and width."""
    sweep = budget.sweep
    return {
        (depth, width): Imitation(
            Mlp(depth, width), PLAN, sweep.width_steps, seed, sweep.every
        )
        for depth in sweep.width_depths
        for width in sweep.widths
    }


def rows_of(cell: Imitation) -> tuple[int, int]:
    """Return how many rows train and test a cell."""
    rows = source_plan(cell.plan, cell.every).rows
    training, test = split(rows, cell.seed)
    return len(training), len(test)


def _seeds(budget: Budget, shape: Mlp, steps: int) -> list[Imitation]:
    sweep = budget.sweep
    return [Imitation(shape, PLAN, steps, s, sweep.every) for s in sweep.seeds]


def imitated(pretrained: Pretrained) -> dict[str, np.ndarray]:
    """Return errors on training and test rows, in mm, and the loss curve.

    Returns:
        `errors`: (training and test) x (MAE, STDE, ME) x (x, y, z); `loss` and `step`.
    """
    errors = [
        [e.mae, e.stde, e.me] for e in (pretrained.on_training, pretrained.on_test)
    ]
    step, loss = thinned(pretrained.loss)
    return {"errors": 1e3 * np.array(errors), "loss": loss, "step": step}


def thinned(
    loss: Float[np.ndarray, " steps"], points: int = CURVE
) -> tuple[Float[np.ndarray, " points"], Float[np.ndarray, " points"]]:
    """Return the end steps and mean losses of equal intervals of a curve."""
    parts = np.array_split(loss, min(points, len(loss)))
    ends = np.cumsum([len(part) for part in parts]).astype(float)
    return ends, np.array([part.mean() for part in parts])


def source_plan(name: str, every: int = 1) -> SourcePlan:
    """Return one of `budget.PLANS` over every so many of Table 4's postures."""
    postures = table_4_postures()[::every]
    return table_5_plan(postures) if name == "table 5" else spanning_plan(postures)


def step_cost(shape: Mlp) -> float:
    """Return the approximate time of a training step, in s."""
    weights = shape.width * (21 + (shape.hidden - 1) * shape.width)
    return 2e-3 + SECONDS_A_WEIGHT * weights
