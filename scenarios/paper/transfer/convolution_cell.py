"""DT-CNN learns from springs and is asked about the arm, as it is or transferred."""

from dataclasses import dataclass, replace
from pathlib import Path

from typing_extensions import override

from scenarios.paper.budget import Transfer
from scenarios.paper.imitation.cells import imitated, source_plan
from scenarios.paper.material import Material
from scenarios.paper.transfer.answers import answers
from scenarios.paper.work.cells import Cell, Result
from stiffness.methods.dt_cnn import DtCnn
from stiffness.networks.alignment import Alignment
from stiffness.networks.cnn import Cnn
from stiffness.networks.fine_tuning import FineTuning
from stiffness.networks.pretraining import Pretraining
from stiffness.networks.training import Training

STEP_SECONDS = 0.011
"""Of one step of 256 rows; as measured."""
DENSE, OUTPUT = 5, 6
"""Layers of the convolutional network that its frozen variant corrects."""


@dataclass(frozen=True)
class ConvolutionCell(Cell):
    """DT-CNN on one split and one source plan; its variants where asked for."""

    seed: int
    plan: str
    settings: Transfer

    @property
    @override
    def cost(self) -> float:
        return STEP_SECONDS * self.settings.cnn_steps + 60.0 * self.settings.variants

    @override
    def work(self, material: Material, scratch: Path) -> Result:
        recording = material.training(self.seed)
        training = Training(steps=self.settings.cnn_steps)
        method = DtCnn(
            material.arm,
            source_plan(self.plan, self.settings.every),
            Pretraining(Cnn(), training=training, seed=self.seed),
            file=scratch,
        )
        direct = method.fit(recording)
        found = imitated(direct.pretrained)
        found |= answers("direct", direct, material, self.seed)
        if self.settings.variants:
            tuning = FineTuning((DENSE, OUTPUT), self.settings.epochs, seed=self.seed)
            for name, transfer in (
                ("aligned", Alignment(seed=self.seed)),
                ("frozen", tuning),
            ):
                other = replace(method, transfer=transfer, pretrained=direct.pretrained)
                fitted = other.fit(recording)
                found |= answers(name, fitted, material, self.seed)
        return found
