"""Methods learn from a few poses, each from as many as it is given and no more.

A network is pre-trained once on the springs of the model file, so that no pose teaches
it before its turn, and then goes on for some steps with the springs that the few poses
show. Where those cannot show an axis, its spring is taken from the model file.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from typing_extensions import override

from bench.errors import NotIdentifiable
from bench.recording import Recording
from scenarios.paper.cells import Cell, Result
from scenarios.paper.imitation import source_plan
from scenarios.paper.material import Material
from stiffness.arm import Arm
from stiffness.deflections import every_plateau
from stiffness.methods.dt_cnn import DtCnn
from stiffness.methods.ft_mlp import FtMlp, domain_of
from stiffness.methods.gp_residual import GpResidual
from stiffness.methods.method import Fitted
from stiffness.methods.vjm import Vjm, VjmFit
from stiffness.networks.cnn import Cnn
from stiffness.networks.fine_tuning import FineTuning
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


@dataclass(frozen=True)
class FewPosesPlain(Cell):
    """Springs, and a Gaussian process on what they leave, on some poses of one draw.

    Attributes:
        poses: How many.
        draw: Which draw; the poses of fewer are the first of more.
    """

    poses: int
    draw: int

    @property
    @override
    def cost(self) -> float:
        return 0.1 + 0.03 * self.poses

    @override
    def work(self, material: Material, scratch: Path) -> Result:
        few = few_of(material.recording, self.poses, self.draw)
        springs, held = springs_of(material.arm, few)
        process = GpResidual(material.arm, held=held).fit(few)
        found = left({"vjm": springs, "gp_residual": process}, material)
        return found | {"held": np.isin(material.arm.axes, held)}


@dataclass(frozen=True)
class FewPosesNetworks(Cell):
    """Both networks on the same poses.

    Attributes:
        poses: How many.
        draw: Which draw.
        effort: What is spent.
        seed: Of the networks.
    """

    poses: int
    draw: int
    effort: Effort
    seed: int

    @property
    @override
    def cost(self) -> float:
        return 0.02 * self.effort.on.steps + 2e-4 * self.effort.epochs * self.poses + 1

    @override
    def work(self, material: Material, scratch: Path) -> Result:
        few = few_of(material.recording, self.poses, self.draw)
        springs, held = springs_of(material.arm, few)
        domain = domain_of(
            springs,
            source_plan(PLAN, self.effort.every),
            every_plateau(material.arm, few, springs.compliance),
        )
        mlp, cnn = (
            self._gone_on(
                prepared(kind, material, self.effort, self.seed, scratch.parent), domain
            )
            for kind in ("mlp", "cnn")
        )
        tuning = FineTuning(epochs=self.effort.epochs, seed=self.draw)
        tuned = FtMlp(material.arm, tuning=tuning, held=held, pretrained=mlp)
        direct = DtCnn(material.arm, held=held, pretrained=cnn)
        return left({"ft_mlp": tuned.fit(few), "dt_cnn": direct.fit(few)}, material)

    def _gone_on(self, base: Pretrained, domain: SourceDomain) -> Pretrained:
        """Return a network that has learnt other springs, too."""
        network = base.network
        rows = source_rows(network, domain)
        after = train(network.build(), rows, self.effort.on, self.seed)
        return replace(base, network=replace(network, weights=after.weights))


def few_of(recording: Recording, poses: int, draw: int) -> Recording:
    """Draw some poses of a recording, with all of their visits."""
    known = np.unique(recording.pose)
    order = np.random.default_rng([draw, len(known)]).permutation(known)
    return recording.take(np.isin(recording.pose, order[:poses]))


def left(fits: Mapping[str, Fitted], material: Material) -> dict[str, np.ndarray]:
    """Return what methods leave on the fresh poses, in mm."""
    unseen = material.unseen
    return {
        name: 1e3 * (fit.predict(unseen.cases) - unseen.deflection)
        for name, fit in fits.items()
    }


def springs_of(arm: Arm, few: Recording) -> tuple[VjmFit, tuple[str, ...]]:
    """Fit springs, holding as many axes as must be, and say which.

    Of the axes that a refusal names, the one furthest out is held, until none is named:
    its spring moves the tool by the shortest lever, so the model's value harms least.

    Raises:
        NotIdentifiable: Where no axis can be identified, the others held.
    """
    held: tuple[str, ...] = ()
    while True:
        try:
            return Vjm(arm, held).fit(few), held
        except NotIdentifiable as refusal:
            free = [axis for axis in arm.axes if axis not in held]
            if len(free) == 1:
                raise
            furthest = [axis for axis in free if axis in refusal.axes] or free
            held = tuple(a for a in arm.axes if a in (*held, furthest[-1]))


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
