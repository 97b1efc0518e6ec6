"""What does a diagnosis of 12,000 poses cost, and does the cost grow with the poses?

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
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

import numpy as np

from bench import files, postures
from bench.effects.parse import parse_all
from bench.errors import BenchError
from bench.experiment import record
from bench.load_path import LoadStep
from bench.plan import Plan, mixed_pulleys
from bench.recording import Recording
from bench.rig import Rig
from bench.room import Room
from scenarios.command import run
from scenarios.cost import answered
from scenarios.reporting import page, run_file, table
from scenarios.reporting.page import Table

KR10 = Path(__file__).parents[1] / "mjcf" / "kr10_r1100_2" / "kr10_r1100_2.xml"
Kind = Literal["loads", "weight"]
LOADED = ("hysteresis@a2,width_rad=2.9e-4", "bearing_tilt@a3")
UNEVEN = (
    "transmission_error@a1,amplitude_rad=2e-4,order=8",
    "transmission_error@a2,amplitude_rad=1.5e-4,order=17",
    "transmission_error@a3,amplitude_rad=1.5e-4,order=23",
    "transmission_error@a5,amplitude_rad=3e-4,order=11",
    "encoder_offset@a2,offset_rad=5e-4",
    "encoder_offset@a3,offset_rad=-7e-4",
)

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
    kinds: tuple[Kind, ...] = ("loads", "weight")
    """With loads and 28 marks; or one target and the arm's own weight alone."""


def main(settings: Settings) -> list[dict[str, object]]:
    """Record, diagnose and write down what it cost."""
    settings.out.mkdir(parents=True, exist_ok=True)
    found: list[dict[str, object]] = []
    with TemporaryDirectory() as folder:
        for kind in settings.kinds:
            for row in _rows(kind, settings.poses, Path(folder) / kind):
                found.append(row)
                print("  ".join(f"{k}={v}" for k, v in row.items()), flush=True)
    table.write(settings.out / "many_poses.csv", found)
    cells = [[str(v) for v in row.values()] for row in found]
    page.write(
        settings.out,
        "What many poses cost",
        f"{answered(found)} Measured under a load of {os.getloadavg()[0]:.0f}, which "
        "stretches wall seconds most.",
        [Table(CAPTION, HEADS, cells)],
    )
    command = f"python -m scenarios.many_poses --out {settings.out.as_posix()}"
    facts = {"cores": os.cpu_count(), "load": os.getloadavg()[0]}
    run_file.write(settings.out, command, asdict(settings), **facts)
    return found


def _rows(
    kind: Kind, counts: tuple[int, ...], folder: Path
) -> Iterator[dict[str, object]]:
    whole = recorded(kind, max(counts))
    for count in counts:
        part = whole.take(np.flatnonzero(whole.pose < count))
        files.write(folder / str(count), part)
        wall, core, peak = spent(folder / str(count), folder / f"answer-{count}")
        yield {
            "kind": kind,
            "poses": count,
            "rows": len(part.time),
            "core_s": round(core, 1),
            "wall_s": round(wall, 1),
            "peak_gb": round(peak, 2),
            "core_ms_a_pose": round(1e3 * core / count, 2),
        }


def recorded(kind: Kind, poses: int) -> Recording:
    """Carry out an experiment of many poses on the bench."""
    bare = Rig(KR10)
    rig = Rig(KR10, parse_all(UNEVEN if kind == "weight" else LOADED, bare.nominal))
    room = Room(rig.nominal, rig.anatomy, rig.mounted)
    masses = (0.0,) if kind == "weight" else (0.0, 5.0, 10.0, 5.0)
    plan = Plan(
        name=f"{poses} poses, {kind}",
        posture=postures.spread(room.limits, poses, 0, room),
        pose=np.arange(poses),
        pulley=mixed_pulleys(poses, len(rig.mounted.pulley)),
        path=tuple(map(LoadStep, masses)),
    )
    recording = record(rig, plan)
    if kind == "loads" or recording.points is None:
        return recording
    k = [marker.body for marker in recording.markers].index("flange")
    one = {"markers": recording.markers[k : k + 1], "points": recording.points[:, [k]]}
    return replace(recording, wrench=None, wrench_sensor=None, load_mass=None, **one)


def spent(recording: Path, out: Path) -> tuple[float, float, float]:
    """Diagnose in a process of its own; returns wall s, core s and peak GB.

    Raises:
        BenchError: Where the diagnosis does not end well.
    """
    line = [sys.executable, "-m", "scenarios.diagnose", str(recording)]
    line += ["--robot", str(KR10), "--out", str(out)]
    started = time.perf_counter()
    quiet = (os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0)
    child = os.posix_spawn(sys.executable, line, os.environ, file_actions=[quiet])
    _, status, used = os.wait4(child, 0)
    if code := os.waitstatus_to_exitcode(status):
        raise BenchError(f"The diagnosis of {recording} ended with status {code}.")
    unit = 1e9 if sys.platform == "darwin" else 1e6  # of ru_maxrss: bytes, or KiB
    wall = time.perf_counter() - started
    return wall, used.ru_utime + used.ru_stime, used.ru_maxrss / unit


if __name__ == "__main__":
    run(main, Settings)
