"""FT-MLP learns from springs once and is corrected in many ways: Tables 8 to 10."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from typing_extensions import override

from scenarios.paper.budget import Transfer
from scenarios.paper.imitation.cells import imitated, source_plan, step_cost
from scenarios.paper.material import Material
from scenarios.paper.transfer.answers import answers, learnt
from scenarios.paper.work.cells import Cell, Result
from stiffness.methods.ft_mlp import FtMlp
from stiffness.methods.network_fit import NetworkFit
from stiffness.networks.fine_tuning import FineTuning
from stiffness.networks.pretraining import Pretraining
from stiffness.networks.training import Training

EPOCH_SECONDS = 0.04
"""Of fine-tuning the paper's network by eight plateaus of 121 poses; as measured."""


@dataclass(frozen=True)
class PerceptronCell(Cell):
    """FT-MLP on one split and one source plan, all unfreezings."""

    seed: int
    plan: str
    settings: Transfer
    unfreezings: tuple[tuple[int, ...], ...]

    @property
    @override
    def cost(self) -> float:
        epochs = self.settings.unfreezing_epochs * len(self.unfreezings)
        epochs += 2 * self.settings.epochs
        return step_cost(self.settings.shape) * self.settings.steps + (
            EPOCH_SECONDS * epochs
        )

    @override
    def work(self, material: Material, scratch: Path) -> Result:
        settings, recording = self.settings, material.training(self.seed)
        method = FtMlp(
            material.arm,
            source_plan(self.plan, settings.every),
            Pretraining(
                settings.shape, training=Training(steps=settings.steps), seed=self.seed
            ),
            FineTuning(epochs=settings.epochs, seed=self.seed),
            file=scratch,
        )
        best = method.fit(recording)
        method = replace(method, pretrained=best.pretrained)
        last = replace(method, tuning=replace(method.tuning, keep="last"))
        fits = {"best": best, "last": last.fit(recording)}
        slow = replace(method.tuning, epochs=settings.unfreezing_epochs)
        for layers in self.unfreezings:
            tuning = replace(slow, unfrozen=layers)
            fits[unfrozen(layers)] = replace(method, tuning=tuning).fit(recording)
        before = NetworkFit(best.pretrained.network, best.springs)
        found = imitated(best.pretrained) | answers(
            "pretrained", before, material, self.seed
        )
        for name, fit in fits.items():
            found |= answers(name, fit, material, self.seed)
            found[f"{name}/learnt"] = learnt(fit, material, self.seed)
            found[f"{name}/curve"] = 1e3 * np.array(
                [fit.tuned.training_mae, fit.tuned.validation_mae]
            )
            found[f"{name}/epoch"] = np.array(fit.tuned.epoch)
        return found


def unfrozen(layers: tuple[int, ...]) -> str:
    """Return how a table calls an unfreezing."""
    return "unfrozen " + "+".join(str(layer) for layer in layers)
