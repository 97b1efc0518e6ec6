"""DT-CNN: convolutional network trained on fitted springs and transferred to the arm.

==========  ==========================================================================
Equation    d = network(q, w), trained on d_VJM over a source plan
Source      Wu et al. 2024, sections 2.2 and 5.3: DT-CNN, after Zhao et al. 2021; the
            paper's text: "directly predicting the target domain after training in the
            source domain"
Needs       what the virtual joint model needs
Assumes     postures and wrenches among those of the source plan, and an arm that
            behaves as the springs: measured deflections change only the springs
==========  ==========================================================================

Three ways to transfer, the first is the paper's. `stiffness.networks.model` describes
which inputs are channels, and what pooling does to a signal of length one.

- `Direct()`: without change.
- `Alignment()`: the reference's; features of the recording's postures and wrenches get
  the covariance of those of the source. Measured deflections are not used.
- `FineTuning(unfrozen=…)`: frozen layers, as in FT-MLP. Layers 1 to 4 are the
  convolutions, 5 is dense, 6 the output layer.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias

from typing_extensions import override

from bench.shared.recording import Recording
from stiffness.experiment.deflections import Selection, every_plateau
from stiffness.methods.ft_mlp import as_seen, domain_of, tune
from stiffness.methods.method import Method
from stiffness.methods.network_fit import NetworkFit
from stiffness.methods.vjm import Vjm
from stiffness.networks.alignment import Alignment, align
from stiffness.networks.fine_tuning import FineTuning
from stiffness.networks.model import Cnn
from stiffness.networks.pretraining import Pretrained, Pretraining, pretrain
from stiffness.networks.source_domain import SourcePlan, spanning_plan
from stiffness.networks.training import Tell, about
from stiffness.robot.arm import Arm


@dataclass(frozen=True)
class Direct:
    """Transfer without change: predictions of the pre-trained network."""


Transfer: TypeAlias = Direct | Alignment | FineTuning
"""The three ways to transfer a network from springs to the arm."""


@dataclass(frozen=True)
class DtCnn(Method):
    """DT-CNN, the method that the paper compares with.

    Attributes:
        arm: The nominal arm.
        plan: Postures and wrenches of the pre-training.
        pretraining: Network and pre-training.
        transfer: `Direct()`, an `Alignment` or a `FineTuning`.
        select: Readings used for the transfer.
        held: Axes whose compliance the springs take from the model, as in `Vjm`.
        pretrained: A network to use in place of a new pre-training; for sweeps.
        file: File of the pre-training, to resume after an interruption.
        tell: Callback for every step: its phase, its number, the loss.
    """

    arm: Arm
    plan: SourcePlan = field(default_factory=spanning_plan, repr=False)
    pretraining: Pretraining = field(default_factory=lambda: Pretraining(shape=Cnn()))
    transfer: Transfer = field(default_factory=Direct)
    select: Selection = every_plateau
    held: tuple[str, ...] = ()
    pretrained: Pretrained | None = None
    file: Path | None = None
    tell: Tell | None = None

    @override
    def fit(self, recording: Recording) -> "DtCnnFit":
        """Fit springs, pre-train on them, transfer; see the base class.

        Raises:
            Unusable: Where the recording or the file cannot be used, with all faults.
            NotIdentifiable: Where an axis' spring cannot be identified, by name.
        """
        arm = self.arm.for_recording(recording)
        springs = Vjm(arm, self.held).fit(recording)
        data = self.select(arm, recording, springs.compliance)
        domain = domain_of(springs, self.plan, data)
        pretrained = self.pretrained or pretrain(
            domain, self.pretraining, self.file, about(self.tell, "pre-training")
        )
        network = pretrained.network
        if isinstance(self.transfer, Alignment):
            seen = as_seen(network, arm, data)
            told = about(self.tell, "alignment")
            network = align(network, domain, seen, self.transfer, told)
        elif isinstance(self.transfer, FineTuning):
            tuned = tune(network, springs, data, self.transfer, self.tell)
            network = tuned.network
        return DtCnnFit(network, springs, pretrained)


@dataclass(frozen=True)
class DtCnnFit(NetworkFit):
    """A transferred network, with its pre-training.

    Attributes:
        pretrained: The network before the transfer.
    """

    pretrained: Pretrained
