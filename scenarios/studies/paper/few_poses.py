"""How many poses are enough: methods that learn from 5 to 121 poses.

`springs_of` fits springs to few poses; an axis that these do not identify keeps the
stiffness of the model file. A network is pre-trained once on the springs of the model
file (`prepared`), so that no pose is used before its turn, and then trained for some
steps on the springs that the few poses show (`gone_on`). Each cell holds the methods on
some poses of one draw; tables and figure give mean and range over draws.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure as Picture
from typing_extensions import override

from bench.shared.errors import NotIdentifiable
from bench.shared.recording import Recording
from scenarios.report import figures, page
from scenarios.studies.paper.budget import Effort
from scenarios.studies.paper.cells import Cell, CellResult
from scenarios.studies.paper.comparison import NAMED, TITLES
from scenarios.studies.paper.experiment import Material
from scenarios.studies.paper.imitation import source_plan
from scenarios.studies.paper.transfer import named_physics
from stiffness.experiment.deflections import every_plateau
from stiffness.methods.gp_residual import GpResidual
from stiffness.methods.method import Fitted
from stiffness.methods.transferred_networks import DtCnn, FtMlp, domain_of
from stiffness.methods.vjm import Vjm, VjmFit
from stiffness.networks.model import Cnn
from stiffness.networks.pretraining import (
    Pretrained,
    Pretraining,
    pretrain,
    source_rows,
)
from stiffness.networks.source_domain import SourceDomain, source_domain
from stiffness.networks.training import Training, train
from stiffness.networks.transfer import FineTuning
from stiffness.robot.arm import Arm

# --- Springs from few poses -----------------------------------------------------------


def few_of(recording: Recording, poses: int, draw: int) -> Recording:
    """Draw some poses of a recording, with all of their visits."""
    known = np.unique(recording.posture_id)
    order = np.random.default_rng([draw, len(known)]).permutation(known)
    return recording.take(np.isin(recording.posture_id, order[:poses]))


def springs_of(arm: Arm, few: Recording) -> tuple[VjmFit, tuple[str, ...]]:
    """Fit springs, holding as few axes as necessary; return the fit and these axes.

    Of the axes that are not identifiable, the one nearest to the tool is held, until
    the others are: its spring moves the tool by the shortest lever, so an error of the
    model's value has the least effect.

    Raises:
        NotIdentifiable: Where no axis is identifiable with all others held.
    """
    held: tuple[str, ...] = ()
    while True:
        try:
            return Vjm(arm, held).fit(few), held
        except NotIdentifiable as refusal:
            free = [axis for axis in arm.axes if axis not in held]
            if len(free) == 1:
                raise
            furthest = [axis for axis in free if axis in refusal.axes] or free
            held = tuple(a for a in arm.axes if a in (*held, furthest[-1]))


# --- Networks from few poses ----------------------------------------------------------

PLAN = "spanning"
NETWORKS = ("mlp", "cnn")


def prepared(
    kind: str, material: Material, effort: Effort, seed: int, folder: Path
) -> Pretrained:
    """Return a network pre-trained on the model file's springs; kept in the folder."""
    data = material.measured
    domain = source_domain(
        material.arm,
        1.0 / material.arm.stiffness,
        source_plan(PLAN, effort.every),
        data.cases.point_in_flange.mean(axis=0),
        data.cases.origin_in_flange,
    )
    shape, steps = (
        (effort.shape, effort.steps) if kind == "mlp" else (Cnn(), effort.cnn_steps)
    )
    settings = Pretraining(shape, training=Training(steps=steps), seed=seed)
    folder.mkdir(parents=True, exist_ok=True)
    return pretrain(domain, settings, folder / _file(kind))


def prepared_files(
    material: Material, effort: Effort, seed: int, folder: Path
) -> tuple[str, ...]:
    """Pre-train both networks, once for all cells; return the names of their files."""
    for kind in NETWORKS:
        prepared(kind, material, effort, seed, folder)
    return tuple(map(_file, NETWORKS))


def _file(kind: str) -> str:
    return f"model-springs-{kind}.npz"


def gone_on(
    base: Pretrained, domain: SourceDomain, training: Training, seed: int
) -> Pretrained:
    """Return a pre-trained network after further steps on other springs."""
    network = base.network
    after = train(network.build(), source_rows(network, domain), training, seed)
    return replace(base, network=replace(network, weights=after.weights))


# --- Cells ----------------------------------------------------------------------------


