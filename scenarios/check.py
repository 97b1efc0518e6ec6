"""What is in a recording, what is wrong with it, and what can it show?

Reads a recording folder against the model of the robot. Faults of the files end the
run, all of them named. First comes what only the physics shows, such as an axis counted
backwards; then the contents, the view of every axis, and what the experiment cannot
tell apart, with what to add. Nothing is written.

Run:    python -m scenarios.check RECORDING --robot MODEL.xml
Takes:  2 s
Expect: mistakes of the set-up, if any, and three tables; 2 and a list of faults
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from bench.recording import Recording
from scenarios.abilities import abilities
from scenarios.axis_view import axis_views
from scenarios.command import run
from scenarios.diagnosing.steps import slips
from scenarios.nominal import arm_of, read_for
from scenarios.replicates import replicate_noise


@dataclass(frozen=True)
class Settings:
    """What to look at."""

    recording: Annotated[Path, tyro.conf.Positional]
    """Folder of the recording."""
    robot: Path
    """Model of the robot, MJCF or URDF."""


def main(settings: Settings) -> Recording:
    """Print what is in a recording and what it can show; returns it."""
    recording, arm, notes = read_for(settings.recording, arm_of(settings.robot))
    views = axis_views(recording, arm)
    console = Console()
    for slip in slips(recording, arm):
        said = f"{slip.text} Until it is mended `diagnose` names no effect."
        console.print(f"Mistake ({slip.where}): {said}\n", markup=False)
    contents = _table(recording.name, "what", "in this recording")
    for row in contents_of(recording):
        contents.add_row(*map(escape, row))
    axes = _table("Axes", "axis", "travel [°]", "torque varies by [Nm]", "lever [m]")
    for view, slides in zip(views, arm.slides, strict=True):
        travel = f"{1e3 * view.travel:.1f} mm" if slides else _degrees(view.travel)
        lever = "no marker" if np.isnan(view.lever) else f"{view.lever:.3f}"
        axes.add_row(escape(view.name), travel, f"{view.torque:.2f}", lever)
    can = _table("What it can show", "question", "", "why", "what to add")
    for ability in abilities(recording, arm, views):
        mark = "[green]yes[/]" if ability.can else "[red]no[/]"
        can.add_row(ability.question, mark, escape(ability.why), escape(ability.add))
    for table in (contents, axes, can):
        console.print(table)
    for note in notes:
        console.print(f"Note: {note}", markup=False)
    return recording


def contents_of(r: Recording) -> Iterator[tuple[str, str]]:
    """Say what a recording holds, row by row of a table."""
    visits = np.unique(r.visit, return_index=True)[1]
    counts = Counter(r.pose[visits].tolist())
    again = sum(1 for count in counts.values() if count > 1)
    yield "robot", r.robot or "not named"
    yield "rows", f"{len(r.time)} {'plateaus' if r.rows == 'plateaus' else 'instants'}"
    yield "duration", f"{(r.time[-1] - r.time[0]) / 60.0:.1f} min"
    yield "poses", f"{len(counts)} in {len(visits)} visits, {again} visited again"
    yield "displacement", r.displacement
    for body, count in Counter(m.body for m in r.markers).items():
        columns = [i for i, m in enumerate(r.markers) if m.body == body]
        assert r.points is not None
        blank = float(np.mean(np.isnan(r.points[:, columns]).any(axis=2)))
        targets = {m.target for m in r.markers if m.body == body and m.target}
        six = f" of {len(targets)} in 6D" if targets else ""
        place = sum(r.markers[i].position is not None for i in columns)
        yield (
            f"markers on {body}",
            f"{count}{six}, {place} of known place, {blank:.1%} not seen",
        )
    if not r.markers:
        yield "markers", "none"
    known = "known" if r.base_from_tracker is not None else "unknown, to be fitted"
    yield "tracker's frame", known
    yield "noise", noise_of(r)
    yield "wrench", wrench_of(r)
    yield "load path", load_path_of(r)
    if r.link_posture is not None:
        yield "encoders after the gear", f"{_measured(r.link_posture)} axes"
    if r.axis_torque is not None:
        yield "motor torque", f"{_measured(r.axis_torque)} axes"
    if r.temperature is not None:
        low, high = r.temperature.min(), r.temperature.max()
        yield "temperature", f"{low:.1f} to {high:.1f} °C"


def noise_of(r: Recording) -> str:
    """Put the tracker's stated noise beside what replicates show."""
    if r.tracker is None:
        return "no tracker"
    frames = 1.0 if r.frames is None else float(np.mean(1.0 / r.frames)) ** 0.5
    stated = ", ".join(f"{1e3 * s * frames:.4f}" for s in r.tracker.repeatability)
    found = replicate_noise(r)
    if found is None:
        return f"stated {stated} mm; no replicates to compare"
    seen = ", ".join(f"{1e3 * s:.4f}" for s in found[0])
    return f"stated {stated} mm; replicates show {seen} mm"


def wrench_of(r: Recording) -> str:
    """Say how strong the measured load is."""
    if r.wrench is None:
        return "not measured"
    force = np.linalg.norm(r.wrench[:, :3], axis=1).max()
    torque = np.linalg.norm(r.wrench[:, 3:], axis=1).max()
    return f"up to {force:.1f} N and {torque:.2f} Nm"


def load_path_of(r: Recording) -> str:
    """Say how the load goes in the commonest visit."""
    if r.load_mass is None and r.wrench is None:
        return "weight alone"
    per_row = r.stage if r.load_mass is None else r.load_mass
    unit = "" if r.load_mass is None else " kg"
    starts = np.unique(r.visit, return_index=True)[1][1:]
    paths = Counter(tuple(visit.tolist()) for visit in np.split(per_row, starts))
    path, count = paths.most_common(1)[0]
    shown = [step if isinstance(step, str) else f"{step:g}" for step in path[:16]]
    more = " …" if len(path) > len(shown) else ""
    return f"{' '.join(shown)}{more}{unit} in {count} of {paths.total()} visits"


def _measured(columns: np.ndarray) -> int:
    return int(np.sum(~np.isnan(columns).all(axis=0)))


def _degrees(angle: float) -> str:
    return f"{np.degrees(angle):.1f}"


def _table(title: str, *columns: str) -> Table:
    table = Table(title=escape(title), title_justify="left")
    for column in columns:
        table.add_column(escape(column))
    return table


if __name__ == "__main__":
    run(main, Settings)
