"""The fit of six linear springs: Tables 2 and 3, Fig. 4.

`refuse_if_blind` checks that the experiment and every split of it identify all six
springs, on which every method depends: with too few postures, compliance beside the
axes would be ascribed to one of them, or lost in it. `fit` fits the springs and scores
them as the paper does; `report` makes tables, figures and their text.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure as Picture

from bench.shared.errors import NotIdentifiable, Unusable
from bench.shared.recording import Recording
from scenarios.report import data_files, figures
from scenarios.report.page import Block, Figure, Heading, Paragraph, Table, table_of
from scenarios.studies.paper import TABLE_02_MM, TABLE_03_NM_PER_RAD
from scenarios.studies.paper.experiment import Experiment, Material
from stiffness.experiment.deflections import Selection, every_plateau, one_per_pose
from stiffness.methods.method import Fitted, Parameter, Rigid
from stiffness.methods.score import DIRECTIONS, Score, scores
from stiffness.methods.vjm import Vjm, VjmFit

# --- Identifiability ------------------------------------------------------------------

ADVICE = (
    " The study needs all six springs: ask for 55 postures or more; what fewer are "
    "worth with axes held: python -m scenarios.how_many_poses."
)


def refuse_if_blind(material: Material, seeds: Sequence[int]) -> None:
    """Refuse an experiment that does not identify every spring, before the study runs.

    Raises:
        Unusable: With every axis that is not identified, and on which data.
    """
    whole, count = material.recording, len(np.unique(material.recording.posture_id))
    asked: list[tuple[str, Recording, Selection]] = [
        ("one reading of each", whole, one_per_pose),
        ("all readings", whole, every_plateau),
    ]
    for seed in seeds:
        part = material.training(seed)
        learnt = len(np.unique(part.posture_id))
        who = f"the {learnt} that methods learn from with seed {seed}"
        asked.append((who, part, every_plateau))
    faults = []
    for who, recording, select in asked:
        try:
            Vjm(material.arm, select=select).fit(recording)
        except NotIdentifiable as error:
            faults += [f"{who}: {line}" for line in str(error).splitlines()]
    if faults:
        faults[-1] += ADVICE
        raise Unusable(f"An experiment of {count} postures", faults)


# --- The fit --------------------------------------------------------------------------


@dataclass(frozen=True)
class LinearFit:
    """The fitted springs, their predictions and their errors.

    Attributes:
        predicted: Deflections by each method, in m, along the base's axes.
        floor: Scores of the instruments alone: measured against true deflections.
    """

    fitted: VjmFit
    predicted: dict[str, Float[np.ndarray, "rows 3"]]
    scores: dict[str, tuple[Score, ...]]
    floor: tuple[Score, ...]


def fit(experiment: Experiment, seed: int) -> LinearFit:
    """Fit the springs to the experiment and score them on it, as the paper does."""
    recording, measured = experiment.recording, experiment.measured
    springs = Vjm(experiment.arm, select=one_per_pose).fit(recording)
    methods: dict[str, Fitted] = {
        "rigid": Rigid(experiment.arm).fit(recording),
        "vjm": springs,
    }
    predicted = {name: m.predict(measured.cases) for name, m in methods.items()}
    return LinearFit(
        fitted=springs,
        predicted=predicted,
        scores={
            name: scores(deflection, measured.deflection, measured.posture_id, seed)
            for name, deflection in predicted.items()
        },
        floor=scores(
            experiment.true_deflection, measured.deflection, measured.posture_id, seed
        ),
    )


# --- Findings in words ----------------------------------------------------------------


def against_truth(experiment: Experiment, found: LinearFit) -> str:
    """Return how the springs differ from the true axes, in words."""
    rows = stiffness_of(experiment, found)
    softer = [p for p, secant, _ in rows if p.high < secant]
    stiffer = [p for p, secant, _ in rows if p.low > secant]
    worst, true, _ = max(rows, key=lambda row: abs(np.log(row[0].value / row[1])))
    ratio = max(worst.value / true, true / worst.value)
    said = [
        f"{_names(axes)} {kind} than true by more than the interval"
        for axes, kind in ((softer, "softer"), (stiffer, "stiffer"))
        if axes
    ]
    return "; ".join(
        [
            *(said or ["no interval leaves the truth out"]),
            f"furthest off is {worst.name.upper()}, by a factor of {ratio:.1f}. A "
            "spring also takes on what bearings, links and base give way along with it",
        ]
    )


def _names(axes: Sequence[Parameter]) -> str:
    names = ", ".join(p.name.upper() for p in axes)
    return f"{names} come{'s' * (len(axes) == 1)} out"


def against_paper(found: LinearFit) -> str:
    """Return by how much MAE and signed STDE differ from the paper's, in words."""
    parts = []
    for metric in ("MAE", "STDE_signed"):
        change = [
            100 * (s.value_mm / paper - 1)
            for s in found.scores["vjm"]
            if s.metric == metric and (paper := published(s)) is not None
        ]
        listed = ", ".join(f"{c:+.0f}" for c in change)
        parts.append(f"{metric.replace('_', ', ')} {listed} %")
    return (
        "Against the paper's, in X, Y, Z: " + "; ".join(parts) + "; the truth was "
        "calibrated for that"
    )