@dataclass(frozen=True)
class FewPosesPlain(Cell):
    """Springs, and a Gaussian process on their residuals, on some poses of one draw.

    Attributes:
        draw: Number of the draw; smaller numbers of poses are subsets of larger ones.
    """

    poses: int
    draw: int

    @property
    @override
    def cost(self) -> float:
        return 0.1 + 0.03 * self.poses

    @override
    def work(self, material: Material, scratch: Path) -> CellResult:
        few = few_of(material.recording, self.poses, self.draw)
        springs, held = springs_of(material.arm, few)
        process = GpResidual(material.arm, held=held).fit(few)
        found = residuals({"vjm": springs, "gp_residual": process}, material)
        return found | {"held": np.isin(material.arm.axes, held)}


@dataclass(frozen=True)
class FewPosesNetworks(Cell):
    """Both networks on some poses of one draw."""

    poses: int
    draw: int
    effort: Effort
    seed: int

    @property
    @override
    def cost(self) -> float:
        return 0.02 * self.effort.on.steps + 2e-4 * self.effort.epochs * self.poses + 1

    @override
    def work(self, material: Material, scratch: Path) -> CellResult:
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
            for kind in NETWORKS
        )
        tuning = FineTuning(epochs=self.effort.epochs, seed=self.draw)
        tuned = FtMlp(material.arm, transfer=tuning, held=held, pretrained=mlp)
        direct = DtCnn(material.arm, held=held, pretrained=cnn)
        return residuals(
            {"ft_mlp": tuned.fit(few), "dt_cnn": direct.fit(few)}, material
        )


@dataclass(frozen=True)
class FewPosesNamed(Cell):
    """Named physics on some poses of one draw.

    Attributes:
        all_markers: Whether it is fitted to all markers too.
    """

    poses: int
    draw: int
    all_markers: bool

    @property
    @override
    def cost(self) -> float:
        return (3.0 + 0.05 * self.poses) * (3.0 if self.all_markers else 1.0)

    @override
    def work(self, material: Material, scratch: Path) -> CellResult:
        few = few_of(material.recording, self.poses, self.draw)
        _, held = springs_of(material.arm, few)
        methods = named_physics(material.arm, held)
        if not self.all_markers:
            methods = {name: methods[name] for name in NAMED[:1]}
        fits = {name: method.fit(few) for name, method in methods.items()}
        names = {
            f"{n}/names": np.array(len(f.diagnosis.named)) for n, f in fits.items()
        }
        return {**residuals(fits, material), **names}


def residuals(fits: Mapping[str, Fitted], material: Material) -> dict[str, np.ndarray]:
    """Return the residuals of methods on the fresh poses, in mm."""
    unseen = material.unseen
    return {
        name: 1e3 * (fit.predict(unseen.cases) - unseen.deflection)
        for name, fit in fits.items()
    }


# --- Tables ---------------------------------------------------------------------------

METHODS = ("vjm", "ft_mlp", "dt_cnn", "gp_residual", *NAMED)


def tidy(
    found: Mapping[int, Mapping[int, CellResult]], fresh: int
) -> list[dict[str, object]]:
    """Return the tidy table: one row for each number of poses, method and metric.

    Results are by number of poses and by draw; not every draw has every method.
    """
    rows: list[dict[str, object]] = []
    for count, draws in found.items():
        for method in METHODS:
            mine = [result for result in draws.values() if method in result]
            if not mine:
                continue
            size = np.abs([result[method] for result in mine])  # (draws, poses, 3) mm
            springs = np.abs([result["vjm"] for result in mine])
            for metric, of_draws in (("MAE", _mae), ("P99", _p99), ("ME", _largest)):
                value, beside = of_draws(size), of_draws(springs)
                rows.append(
                    {
                        "poses": count,
                        "method": method,
                        "metric": metric,
                        "value_mm": float(value.mean()),
                        "low_mm": float(value.min()),
                        "high_mm": float(value.max()),
                        "springs_of_same_draws_mm": float(beside.mean()),
                        "better_than_springs": int((value < beside).sum()),
                        "held_axes": float(np.mean([r["held"].sum() for r in mine])),
                        "n": fresh,
                        "draws": len(mine),
                        "plan": "spanning",
                    }
                )
    return rows


def _mae(size: np.ndarray) -> np.ndarray:
    return size.mean(axis=(1, 2))


def _p99(size: np.ndarray) -> np.ndarray:
    return np.quantile(size, 0.99, axis=1).mean(axis=1)


def _largest(size: np.ndarray) -> np.ndarray:
    return size.max(axis=(1, 2))


def of(rows: Sequence[Mapping], method: str, metric: str = "MAE") -> list[Mapping]:
    """Return the rows of a method and metric, one for each number of poses."""
    return [r for r in rows if (r["method"], r["metric"]) == (method, metric)]


