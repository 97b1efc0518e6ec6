"""FT-MLP and DT-CNN: networks trained on fitted springs and transferred to the arm.

==========  ==========================================================================
Equation    d(p) = network(q, w) + d_VJM(p) - d_VJM(p_0); p_0, the network's point;
            network trained on d_VJM over a source plan; FT-MLP: then two of its layers
            on the measured d; torque about o_0 = torque about o + R (o - o_0) x force
Source      Wu et al. 2024, Fig. 2, sections 4 and 5: FT-MLP, four hidden layers of 380,
            ReLU; first and second hidden layer corrected; best epoch on a fifth of the
            data; sections 2.2 and 5.3: DT-CNN, after Zhao et al. 2021, "directly
            predicting the target domain after training in the source domain"
Needs       what the virtual joint model needs; FT-MLP at least two poses
Assumes     postures and wrenches among those of the source plan: a network does not
            extrapolate. Table 4 has A4 = A6 = 0, Table 5 three wrenches of six. DT-CNN:
            the arm behaves as the springs. Where p is not p_0: the flange turns as the
            springs predict
==========  ==========================================================================

With the paper's Table 5 as the plan (`table_5_plan()`) the experiment has wrenches
outside the network's training data; with `spanning_plan()`, the default, it has not.

DT-CNN transfers in one of three ways, the first is the paper's.
`stiffness.networks.model` describes which inputs are channels, and what pooling does to
a signal of length one.

- `Direct()`: without change.
- `Alignment()`: the reference's; features of the recording's postures and wrenches get
  the covariance of those of the source. Measured deflections are not used.
- `FineTuning(unfrozen=…)`: frozen layers, as in FT-MLP. Layers 1 to 4 are the
  convolutions, 5 is dense, 6 the output layer.
"""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from bench.shared.recording import Recording
from stiffness.experiment.deflections import (
    Deflections,
    LoadCases,
    every_plateau,
)
from stiffness.methods.method import Fitted, Method, Parameter
from stiffness.methods.vjm import Vjm, VjmFit
from stiffness.networks.model import Cnn, DeflectionNetwork
from stiffness.networks.pretraining import Pretrained, Pretraining, pretrain
from stiffness.networks.source_domain import (
    SourceDomain,
    SourcePlan,
    source_domain,
    spanning_plan,
)
from stiffness.networks.training import Tell, about
from stiffness.networks.transfer import (
    Alignment,
    FineTuned,
    FineTuning,
    align,
    fine_tune,
)
from stiffness.robot.arm import Arm

# --- Fitted networks -----------------------------------------------------------------

SAME_POINT = 1e-6
"""Points closer than this are one, in m; chosen: a turn of 1 mrad moves it 1 nm."""


@dataclass(frozen=True)
class NetworkFit(Fitted):
    """A trained network, and the springs that it was pre-trained on.

    Attributes:
        network: Predicts the deflection of its own point.
        springs: Predict the deflection of other points relative to it.
    """

    network: DeflectionNetwork
    springs: VjmFit

    @override
    def predict(self, cases: LoadCases) -> Float[np.ndarray, "cases 3"]:
        """Predict with the network, and carry the result to each case's point."""
        wrench = wrench_about(self.springs.arm, cases, self.network.origin_in_flange)
        answer = self.network.predict(cases.posture, wrench)
        return answer + relative_deflection(
            self.springs, cases, self.network.point_in_flange
        )

    @property
    @override
    def parameters(self) -> tuple[Parameter, ...]:
        """None: weights have no meaning one by one."""
        return ()


def wrench_about(
    arm: Arm, cases: LoadCases, origin_in_flange: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "cases 6"]:
    """Return the wrenches with torques about another point of the flange.

    It is in m.
    """
    apart = cases.origin_in_flange - origin_in_flange
    if np.linalg.norm(apart) < SAME_POINT:
        return cases.wrench_in_base
    lever = arm.at(cases.posture).turn("flange") @ apart
    force, torque = cases.wrench_in_base[:, :3], cases.wrench_in_base[:, 3:]
    return np.hstack([force, torque + np.cross(lever, force)])


