"""Every method learns from the same poses and is asked about the same others.

A seed splits the experiment's poses: 80 % are learnt from, 20 % are held out. FT-MLP
holds back a fifth of the first to choose its epoch, so nothing that judges has chosen.
"""

from scenarios.paper.budget import PLANS, Budget
from scenarios.paper.transfer.convolution_cell import ConvolutionCell
from scenarios.paper.transfer.own_method import OwnMethod
from scenarios.paper.transfer.perceptron_cell import PerceptronCell
from scenarios.paper.transfer.plain_cells import OwnCell, SpringsCell
from scenarios.paper.work.cells import Cell

UNFREEZINGS = ((1,), (2,), (3,), (4,), (5,), (1, 2), (2, 3), (3, 4), (4, 5))
ALL_LAYERS = (1, 2, 3, 4, 5)
"""Layers of Table 8: one, two neighbours, all; 5 is the output layer."""


def cells(budget: Budget, own: OwnMethod | None) -> list[Cell]:
    """Return every cell of Tables 8, 9 and 10."""
    settings = budget.transfer
    found: list[Cell] = []
    for i, seed in enumerate(settings.seeds):
        found.append(SpringsCell(seed, settings.evaluations))
        for plan in PLANS:
            shown = i < settings.unfreezing_seeds and plan == "spanning"
            layers = (*UNFREEZINGS, ALL_LAYERS) if shown else ()
            found.append(PerceptronCell(seed, plan, settings, layers))
            found.append(ConvolutionCell(seed, plan, settings))
        if own is not None:
            found.append(OwnCell(seed, own))
    return found
