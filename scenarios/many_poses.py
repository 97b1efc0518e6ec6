"""Measures what a diagnosis of 12,000 poses costs, and how the cost grows.

Two recordings are made: one with a load that rises and falls, 28 marks and a force
sensor; one of an arm under its own weight, with more wrong than three effects, so that
it has to be calibrated. Their first thousands of poses are diagnosed by the ordinary
command, each in a process of its own, whose core time and memory the system counts.

Run:    python -m scenarios.many_poses --out results/many_poses
Takes:  5 minutes on two cores
Expect: every count within 60 core seconds and 4 GB either way; the cost hardly grows
        with the poses, if at all
"""

import os
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

from scenarios.report.command_line import run

CAPTION = (
    "What one run of scenarios.diagnose takes, reading and writing too. Loads: four "
    "on the hook in each pose, 28 marks; weight: the arm's own alone, one target."
)
HEADS = ("kind", "poses", "rows", "core time [s]", "wall time [s]", "peak memory [GB]")
HEADS += ("core time a pose [ms]",)


@dataclass(frozen=True)
class Settings:
    """How much is measured, and where it goes."""

    out: Path
    """Folder for the report and the table."""
    poses: tuple[int, ...] = (3000, 6000, 12000)
    """How many poses are diagnosed, smallest first."""
    kinds: tuple[Literal["loads", "weight"], ...] = ("loads", "weight")
    """With loads and 28 marks; or one target and the arm's own weight alone."""


def main(settings: Settings) -> list[dict[str, object]]:
    """Record, diagnose and write down what it cost."""
    from scenarios.report import data_files, page
    from scenarios.report.page import Table
    from scenarios.studies.diagnosis_cost import answered, cost_rows

    settings.out.mkdir(parents=True, exist_ok=True)
    found: list[dict[str, object]] = []
    with TemporaryDirectory() as folder:
        for kind in settings.kinds:
            for row in cost_rows(kind, settings.poses, Path(folder) / kind):
                found.append(row)
                print("  ".join(f"{k}={v}" for k, v in row.items()), flush=True)
    data_files.write_table(settings.out / "many_poses.csv", found)
    cells = [[str(v) for v in row.values()] for row in found]
    page.write(
        settings.out,
        "What many poses cost",
        f"{answered(found)} Measured under a load of {os.getloadavg()[0]:.0f}, which "
        "stretches wall seconds most.",
        [Table(CAPTION, HEADS, cells)],
    )
    command = data_files.command_of("scenarios.many_poses", settings)
    facts = {"cores": os.cpu_count(), "load": os.getloadavg()[0]}
    data_files.write_run_file(settings.out, command, asdict(settings), **facts)
    return found


if __name__ == "__main__":
    run(main, Settings)