def over_floor(found: LinearFit) -> float:
    """Return the ratio of the springs' MAE to the instruments', mean of directions."""
    floor = {s.direction: s.value_mm for s in found.floor if s.metric == "MAE"}
    own = {s.direction: s.value_mm for s in found.scores["vjm"] if s.metric == "MAE"}
    return sum(own[d] / floor[d] for d in floor) / len(floor)


def published(score: Score) -> float | None:
    """Return the paper's number of Table 2, in mm, where it prints one."""
    metric = {"MAE": "MAE", "STDE_signed": "STDE", "ME": "ME"}.get(score.metric)
    return TABLE_02_MM[score.direction, metric] if metric else None


def stiffness_of(
    experiment: Experiment, found: LinearFit
) -> list[tuple[Parameter, float, float]]:
    """Return identified, true secant and published stiffness of each axis."""
    secant = [float(k) for k in experiment.secant_stiffness]
    return list(zip(found.fitted.stiffness, secant, TABLE_03_NM_PER_RAD, strict=True))


# --- Figures --------------------------------------------------------------------------


def figure_04(experiment: Experiment, found: LinearFit, file: Path) -> None:
    """Draw predicted against measured deflection in each direction."""
    picture = Picture(figsize=(11, 3.9), layout="constrained")
    measured = 1e3 * experiment.measured.deflection
    predicted = 1e3 * found.predicted["vjm"]
    for k, axes in enumerate(picture.subplots(1, 3)):
        x, y = measured[:, k], predicted[:, k]
        ends = np.array([min(x.min(), y.min()), max(x.max(), y.max())])
        r = np.corrcoef(x, y)[0, 1]
        axes.plot(ends, ends, color=figures.GREY, lw=1, label="equal")
        axes.plot(x, y, "o", ms=4, color=figures.ORANGE, mec="white", mew=0.4)
        axes.set_title(f"{DIRECTIONS[k].upper()}: r = {r:.4f}, n = {len(x)}")
        axes.set_xlabel("measured deflection [mm]")
        axes.set_ylabel("six springs [mm]" if k == 0 else "")
        axes.set_aspect("equal", adjustable="datalim")
    figures.save(picture, file)


def stiffness_points(experiment: Experiment, found: LinearFit, file: Path) -> None:
    """Draw identified, true secant and published stiffness of each axis."""
    picture = Picture(figsize=(8, 3.8), layout="constrained")
    axes = picture.subplots()
    springs = found.fitted.stiffness
    place = np.arange(len(springs))
    value = np.array([p.value for p in springs]) / 1e3
    low = value - np.array([p.low for p in springs]) / 1e3
    high = np.array([p.high for p in springs]) / 1e3 - value
    paper = np.array(TABLE_03_NM_PER_RAD) / 1e3
    for shift, (label, height, colour) in zip(
        (-0.2, 0.0, 0.2),
        (
            ("identified", value, figures.ORANGE),
            ("truth, secant", experiment.secant_stiffness / 1e3, figures.BLUE),
            ("paper", paper, figures.GREY),
        ),
        strict=True,
    ):
        axes.plot(place + shift, height, "o", color=colour, label=label)
    axes.errorbar(
        place - 0.2, value, (low, high), fmt="none", ecolor=figures.ORANGE, capsize=2
    )
    axes.set_yscale("log")
    figures.plain_log(axes.yaxis)
    axes.set_xticks(place, [p.name.upper() for p in springs])
    axes.set_ylabel("stiffness [kN m/rad]")
    axes.grid(visible=False, axis="x")
    axes.legend(ncols=3, loc="upper right")
    figures.save(picture, file)


