"""Transfer of a pretrained network to an arm: fine-tuning, or CORAL alignment.

==========  ==========================================================================
Equation    fine-tuning: loss = mean |d_hat - d| over rows and directions, in mm
            + pull sum (theta - theta_0)^2 over the weights that are not frozen
            alignment: loss = mean (y - y_hat)^2 + weight |C_S - C_T|_F^2 / (4 d^2)
            C: covariance of the d features of source and target rows
Source      Wu et al. 2024, section 5, Fig. 7: MAE as the loss, first and second hidden
            layer, the epoch that is best on a fifth of the data; pull towards the
            pre-trained weights: Li, Grandvalet, Davoine 2018, "Explicit inductive bias
            for transfer learning", L2-SP; alignment: Sun, Saenko 2016, "Deep CORAL",
            Eqs 1 to 4, among those of Zhao et al. 2021, the paper's reference 34
Valid       postures and wrenches among those of the source plan; the alignment uses
            no deflection of the target, only its postures and wrenches
Ignores     the uncertainty of each reading; in the alignment, means and everything
            beyond the second moments
==========  ==========================================================================

Readings chosen: the fifth is a fifth of the poses, since rows of a pose are not
independent; "first hidden layer" is the weights that lead into it. The paper's rate of
0.03 over 50,000 epochs moves the weights far from where they were before it brings them
back; here a lower rate falls to zero over fewer epochs (chosen).
"""

from dataclasses import dataclass, field, replace
from math import cos, pi
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import nn

from bench.shared.errors import Unusable, refuse
from stiffness.networks.model import DeflectionNetwork, one_thread, weights_of
from stiffness.networks.pretraining import source_rows
from stiffness.networks.source_domain import SourceDomain
from stiffness.networks.training import Listeners, Training, Watch, train

# --- Alignment -----------------------------------------------------------------------


@dataclass(frozen=True)
class Alignment:
    """Settings of further training on the source domain with aligned features.

    Attributes:
        weight: Weight of the alignment in the loss; the reference's trade-off is 1.
        training: Steps and rate; chosen: a tenth of the pre-training, slower.

    Raises:
        Unusable: Where the weight is below 0.
    """

    weight: float = 1.0
    training: Training = field(default_factory=lambda: Training(steps=500, rate=5e-4))
    seed: int = 0

    def __post_init__(self):
        """Check the weight."""
        if not self.weight >= 0.0:
            fault = f"weight is {self.weight}, expected at least 0."
            raise Unusable("The alignment", [fault])


def coral(source: torch.Tensor, target: torch.Tensor) -> torch.Tensor:
    """Return the distance between the covariances of two sets of features."""
    apart = torch.cov(source.T) - torch.cov(target.T)
    return (apart**2).sum() / (4 * source.shape[1] ** 2)


def align(
    network: DeflectionNetwork,
    domain: SourceDomain,
    seen: Float[np.ndarray, "rows inputs"],
    settings: Alignment,
    watch: Watch | None = None,
) -> DeflectionNetwork:
    """Train on the source until the target's features have the source's covariance.

    What was seen are the target's rows, encoded as inputs of the network.
    """
    built = network.build()
    target = torch.from_numpy(seen.astype(np.float32))
    shape = network.shape

    def apart(being_trained: nn.Module, batch: torch.Tensor) -> torch.Tensor:
        features = [shape.features(being_trained, rows) for rows in (batch, target)]
        return settings.weight * coral(*features)

    aligned = train(
        built,
        source_rows(network, domain),
        settings.training,
        settings.seed,
        tell=Listeners(watch),
        penalty=apart,
    )
    return replace(network, weights=aligned.weights)


# --- Frozen layers --------------------------------------------------------------------


def unfreeze(
    layers: tuple[nn.Module, ...], network: nn.Module, unfrozen: tuple[int, ...]
) -> list[nn.Parameter]:
    """Freeze everything but some layers.

    Layers count from 1, from the inputs on.

    Returns:
        The weights that may change.

    Raises:
        Unusable: Where there is no such layer.
    """
    strange = [k for k in unfrozen if not 1 <= k <= len(layers)]
    if strange:
        fault = f"it has layers 1 to {len(layers)}, not {strange}."
        raise Unusable("The network", [fault])
    network.requires_grad_(False)
    chosen = [layers[k - 1] for k in sorted(set(unfrozen))]
    free = [weight for layer in chosen for weight in layer.parameters()]
    for weight in free:
        weight.requires_grad_()
    return free


def hold_back(
    pose: Int[np.ndarray, " rows"], share: float, seed: int
) -> Int[np.ndarray, " poses"]:
    """Draw a share of the poses for validation, at least one if any, never all."""
    poses = np.unique(pose)
    count = 0
    if share > 0.0 and len(poses) > 1:
        count = min(max(round(share * len(poses)), 1), len(poses) - 1)
    return np.sort(np.random.default_rng(seed).permutation(poses)[:count])


# --- Fine tuning ----------------------------------------------------------------------


