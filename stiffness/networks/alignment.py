"""Domain adaptation by CORAL: aligns the covariances of source and target features.

==========  ==========================================================================
Equation    loss = mean (y - y_hat)^2 + weight |C_S - C_T|_F^2 / (4 d^2)
            C: covariance of the d features of source and target rows
Source      Sun, Saenko 2016, "Deep CORAL", Eqs 1 to 4; among the alignments of Zhao et
            al. 2021, which is the paper's reference 34
Valid       no deflection of the target is needed, only its postures and wrenches
Ignores     means and everything beyond the second moments
==========  ==========================================================================
"""

from dataclasses import dataclass, field, replace

import numpy as np
import torch
from jaxtyping import Float
from torch import nn

from bench.shared.errors import Unusable
from stiffness.networks.model import DeflectionNetwork
from stiffness.networks.pretraining import source_rows
from stiffness.networks.source_domain import SourceDomain
from stiffness.networks.training import Listeners, Training, Watch, train


@dataclass(frozen=True)
class Alignment:
    """Settings of further training on the source domain with aligned features.

    Attributes:
        weight: Weight of the alignment in the loss; the reference's trade-off is 1.
        training: Steps and rate; chosen: a tenth of the pre-training, slower.
        seed: Seed of the order of the rows.

    Raises:
        Unusable: Where the weight is below 0.
    """

    weight: float = 1.0
    training: Training = field(default_factory=lambda: Training(steps=500, rate=5e-4))
    seed: int = 0

    def __post_init__(self):
        """Check the weight."""
        if not self.weight >= 0.0:
            fault = f"weight is {self.weight}, expected at least 0."
            raise Unusable("The alignment", [fault])


def coral(source: torch.Tensor, target: torch.Tensor) -> torch.Tensor:
    """Return the distance between the covariances of two sets of features.

    Args:
        source: One row of features per row.
        target: As many features, any number of rows above one.
    """
    apart = torch.cov(source.T) - torch.cov(target.T)
    return (apart**2).sum() / (4 * source.shape[1] ** 2)


def align(
    network: DeflectionNetwork,
    domain: SourceDomain,
    seen: Float[np.ndarray, "rows inputs"],
    settings: Alignment,
    watch: Watch | None = None,
) -> DeflectionNetwork:
    """Train on the source until the target's features have the source's covariance.

    Args:
        network: Pre-trained on the domain.
        domain: Deflections of the springs.
        seen: The target's rows, encoded as inputs of the network.
        settings: Settings of the alignment.
        watch: Callback for every step.

    Returns:
        The network with other weights.
    """
    built = network.build()
    target = torch.from_numpy(seen.astype(np.float32))
    shape = network.shape

    def apart(being_trained: nn.Module, batch: torch.Tensor) -> torch.Tensor:
        features = [shape.features(being_trained, rows) for rows in (batch, target)]
        return settings.weight * coral(*features)

    aligned = train(
        built,
        source_rows(network, domain),
        settings.training,
        settings.seed,
        tell=Listeners(watch),
        penalty=apart,
    )
    return replace(network, weights=aligned.weights)
