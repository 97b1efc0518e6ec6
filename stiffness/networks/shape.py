"""A network's shape says how many layers it has, how wide, and which can be frozen."""

from abc import ABC, abstractmethod
from collections.abc import Mapping

import numpy as np
import torch
from torch import nn

OUTPUTS = 3
"""A deflection has three directions."""


class Shape(ABC):
    """How a network is built; it holds no weights."""

    @abstractmethod
    def build(self, inputs: int, seed: int) -> nn.Module:
        """Build the network with weights drawn by the seed.

        Args:
            inputs: How many numbers go in.
            seed: Of the draw; the same seed gives the same weights.
        """

    @abstractmethod
    def layers(self, network: nn.Module) -> tuple[nn.Module, ...]:
        """Return what can be frozen, from the inputs on, the output layer last."""

    @abstractmethod
    def features(self, network: nn.Module, inputs: torch.Tensor) -> torch.Tensor:
        """Return what the output layer is given, a row of features per row."""


def load(network: nn.Module, weights: Mapping[str, np.ndarray]) -> None:
    """Put weights into a network, running statistics included."""
    state = {name: torch.from_numpy(np.array(w)) for name, w in weights.items()}
    network.load_state_dict(state)


def weights_of(network: nn.Module) -> dict[str, np.ndarray]:
    """Return a copy of a network's weights, running statistics included."""
    return {name: w.numpy().copy() for name, w in network.state_dict().items()}
