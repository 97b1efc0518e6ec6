"""Training by minibatch gradient descent, with progress that can be stored.

A `Progress` can be reported, written to a file and resumed. The file is a plain archive
of arrays (`np.savez`): key of the training, number of steps, weights, the optimiser's
moments, losses. It holds no code. A key prevents resuming another training.

==========  ==========================================================================
Equation    loss = mean (y - y_hat)^2; rate(s) rises linearly over the first w steps to
            its peak and then falls as peak (1 + cos(pi (s - w) / (S - w))) / 2
Source      loss: Wu et al. 2024, Eq. 3; its "dynamic adjustment" of the rate is not
            given: Loshchilov, Hutter 2017, "SGDR"; steps: Kingma, Ba 2015, "Adam"
Valid       numbers without units (`stiffness.networks.model`)
Ignores     nothing that is known to matter here
==========  ==========================================================================

The paper takes 100,000 steps on all rows at once, days on a desk; here each step uses a
mini-batch. Everything follows from the seed and the number of the step, so that a
training that was interrupted resumes to the same weights.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from math import cos, pi
from pathlib import Path
from typing import TYPE_CHECKING
from zipfile import BadZipFile

import numpy as np
from jaxtyping import Float

from bench.shared import replaced_whole
from bench.shared.errors import Unusable, refuse
from stiffness.networks.model import load, one_thread, weights_of

if TYPE_CHECKING:  # who only states steps and rates needs no torch
    import torch

# --- Progress -------------------------------------------------------------------------

EVERY = 500
"""Steps between two saves of a training; chosen: ten seconds."""


@dataclass(frozen=True)
class Progress:
    """State of a training after some steps.

    Attributes:
        weights: Weights, by the network's names.
        moments: The optimiser's moments, by the same names.
        loss: Loss of every step done; no unit.
    """

    step: int
    weights: Mapping[str, np.ndarray]
    moments: Mapping[str, np.ndarray]
    loss: Float[np.ndarray, " steps"]


Watch = Callable[[int, float], None]
"""Callback for every step: number of steps done, and the loss."""
Keep = Callable[[Progress], None]
"""Callback that receives the training at intervals, to save it."""


@dataclass(frozen=True)
class Listeners:
    """Callbacks of a training."""

    watch: Watch | None = None
    keep: Keep | None = None
    every: int = EVERY


Tell = Callable[[str, int, float], None]
"""Callback with the phase (`pre-training`, `alignment`, `fine-tuning`), the number of
its steps done, and the loss: without unit, in mm while fine-tuning."""


def about(tell: Tell | None, phase: str) -> Watch | None:
    """Return the callback for the steps of one phase."""
    return None if tell is None else partial(tell, phase)


def taken_down(
    optimizer: "torch.optim.Optimizer", network: "torch.nn.Module", loss: np.ndarray
) -> Progress:
    """Return a copy of the state of a training."""
    moments = {
        f"{name}.{moment}": value.numpy().copy()
        for name, parameter in network.named_parameters()
        for moment, value in optimizer.state[parameter].items()
    }
    return Progress(len(loss), weights_of(network), moments, loss.copy())


def take_up(
    optimizer: "torch.optim.Optimizer", network: "torch.nn.Module", begun: Progress
) -> None:
    """Restore the state of a training."""
    import torch

    load(network, begun.weights)
    for name, parameter in network.named_parameters():
        optimizer.state[parameter] = {
            moment: torch.from_numpy(np.array(begun.moments[f"{name}.{moment}"]))
            for moment in ("step", "exp_avg", "exp_avg_sq")
        }


# --- Store ----------------------------------------------------------------------------

WEIGHTS, MOMENTS = "weights/", "moments/"


def write_progress(file: Path, key: str, progress: Progress) -> None:
    """Write a training atomically: a failure leaves the old file.

    The key identifies this training; the file's name should end in `.npz`.

    Raises:
        Unusable: Where the file cannot be written.
    """
    arrays = {"key": np.array(key), "loss": progress.loss}
    arrays |= {WEIGHTS + name: value for name, value in progress.weights.items()}
    arrays |= {MOMENTS + name: value for name, value in progress.moments.items()}
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with replaced_whole(file) as beside, beside.open("wb") as data:
            np.savez(data, **arrays)  # pyright: ignore[reportArgumentType]
    except OSError as error:
        fault = f"it cannot be written: {error}."
        raise Unusable(f"Training {str(file)!r}", [fault]) from error


def begun_or_none(file: Path, key: str) -> Progress | None:
    """Read a training of this key; None without a file or with another key.

    Raises:
        Unusable: Where the file exists but holds no training.
    """
    if not file.exists():
        return None
    try:
        with file.open("rb") as data, np.load(data, allow_pickle=False) as archive:
            if str(archive["key"]) != key:
                return None
            loss = archive["loss"]
            arrays = {name: archive[name] for name in archive.files}
    except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
        fault = "it is no training, or damaged; delete it to begin anew."
        raise Unusable(f"Training {str(file)!r}", [fault]) from error
    weights, moments = (
        {name.removeprefix(p): a for name, a in arrays.items() if name.startswith(p)}
        for p in (WEIGHTS, MOMENTS)
    )
    return Progress(len(loss), weights, moments, loss)


# --- Training -------------------------------------------------------------------------

Penalty = Callable[["torch.nn.Module", "torch.Tensor"], "torch.Tensor"]
"""Term added to the loss, given the network and the inputs of a mini-batch."""


@dataclass(frozen=True)
class Training:
    """Settings of a training: steps, batch and learning rate.

    Attributes:
        batch: Rows of each step; 256: chosen, best accuracy per second here.
        rate: Peak learning rate.
        warm_up: Share of the steps over which the rate rises; chosen.
        forget: Adam's beta_2; chosen: 0.999, its usual value, was slower here.

    Raises:
        Unusable: Where a number makes no sense, naming all.
    """

    steps: int = 5000
    batch: int = 256
    rate: float = 2e-3
    warm_up: float = 0.05
    forget: float = 0.98

    def __post_init__(self):
        """Check the numbers."""
        faults = [
            f"{name} is {getattr(self, name)}, expected at least 1."
            for name in ("steps", "batch")
            if getattr(self, name) < 1
        ]
        if not self.rate > 0.0:
            faults.append(f"rate is {self.rate}, expected above 0.")
        if not 0.0 <= self.warm_up < 1.0:
            faults.append(f"warm_up is {self.warm_up}, expected 0 to below 1.")
        if not 0.0 < self.forget < 1.0:
            faults.append(f"forget is {self.forget}, expected between 0 and 1.")
        refuse("The training", faults)

    def rate_at(self, step: int) -> float:
        """Return the learning rate of a step, counted from 0."""
        rising = round(self.warm_up * self.steps)
        if step < rising:
            return self.rate * (step + 1) / rising
        return self.rate * (1.0 + cos(pi * (step - rising) / (self.steps - rising))) / 2


def train(
    network: "torch.nn.Module",
    rows: tuple[Float[np.ndarray, "rows inputs"], Float[np.ndarray, "rows 3"]],
    settings: Training,
    seed: int,
    begun: Progress | None = None,
    tell: Listeners | None = None,
    penalty: Penalty | None = None,
) -> Progress:
    """Train a network in place; on one thread, for reproducible results.

    Inputs and targets have no unit; the seed orders the rows.
    """
    import torch

    tell = tell or Listeners()
    with one_thread(), torch.random.fork_rng(devices=[]):
        weights, betas = network.parameters(), (0.9, settings.forget)
        optimizer = torch.optim.Adam(weights, lr=0.0, betas=betas, fused=True)
        loss_of = np.zeros(settings.steps)
        start = 0
        if begun is not None:
            start = begun.step
            loss_of[:start] = begun.loss
            take_up(optimizer, network, begun)
        x, y = (torch.from_numpy(values.astype(np.float32)) for values in rows)
        batches = _batches(len(x), settings.batch, seed, start)
        network.train()
        for step in range(start, settings.steps):
            torch.manual_seed(seed * settings.steps + step)  # for layers that draw
            batch = torch.from_numpy(next(batches))
            optimizer.param_groups[0]["lr"] = settings.rate_at(step)
            optimizer.zero_grad()
            some = x[batch]
            loss = torch.nn.functional.mse_loss(network(some), y[batch])
            if penalty is not None:
                loss = loss + penalty(network, some)
            loss.backward()
            optimizer.step()
            loss_of[step] = loss.item()
            done = step + 1
            if tell.watch is not None:
                tell.watch(done, float(loss_of[step]))
            if tell.keep is not None and done % tell.every == 0:
                tell.keep(taken_down(optimizer, network, loss_of[:done]))
        network.eval()
        return taken_down(optimizer, network, loss_of)


def _batches(rows: int, batch: int, seed: int, start: int) -> Iterator[np.ndarray]:
    """Yield batches of rows from step `start` on; no epoch repeats a row."""
    batch = min(batch, rows)
    per_epoch = rows // batch
    epoch, first = divmod(start, per_epoch)
    while True:
        order = np.random.default_rng([seed, epoch]).permutation(rows)
        for i in range(first, per_epoch):
            yield order[i * batch : (i + 1) * batch]
        epoch, first = epoch + 1, 0
