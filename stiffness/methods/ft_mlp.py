"""FT-MLP: network pre-trained on fitted springs and fine-tuned on measurements.

==========  ==========================================================================
Equation    d = network(q, w), trained on d_VJM over a source plan, then two of its
            layers on the measured d
Source      Wu et al. 2024, sections 4 and 5: FT-MLP, four hidden layers of 380, ReLU;
            first and second hidden layer corrected; best epoch on a fifth of the data
Needs       what the virtual joint model needs, and at least two poses
Assumes     postures and wrenches among those of the source plan: a network does not
            extrapolate. Table 4 has A4 = A6 = 0, Table 5 three wrenches of six
==========  ==========================================================================

With the paper's Table 5 as the plan (`table_5_plan()`) the experiment has wrenches
outside the network's training data; with `spanning_plan()`, the default, it has not.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from bench.shared.recording import Recording
from stiffness.experiment.deflections import Deflections, Selection, every_plateau
from stiffness.methods.method import Method
from stiffness.methods.network_fit import NetworkFit, relative_deflection, wrench_about
from stiffness.methods.vjm import Vjm, VjmFit
from stiffness.networks.fine_tuning import FineTuned, FineTuning, fine_tune
from stiffness.networks.model import DeflectionNetwork
from stiffness.networks.pretraining import Pretrained, Pretraining, pretrain
from stiffness.networks.source_domain import (
    SourceDomain,
    SourcePlan,
    source_domain,
    spanning_plan,
)
from stiffness.networks.training import Tell, about
from stiffness.robot.arm import Arm


@dataclass(frozen=True)
class FtMlp(Method):
    """FT-MLP, the paper's method.

    Attributes:
        arm: The nominal arm.
        plan: Postures and wrenches of the pre-training.
        pretraining: Network and pre-training.
        tuning: Which layers are trained, how long, which epoch is kept.
        select: Readings used for the fine-tuning: `every_plateau`, or `one_per_pose`.
        held: Axes whose compliance the springs take from the model, as in `Vjm`.
        pretrained: A network to use in place of a new pre-training; for sweeps.
        file: File of the pre-training, to resume after an interruption.
        tell: Callback for every step: its phase, its number, the loss.
    """

    arm: Arm
    plan: SourcePlan = field(default_factory=spanning_plan, repr=False)
    pretraining: Pretraining = field(default_factory=Pretraining)
    tuning: FineTuning = field(default_factory=FineTuning)
    select: Selection = every_plateau
    held: tuple[str, ...] = ()
    pretrained: Pretrained | None = None
    file: Path | None = None
    tell: Tell | None = None

    @override
    def fit(self, recording: Recording) -> "FtMlpFit":
        """Fit springs, pre-train on them, fine-tune on readings; see the base class.

        Raises:
            Unusable: Where the recording or the file cannot be used, with all faults.
            NotIdentifiable: Where an axis' spring cannot be identified, by name.
        """
        arm = self.arm.for_recording(recording)
        springs = Vjm(arm, self.held).fit(recording)
        data = self.select(arm, recording, springs.compliance)
        pretrained = self.pretrained or pretrain(
            domain_of(springs, self.plan, data),
            self.pretraining,
            self.file,
            about(self.tell, "pre-training"),
        )
        tuned = tune(pretrained.network, springs, data, self.tuning, self.tell)
        return FtMlpFit(tuned.network, springs, pretrained, tuned)


@dataclass(frozen=True)
class FtMlpFit(NetworkFit):
    """A fine-tuned network, with its pre-training.

    Attributes:
        pretrained: The network before the fine-tuning.
        tuned: Result of the fine-tuning.
    """

    pretrained: Pretrained
    tuned: FineTuned


def domain_of(springs: VjmFit, plan: SourcePlan, data: Deflections) -> SourceDomain:
    """Return the deflections of springs in a plan, at the recording's mean point."""
    point = data.cases.point_in_flange.mean(axis=0)
    origin = data.cases.origin_in_flange
    return source_domain(springs.arm, springs.compliance, plan, point, origin)


def tune(
    network: DeflectionNetwork,
    springs: VjmFit,
    data: Deflections,
    settings: FineTuning,
    tell: Tell | None = None,
) -> FineTuned:
    """Fine-tune a network on deflections, each referred to the network's own point."""
    deflection = data.deflection - relative_deflection(
        springs, data.cases, network.point_in_flange
    )
    return fine_tune(
        network,
        as_seen(network, springs.arm, data),
        deflection,
        data.posture_id,
        settings,
        about(tell, "fine-tuning"),
    )


def as_seen(
    network: DeflectionNetwork, arm: Arm, data: Deflections
) -> Float[np.ndarray, "rows inputs"]:
    """Return a recording's rows encoded as inputs of a network."""
    wrench = wrench_about(arm, data.cases, network.origin_in_flange)
    return network.encode(data.cases.posture, wrench)