def relative_deflection(
    springs: VjmFit, cases: LoadCases, point_in_flange: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "cases 3"]:
    """Return the deflection of each case's point relative to a common point, in m.

    Both points are in m.
    """
    apart = np.linalg.norm(cases.point_in_flange - point_in_flange, axis=1)
    farther = np.zeros((len(cases), 3))
    far = np.flatnonzero(apart > SAME_POINT)
    if len(far):
        meant = cases.take(far)
        common = np.broadcast_to(point_in_flange, (len(far), 3))
        answers = [
            springs.predict(c) for c in (meant, replace(meant, point_in_flange=common))
        ]
        farther[far] = answers[0] - answers[1]
    return farther


# --- Methods --------------------------------------------------------------------------


@dataclass(frozen=True)
class Direct:
    """Transfer without change: predictions of the pre-trained network."""


Transfer: TypeAlias = Direct | Alignment | FineTuning
"""The three ways to transfer a network from springs to the arm."""


@dataclass(frozen=True)
class Transferred(Method):
    """A network that is trained on fitted springs and transferred to the arm.

    Attributes:
        arm: The nominal arm.
        plan: Postures and wrenches of the pre-training.
        pretraining: Network and pre-training.
        transfer: `Direct()`, an `Alignment` or a `FineTuning`.
        held: Axes whose compliance the springs take from the model, as in `Vjm`.
        pretrained: A network to use in place of a new pre-training; for sweeps.
        file: File of the pre-training, to resume after an interruption.
        tell: Callback for every step: its phase, its number, the loss.
    """

    arm: Arm
    plan: SourcePlan = field(default_factory=spanning_plan, repr=False)
    pretraining: Pretraining = field(default_factory=Pretraining)
    transfer: Transfer = field(default_factory=Direct)
    held: tuple[str, ...] = ()
    pretrained: Pretrained | None = None
    file: Path | None = None
    tell: Tell | None = None

    @override
    def fit(self, recording: Recording) -> "TransferredFit":
        """Fit springs, pre-train on them, transfer; see the base class.

        Raises:
            Unusable: Where the recording or the file cannot be used, with all faults.
            NotIdentifiable: Where an axis' spring cannot be identified, by name.
        """
        arm = self.arm.for_recording(recording)
        springs = Vjm(arm, self.held).fit(recording)
        data = every_plateau(arm, recording, springs.compliance)
        pretrained = self.pretrained or pretrain(
            domain_of(springs, self.plan, data),
            self.pretraining,
            self.file,
            about(self.tell, "pre-training"),
        )
        network, tuned = pretrained.network, None
        if isinstance(self.transfer, Alignment):
            domain, seen = (
                domain_of(springs, self.plan, data),
                as_seen(network, arm, data),
            )
            told = about(self.tell, "alignment")
            network = align(network, domain, seen, self.transfer, told)
        elif isinstance(self.transfer, FineTuning):
            tuned = tune(network, springs, data, self.transfer, self.tell)
            network = tuned.network
        return TransferredFit(network, springs, pretrained, tuned)


@dataclass(frozen=True)
class FtMlp(Transferred):
    """FT-MLP, the paper's method: a perceptron, two of whose layers are fine-tuned."""

    transfer: Transfer = field(default_factory=FineTuning)


@dataclass(frozen=True)
class DtCnn(Transferred):
    """DT-CNN, the method that the paper compares with."""

    pretraining: Pretraining = field(default_factory=lambda: Pretraining(shape=Cnn()))


@dataclass(frozen=True)
class TransferredFit(NetworkFit):
    """A transferred network, with its pre-training.

    Attributes:
        pretrained: The network before the transfer.
        tuned: Result of the fine-tuning; None: there was none.
    """

    pretrained: Pretrained
    tuned: FineTuned | None


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