@dataclass(frozen=True)
class FineTuning:
    """Settings of the fine-tuning: which layers, how long, which epoch is kept.

    Attributes:
        unfrozen: Layers that may change, from 1; the output layer comes last.
        epochs: Steps, each on all training rows.
        rate: Learning rate at the beginning; it falls to zero as a cosine.
        pull: Weight of the penalty towards the pre-trained weights; chosen.
        averaging: Share of the running mean of the weights that each step keeps; the
            mean is validated and kept (Polyak, Juditsky 1992); 0 = none.
        validation: Share of the poses that are held back to choose the epoch.
        keep: The epoch that is `best` on them, or the `last`: the paper's "normal".
        seed: Seed of the draw of held-back poses.

    Raises:
        Unusable: Where a setting makes no sense, naming all.
    """

    unfrozen: tuple[int, ...] = (1, 2)
    epochs: int = 300
    rate: float = 1e-3
    pull: float = 1e-4
    averaging: float = 0.98
    validation: float = 0.2
    keep: Literal["best", "last"] = "best"
    seed: int = 0

    def __post_init__(self):
        """Check the settings."""
        faults = []
        if self.epochs < 1:
            faults.append(f"epochs is {self.epochs}, expected at least 1.")
        if not self.rate > 0.0:
            faults.append(f"rate is {self.rate}, expected above 0.")
        if not self.pull >= 0.0:
            faults.append(f"pull is {self.pull}, expected at least 0.")
        for name in ("averaging", "validation"):
            if not 0.0 <= getattr(self, name) < 1.0:
                value = getattr(self, name)
                faults.append(f"{name} is {value}, expected 0 to below 1.")
        if self.keep not in ("best", "last"):
            faults.append(f"keep is {self.keep!r}, expected 'best' or 'last'.")
        elif self.keep == "best" and not self.validation:
            faults.append("keep is 'best' with no poses held back; say 'last'.")
        if not self.unfrozen:
            faults.append("unfrozen names no layer; nothing could be learnt.")
        refuse("The fine-tuning", faults)

    def rate_at(self, epoch: int) -> float:
        """Return the learning rate of an epoch, counted from 0."""
        return self.rate * (1.0 + cos(pi * epoch / self.epochs)) / 2.0


@dataclass(frozen=True)
class FineTuned:
    """A fine-tuned network, with the course of its errors.

    Attributes:
        epoch: Number of that epoch, from 1.
        held_back: Ids of the poses used for validation.
        training_mae: Error after every epoch, in m.
        validation_mae: Error after every epoch, in m; NaN without held-back poses.
    """

    network: DeflectionNetwork
    epoch: int
    held_back: Int[np.ndarray, " poses"]
    training_mae: Float[np.ndarray, " epochs"]
    validation_mae: Float[np.ndarray, " epochs"]


def fine_tune(
    network: DeflectionNetwork,
    seen: Float[np.ndarray, "rows inputs"],
    deflection: Float[np.ndarray, "rows 3"],
    pose: Int[np.ndarray, " rows"],
    settings: FineTuning,
    watch: Watch | None = None,
) -> FineTuned:
    """Fine-tune a network on measured deflections.

    What was seen are rows as inputs of the network (`DeflectionNetwork.encode`);
    measured deflections are in m along the base's axes. `watch` is called for every
    epoch, with the training MAE in mm.

    Raises:
        Unusable: Where a layer is to change that the network does not have.
    """
    built = network.build()
    free = unfreeze(network.shape.layers(built), built, settings.unfrozen)
    start = [weight.detach().clone() for weight in free]
    back = hold_back(pose, settings.validation, settings.seed)
    judges = np.isin(pose, back)
    measured = 1e3 * (deflection - network.outputs.mean)
    rows, others = (
        (torch.from_numpy(seen[k].astype(np.float32)), _single(measured[k]))
        for k in (~judges, judges)
    )
    in_mm = _single(1e3 * network.outputs.scale)
    averaged = network.build()
    curve = np.full((2, settings.epochs), np.nan)
    best, kept, which = np.inf, weights_of(built), 0
    with one_thread():
        optimizer = torch.optim.Adam(free, fused=True)
        for epoch in range(settings.epochs):
            optimizer.param_groups[0]["lr"] = settings.rate_at(epoch)
            optimizer.zero_grad()
            loss = _mae(built, rows, in_mm)
            curve[0, epoch] = loss.item()
            for weight, before in zip(free, start, strict=True):
                loss = loss + settings.pull * ((weight - before) ** 2).sum()
            loss.backward()
            optimizer.step()
            # The mean starts late: early weights would weigh in for long.
            stay = min(settings.averaging, epoch / (epoch + 1.0))
            _blend(averaged, built, stay)
            if len(back):
                with torch.no_grad():
                    curve[1, epoch] = _mae(averaged, others, in_mm).item()
            if settings.keep == "last" or curve[1, epoch] < best:
                best, which = curve[1, epoch], epoch + 1
                kept = weights_of(averaged)
            if watch is not None:
                watch(epoch + 1, float(curve[0, epoch]))
    tuned = replace(network, weights=kept)
    return FineTuned(tuned, which, back, *(1e-3 * curve))


def _mae(
    network: nn.Module, rows: tuple[torch.Tensor, torch.Tensor], in_mm: torch.Tensor
) -> torch.Tensor:
    seen, measured = rows
    return (network(seen) * in_mm - measured).abs().mean()


def _blend(averaged: nn.Module, network: nn.Module, stay: float) -> None:
    """Update the running mean of the weights."""
    with torch.no_grad():
        pairs = zip(averaged.parameters(), network.parameters(), strict=True)
        for mean, weight in pairs:
            mean.lerp_(weight, 1.0 - stay)


def _single(values: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(values.astype(np.float32))
