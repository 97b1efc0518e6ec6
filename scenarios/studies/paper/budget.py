"""Budgets of the study: training steps, seeds and poses for each question."""

from dataclasses import dataclass, field
from typing import Literal

from bench.shared.errors import UnknownName
from stiffness.networks.model import Mlp
from stiffness.networks.training import Training

PLANS = ("table 5", "spanning")
"""Source plans by name: the paper's, and one whose wrenches span all six dimensions."""


ON = Training(steps=300, rate=1e-3)
"""Further training on the springs of the few poses; chosen: twice as many steps bring
the network no nearer to them (0.027 and 0.026 mm off on fresh poses)."""


@dataclass(frozen=True)
class Effort:
    """What is spent on the networks.

    Attributes:
        on: Of going on with other springs.
        every: Every how many of Table 4's postures are in the source plan.
    """

    shape: Mlp = field(default_factory=Mlp)
    steps: int = 7000
    cnn_steps: int = 2500
    on: Training = ON
    epochs: int = 300
    every: int = 1


@dataclass(frozen=True)
class Sweep:
    """Budget of the choice of the network's shape: Tables 6 and 7, Fig. 5.

    Attributes:
        depths: Hidden layers of Table 6.
        depth_steps: Steps of each of its cells.
        activation_steps: Steps of each cell of Table 7.
        seeds: Of every cell of both tables.
        widths: Neurons a layer of Fig. 5.
        width_depths: Hidden layers of Fig. 5.
        width_steps: Steps of each of its cells, one seed.
        convergence: Steps of Table 6's four layers, to see whether more would help.
        chosen: What Table 7 varies the activation of.
        every: Every how many of Table 4's postures are in the source plan.
    """

    depth_steps: int
    activation_steps: int
    seeds: tuple[int, ...]
    widths: tuple[int, ...]
    width_steps: int
    convergence: tuple[int, ...] = ()
    depths: tuple[int, ...] = (2, 3, 4, 5, 6)
    width_depths: tuple[int, ...] = (3, 4, 5)
    chosen: Mlp = field(default_factory=Mlp)
    every: int = 1


@dataclass(frozen=True)
class Transfer:
    """How the methods are compared: Tables 8, 9 and 10.

    Attributes:
        cnn_steps: Of pre-training the convolutional network; at the full budget as many
            as the perceptron's.
        unfreezing_epochs: Of fine-tuning in Table 8.
        seeds: Of Tables 9 and 10; each has its own split of the poses.
        unfreezing_seeds: How many of them Table 8 takes.
        variants: Whether the reference's alignment and frozen layers are shown too.
        evaluations: Of the Gaussian process' likelihood.
        shape: Of the perceptron.
        every: As in `Sweep`.
    """

    steps: int
    cnn_steps: int
    epochs: int
    unfreezing_epochs: int
    seeds: tuple[int, ...]
    unfreezing_seeds: int = 3
    variants: bool = True
    evaluations: int = 60
    shape: Mlp = field(default_factory=Mlp)
    every: int = 1


@dataclass(frozen=True)
class Budget:
    """The whole budget of the study."""

    name: str
    unseen: int
    sweep: Sweep
    transfer: Transfer


def budget(name: Literal["quick", "full", "tiny"], seed: int) -> Budget:
    """Return a budget; its seeds are consecutive from the one given.

    Raises:
        UnknownName: Where there is none of that name.
    """
    if name == "quick":
        sweep = Sweep(
            depth_steps=1000,
            activation_steps=800,
            seeds=(seed,),
            widths=(40, 120, 260, 400),
            width_steps=400,
        )
        transfer = Transfer(
            steps=7000,
            cnn_steps=2500,
            epochs=300,
            unfreezing_epochs=150,
            seeds=(seed,),
            unfreezing_seeds=1,
            variants=False,
        )
        return Budget(name, 500, sweep, transfer)
    if name == "full":
        three, five = tuple(range(seed, seed + 3)), tuple(range(seed, seed + 5))
        sweep = Sweep(
            depth_steps=20_000,
            activation_steps=10_000,
            seeds=three,
            widths=tuple(range(40, 401, 20)),
            width_steps=5000,
            convergence=(5000, 10_000, 20_000, 40_000),
        )
        transfer = Transfer(
            steps=20_000,
            cnn_steps=20_000,
            epochs=300,
            unfreezing_epochs=300,
            seeds=five,
        )
        return Budget(name, 1000, sweep, transfer)
    if name == "tiny":
        small = Mlp(hidden=4, width=16)
        sweep = Sweep(
            depth_steps=20,
            activation_steps=20,
            seeds=(seed,),
            widths=(8, 16),
            width_steps=20,
            depths=(2, 4),
            width_depths=(3,),
            chosen=small,
            every=80,
        )
        transfer = Transfer(
            steps=20,
            cnn_steps=5,
            epochs=6,
            unfreezing_epochs=4,
            seeds=(seed,),
            unfreezing_seeds=1,
            variants=False,
            evaluations=3,
            shape=small,
            every=80,
        )
        return Budget(name, 16, sweep, transfer)
    raise UnknownName("budget", name, ("quick", "full", "tiny"))


def said_seeds(n: int) -> str:
    """Return the number of seeds in words."""
    return "one seed" if n == 1 else f"{n} seeds"
