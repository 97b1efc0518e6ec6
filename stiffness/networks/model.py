"""Networks for deflections: multilayer perceptron and convolutional network.

A `Shape` defines layers and widths, and which layers can be frozen. A
`DeflectionNetwork` holds a shape, its weights, the encoding of its inputs, and the
point of the flange whose deflection it predicts; it is the same type before and after
fine-tuning. Sums are computed on one thread, for reproducible results (`one_thread`).

Multilayer perceptron (`Mlp`):

==========  ==========================================================================
Equation    h_1 = phi(W_1 x + b_1), h_i = phi(W_i h_(i-1) + b_i), y = W h_n + b
Source      Wu et al. 2024, Eq. 1; four layers of 380 with ReLU: sections 4.2, Table 7
Valid       postures and wrenches among those of the training
Ignores     the near linearity of deflections in the wrench
==========  ==========================================================================

Convolutional network (`Cnn`), whose kernels of size one mix channels only:

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

Inputs: angles as sines and cosines (`sine_and_cosine`; Wu et al. 2024, Eq. 5 and
section 4.1), all scaled to z = (x - mean) / standard deviation over the rows
(`Scaling`; LeCun, Bottou, Orr, Müller 1998, "Efficient BackProp", section 4.3). The
paper wants "twelve neurons" in the input layer and sines and cosines as well, which
cannot both be: six angles as pairs and six components of the wrench are eighteen.
Chosen are eighteen; `plain_angles` is the other reading, twelve inputs and no sines.

What are channels? The paper does not say. Two readings of its twelve quantities:

- `channels` (chosen): every input is a channel of a signal of length one. A kernel of
  one is then a dense layer. Pooling acts on one value and returns it: halving rounds
  up, and the reference's four places all hold the same value.
- `signal`: the inputs are the places of one channel, as the reference's vibration
  signals are. All inputs then pass the same small network one by one, pairs are
  pooled, and only the largest in each quarter is kept: which input it came from is
  lost.

With kernels of one the reference's 16 channels are a first layer of 16 neurons: half of
a ReLU's input is lost, and 14 inputs vary. That bounds how well springs are imitated
(tried: 0.060 mm after 2,500 steps, 0.048 mm after 5,000; with
`channels=(64, 64, 64, 128)` 0.042 mm after 2,500). Batch normalisation does not: left
out, it was 0.076 mm, and running statistics are as good as those of the final weights.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from bench.shared.errors import UnknownName, Unusable, refuse

if TYPE_CHECKING:  # who only states a shape, as a command's flags do, needs no torch
    import torch

from collections.abc import Callable
from typing import TypeAlias

# --- Inputs and their scale ----------------------------------------------------------

# --- Encoding of angles ---------------------------------------------------------------

Encoding: TypeAlias = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Function from postures in rad and wrenches in N and N m to a network's inputs."""


def sine_and_cosine(
    posture: Float[np.ndarray, "rows axes"], wrench: Float[np.ndarray, "rows 6"]
) -> Float[np.ndarray, "rows inputs"]:
    """Return sines, cosines, then the wrench: 18 inputs for six axes."""
    return np.hstack([np.sin(posture), np.cos(posture), wrench])


def plain_angles(
    posture: Float[np.ndarray, "rows axes"], wrench: Float[np.ndarray, "rows 6"]
) -> Float[np.ndarray, "rows inputs"]:
    """Return angles in rad, then the wrench: 12 inputs for six axes."""
    return np.hstack([posture, wrench])


ENCODINGS: Final[Mapping[str, Encoding]] = MappingProxyType(
    {"sine_and_cosine": sine_and_cosine, "plain_angles": plain_angles}
)
"""Both encodings, by the names that files give them."""


def encoding(name: str) -> Encoding:
    """Return an encoding by its name.

    Raises:
        UnknownName: Where there is none of that name.
    """
    if name not in ENCODINGS:
        raise UnknownName("encoding", name, ENCODINGS)
    return ENCODINGS[name]


# --- Scaling --------------------------------------------------------------------------

CONSTANT = 1e-9
"""Range below which a column is constant; chosen: rounding of sines is 1e-16."""


