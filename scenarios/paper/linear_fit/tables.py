"""Tables 2 and 3 and Fig. 4: what six linear springs make of the experiment."""

from collections.abc import Sequence
from pathlib import Path

from scenarios.paper.experiment import Experiment
from scenarios.paper.linear_fit.findings import (
    against_paper,
    against_truth,
    over_floor,
    published,
    stiffness_of,
)
from scenarios.paper.linear_fit.fit import LinearFit
from scenarios.paper.linear_fit.pictures import figure_04, stiffness_points
from scenarios.reporting import table
from scenarios.reporting.page import Block, Figure, Heading, Paragraph, Table


def report(
    experiment: Experiment, found: LinearFit, seed: int, out: Path
) -> Sequence[Block]:
    """Write tables and figures into a folder and return the section of the report."""
    table.write(out / "table_02.csv", _table_02(found, seed))
    table.write(out / "table_03.csv", _table_03(experiment, found))
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
    rows = []
    for s in found.scores["vjm"]:
        paper = published(s)
        rows.append(
            (
                s.direction.upper(),
                s.metric.replace("_", ", "),
                f"{s.value_mm:.4f}",
                "" if s.low_mm is None else f"{s.low_mm:.3f} to {s.high_mm:.3f}",
                "" if paper is None else f"{paper:.3f}",
                f"{floor[s.direction, s.metric]:.4f}",
            )
        )
    n = found.scores["vjm"][0].n
    return Table(
        f"Table 2. Errors of the six-spring fit over {n} postures, seed {seed} [mm]: "
        "mean absolute (MAE), their standard deviation (STDE), the largest (ME); the "
        "paper's STDE is of signed errors here, Eq. 8 to the letter is of absolute "
        f"ones. {against_paper(found)}.",
        ("direction", "measure", "ours", "95 % interval", "paper", "floor"),
        rows,
    )


def _stiffness_table(experiment: Experiment, found: LinearFit) -> Table:
    rows = [
        (
            p.name.upper(),
            f"{p.value / 1e3:.2f}",
            f"{p.low / 1e3:.2f} to {p.high / 1e3:.2f}",
            f"{secant / 1e3:.2f}",
            f"{paper / 1e3:.2f}",
        )
        for p, secant, paper in stiffness_of(experiment, found)
    ]
    return Table(
        f"Table 3. Stiffness identified from {found.scores['vjm'][0].n} postures "
        "[kN m/rad]; the truth's secant stiffness is torque over wind-up about the "
        "axis alone.",
        ("axis", "ours", "95 % interval", "truth, secant", "paper"),
        rows,
    )
