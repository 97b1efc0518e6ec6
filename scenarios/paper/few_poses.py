"""Methods learn from a few poses, each from as many as it is given and no more.

A network is pre-trained once on the springs of the model file, so that no pose teaches
it before its turn, and then goes on for some steps with the springs that the few poses
show. Where those cannot show an axis, its spring is taken from the model file, the
wrist's first.
"""

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
from stiffness.source_domain import source_domain

PLAN = "spanning"
WRIST, FORE = ("a4", "a5", "a6"), ("a3", "a4", "a5", "a6")
HELD = ((), ("a4",), ("a4", "a6"), WRIST, FORE, ("a1", *FORE), ("a2", *FORE))
"""Axes that are held, in turn, until the poses show the others."""
ON = Training(steps=300, rate=1e-3)
"""How a network goes on with the springs of the few poses; chosen: its test MAE is then
what it was on the springs of the model file."""


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
    every: int = 8


@dataclass(frozen=True)
class FewPosesCell(Cell):
    """All methods on some poses of one draw.

    Attributes:
        poses: How many.
        draw: Which draw; the poses of fewer are the first of more.
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
        return 0.05 * self.effort.on.steps + 1e-4 * self.effort.epochs * self.poses + 1

    @override
    def work(self, material: Material, scratch: Path) -> Result:
        few = self._few(material.recording)
        springs, held = springs_of(material.arm, few)
        domain = domain_of(
            springs,
            source_plan(PLAN, self.effort.every),
            every_plateau(material.arm, few, springs.compliance),
        )
        networks = []
        for kind in ("mlp", "cnn"):
            base = prepared(kind, material, self.effort, self.seed, scratch.parent)
            network = base.network
            rows = source_rows(network, domain)
            went_on = train(network.build(), rows, self.effort.on, self.seed)
            network = replace(network, weights=went_on.weights)
            networks.append(replace(base, network=network))
        tuning = FineTuning(epochs=self.effort.epochs, seed=self.draw)
        mlp = FtMlp(material.arm, tuning=tuning, held=held, pretrained=networks[0])
        cnn = DtCnn(material.arm, held=held, pretrained=networks[1])
        fits = {
            "vjm": springs,
            "ft_mlp": mlp.fit(few),
            "dt_cnn": cnn.fit(few),
            "gp_residual": GpResidual(material.arm, held=held).fit(few),
        }
        unseen = material.unseen
        found = {
            name: 1e3 * (fit.predict(unseen.cases) - unseen.deflection)
            for name, fit in fits.items()
        }
        return found | {"held": np.array(len(held))}

    def _few(self, recording: Recording) -> Recording:
        poses = np.unique(recording.pose)
        order = np.random.default_rng([self.draw, len(poses)]).permutation(poses)
        return recording.take(np.isin(recording.pose, order[: self.poses]))


def springs_of(arm: Arm, few: Recording) -> tuple[VjmFit, tuple[str, ...]]:
    """Fit springs, holding as many axes as must be, and say which.

    Raises:
        NotIdentifiable: Where neither A1 nor A2 can be identified, the others held.
    """
    for held in HELD:
        try:
            return Vjm(arm, held).fit(few), held
        except NotIdentifiable:
            if held == HELD[-1]:
                raise
    raise AssertionError


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
