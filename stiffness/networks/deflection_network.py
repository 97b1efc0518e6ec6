"""A trained network says how far one point of the flange moves under a wrench.

A noun: a shape, its weights, how quantities become the numbers that it sees, and the
point that is meant. It is the same thing before and after fine-tuning.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import torch
from jaxtyping import Float
from torch import nn

from bench.errors import Unusable
from stiffness.networks.encoding import encoding
from stiffness.networks.scaling import Scaling
from stiffness.networks.shape import Shape, load
from stiffness.networks.threads import one_thread

ROWS_AT_ONCE = 8192
"""Rows that are predicted together; chosen: some 10 MB a layer."""


@dataclass(frozen=True)
class DeflectionNetwork:
    """A network with everything needed to ask it.

    Attributes:
        shape: How it is built.
        encoding: How it is shown postures; a name of `encoding.ENCODINGS`.
        inputs: Takes units from what goes in.
        outputs: Gives units, m, to what comes out.
        weights: By the network's names.
        point_in_flange: The point whose motion it predicts, in m.
        origin_in_flange: About which it wants torques, in m.
    """

    shape: Shape
    encoding: str
    inputs: Scaling
    outputs: Scaling
    weights: Mapping[str, np.ndarray] = field(repr=False)
    point_in_flange: Float[np.ndarray, "3"]
    origin_in_flange: Float[np.ndarray, "3"]

    def build(self) -> nn.Module:
        """Return a network of torch with these weights, set to predict."""
        network = self.shape.build(len(self.inputs.mean), seed=0)
        load(network, self.weights)
        return network.eval()

    def encode(
        self,
        posture: Float[np.ndarray, "rows axes"],
        wrench_in_base: Float[np.ndarray, "rows 6"],
    ) -> Float[np.ndarray, "rows inputs"]:
        """Turn postures in rad and wrenches in N, N m into what the network sees.

        Raises:
            Unusable: Where the network has learnt another number of axes.
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

        Args:
            posture: In rad.
            wrench_in_base: Force in N, torque in N m about `origin_in_flange`.

        Raises:
            Unusable: Where the network has learnt another number of axes.
        """
        network = self.build()
        seen = torch.from_numpy(self.encode(posture, wrench_in_base).astype(np.float32))
        with torch.no_grad(), one_thread():
            parts = [network(part) for part in seen.split(ROWS_AT_ONCE)]
        answer = np.concatenate([part.numpy() for part in parts]).astype(float)
        return self.outputs.in_units(answer)
