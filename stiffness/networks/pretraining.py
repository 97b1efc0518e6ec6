"""Pre-training of a network on the deflections of fitted springs.

==========  ==========================================================================
Equation    network = argmin over the training rows of mean (network(x) - d_VJM)^2,
            directions in units of their standard deviation
Source      Wu et al. 2024, sections 2.2 and 4; 70 % of the rows at random train, 30 %
            test: section 4.2
Valid       postures and wrenches among those of the source plan
Ignores     everything but springs in the axes
==========  ==========================================================================
"""

from dataclasses import dataclass, field, replace
from hashlib import sha256
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from stiffness.networks.model import (
    DeflectionNetwork,
    Mlp,
    Scaling,
    Shape,
    encoding,
    weights_of,
)
from stiffness.networks.source_domain import SourceDomain
from stiffness.networks.training import (
    EVERY,
    Listeners,
    Progress,
    Training,
    Watch,
    begun_or_none,
    train,
    write_progress,
)

TRAINING_SHARE = 0.7
"""Share of the rows used for training; Wu et al. 2024, section 4.2."""


@dataclass(frozen=True)
class Errors:
    """Errors of a network with respect to its springs, in x, y and z.

    Attributes:
        mae: Mean absolute error, Eq. 7, in m.
        stde: Standard deviation of absolute errors, Eq. 8, in m.
        me: Largest absolute error, Eq. 9, in m.
    """

    mae: Float[np.ndarray, "3"]
    stde: Float[np.ndarray, "3"]
    me: Float[np.ndarray, "3"]

    @classmethod
    def of(
        cls, predicted: Float[np.ndarray, "rows 3"], wanted: Float[np.ndarray, "rows 3"]
    ) -> "Errors":
        """Return the errors of predictions, both in m."""
        error = np.abs(predicted - wanted)
        return cls(error.mean(axis=0), error.std(axis=0), error.max(axis=0))


@dataclass(frozen=True)
class Pretraining:
    """Settings of the pre-training.

    Attributes:
        shape: Its architecture; the paper's: four hidden layers of 380, ReLU.
        encoding: Encoding of postures; a name of `model.ENCODINGS`.
        training: Steps and rate.
    """

    shape: Shape = field(default_factory=Mlp)
    encoding: str = "sine_and_cosine"
    training: Training = field(default_factory=Training)
    seed: int = 0


@dataclass(frozen=True)
class Pretrained:
    """A pre-trained network, with its errors.

    Attributes:
        plan: Name of the source plan.
        loss: Loss of every step; no unit.
    """

    network: DeflectionNetwork
    plan: str
    settings: Pretraining
    loss: Float[np.ndarray, " steps"]
    on_training: Errors
    on_test: Errors


def split(rows: int, seed: int) -> tuple[Int[np.ndarray, " train"], np.ndarray]:
    """Split rows at random into 70 % for training and 30 % for testing."""
    order = np.random.default_rng([seed, rows]).permutation(rows)
    count = round(TRAINING_SHARE * rows)
    return np.sort(order[:count]), np.sort(order[count:])


def pretrain(
    domain: SourceDomain,
    settings: Pretraining | None = None,
    file: Path | None = None,
    watch: Watch | None = None,
    every: int = EVERY,
) -> Pretrained:
    """Train a network on a source domain.

    The settings are by default the paper's network at the quick budget. Every so many
    steps the training is saved to the file, from which it resumes if domain and
    settings are the same.

    Returns:
        The network and its errors. The same arguments give the same numbers, whether
        the training was interrupted or not.

    Raises:
        Unusable: Where the file exists but holds no training.
    """
    settings = settings or Pretraining()
    parts = [domain.take(rows) for rows in split(len(domain), settings.seed)]
    network = _untrained(parts[0], settings)
    key = _key(domain, settings)
    begun = None if file is None else begun_or_none(file, key)

    def keep(progress: Progress) -> None:
        assert file is not None
        write_progress(file, key, progress)

    finished = train(
        network.build(),
        source_rows(network, parts[0]),
        settings.training,
        settings.seed,
        begun,
        Listeners(watch, None if file is None else keep, every),
    )
    if file is not None:
        keep(finished)
    network = replace(network, weights=finished.weights)
    errors = [
        Errors.of(network.predict(part.posture, part.wrench_in_base), part.deflection)
        for part in parts
    ]
    return Pretrained(network, domain.plan, settings, finished.loss, *errors)


def source_rows(
    network: DeflectionNetwork, domain: SourceDomain
) -> tuple[Float[np.ndarray, "rows inputs"], Float[np.ndarray, "rows 3"]]:
    """Return a domain's encoded inputs and targets, without units."""
    inputs = network.encode(domain.posture, domain.wrench_in_base)
    return inputs, network.outputs.unitless(domain.deflection)


def _untrained(shown: SourceDomain, settings: Pretraining) -> DeflectionNetwork:
    """Return an untrained network with the scaling of its inputs and outputs."""
    seen = encoding(settings.encoding)(shown.posture, shown.wrench_in_base)
    return DeflectionNetwork(
        shape=settings.shape,
        encoding=settings.encoding,
        inputs=Scaling.of(seen),
        outputs=Scaling.of(shown.deflection),
        weights=weights_of(settings.shape.build(seen.shape[1], settings.seed)),
        point_in_flange=shown.point_in_flange,
        origin_in_flange=shown.origin_in_flange,
    )


def _key(domain: SourceDomain, settings: Pretraining) -> str:
    """Return the key that identifies this training."""
    digest = sha256(f"{domain.plan} {settings}".encode())
    for values in (domain.posture, domain.wrench_in_base, domain.deflection):
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()
