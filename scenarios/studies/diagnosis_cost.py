"""Core time and memory that a diagnosis takes, against the number of poses."""

import os
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from bench.effects.parse import parse_all
from bench.experiment import record
from bench.rig import Rig
from bench.shared.errors import BenchError
from bench.shared.format import folder as files
from bench.shared.plan import LoadStep
from bench.shared.recording import Recording
from bench.standard_plans import spread_plan
from scenarios.pipelines.synthetic_recording import KR10

# --- Limits and growth ----------------------------------------------------------------

BAR_S, BAR_GB = 60.0, 4.0
"""Limits of a diagnosis of many poses, in core seconds and GB."""


def answered(found: Sequence[Mapping[str, object]]) -> str:
    """Return whether the bars are kept and how the cost grows, in words."""
    cost, gb = ([float(str(r[k])) for r in found] for k in ("core_s", "peak_gb"))
    kept = max(cost) <= BAR_S and max(gb) <= BAR_GB
    said = [
        f"At most {max(cost):.0f} core seconds and {max(gb):.1f} GB: "
        f"{'within' if kept else 'NOT within'} the bars of "
        f"{BAR_S:.0f} core seconds and {BAR_GB:.0f} GB."
    ]
    for kind in dict.fromkeys(str(r["kind"]) for r in found):
        own = [
            (int(str(r["poses"])), float(str(r["core_s"])))
            for r in found
            if r["kind"] == kind
        ]
        (few, before), (many, after) = min(own), max(own)
        if many == few:
            continue
        times, more = after / before, many / few
        verdict = (
            "does not grow with the poses"
            if times <= 1.0
            else "grows by less than the poses"
            if times < more
            else "grows as the poses or faster"
        )
        said.append(
            f"Of {kind} the cost {verdict}: {more:.3g} times the poses cost "
            f"{times:.2f} times the core seconds."
        )
    return " ".join(said)


# --- Recordings and measurements ------------------------------------------------------

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


def cost_rows(
    kind: Kind, counts: tuple[int, ...], folder: Path
) -> Iterator[dict[str, object]]:
    """Yield time and memory of one diagnosis a number of poses, in its own process."""
    whole = recorded(kind, max(counts))
    for count in counts:
        part = whole.take(np.flatnonzero(whole.posture_id < count))
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
    """Return the recording of an experiment of many poses on the bench."""
    bare = Rig(KR10)
    rig = Rig(KR10, parse_all(UNEVEN if kind == "weight" else LOADED, bare.nominal))
    masses = (0.0,) if kind == "weight" else (0.0, 5.0, 10.0, 5.0)
    path = tuple(map(LoadStep, masses))
    recording = record(rig, spread_plan(f"{poses} poses, {kind}", rig, poses, path))
    if kind == "loads" or recording.points is None:
        return recording
    k = [marker.body for marker in recording.markers].index("flange")
    one = {"markers": recording.markers[k : k + 1], "points": recording.points[:, [k]]}
    return replace(recording, wrench=None, wrench_sensor=None, load_mass=None, **one)


def spent(recording: Path, out: Path) -> tuple[float, float, float]:
    """Diagnose in a process of its own; return wall s, core s and peak GB.

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
