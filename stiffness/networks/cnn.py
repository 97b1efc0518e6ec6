"""Convolutions with kernels of one mix channels and never look at neighbours.

==========  ==========================================================================
Equation    z_1 = phi(bn(x * w_1 + b_1)), z_i = phi(bn(c_(i-1) * w_i + b_i)),
            c = pooled z after the second and fourth; h = phi(W_c c + b_c), y = W h + b
Source      Wu et al. 2024, Eq. 2 and section 2.1, after its reference 34: Zhao et al.
            2021, "Applications of unsupervised deep transfer learning to intelligent
            fault diagnosis": convolutions of 16, 32, 64, 128 channels, a dense layer
            of 256
Valid       postures and wrenches among those of the training
Ignores     the reference's wide kernels (15, then 3): the paper's are one
==========  ==========================================================================

What are channels? The paper does not say. Two readings of its twelve quantities:

- `channels` (taken): every input is a channel of a signal of length one. A kernel of
  one is then a dense layer. Pooling acts on one value and returns it: halving rounds
  up, and the reference's four places all hold the same value.
- `signal`: the inputs are the places of one channel, as the reference's vibration
  signals are. All inputs then pass the same small network one by one, pairs are
  pooled, and the largest in each quarter survives: which input it came from is lost.

With kernels of one the reference's 16 channels are a first layer of 16 neurons: half of
what a ReLU is given is lost, and 14 inputs vary. That bounds how well springs are
imitated (tried: 0.060 mm after 2,500 steps, 0.048 mm after 5,000; with
`channels=(64, 64, 64, 128)` 0.042 mm after 2,500). Batch normalisation does not: left
out, it was 0.076 mm, and running statistics are as good as those of the final weights.
"""

from dataclasses import dataclass
from typing import Literal

import torch
from torch import nn
from typing_extensions import override

from bench.errors import Unusable
from stiffness.networks.shape import OUTPUTS, Shape

CHANNELS = (16, 32, 64, 128)
POOLED = (1, 3)
"""Which convolutions are followed by pooling, from 0."""
PLACES = 4
"""Places left by the last pooling; as in the reference."""
DENSE = 256


@dataclass(frozen=True)
class Cnn(Shape):
    """Four convolutions and a dense layer.

    Attributes:
        inputs_are: `channels` or `signal`, see above.
        channels: Of each convolution; the reference's.
        dropout: Share of the dense layer that is left out in training. The reference's
            is 0.5, to tell classes apart; chosen: none, for it blurs a regression.

    Raises:
        Unusable: Where a setting is out of its range, naming all.
    """

    inputs_are: Literal["channels", "signal"] = "channels"
    channels: tuple[int, int, int, int] = CHANNELS
    dropout: float = 0.0

    def __post_init__(self):
        """Check the settings."""
        faults = []
        if self.inputs_are not in ("channels", "signal"):
            fault = f"inputs_are is {self.inputs_are!r}, expected 'channels' or "
            faults.append(fault + "'signal'.")
        if len(self.channels) != len(CHANNELS) or min(self.channels) < 1:
            fault = f"channels are {self.channels}, expected four of at least 1."
            faults.append(fault)
        if not 0.0 <= self.dropout < 1.0:
            faults.append(f"dropout is {self.dropout}, expected 0 to below 1.")
        if faults:
            raise Unusable("The network", faults)

    @override
    def build(self, inputs: int, seed: int) -> nn.Sequential:
        """Build it; weights as torch draws them."""
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            one_by_one = self.inputs_are == "signal"
            before = 1 if one_by_one else inputs
            parts: list[nn.Module] = [nn.Unflatten(1, (before, inputs // before))]
            for i, after in enumerate(self.channels):
                convolution = nn.Conv1d(before, after, kernel_size=1)
                block = [convolution, nn.BatchNorm1d(after), nn.ReLU()]
                if i == POOLED[0]:
                    block.append(nn.MaxPool1d(2, ceil_mode=True))
                elif i == POOLED[1]:
                    block.append(nn.AdaptiveMaxPool1d(PLACES))
                parts.append(nn.Sequential(*block))
                before = after
            dense = nn.Linear(before * PLACES, DENSE)
            flat = [nn.Flatten(), dense, nn.ReLU(), nn.Dropout(self.dropout)]
            parts.append(nn.Sequential(*flat))
            return nn.Sequential(*parts, nn.Linear(DENSE, OUTPUTS))

    @override
    def layers(self, network: nn.Module) -> tuple[nn.Module, ...]:
        """Return four convolutions with their normalisation, dense, output layer."""
        return tuple(network.children())[1:]

    @override
    def features(self, network: nn.Module, inputs: torch.Tensor) -> torch.Tensor:
        """Return the dense layer."""
        assert isinstance(network, nn.Sequential)
        return network[:-1](inputs)
