"""Records a synthetic experiment of an arm whose truth is known.

One synthetic experiment becomes a recording as a lab would hand it over. What is true
of the arm goes to the truth file, never beside the recording. Without `--effect` and
`--truth` the arm is what its model says: linear springs and nothing else.

A KR10 R1100-2 goes through the postures of the paper's Table 1, another arm through
postures spread over its joint limits; loads stay within its payload. What each effect
moves is printed; one that noise would hide is refused. A recording that is in DIR is
replaced, a folder with anything else left alone. The same flags give the same files.

Run:    python -m scenarios.record --effect hysteresis@a2,width_rad=2e-4 --out DIR
Takes:  4 s
Expect: DIR with 1359 rows of 28 markers, which `python -m scenarios.check` finds whole
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from scenarios.pipelines.synthetic_recording import KR10, USUAL_LOADS, Watching
from scenarios.report.command_line import at_least, run

if TYPE_CHECKING:
    from bench.shared.recording import Recording

LOADS = tyro.conf.arg(metavar="KG,…", help_behavior_hint=f"(default: {USUAL_LOADS})")
KUKA = tyro.conf.arg(help_behavior_hint="(default: the KR10 R1100-2)")


@dataclass(frozen=True)
class Settings:
    """What is true, what is done, and what watches."""

    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder for the recording."""
    effect: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """NAME@WHERE[,param=value…] in SI, such as hysteresis@a2,width_rad=2e-4; repeat."""
    truth: Literal["default"] | None = None
    """`default`: the study's KR10, with springs and effects of its own; more add up."""
    stiffness_scale: tuple[float, ...] = (1.0,)
    """True stiffness over the model's, one for all axes or one each."""
    stiffness: tuple[float, ...] = ()
    """True stiffness in N m/rad in place of the model's, for all axes or one each."""
    robot: Annotated[Path, KUKA] = KR10
    """MJCF or URDF of the arm alone."""
    hand: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """Of a torso's arms, the hand that ropes pull; repeat it for others that move."""
    poses: int = 151
    """How many postures; a KR10's table has 151."""
    revisits: int = 0
    """How many of them are visited once more at the end."""
    path: Annotated[str | None, LOADS] = None
    """What hangs on the hook in each posture, in kg; mass@seconds stays that long."""
    overload: bool = False
    """Let --path hang more than the arm's payload."""
    widest_deg: float = 180.0
    """How far an axis turns either way at most; a KR10's table is what it is."""
    memory: Literal["forgotten", "carried"] = "forgotten"
    """Whether gears keep what slipped and crept from visit to visit."""
    seed: int = 0
    """Of everything random."""
    truth_file: Path | None = None
    """JSON file for what is true; outside DIR."""
    name: str = ""
    """Name of the recording; empty: that of the plan."""
    effects: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """List all effects, their places, parameters and usual ranges, and end."""
    watch: Annotated[Watching, tyro.conf.OmitArgPrefixes] = field(
        default_factory=Watching
    )


def main(settings: Settings) -> Recording:
    """Record one experiment."""
    from rich.console import Console

    from bench.effect_size import effect_sizes
    from bench.experiment import record
    from bench.shared.errors import collect
    from bench.shared.format import folder
    from bench.shared.plan import parse_path
    from scenarios.pipelines import synthetic_recording as synthetic
    from scenarios.report.effects import catalogue_tables, sizes_table

    s = settings
    if s.effects:
        Console().print(catalogue_tables(synthetic.bare_rig(s.robot, s.hand).anatomy))
        raise SystemExit(0)
    true = (s.effect, s.truth == "default", s.stiffness_scale, s.stiffness)
    out, rig, path, tools, *_ = collect(
        lambda: synthetic.folder_beside(s.out, s.truth_file),
        lambda: synthetic.concealing_rig(s.robot, s.hand, *true),
        lambda: None if s.path is None else parse_path(s.path),
        s.watch.instruments,
        lambda: at_least(0, seed=s.seed, revisits=s.revisits),
        lambda: at_least(1, poses=s.poses),
    )
    asked = (s.overload, s.poses, s.revisits, s.seed, s.widest_deg)
    plan, loads = synthetic.planned(rig, path, *asked)
    with Console(stderr=True).status("recording"):
        sizes = tuple(effect_sizes(rig, plan, tools, s.seed))
        synthetic.refuse_unseen(sizes[len(sizes) - len(s.effect) :], tools, rig)
        recording = record(rig, plan, tools, s.seed, s.name, s.memory)
    truth = synthetic.truth_text(rig, recording.name, s.seed, tools, s.memory)
    write = lambda: folder.write(out, recording)  # noqa: E731
    synthetic.written_with_truth(s.truth_file, truth, write)
    print(f"{out}: {len(recording.time)} rows, {len(recording.markers)} markers.")
    print(loads)
    if sizes:
        Console().print(sizes_table(sizes, tools))
    return recording


if __name__ == "__main__":
    run(main, Settings)
