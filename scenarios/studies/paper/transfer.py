"""Cells in which every method learns from the same poses and predicts the same.

A seed splits the experiment's poses: 80 % are for learning, 20 % are held out. FT-MLP
holds back a fifth of the first to choose its epoch, so no pose of the evaluation is
used for a choice. Cells: springs and Gaussian process; FT-MLP, pre-trained on springs
once and fine-tuned in many ways (Tables 8 to 10); DT-CNN, as pre-trained or
transferred; named physics; and a user's own method.

A user's method is `package.module:Class`, imported from where Python finds modules, the
working folder included. The class derives from `Method` and takes the nominal arm;
`fit(recording)` returns a `Fitted`, which can `predict(cases)`: deflections in m along
the base's axes.
"""

import importlib
import inspect
from collections.abc import Callable
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from bench.patch import rig_of
from bench.proof.setup import mounted_on
from bench.shared.errors import Unusable
from bench.shared.recording import Recording
from scenarios.pipelines.patching import patch_of_diagnosis
from scenarios.pipelines.synthetic_recording import KR10
from scenarios.studies.paper.budget import PLANS, Budget, Transfer
from scenarios.studies.paper.cells import Cell, CellResult
from scenarios.studies.paper.experiment import Material, displacement
from scenarios.studies.paper.imitation import imitated, source_plan, step_cost
from stiffness.experiment.deflections import every_plateau
from stiffness.methods.gp_residual import GpResidual
from stiffness.methods.method import Fitted, Method, faults
from stiffness.methods.named_physics import NamedPhysics, NamedPhysicsFit
from stiffness.methods.transferred_networks import DtCnn, FtMlp, NetworkFit
from stiffness.methods.vjm import Vjm
from stiffness.networks.model import Cnn
from stiffness.networks.pretraining import Pretraining
from stiffness.networks.training import Training
from stiffness.networks.transfer import Alignment, FineTuned, FineTuning
from stiffness.robot.arm import Arm

# --- Predictions ----------------------------------------------------------------------


def answers(
    name: str, fitted: Fitted, material: Material, seed: int
) -> dict[str, np.ndarray]:
    """Return errors in mm on fresh poses, on poses held out and on the experiment."""
    measured = material.measured
    out = np.isin(measured.posture_id, material.held_out(seed))
    unseen = material.unseen
    error = 1e3 * (fitted.predict(measured.cases) - measured.deflection)
    return {
        f"{name}/unseen": 1e3 * (fitted.predict(unseen.cases) - unseen.deflection),
        f"{name}/held_out": error[out],
        f"{name}/experiment": error,
    }


def learnt(
    fit: NetworkFit, tuned: FineTuned, material: Material, seed: int
) -> np.ndarray:
    """Return MAE and STDE, Eqs 7 and 8, in mm, on training and on choosing poses."""
    data = every_plateau(fit.springs.arm, material.training(seed))
    error = 1e3 * np.abs(fit.predict(data.cases) - data.deflection)
    chose = np.isin(data.posture_id, tuned.held_back)
    return np.array([[e.mean(), e.std()] for e in (error[~chose], error[chose])])


# --- A user's method ------------------------------------------------------------------

EXPECTED = (
    "expected is package.module:Class, a class that derives from "
    "stiffness.methods.method.Method and is built from a stiffness.robot.arm.Arm."
)


@dataclass(frozen=True)
class OwnMethod:
    """A user's method: its name and a hash of its source.

    Attributes:
        name: `package.module:Class`.
        source: SHA-256 of its module's source, so that kept cells of another version
            are not used.
    """

    name: str
    source: str

    @classmethod
    def named(cls, name: str) -> "OwnMethod":
        """Return the method of a name, with its source's hash.

        Raises:
            Unusable: Where there is none, saying what is wrong and what is expected.
        """
        module = inspect.getsource(inspect.getmodule(_found(name)) or _found(name))
        return cls(name, sha256(module.encode()).hexdigest())

    def load(self) -> Callable[[Arm], Method]:
        """Import and return the class."""
        return _found(self.name)

    @property
    def title(self) -> str:
        """Its name in tables: the class' name."""
        return self.name.partition(":")[2]


