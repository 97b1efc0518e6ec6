"""What do the instruments see of an arm whose secrets are known?

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

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro
from rich.console import Console

from bench import files
from bench.effects.parse import parse_all
from bench.errors import Unusable
from bench.experiment import record
from bench.model_file import load
from bench.one_chain import axes_to
from bench.plan import parse_path
from bench.recording import Recording
from bench.rig import Rig
from bench.tour import is_kr10, tour
from bench.truth import default_truth
from scenarios.collect import at_least, collect
from scenarios.command import run
from scenarios.reporting.truth_file import refuse_inside, truth_text, written_with
from scenarios.watching import Watching

KR10 = Path(__file__).parents[1] / "mjcf" / "kr10_r1100_2" / "kr10_r1100_2.xml"


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
    s = settings
    rig, path, instruments, *_ = collect(
        lambda: _rig(s),
        lambda: parse_path(s.path),
        s.watch.instruments,
        lambda: at_least(0, seed=s.seed),
        lambda: at_least(1, poses=s.poses),
        lambda: refuse_inside(s.out, s.truth_file),
    )
    plan = tour(rig, s.poses, path, s.revisits, s.seed)
    with Console(stderr=True).status("recording"):
        recording = record(rig, plan, instruments, s.seed, s.name)
    if s.truth_file is None:
        files.write(s.out, recording)
    else:
        truth = truth_text(rig, recording.name, s.seed, instruments)
        written_with(s.truth_file, truth, lambda: files.write(s.out, recording))
    rows, markers = len(recording.time), len(recording.markers)
    print(f"{s.out}: {rows} rows, {markers} markers.")
    return recording


def _rig(settings: Settings) -> Rig:
    """Return the arm as it truly is."""
    robot, hand = settings.robot, settings.hand
    rig = Rig(robot, axes=axes_to(load(robot), hand) if hand else ())
    axes = len(rig.anatomy.axes)
    scale, stiffness, known = settings.stiffness_scale, rig.nominal.jnt_stiffness, ()
    effects, _ = collect(
        lambda: parse_all(settings.effect, rig.nominal),
        lambda: _check_scale(scale, axes),
    )
    if settings.truth == "default":
        if not is_kr10(rig):
            raise Unusable("Truth", ["--truth default is that of a KR10 R1100-2."])
        truth = default_truth()
        known, stiffness = truth.effects, truth.stiffness
    rig = replace(
        rig, effects=(*known, *effects), stiffness=stiffness * np.array(scale)
    )
    _ = rig.model  # compiled here: what cannot be built is a fault of the settings
    return rig


def _check_scale(scale: tuple[float, ...], axes: int) -> None:
    positive = all(np.isfinite(factor) and factor > 0.0 for factor in scale)
    if len(scale) not in (1, axes) or not positive:
        say = f"expected one number or {axes}, all above 0"
        raise Unusable("Flags", [f"--stiffness-scale is {scale}, {say}."])


if __name__ == "__main__":
    run(main, Settings)
