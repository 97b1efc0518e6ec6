"""What is in a recording, what is wrong with it, and what can it show?

Reads a recording folder against the model of the robot. Faults of the files end the
run, all of them named. First comes what only the physics shows, such as an axis counted
backwards; then the contents, the view of every axis, and what the experiment cannot
tell apart, with what to add. Nothing is written.

Run:    python -m scenarios.check RECORDING --robot MODEL.xml
Takes:  5 s of a core
Expect: mistakes of the set-up, if any, and three tables; 2 and a list of faults
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from scenarios.report.command_line import run

if TYPE_CHECKING:
    from rich.table import Table

    from bench.shared.recording import Recording

AXES = ("axis", "travel [°]", "torque varies by [Nm]", "longest marker's lever [m]")


@dataclass(frozen=True)
class Settings:
    """What to look at."""

    recording: Annotated[Path, tyro.conf.Positional]
    """Folder of the recording."""
    robot: Path
    """Model of the robot, MJCF or URDF."""


def main(settings: Settings) -> Recording:
    """Print what is in a recording and what it can show; returns it."""
    import numpy as np
    from rich.console import Console
    from rich.markup import escape

    from bench.proof.setup import why_not_simulated
    from scenarios.pipelines.diagnosis import setup_errors_of, springs_warning_of
    from scenarios.pipelines.inputs import arm_of, read_for
    from scenarios.pipelines.recording_check import (
        SMALL_LEVER,
        abilities,
        axis_views,
        contents_of,
    )
    from stiffness.experiment.outliers import outlier_text, outliers_of

    recording, arm, notes = read_for(settings.recording, arm_of(settings.robot))
    views, markers = axis_views(recording, arm), recording.markers
    console = Console()
    slips = setup_errors_of(recording, arm)
    springs = None if slips else springs_warning_of(recording, arm)
    for slip in slips:
        said = f"{slip.text} Until it is mended `diagnose` names no effect."
        console.print(f"Mistake ({slip.where}): {said}\n", markup=False)
    contents = _table(recording.name, "what", "in this recording")
    for row in contents_of(recording):
        contents.add_row(*map(escape, row))
    axes = _table("Axes", *AXES)
    for view, slides in zip(views, arm.slides, strict=True):
        travel = f"{1e3 * view.travel:.1f} mm" if slides else _degrees(view.travel)
        lever = "no marker" if np.isnan(view.lever) else f"{view.lever:.3f}"
        if view.lever < SMALL_LEVER and any(m.position is None for m in markers):
            lever = "places not stated"
        torque = f"{view.torque:.2f}{' N' * bool(slides)}"
        axes.add_row(escape(view.name), travel, torque, lever)
    can = _table("What it can show", "can it show", "", "because", "what to add")
    for ability in abilities(recording, arm, views):
        mark = "[green]yes[/]" if ability.can else "[red]no[/]"
        can.add_row(ability.question, mark, escape(ability.why), escape(ability.add))
    for table in (contents, axes, can):
        console.print(table)
    if why := why_not_simulated(recording, settings.robot):
        notes = (*notes, f"no proof can be made of it: {why}")
    found = outliers_of(recording)
    outliers = [outlier_text(found)] if found else []
    for note in (*notes, *([springs.text] if springs else []), *outliers):
        console.print(f"Note: {note}", markup=False)
    return recording


def _degrees(angle: float) -> str:
    import numpy as np

    return f"{np.degrees(angle):.1f}"


def _table(title: str, *columns: str) -> Table:
    from rich.markup import escape
    from rich.table import Table

    table = Table(title=escape(title), title_justify="left")
    for column in columns:
        table.add_column(escape(column))
    return table


if __name__ == "__main__":
    run(main, Settings)