@dataclass(frozen=True)
class Scaling:
    """Standardisation of columns, and its inverse.

    A constant column has an infinite scale, so that it is always zero: the network
    has not learnt from it, and its prediction must not depend on it.

    Attributes:
        mean: Mean of each column.
        scale: Standard deviation of each column; infinite where it is constant.
    """

    mean: Float[np.ndarray, " columns"]
    scale: Float[np.ndarray, " columns"]

    @classmethod
    def of(cls, values: Float[np.ndarray, "rows columns"]) -> "Scaling":
        """Return the scaling by mean and standard deviation of each column."""
        scale = values.std(axis=0)
        return cls(values.mean(axis=0), np.where(scale > CONSTANT, scale, np.inf))

    def unitless(
        self, values: Float[np.ndarray, "rows columns"]
    ) -> Float[np.ndarray, "rows columns"]:
        """Return standardised values, without units."""
        return (values - self.mean) / self.scale

    def in_units(
        self, values: Float[np.ndarray, "rows columns"]
    ) -> Float[np.ndarray, "rows columns"]:
        """Return values in units; constant columns are at their mean."""
        return self.mean + values * np.where(np.isfinite(self.scale), self.scale, 0.0)


# --- Single thread --------------------------------------------------------------------


@contextmanager
def one_thread() -> Iterator[None]:
    """Compute on one thread for a while; sums then run in one order."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


# --- Shape of a network ---------------------------------------------------------------

OUTPUTS = 3
"""A deflection has three directions."""


class Shape(ABC):
    """Architecture of a network, without weights."""

    @abstractmethod
    def build(self, inputs: int, seed: int) -> "torch.nn.Module":
        """Build the network with weights drawn by the seed."""

    @abstractmethod
    def layers(self, network: "torch.nn.Module") -> "tuple[torch.nn.Module, ...]":
        """Return the layers that can be frozen, from inputs to the output layer."""

    @abstractmethod
    def features(
        self, network: "torch.nn.Module", inputs: "torch.Tensor"
    ) -> "torch.Tensor":
        """Return the inputs of the output layer, a row of features per row."""


def load(network: "torch.nn.Module", weights: Mapping[str, np.ndarray]) -> None:
    """Load weights into a network, running statistics included."""
    import torch

    state = {name: torch.from_numpy(np.array(w)) for name, w in weights.items()}
    network.load_state_dict(state)


def weights_of(network: "torch.nn.Module") -> dict[str, np.ndarray]:
    """Return a copy of a network's weights, running statistics included."""
    return {name: w.numpy().copy() for name, w in network.state_dict().items()}


# --- Multilayer perceptron ------------------------------------------------------------

ACTIVATIONS: Final[Mapping[str, str]] = MappingProxyType(
    {"relu": "ReLU", "tanh": "Tanh", "sigmoid": "Sigmoid"}
)
"""Activation functions of the paper's Table 7, with torch's names of their layers."""


@dataclass(frozen=True)
class Mlp(Shape):
    """A multi-layer perceptron.

    Attributes:
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
        refuse("The network", faults)
        if self.activation not in ACTIVATIONS:
            raise UnknownName("activation", self.activation, ACTIVATIONS)

    @override
    def build(self, inputs: int, seed: int) -> "torch.nn.Sequential":
        """Build it with orthogonal weights in hidden layers and zeros in the output.

        Orthogonal weights preserve the size of signals through many layers (Saxe et al.
        2014, "Exact solutions to the nonlinear dynamics of learning").
        """
        import torch
        from torch import nn

        draw = torch.Generator().manual_seed(seed)
        gain = nn.init.calculate_gain(self.activation)  # pyright: ignore[reportArgumentType]
        parts: list[nn.Module] = []
        for layer in range(self.hidden):
            dense = _dense(inputs if layer == 0 else self.width, self.width)
            nn.init.orthogonal_(dense.weight, gain, draw)
            parts += [dense, getattr(nn, ACTIVATIONS[self.activation])()]
        last = _dense(self.width, OUTPUTS)
        nn.init.zeros_(last.weight)
        return nn.Sequential(*parts, last)

    @override
    def layers(self, network: "torch.nn.Module") -> "tuple[torch.nn.Module, ...]":
        """Return the hidden layers, then the output layer."""
        from torch import nn

        return tuple(part for part in network.children() if isinstance(part, nn.Linear))

    @override
    def features(
        self, network: "torch.nn.Module", inputs: "torch.Tensor"
    ) -> "torch.Tensor":
        """Return the last hidden layer."""
        from torch import nn

        assert isinstance(network, nn.Sequential)
        return network[:-1](inputs)


def _dense(before: int, after: int) -> "torch.nn.Linear":
    """Return a layer without bias yet, and without a draw from torch's generator."""
    from torch import nn

    layer = nn.Linear(before, after, device="meta").to_empty(device="cpu")
    nn.init.zeros_(layer.bias)
    return layer


