"""Does the paper's line of argument hold on an arm whose truth is known?

A virtual KR10 with catalogue-sized hardening gears, hysteresis, tilting bearings,
bending links and a foot that gives way goes through the 151 postures of the paper's
Table 1. Six springs are identified as the paper does, and judged beside it.

Run:    python -m scenarios.study --budget quick --seed 0 --out results/study
Takes:  1 min
Expect: Table 2 within 25 % of the paper's MAE and STDE in each direction; report.html,
        table_02.csv, table_03.csv and study.rrd in the folder
"""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

from rich.progress import Progress

from scenarios.command import run
from scenarios.paper import linear_fit, linear_fit_tables, playback
from scenarios.paper.experiment import carry_out
from scenarios.paper.linear_fit import LinearFit
from scenarios.reporting import page, run_file


@dataclass(frozen=True)
class Settings:
    """How much of the study is run, and where it goes."""

    out: Path
    """Folder for report, tables, figures and the recording."""
    budget: Literal["quick", "full"] = "quick"
    """quick: minutes on two cores; full: the numbers that are committed."""
    seed: int = 0
    """Of the instruments and of everything that is drawn."""
    poses: int = 151
    """How many of the 151 postures; fewer only to try things out."""
    view: bool = False
    """Stream to a viewer while it runs, instead of saving study.rrd."""


def main(settings: Settings) -> LinearFit:
    """Run the study and write everything into the folder."""
    out = settings.out
    out.mkdir(parents=True, exist_ok=True)
    with Progress(transient=True) as progress:
        task = progress.add_task("carrying out the experiment", total=3)
        experiment = carry_out(settings.seed, settings.poses)
        progress.update(task, advance=1, description="fitting six springs")
        found = linear_fit.fit(experiment, settings.seed)
        blocks = linear_fit_tables.report(experiment, found, settings.seed, out)
        progress.update(task, advance=1, description="drawing the recording")
        playback.show(experiment, found, out, settings.seed, settings.view)
        progress.update(task, advance=1)
    page.write(out, "The study on the bench", _summary(found), blocks)
    command = f"python -m scenarios.study --budget {settings.budget} --seed"
    run_file.write(
        out,
        f"{command} {settings.seed} --out {out.as_posix()}",
        asdict(settings),
        rows=len(experiment.recording.time),
    )
    print(f"Report:    {out / 'report.html'}\nRecording: rerun {out / 'study.rrd'}")
    return found


def _summary(found: LinearFit) -> str:
    mae = {s.direction: s for s in found.scores["vjm"] if s.metric == "MAE"}
    floor = {s.direction: s for s in found.floor if s.metric == "MAE"}
    parts = [
        f"{d.upper()} {mae[d].value_mm:.3f} mm ({mae[d].low_mm:.3f} to "
        f"{mae[d].high_mm:.3f}; floor {floor[d].value_mm:.4f})"
        for d in mae
    ]
    return (
        f"Six linear springs fitted to {mae['x'].n} postures leave a mean absolute "
        f"error of {', '.join(parts)}: about ten times what the instruments alone "
        "would leave. The rest is physics that six springs do not have."
    )


if __name__ == "__main__":
    run(main, Settings)
