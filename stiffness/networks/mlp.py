"""Layers of neurons, each connected to all of the next, can take any smooth form.

==========  ==========================================================================
Equation    h_1 = phi(W_1 x + b_1), h_i = phi(W_i h_(i-1) + b_i), y = W h_n + b
Source      Wu et al. 2024, Eq. 1; four layers of 380 with ReLU: sections 4.2, Table 7
Valid       postures and wrenches among those of the training
Ignores     that a deflection is nearly linear in the wrench
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import torch
from torch import nn
from typing_extensions import override

from bench.errors import UnknownName, Unusable
from stiffness.networks.shape import OUTPUTS, Shape

ACTIVATIONS: Final[Mapping[str, type[nn.Module]]] = MappingProxyType(
    {"relu": nn.ReLU, "tanh": nn.Tanh, "sigmoid": nn.Sigmoid}
)
"""Those of the paper's Table 7."""


@dataclass(frozen=True)
class Mlp(Shape):
    """A multi-layer perceptron.

    Attributes:
        hidden: How many hidden layers.
        width: Neurons of each.
        activation: A name of `ACTIVATIONS`.

    Raises:
        Unusable: Where there would be no neuron.
        UnknownName: Where there is no such activation.
    """

    hidden: int = 4
    width: int = 380
    activation: str = "relu"

    def __post_init__(self):
        """Check sizes and name."""
        faults = [
            f"{name} is {value}, expected at least 1."
            for name, value in (("hidden", self.hidden), ("width", self.width))
            if value < 1
        ]
        if faults:
            raise Unusable("The network", faults)
        if self.activation not in ACTIVATIONS:
            raise UnknownName("activation", self.activation, ACTIVATIONS)

    @override
    def build(self, inputs: int, seed: int) -> nn.Sequential:
        """Build it; each hidden layer begins as a turn, the output as zero.

        Orthogonal weights keep the size of what passes through many layers (Saxe et al.
        2014, "Exact solutions to the nonlinear dynamics of learning").
        """
        draw = torch.Generator().manual_seed(seed)
        gain = nn.init.calculate_gain(self.activation)  # pyright: ignore[reportArgumentType]
        parts: list[nn.Module] = []
        for layer in range(self.hidden):
            dense = _dense(inputs if layer == 0 else self.width, self.width)
            nn.init.orthogonal_(dense.weight, gain, draw)
            parts += [dense, ACTIVATIONS[self.activation]()]
        last = _dense(self.width, OUTPUTS)
        nn.init.zeros_(last.weight)
        return nn.Sequential(*parts, last)

    @override
    def layers(self, network: nn.Module) -> tuple[nn.Module, ...]:
        """Return the hidden layers, then the output layer."""
        return tuple(part for part in network.children() if isinstance(part, nn.Linear))

    @override
    def features(self, network: nn.Module, inputs: torch.Tensor) -> torch.Tensor:
        """Return the last hidden layer."""
        assert isinstance(network, nn.Sequential)
        return network[:-1](inputs)


def _dense(before: int, after: int) -> nn.Linear:
    """Return a layer without bias yet, and without a draw from torch's own numbers."""
    layer = nn.Linear(before, after, device="meta").to_empty(device="cpu")
    nn.init.zeros_(layer.bias)
    return layer
