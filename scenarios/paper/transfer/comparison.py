"""What every method leaves on poses it has not seen, gathered over seeds and plans."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from scenarios.paper.budget import PLANS, Budget
from scenarios.paper.transfer.convolution_cell import ConvolutionCell
from scenarios.paper.transfer.own_method import OwnMethod
from scenarios.paper.transfer.perceptron_cell import PerceptronCell
from scenarios.paper.transfer.plain_cells import OwnCell, SpringsCell
from scenarios.paper.transfer.pooled import MEASURES, Draws, pooled
from scenarios.paper.work.cells import Cell, Result

TITLES = {
    "vjm": "VJM",
    "ft_mlp": "FT-MLP",
    "dt_cnn": "DT-CNN",
    "gp_residual": "VJM + GP",
    "pretrained": "MLP, not tuned",
    "aligned": "DT-CNN, aligned",
    "frozen": "DT-CNN, fine-tuned",
}
NO_PLAN = "-"


@dataclass(frozen=True)
class Contender:
    """One method, on one source plan where it has one.

    Attributes:
        method: Its name in tables that one computes with.
        title: Its name for readers.
        plan: Of its source domain; `-` where it has none.
        seeds: Of its splits and networks.
        unseen: Errors in mm of every seed on the fresh poses.
        held_out: Errors in mm of every seed on the measured poses it has not seen.
        experiment: Errors in mm of the first seed on all measured poses.
    """

    method: str
    title: str
    plan: str
    seeds: tuple[int, ...]
    unseen: Float[np.ndarray, "seeds poses 3"]
    held_out: Float[np.ndarray, "seeds out 3"]
    experiment: Float[np.ndarray, "measured 3"]

    def draws(self, direction: int, measure: str, seed: int = 0) -> Draws:
        """Return a measure on the fresh poses, pooled over seeds."""
        return pooled(self.unseen[:, :, direction], MEASURES[measure], seed)

    def held_out_draws(self, direction: int, measure: str, seed: int = 0) -> Draws:
        """Return it on the measured poses; each seed has its own, so they add up."""
        error = self.held_out[:, :, direction].reshape(1, -1)
        return pooled(error, MEASURES[measure], seed)

    def overall(self, seed: int = 0) -> Draws:
        """Return the MAE over all directions on the fresh poses, pooled over seeds."""
        return pooled(np.abs(self.unseen).mean(axis=2), MEASURES["MAE"], seed)

    @property
    def name(self) -> str:
        """Title and plan."""
        return self.title if self.plan == NO_PLAN else f"{self.title} ({self.plan})"


def contenders(
    budget: Budget, found: Mapping[Cell, Result], own: OwnMethod | None
) -> list[Contender]:
    """Gather every method, the paper's three first."""
    seeds, evaluations = budget.transfer.seeds, budget.transfer.evaluations
    springs = {seed: found[SpringsCell(seed, evaluations)] for seed in seeds}
    gathered = [of_results("vjm", NO_PLAN, springs, "vjm")]
    by_plan = {
        (kind, plan): dict(zip(seeds, perceptrons(budget, found, plan), strict=True))
        if kind is PerceptronCell
        else {s: found[ConvolutionCell(s, plan, budget.transfer)] for s in seeds}
        for plan in PLANS
        for kind in (PerceptronCell, ConvolutionCell)
    }
    wanted = [
        ("ft_mlp", PerceptronCell, "best"),
        ("dt_cnn", ConvolutionCell, "direct"),
        ("aligned", ConvolutionCell, "aligned"),
        ("frozen", ConvolutionCell, "frozen"),
        ("pretrained", PerceptronCell, "pretrained"),
    ]
    for method, kind, name in wanted:
        for plan in PLANS:
            results = by_plan[kind, plan]
            if f"{name}/unseen" in results[seeds[0]]:
                gathered.append(of_results(method, plan, results, name))
    gathered.append(of_results("gp_residual", NO_PLAN, springs, "gp_residual"))
    if own is not None:
        results = {seed: found[OwnCell(seed, own)] for seed in seeds}
        gathered.append(of_results(own.title, NO_PLAN, results, "own"))
    return gathered


def perceptrons(
    budget: Budget, found: Mapping[Cell, Result], plan: str
) -> list[Result]:
    """Return FT-MLP's cells of one plan, one a seed."""
    cells = [c for c in found if isinstance(c, PerceptronCell) and c.plan == plan]
    cells = {c.seed: c for c in cells if c.settings == budget.transfer}
    return [found[cells[seed]] for seed in budget.transfer.seeds]


def of_results(
    method: str, plan: str, by_seed: Mapping[int, Result], name: str
) -> Contender:
    """Gather one method's cells, one a seed.

    Args:
        method: Its name in tables.
        plan: Of its source domain, or `NO_PLAN`.
        by_seed: What the cells found.
        name: What the cells call it.
    """
    results = list(by_seed.values())
    return Contender(
        method,
        TITLES.get(method, method),
        plan,
        tuple(by_seed),
        np.stack([r[f"{name}/unseen"] for r in results]),
        np.stack([r[f"{name}/held_out"] for r in results]),
        results[0][f"{name}/experiment"],
    )