# --- Tables ---------------------------------------------------------------------------


def report(
    experiment: Experiment, found: LinearFit, seed: int, out: Path
) -> Sequence[Block]:
    """Write tables and figures into a folder and return the section of the report."""
    data_files.write_table(out / "table_02.csv", _table_02(found, seed))
    data_files.write_table(out / "table_03.csv", _table_03(experiment, found))
    figure_04(experiment, found, out / "figure_04.png")
    stiffness_points(experiment, found, out / "table_03.png")
    return [
        Heading("Six linear springs"),
        Paragraph(
            "The virtual joint model is fitted to one loaded plateau per posture and "
            "judged on the same postures, as in the paper's section 3.3. Intervals "
            "(95 %) come from drawing postures anew, never rows; the springs stay as "
            "they were fitted, so the intervals are those of these springs on postures "
            "like these, not of springs fitted to others. A largest error has none: "
            "postures drawn anew from the same can never exceed it. The floor is what "
            "the instruments alone leave between measured and true deflection."
        ),
        _errors_table(found, seed),
        Figure(
            "Predicted against measured deflection (the paper's Fig. 4); what six "
            f"springs leave is {over_floor(found):.1f} times the instruments' floor.",
            "figure_04.png",
        ),
        _stiffness_table(experiment, found),
        Figure(
            "Identified stiffness with 95 % intervals, beside the paper's and beside "
            f"the truth's secant stiffness: {against_truth(experiment, found)}.",
            "table_03.png",
        ),
    ]


def _table_02(found: LinearFit, seed: int) -> list[dict[str, object]]:
    floor = {(s.direction, s.metric): s.value_mm for s in found.floor}
    return [
        {
            "method": method,
            "direction": s.direction,
            "metric": s.metric,
            "value_mm": s.value_mm,
            "low_mm": s.low_mm,
            "high_mm": s.high_mm,
            "paper_mm": published(s) if method == "vjm" else None,
            "floor_mm": floor[s.direction, s.metric],
            "n": s.n,
            "seeds": seed,
            "plan": "table_01",
        }
        for method, all_scores in found.scores.items()
        for s in all_scores
    ]


def _table_03(experiment: Experiment, found: LinearFit) -> list[dict[str, object]]:
    return [
        {
            "axis": p.name,
            "stiffness_nm_per_rad": p.value,
            "low": p.low,
            "high": p.high,
            "truth_secant": secant,
            "paper": paper,
        }
        for p, secant, paper in stiffness_of(experiment, found)
    ]


def _errors_table(found: LinearFit, seed: int) -> Table:
    floor = {(s.direction, s.metric): s.value_mm for s in found.floor}
    n = found.scores["vjm"][0].n
    return table_of(
        f"Table 2. Errors of the six-spring fit over {n} postures, seed {seed} [mm]: "
        "mean absolute (MAE), their standard deviation (STDE), the largest (ME); the "
        "paper's STDE is of signed errors here, Eq. 8 to the letter is of absolute "
        f"ones. {against_paper(found)}.",
        found.scores["vjm"],
        {
            "direction": lambda s: s.direction.upper(),
            "measure": lambda s: s.metric.replace("_", ", "),
            "ours": lambda s: f"{s.value_mm:.4f}",
            "95 % interval": lambda s: (
                "" if s.low_mm is None else f"{s.low_mm:.3f} to {s.high_mm:.3f}"
            ),
            "paper": lambda s: (
                "" if (paper := published(s)) is None else f"{paper:.3f}"
            ),
            "floor": lambda s: f"{floor[s.direction, s.metric]:.4f}",
        },
    )


def _stiffness_table(experiment: Experiment, found: LinearFit) -> Table:
    return table_of(
        f"Table 3. Stiffness identified from {found.scores['vjm'][0].n} postures "
        "[kN m/rad]; the truth's secant stiffness is torque over wind-up about the "
        "axis alone.",
        stiffness_of(experiment, found),
        {
            "axis": lambda k: k[0].name.upper(),
            "ours": lambda k: f"{k[0].value / 1e3:.2f}",
            "95 % interval": lambda k: f"{k[0].low / 1e3:.2f} to {k[0].high / 1e3:.2f}",
            "truth, secant": lambda k: f"{k[1] / 1e3:.2f}",
            "paper": lambda k: f"{k[2] / 1e3:.2f}",
        },
    )
