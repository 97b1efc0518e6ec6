"""Methods without a network learn in seconds: springs, a process, and your own."""

from dataclasses import dataclass
from pathlib import Path

from typing_extensions import override

from scenarios.paper.material import Material
from scenarios.paper.transfer.answers import answers
from scenarios.paper.transfer.own_method import OwnMethod
from scenarios.paper.work.cells import Cell, Result
from stiffness.methods.gp_residual import GpResidual
from stiffness.methods.vjm import Vjm


@dataclass(frozen=True)
class SpringsCell(Cell):
    """What needs no network: springs, and a Gaussian process on what they leave."""

    seed: int
    evaluations: int

    @property
    @override
    def cost(self) -> float:
        return 8.0

    @override
    def work(self, material: Material, scratch: Path) -> Result:
        training = material.training(self.seed)
        process = GpResidual(material.arm, evaluations=self.evaluations).fit(training)
        springs = Vjm(material.arm).fit(training)
        return {
            **answers("vjm", springs, material, self.seed),
            **answers("gp_residual", process, material, self.seed),
        }


@dataclass(frozen=True)
class OwnCell(Cell):
    """A user's own method on one split."""

    seed: int
    own: OwnMethod

    @property
    @override
    def cost(self) -> float:
        return 10.0

    @override
    def work(self, material: Material, scratch: Path) -> Result:
        method = self.own.load()(material.arm)
        fitted = method.fit(material.training(self.seed))
        return answers("own", fitted, material, self.seed)
