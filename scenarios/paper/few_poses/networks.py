"""A network that knows other springs needs few steps to learn these.

It is pre-trained once on the springs of the model file, so that no pose teaches it
before its turn, and then goes on for some steps with the springs that the few poses
show.
"""

from dataclasses import dataclass, field, replace
from pathlib import Path

from scenarios.paper.imitation.cells import source_plan
from scenarios.paper.material import Material
from stiffness.networks.cnn import Cnn
from stiffness.networks.mlp import Mlp
from stiffness.networks.pretraining import (
    Pretrained,
    Pretraining,
    pretrain,
    source_rows,
)
from stiffness.networks.training import Training, train
from stiffness.source_domain import SourceDomain, source_domain

PLAN = "spanning"
ON = Training(steps=300, rate=1e-3)
"""How a network goes on with the springs of the few poses; chosen: twice as many steps
bring it no nearer to them (0.027 and 0.026 mm off on fresh poses)."""


@dataclass(frozen=True)
class Effort:
    """What is spent on the networks.

    Attributes:
        shape: Of the perceptron.
        steps: Of its pre-training.
        cnn_steps: Of the convolutional network's.
        on: Of going on with other springs.
        epochs: Of fine-tuning.
        every: Every how many of Table 4's postures are in the source plan.
    """

    shape: Mlp = field(default_factory=Mlp)
    steps: int = 7000
    cnn_steps: int = 2500
    on: Training = ON
    epochs: int = 300
    every: int = 1


def prepared(
    kind: str, material: Material, effort: Effort, seed: int, folder: Path
) -> Pretrained:
    """Return a network pre-trained on the model file's springs; kept in the folder."""
    data = material.measured
    domain = source_domain(
        material.arm,
        1.0 / material.arm.stiffness,
        source_plan(PLAN, effort.every),
        data.cases.point_in_flange.mean(axis=0),
        data.cases.origin_in_flange,
    )
    shape, steps = (
        (effort.shape, effort.steps) if kind == "mlp" else (Cnn(), effort.cnn_steps)
    )
    settings = Pretraining(shape, training=Training(steps=steps), seed=seed)
    folder.mkdir(parents=True, exist_ok=True)
    return pretrain(domain, settings, folder / f"model-springs-{kind}.npz")


def gone_on(
    base: Pretrained, domain: SourceDomain, training: Training, seed: int
) -> Pretrained:
    """Return a network that has learnt other springs, too."""
    network = base.network
    after = train(network.build(), source_rows(network, domain), training, seed)
    return replace(base, network=replace(network, weights=after.weights))