# --- Convolutional network ------------------------------------------------------------

CHANNELS = (16, 32, 64, 128)
POOLED = (1, 3)
"""Which convolutions are followed by pooling, from 0."""
PLACES = 4
"""Number of places after the last pooling; as in the reference."""
DENSE = 256


@dataclass(frozen=True)
class Cnn(Shape):
    """Four convolutions and a dense layer.

    Attributes:
        inputs_are: `channels` or `signal`, see above.
        channels: Channels of each convolution; the reference's.
        dropout: Share of the dense layer that is left out in training. The reference's
            is 0.5, for classification; chosen: none, for it adds noise to a regression.

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
        refuse("The network", faults)

    @override
    def build(self, inputs: int, seed: int) -> "torch.nn.Sequential":
        """Build it, with torch's default weights."""
        import torch
        from torch import nn

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
    def layers(self, network: "torch.nn.Module") -> "tuple[torch.nn.Module, ...]":
        """Return four convolutions with their normalisation, dense, output layer."""
        return tuple(network.children())[1:]

    @override
    def features(
        self, network: "torch.nn.Module", inputs: "torch.Tensor"
    ) -> "torch.Tensor":
        """Return the dense layer."""
        from torch import nn

        assert isinstance(network, nn.Sequential)
        return network[:-1](inputs)


# --- Trained network ------------------------------------------------------------------

ROWS_AT_ONCE = 8192
"""Rows that are predicted together; chosen: some 10 MB a layer."""


@dataclass(frozen=True)
class DeflectionNetwork:
    """A network with the encoding, scaling and points needed to predict deflections.

    Attributes:
        shape: Its architecture.
        encoding: Encoding of postures; a name of `ENCODINGS`.
        outputs: Scaling of the outputs, to m.
        weights: Weights, by the network's names.
        point_in_flange: The point whose motion it predicts, in m.
        origin_in_flange: Point about which torques are given, in m.
    """

    shape: Shape
    encoding: str
    inputs: Scaling
    outputs: Scaling
    weights: Mapping[str, np.ndarray] = field(repr=False)
    point_in_flange: Float[np.ndarray, "3"]
    origin_in_flange: Float[np.ndarray, "3"]

    def build(self) -> "torch.nn.Module":
        """Return a network of torch with these weights, set to predict."""
        network = self.shape.build(len(self.inputs.mean), seed=0)
        load(network, self.weights)
        return network.eval()

    def encode(
        self,
        posture: Float[np.ndarray, "rows axes"],
        wrench_in_base: Float[np.ndarray, "rows 6"],
    ) -> Float[np.ndarray, "rows inputs"]:
        """Return the network's inputs for postures in rad and wrenches in N, N m.

        Raises:
            Unusable: Where the network has another number of axes.
        """
        seen = encoding(self.encoding)(posture, wrench_in_base)
        if seen.shape[1] != len(self.inputs.mean):
            fault = (
                f"{posture.shape[1]} axes make {seen.shape[1]} inputs, it was trained "
                f"on {len(self.inputs.mean)}; train one for this arm."
            )
            raise Unusable("The network", [fault])
        return self.inputs.unitless(seen)

    def predict(
        self,
        posture: Float[np.ndarray, "rows axes"],
        wrench_in_base: Float[np.ndarray, "rows 6"],
    ) -> Float[np.ndarray, "rows 3"]:
        """Predict deflections along the base's axes, in m.

        Postures are in rad, forces in N, torques in N m about `origin_in_flange`.

        Raises:
            Unusable: Where the network has another number of axes.
        """
        import torch

        network = self.build()
        seen = torch.from_numpy(self.encode(posture, wrench_in_base).astype(np.float32))
        with torch.no_grad(), one_thread():
            parts = [network(part) for part in seen.split(ROWS_AT_ONCE)]
        answer = np.concatenate([part.numpy() for part in parts]).astype(float)
        return self.outputs.in_units(answer)
