"""Limits of a synthetic recording: loads that an arm carries, effects that noise shows.

A recording whose truth names what cannot be seen in it would test nothing.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bench.effect_size import EffectSize
from bench.instruments import Instruments
from bench.payload import payload_of, usual_path
from bench.rig import Rig
from bench.shared.effect_catalogue import CATALOGUE
from bench.shared.errors import Unusable, collect
from bench.shared.plan import DEFAULT_PATH, HOLD, LoadStep, Plan
from bench.standard_plans import tour
from scenarios.pipelines.synthetic_recording import SPRINGS, rigid_axes

# --- Loads and postures ---------------------------------------------------------------


def planned(
    rig: Rig,
    asked: tuple[LoadStep, ...] | None,
    overload: bool,
    poses: int,
    revisits: int,
    seed: int,
    widest_deg: float,
) -> tuple[Plan, str]:
    """Return the plan of a recording, and a sentence about its loads.

    Args:
        rig: The arm in its cell.
        asked: What shall hang on the hook; None: the usual loads.
        overload: Whether more than the arm's payload may hang.
        poses: How many postures.
        revisits: How many of them are visited once more at the end.
        seed: Of the postures.
        widest_deg: How far an axis turns either way at most, in degrees.

    Raises:
        Unusable: Where the arm has no such postures or carries no such loads.
    """
    widest = float(np.deg2rad(widest_deg))
    (path, loads), plan = collect(
        lambda: load_path(rig, asked, overload),
        lambda: tour(rig, poses, revisits=revisits, seed=seed, widest=widest),
    )
    return replace(plan, path=path), loads


def load_path(
    rig: Rig, asked: tuple[LoadStep, ...] | None, overload: bool = False
) -> tuple[tuple[LoadStep, ...], str]:
    """Return what hangs on the hook in each posture, and a sentence about it.

    Args:
        rig: The arm in its cell.
        asked: What shall hang; None: the usual loads, less where the arm carries less.
        overload: Whether more than the arm's payload may hang.

    Raises:
        Unusable: Where more than the payload is asked for, with what is allowed.
    """
    if asked is not None and overload:
        return asked, f"Loads up to {_largest(asked):g} kg, not checked (--overload)."
    payload = payload_of(rig)
    path = usual_path(payload) if asked is None else asked
    largest = _largest(path)
    loads = f"Loads up to {largest:g} kg"
    if payload is None:
        unknown = "the model states neither a payload nor effort limits to check them"
        return path, f"{loads}; {unknown}."
    may = f"the arm carries {payload.mass:.3g} kg, {payload.source}"
    if largest > payload.mass * (1.0 + 1e-9):
        fault = (
            f"--path hangs up to {largest:g} kg on the hook; {may}. Hang less, such as "
            f"--path {path_text(usual_path(payload))}, or add --overload."
        )
        raise Unusable("Flags", [fault])
    if asked is None and largest < _largest(DEFAULT_PATH):
        loads += f" in place of the usual {_largest(DEFAULT_PATH):g} kg"
    return path, f"{loads}; {may}."


def path_text(path: Sequence[LoadStep]) -> str:
    """Write a load path as `bench.shared.plan.parse_path` reads it."""
    return ",".join(
        f"{step.mass:g}" + (f"@{step.hold:g}" if step.hold != HOLD else "")
        for step in path
    )


USUAL_LOADS = f"{path_text(DEFAULT_PATH)}; less on small arms"
"""What hangs on the hook unless asked for, in words."""


def _largest(path: Sequence[LoadStep]) -> float:
    return max(step.mass for step in path)


# --- Effects --------------------------------------------------------------------------

LEAST = 0.01
"""Of the noise that an effect must move; chosen: a thousand rows and thirty marks
average the noise of a reading down to about as much."""


def refuse_unseen(
    sizes: Sequence[EffectSize], instruments: Instruments, rig: Rig
) -> None:
    """Refuse effects that move nothing that could be seen.

    Args:
        sizes: What each effect moves that was asked for.
        instruments: What watches.
        rig: The arm with all its effects.

    Raises:
        Unusable: Naming all that move less than `LEAST` of the noise.
    """
    faults = []
    for size in sizes:
        if not size.over_noise(instruments) < LEAST:
            continue
        effect = size.effect
        moved = f"marks by {size.points * 1e6:.2g} µm rms"
        noise = f"{rms_noise(instruments) * 1e6:.3g} µm"
        remedy = _remedy(size, rig)
        if CATALOGUE[effect.name].sites == ("wrench_sensor",):
            moved = f"force sensor by {size.force:.2g} N and {size.torque:.2g} N m rms"
            sensor = instruments.force_sensor
            noise = f"{sensor.accuracy_force:g} N and {sensor.accuracy_torque:g} N m"
            remedy = "make it larger"
        faults.append(
            f"{effect.name}@{effect.where} moves the {moved}, less than {LEAST:.0%} of "
            f"the noise of {noise}; {remedy}."
        )
    if faults:
        raise Unusable("The list of effects", faults)


def rms_noise(instruments: Instruments) -> float:
    """Return the noise that the tracker states, rms over its coordinates, in m."""
    return float(np.sqrt(np.mean(np.square(instruments.tracker.repeatability))))


def _remedy(size: EffectSize, rig: Rig) -> str:
    effect, arm = size.effect, rig.anatomy
    gear = CATALOGUE[effect.name].family == "gear"
    rigid = [arm.axis(axis) for axis in rigid_axes(rig)]
    if not gear or arm.axis(effect.where) not in rigid:
        return "make it larger, hang more on the hook or lower --noise-mm"
    which = "no axis has" if len(rigid) == len(arm.axes) else "that axis has no"
    return f"{which} joint stiffness in the model, and {SPRINGS}"