def checked(own: OwnMethod, arm: Arm, recording: Recording) -> None:
    """Check that a method keeps to the contract, before the study runs.

    Raises:
        Unusable: With everything that would spoil the comparison.
    """
    try:
        method = own.load()(arm)
    except Exception as error:  # anything that a user's class raises when built
        fault = f"building it from an arm raises {error!r}; {EXPECTED}"
        raise Unusable(f"--method {own.name!r}", [fault]) from error
    if found := faults(method, arm, recording):
        raise Unusable(f"--method {own.name!r}", found)


def _found(name: str) -> type[Method]:
    module, _, called = name.partition(":")
    if not module or not called:
        raise Unusable(f"--method {name!r}", [f"it names no class; {EXPECTED}"])
    try:
        found = getattr(importlib.import_module(module), called, None)
    except Exception as error:  # anything that a user's module raises on import
        fault = f"{module!r} cannot be imported: {error!r}; {EXPECTED}"
        raise Unusable(f"--method {name!r}", [fault]) from error
    if not inspect.isclass(found):
        fault = f"{module!r} has no class {called!r}; {EXPECTED}"
        raise Unusable(f"--method {name!r}", [fault])
    if not issubclass(found, Method):
        fault = f"{called!r} does not derive from Method; {EXPECTED}"
        raise Unusable(f"--method {name!r}", [fault])
    return found


# --- Methods without a network --------------------------------------------------------


@dataclass(frozen=True)
class SpringsCell(Cell):
    """Springs, and a Gaussian process on their residuals, on one split."""

    seed: int
    evaluations: int

    @property
    @override
    def cost(self) -> float:
        return 8.0

    @override
    def work(self, material: Material, scratch: Path) -> CellResult:
        training = material.training(self.seed)
        process = GpResidual(material.arm, evaluations=self.evaluations).fit(training)
        springs = Vjm(material.arm).fit(training)
        return {
            **answers("vjm", springs, material, self.seed),
            **answers("gp_residual", process, material, self.seed),
        }


@dataclass(frozen=True)
class NamedPhysicsCell(Cell):
    """Named physics on one split, from the flange's target and from all markers."""

    seed: int

    @property
    @override
    def cost(self) -> float:
        return 25.0

    @override
    def work(self, material: Material, scratch: Path) -> CellResult:
        training, found = material.training(self.seed), {}
        for name, method in named_physics(material.arm).items():
            fitted = method.fit(training)
            found |= answers(name, fitted, material, self.seed)
            found[f"{name}/names"] = np.array(len(fitted.diagnosis.named))
            found[f"{name}/patched"] = against_patched_rig(fitted, material)
        return found


CHECKED = 50
"""Fresh poses on which columns are compared with mechanisms; the task's number."""


def against_patched_rig(
    fitted: NamedPhysicsFit, material: Material
) -> Float[np.ndarray, "cases 3"]:
    """Return what names move by their columns, less what they move in the simulator.

    Both have the sizes that the diagnosis gave them, and no law beside the names.

    Returns:
        Differences on the first fresh poses in mm; none where nothing was named.
    """
    mechanics = fitted.names_alone()
    if mechanics is None:
        return np.zeros((0, 3))
    some = np.arange(min(CHECKED, len(material.unseen.cases)))
    cases, recording = material.unseen.cases.take(some), mechanics.situation.recording
    kept = {term.name for term in mechanics.terms}
    named = tuple(
        e for e in fitted.diagnosis.named if (e.name.effect, e.name.where) in kept
    )
    known = replace(fitted.diagnosis, named=named, unexplained=None)
    patch = patch_of_diagnosis(known, recording, material.arm)
    patch = replace(patch, mounted=mounted_on(recording, rig_of(patch, KR10)))
    rig, path = rig_of(patch, KR10), mechanics.path
    load = cases.wrench_in_base[:, None] * path.share[:, None]
    hold = np.tile(path.read - path.changed, (len(cases), 1))
    first = len(path.share) * np.arange(len(cases))
    rows = (first, first + len(path.share) - 1)
    states = rig.respond(cases.posture, load, hold)
    moved = displacement(rig, states, rows, cases.point_in_flange)
    return 1e3 * (mechanics.displacement(cases) - moved)


