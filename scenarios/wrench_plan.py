"""Measures what the wrench plan of the source domain costs.

The paper asks its springs five wrenches, the same in every posture, that span three of
six dimensions (Table 5); the other plan asks five drawn for each posture, that span all
six. Networks pre-trained on either are corrected by the same experiment and judged on
fresh postures, once pulled as in the experiment, once in directions it did not use.

Run:    python -m scenarios.wrench_plan --seeds 0 1 2 3 4 --seeds-of-table-5 0 1 \
            --out results/wrench_plan
Takes:  2 min on two cores a seed
Expect: with Table 5's plan FT-MLP is worse than the springs, most of all where it is
        pulled in other directions; with the spanning plan it is better; named physics
        is best in all directions
"""

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from scenarios.report.command_line import run
from scenarios.studies.paper.budget import Transfer, budget


@dataclass(frozen=True)
class Settings:
    """What is compared, and where results go."""

    out: Path
    """Folder for report, table and figure."""
    unseen: int = 500
    """Fresh postures on which is judged."""
    seeds: tuple[int, ...] = (0,)
    """Of the splits and the networks."""
    seeds_of_table_5: tuple[int, ...] | None = None
    """Of those for Table 5's plan; the same unless said."""
    seed: int = 0
    """Of the experiment."""
    jobs: int = 2
    """How many cells are worked at once on this machine; 0: in this process."""
    scheduler: str = "local"
    """Where cells are worked: local, dask:ADDRESS or ray:ADDRESS."""
    poses: int = 151
    """How many of the 151 postures there are; fewer only to try things out."""
    effort: Transfer = field(default_factory=lambda: budget("quick", 0).transfer)
    """What is spent on the networks."""


def main(settings: Settings) -> list[dict[str, object]]:
    """Run the comparison and write everything into the folder."""
    import numpy as np

    from scenarios.report import data_files, page
    from scenarios.studies.paper import comparison
    from scenarios.studies.paper import wrench_plan as study
    from scenarios.studies.paper.budget import PLANS
    from scenarios.studies.paper.cells import Spread, swept
    from scenarios.studies.paper.experiment import Material, carry_out, unseen
    from scenarios.studies.paper.transfer import (
        NamedPhysicsCell,
        PerceptronCell,
        SpringsCell,
    )

    out, seed, n = settings.out, settings.seed, settings.unseen
    experiment = carry_out(seed, settings.poses)
    out.mkdir(parents=True, exist_ok=True)
    fresh = unseen(experiment.rig, experiment.arm, n, seed)
    judges = study.both(fresh, study.pulled_elsewhere(experiment, fresh, seed))
    material = Material.of(experiment, judges)
    effort = settings.effort
    by_plan: dict[str, tuple[int, ...]] = {plan: settings.seeds for plan in PLANS}
    if settings.seeds_of_table_5 is not None:
        by_plan["table 5"] = settings.seeds_of_table_5
    plain = {s: SpringsCell(s, effort.evaluations) for s in settings.seeds}
    named = {s: NamedPhysicsCell(s) for s in settings.seeds}
    networks = {
        plan: {s: PerceptronCell(s, plan, effort, ()) for s in seeds}
        for plan, seeds in by_plan.items()
    }
    chosen = [
        ("vjm", comparison.NO_PLAN, plain, "vjm"),
        ("gp_residual", comparison.NO_PLAN, plain, "gp_residual"),
        *((name, comparison.NO_PLAN, named, name) for name in comparison.NAMED),
        *(("ft_mlp", plan, networks[plan], "best") for plan in PLANS),
    ]
    cells = dict.fromkeys(cell for c in chosen for cell in c[2].values())
    results = swept(list(cells), material, Spread.of(settings))
    everywhere = [
        comparison.of_results(
            method, plan, {s: results[c] for s, c in cells.items()}, name
        )
        for method, plan, cells, name in chosen
    ]
    errors = {c.name: c.unseen for c in everywhere}
    near = [replace(c, unseen=c.unseen[:, :n]) for c in everywhere]
    springs, tuned = near[0], [c for c in near if c.method == "ft_mlp"]
    rows = study.tidy(everywhere, study.LOADS)
    data_files.write_table(out / "wrench_plan.csv", rows)
    changes = [row for c in tuned for row in comparison.gain_rows(c, springs)]
    data_files.write_table(out / "gains.csv", changes)
    used = experiment.measured.cases.wrench_in_base[:, :3]
    angle = np.rad2deg(study.nearest(judges.cases.wrench_in_base[:, :3], used))
    study.draw(errors, angle, study.LOADS, out / "wrench_plan.png")
    blocks = study.report_blocks(rows, tuned, springs, n, by_plan)
    page.write(out, "What does the wrench plan cost?", study.summary(rows), blocks)
    command = data_files.command_of("scenarios.wrench_plan", settings)
    data_files.write_run_file(out, command, asdict(settings))
    print(f"Report: {out / 'report.html'}")
    return rows


if __name__ == "__main__":
    run(main, Settings)
