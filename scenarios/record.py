"""Records a synthetic experiment of an arm whose truth is known.

One synthetic experiment becomes a recording as a lab would hand it over. What is true
of the arm goes to the truth file, never beside the recording. Without `--effect` and
`--truth` the arm is what its model says: linear springs and nothing else.

A KR10 R1100-2 goes through the postures of the paper's Table 1, another arm through
postures spread over its joint limits. A recording that is in DIR already is replaced;
a folder that holds anything else is left alone. The same flags give the same files.

Run:    python -m scenarios.record --effect hysteresis@a2,width_rad=2e-4 --out DIR
Takes:  4 s
Expect: DIR with 1359 rows of 28 markers, which `python -m scenarios.check` finds whole
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from scenarios.pipelines.synthetic_recording import KR10, Watching
from scenarios.report.command_line import at_least, run

if TYPE_CHECKING:
    from bench.shared.recording import Recording


@dataclass(frozen=True)
class Settings:
    """What is true, what is done, and what watches."""

    out: Path
    """Folder for the recording."""
    effect: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """NAME@WHERE[,param=value…] in SI, such as hysteresis@a2,width_rad=2e-4; repeat."""
    truth: Literal["default"] | None = None
    """`default`: the study's KR10, with springs and effects of its own; more add up."""
    stiffness_scale: tuple[float, ...] = (1.0,)
    """True stiffness over the model's, one for all axes or one each."""
    robot: Annotated[
        Path, tyro.conf.arg(help_behavior_hint="(default: the KR10 R1100-2)")
    ] = KR10
    """MJCF or URDF of the arm alone."""
    hand: str = ""
    """Body that the ropes pull, where a torso carries several arms."""
    poses: int = 151
    """How many postures; a KR10's table has 151."""
    revisits: int = 0
    """How many of them are visited once more at the end."""
    path: str = "0,2.5,5,7.5,10,10@120,5,2.5,0"
    """What hangs on the hook in each posture, in kg; mass@seconds stays that long."""
    seed: int = 0
    """Of everything random."""
    truth_file: Path | None = None
    """JSON file for what is true; outside DIR."""
    name: str = ""
    """Name of the recording; empty: that of the plan."""
    watch: Annotated[Watching, tyro.conf.OmitArgPrefixes] = field(
        default_factory=Watching
    )


def main(settings: Settings) -> Recording:
    """Record one experiment."""
    from rich.console import Console

    from bench.experiment import record
    from bench.shared.errors import collect
    from bench.shared.format import folder
    from bench.shared.plan import parse_path
    from bench.standard_plans import tour
    from scenarios.pipelines.synthetic_recording import (
        concealing_rig,
        refuse_truth_inside,
        truth_text,
        written_with_truth,
    )

    s = settings
    rig, path, instruments, *_ = collect(
        lambda: concealing_rig(
            s.robot, s.hand, s.effect, s.truth == "default", s.stiffness_scale
        ),
        lambda: parse_path(s.path),
        s.watch.instruments,
        lambda: at_least(0, seed=s.seed),
        lambda: at_least(1, poses=s.poses),
        lambda: refuse_truth_inside(s.out, s.truth_file),
    )
    plan = tour(rig, s.poses, path, s.revisits, s.seed)
    with Console(stderr=True).status("recording"):
        recording = record(rig, plan, instruments, s.seed, s.name)
    if s.truth_file is None:
        folder.write(s.out, recording)
    else:
        truth = truth_text(rig, recording.name, s.seed, instruments)
        written_with_truth(s.truth_file, truth, lambda: folder.write(s.out, recording))
    rows, markers = len(recording.time), len(recording.markers)
    print(f"{s.out}: {rows} rows, {markers} markers.")
    return recording


if __name__ == "__main__":
    run(main, Settings)