def errors(rows: Sequence[Mapping]) -> page.Table:
    """Return the report's table: MAE of all methods by number of poses."""
    shown = [method for method in METHODS if of(rows, method)]
    cells = []
    for beside in zip(*(of(rows, method) for method in shown), strict=True):
        springs = beside[0]
        texts = [_ranged(springs)]
        texts += [
            f"{_ranged(r)}, {r['better_than_springs']} of {r['draws']}"
            for r in beside[1:]
        ]
        held = f"{springs['held_axes']:.1f}"
        cells.append([str(springs["poses"]), held, *texts])
    drawn = "; ".join(f"{TITLES[m]} {of(rows, m)[0]['draws']}" for m in shown)
    caption = (
        f"MAE over x, y and z on {rows[0]['n']} fresh poses [mm]: mean and range of "
        "the draws of the poses learnt from, and in how many of them a method was "
        f"better than the springs of the same draw. Draws: {drawn}. Axes held: how "
        "many of the six springs were taken from the model file, on average."
    )
    header = ["poses", "axes held", *(TITLES[method] for method in shown)]
    return page.Table(caption, header, cells)


def summary(rows: Sequence[Mapping]) -> str:
    """Return from how many poses on each method is better than the springs."""
    springs = of(rows, "vjm")
    most, fewest = springs[-1], springs[0]
    enough = next(r for r in springs if r["value_mm"] <= 1.1 * most["value_mm"])
    said = []
    for method in METHODS[1:]:
        mine = of(rows, method)
        if not mine:
            continue
        in_all = [r["better_than_springs"] == r["draws"] for r in mine]
        on_average = [r["value_mm"] < r["springs_of_same_draws_mm"] for r in mine]
        said.append(
            f"{TITLES[method]} on average {_from(mine, on_average)}, in each of "
            f"{mine[0]['draws']} draws {_from(mine, in_all)}"
        )
    return (
        f"With {fewest['poses']} poses the springs leave {fewest['value_mm']:.3f} mm "
        f"on fresh ones ({fewest['held_axes']:.1f} axes held on average), with "
        f"{most['poses']} {most['value_mm']:.3f} mm; from {enough['poses']} on they "
        f"are within 10 % of that. Better than springs: {'; '.join(said)}."
    )


def _from(rows: Sequence[Mapping], better: Sequence[bool]) -> str:
    worse = np.flatnonzero(~np.array(better))
    first = 0 if len(worse) == 0 else worse[-1] + 1  # better from this row to the last
    return f"from {rows[first]['poses']} poses" if first < len(rows) else "never"


def _ranged(row: Mapping) -> str:
    return f"{row['value_mm']:.3f} ({row['low_mm']:.3f} to {row['high_mm']:.3f})"


# --- Figure ---------------------------------------------------------------------------

TICKS_MM = (
    0.003, 0.005, 0.01, 0.02, 0.03, 0.05, 0.07, 0.1, 0.15, 0.2, 0.3, 0.5, 1, 2, 5,
)  # fmt: skip
BESIDE = 1.035
"""Factor between the abscissae of methods, so that their bars do not overlap."""
COLOURS = (
    figures.GREY, figures.BLUE, figures.GREEN, figures.RED, figures.ORANGE, "#f6b26b",
)  # fmt: skip


def draw_courses(rows: Sequence[Mapping], file: Path) -> None:
    """Draw mean and range of every method's MAE over the number of poses."""
    picture = Picture(figsize=(7, 4.2), layout="constrained")
    axes = picture.subplots()
    counts = [row["poses"] for row in of(rows, "vjm")]
    for colour, method in zip(COLOURS, METHODS, strict=True):
        mine = of(rows, method)
        if not mine:
            continue
        value, low, high = (
            [row[name] for row in mine] for name in ("value_mm", "low_mm", "high_mm")
        )
        middle = (len(METHODS) - 1) / 2
        place = np.array(counts) * BESIDE ** (METHODS.index(method) - middle)
        ends = (np.subtract(value, low), np.subtract(high, value))
        label = f"{TITLES[method]}, {mine[0]['draws']} draws"
        axes.errorbar(
            place, value, ends, fmt="o-", ms=4, color=colour, capsize=2, label=label
        )
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xticks(counts, [str(count) for count in counts])
    axes.minorticks_off()
    shown = [row for row in rows if row["metric"] == "MAE"]
    top, bottom = max(r["high_mm"] for r in shown), min(r["low_mm"] for r in shown)
    ticks = [t for t in TICKS_MM if 0.7 * bottom < t < 1.4 * top]
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.set_xlabel("poses learnt from")
    axes.set_ylabel("MAE on fresh poses [mm]")
    axes.legend()
    figures.save(picture, file)