def named_physics(arm: Arm, held: tuple[str, ...] = ()) -> dict[str, NamedPhysics]:
    """Return named physics by the readings that it uses; those of the others first."""
    return {
        "named_physics": NamedPhysics(arm, held),
        "named_physics_all": NamedPhysics(arm, held, "all"),
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
    def work(self, material: Material, scratch: Path) -> CellResult:
        method = self.own.load()(material.arm)
        fitted = method.fit(material.training(self.seed))
        return answers("own", fitted, material, self.seed)


# --- FT-MLP ---------------------------------------------------------------------------

EPOCH_SECONDS = 0.04
"""Time of an epoch on eight plateaus of 121 poses, of the paper's network; measured."""


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
    def work(self, material: Material, scratch: Path) -> CellResult:
        settings, recording = self.settings, material.training(self.seed)
        tuning = FineTuning(epochs=settings.epochs, seed=self.seed)
        method = FtMlp(
            material.arm,
            source_plan(self.plan, settings.every),
            Pretraining(
                settings.shape, training=Training(steps=settings.steps), seed=self.seed
            ),
            tuning,
            file=scratch,
        )
        best = method.fit(recording)
        method = replace(method, pretrained=best.pretrained)
        last = replace(method, transfer=replace(tuning, keep="last"))
        fits = {"best": best, "last": last.fit(recording)}
        slow = replace(tuning, epochs=settings.unfreezing_epochs)
        for layers in self.unfreezings:
            other = replace(method, transfer=replace(slow, unfrozen=layers))
            fits[unfrozen(layers)] = other.fit(recording)
        before = NetworkFit(best.pretrained.network, best.springs)
        found = imitated(best.pretrained) | answers(
            "pretrained", before, material, self.seed
        )
        for name, fit in fits.items():
            found |= answers(name, fit, material, self.seed)
            tuned = fit.tuned
            assert tuned is not None
            found[f"{name}/learnt"] = learnt(fit, tuned, material, self.seed)
            found[f"{name}/curve"] = 1e3 * np.array(
                [tuned.training_mae, tuned.validation_mae]
            )
            found[f"{name}/epoch"] = np.array(tuned.epoch)
        return found


def unfrozen(layers: tuple[int, ...]) -> str:
    """Return the name of an unfreezing in tables."""
    return "unfrozen " + "+".join(str(layer) for layer in layers)


# --- DT-CNN ---------------------------------------------------------------------------

STEP_SECONDS = 0.011
"""Time of a step of 256 rows, in s; as measured."""
DENSE, OUTPUT = 5, 6
"""Layers of the convolutional network that its frozen variant fine-tunes."""


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
    def work(self, material: Material, scratch: Path) -> CellResult:
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


# --- All cells ------------------------------------------------------------------------

UNFREEZINGS = ((1,), (2,), (3,), (4,), (5,), (1, 2), (2, 3), (3, 4), (4, 5))
ALL_LAYERS = (1, 2, 3, 4, 5)
"""Layers of Table 8: one, two neighbours, all; 5 is the output layer."""


def cells(budget: Budget, own: OwnMethod | None) -> list[Cell]:
    """Return every cell of Tables 8, 9 and 10."""
    settings = budget.transfer
    found: list[Cell] = []
    for i, seed in enumerate(settings.seeds):
        found.append(SpringsCell(seed, settings.evaluations))
        found.append(NamedPhysicsCell(seed))
        for plan in PLANS:
            shown = i < settings.unfreezing_seeds and plan == "spanning"
            layers = (*UNFREEZINGS, ALL_LAYERS) if shown else ()
            found.append(PerceptronCell(seed, plan, settings, layers))
            found.append(ConvolutionCell(seed, plan, settings))
        if own is not None:
            found.append(OwnCell(seed, own))
    return found
