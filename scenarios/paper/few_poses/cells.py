"""Methods learn from a few poses, each from as many as it is given and no more."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from typing_extensions import override

from scenarios.paper.few_poses.networks import PLAN, Effort, gone_on, prepared
from scenarios.paper.few_poses.springs import few_of, springs_of
from scenarios.paper.imitation.cells import source_plan
from scenarios.paper.material import Material
from scenarios.paper.work.cells import Cell, Result
from stiffness.deflections import every_plateau
from stiffness.methods.dt_cnn import DtCnn
from stiffness.methods.ft_mlp import FtMlp, domain_of
from stiffness.methods.gp_residual import GpResidual
from stiffness.methods.method import Fitted
from stiffness.networks.fine_tuning import FineTuning


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
            gone_on(
                prepared(kind, material, self.effort, self.seed, scratch.parent),
                domain,
                self.effort.on,
                self.seed,
            )
            for kind in ("mlp", "cnn")
        )
        tuning = FineTuning(epochs=self.effort.epochs, seed=self.draw)
        tuned = FtMlp(material.arm, tuning=tuning, held=held, pretrained=mlp)
        direct = DtCnn(material.arm, held=held, pretrained=cnn)
        return left({"ft_mlp": tuned.fit(few), "dt_cnn": direct.fit(few)}, material)


def left(fits: Mapping[str, Fitted], material: Material) -> dict[str, np.ndarray]:
    """Return what methods leave on the fresh poses, in mm."""
    unseen = material.unseen
    return {
        name: 1e3 * (fit.predict(unseen.cases) - unseen.deflection)
        for name, fit in fits.items()
    }
