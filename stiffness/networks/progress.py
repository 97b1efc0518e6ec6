"""A training somewhere on its way can be told of, written down and taken up again."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from jaxtyping import Float
from torch import nn

from stiffness.networks.shape import load, weights_of

EVERY = 500
"""Steps after which a training is written down; chosen: ten seconds."""


@dataclass(frozen=True)
class Progress:
    """A training somewhere on its way.

    Attributes:
        step: Steps that are done.
        weights: By the network's names.
        moments: The optimiser's, by the same names.
        loss: Of every step that is done; no unit.
    """

    step: int
    weights: Mapping[str, np.ndarray]
    moments: Mapping[str, np.ndarray]
    loss: Float[np.ndarray, " steps"]


Watch = Callable[[int, float], None]
"""Is told of every step: how many are done, and the loss."""
Keep = Callable[[Progress], None]
"""Is handed the training now and then, to write it down."""


@dataclass(frozen=True)
class Listeners:
    """Who is told how a training goes.

    Attributes:
        watch: After every step.
        keep: After every so many.
        every: How many.
    """

    watch: Watch | None = None
    keep: Keep | None = None
    every: int = EVERY


Tell = Callable[[str, int, float], None]
"""Is told the phase (`pre-training`, `alignment`, `fine-tuning`), how many steps of it
are done, and the loss: without unit, in mm while fine-tuning."""


def about(tell: Tell | None, phase: str) -> Watch | None:
    """Return what tells of the steps of one phase."""
    return None if tell is None else partial(tell, phase)


def taken_down(
    optimizer: torch.optim.Optimizer, network: nn.Module, loss: np.ndarray
) -> Progress:
    """Return a copy of where a training stands."""
    moments = {
        f"{name}.{moment}": value.numpy().copy()
        for name, parameter in network.named_parameters()
        for moment, value in optimizer.state[parameter].items()
    }
    return Progress(len(loss), weights_of(network), moments, loss.copy())


def take_up(
    optimizer: torch.optim.Optimizer, network: nn.Module, begun: Progress
) -> None:
    """Go back to where a training stood."""
    load(network, begun.weights)
    for name, parameter in network.named_parameters():
        optimizer.state[parameter] = {
            moment: torch.from_numpy(np.array(begun.moments[f"{name}.{moment}"]))
            for moment in ("step", "exp_avg", "exp_avg_sq")
        }
