"""Synthetic recordings: the arm with its effects, its load limits, instruments, truth.

How well an experiment is watched is given by flags in data sheets' units. Loads stay
within the arm's payload, and an effect that noise would hide is refused, since a truth
that cannot be seen tests nothing. What is true goes to a file apart from what was seen.
"""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np

from bench.effect_size import EffectSize
from bench.effects.effect import Effect
from bench.effects.parse import parse_all
from bench.instruments import Encoders, ForceSensor, Instruments, Markers, Tracker
from bench.instruments.tracker import STILL
from bench.kinematic_chain import axes_to
from bench.model_file import load
from bench.payload import payload_of, usual_path
from bench.rig import RIGID, Memory, Rig
from bench.shared import replaced_whole
from bench.shared.effect_catalogue import CATALOGUE
from bench.shared.errors import Unusable, collect, refuse
from bench.shared.format import json_text
from bench.shared.plan import DEFAULT_PATH, HOLD, LoadStep, Plan
from bench.standard_plans import is_kr10, tour
from bench.study_arm import default_truth

# --- The usual arm and its stiffness --------------------------------------------------

KR10 = Path(__file__).parents[2] / "mjcf" / "kr10_r1100_2" / "kr10_r1100_2.xml"


def bare_rig(robot: Path, hands: Sequence[str]) -> Rig:
    """Return an arm as its model has it.

    Hands are the bodies at the ends of those arms of a torso that move, the one that
    ropes pull first; the others are held at zero.

    Raises:
        UnknownName: Where the model has no such body.
        Unusable: Where it carries several arms and none is named.
    """
    if hands:
        return Rig(robot, axes=axes_to(load(robot), hands), hand=hands[0])
    rig = Rig(robot)
    if len(ends := tuple(rig.anatomy.hands.values())) > 1:
        fault = (
            f"it carries several arms, which end at {', '.join(ends)}: say by --hand "
            "which one ropes pull; repeat --hand for others that move and are watched. "
            "Where these are a gripper's fingers, give the body that carries them."
        )
        raise Unusable(f"Model {str(robot)!r}", [fault])
    return rig


def concealing_rig(
    robot: Path,
    hands: Sequence[str],
    effects: Sequence[str],
    default: bool,
    scale: tuple[float, ...],
    stiffness: tuple[float, ...] = (),
) -> Rig:
    """Return an arm with what is concealed in it.

    `default` means the study's KR10, with springs and effects of its own. Effects are
    NAME@WHERE[,param=value…]; `scale` is the true stiffness over the model's,
    `stiffness` what stands in its place, in N m/rad, one for all axes or one each.

    Raises:
        Unusable: Where something cannot be built, with all faults.
    """
    rig = bare_rig(robot, hands)
    axes = len(rig.anatomy.axes)
    springs, known = rig.nominal.jnt_stiffness, ()
    parsed, *_ = collect(
        lambda: parse_all(effects, rig.nominal),
        lambda: check_for_axes("--stiffness-scale", scale, axes),
        lambda: check_for_axes("--stiffness", stiffness or (1.0,), axes),
    )
    if default:
        faults = [] if is_kr10(rig) else ["--truth default is that of a KR10 R1100-2."]
        if stiffness:
            faults.append("--truth default has springs of its own; no --stiffness.")
        refuse("Truth", faults)
        truth = default_truth()
        known, springs = truth.effects, truth.stiffness
    if stiffness:
        springs = np.broadcast_to(np.array(stiffness), axes)
    rig = replace(rig, effects=(*known, *parsed), stiffness=springs * np.array(scale))
    try:
        _ = rig.model  # compiled here: what cannot be built is a fault of the settings
    except Unusable as error:
        if not parsed or not (rigid := rigid_axes(rig)):
            raise
        why = f"{', '.join(rigid)} have no joint stiffness in the model, and {SPRINGS}."
        raise Unusable(error.what, [*error.faults, why]) from None
    return rig


SPRINGS = (
    "most effects of a gear act on its axis' spring, which neither --stiffness-scale "
    "nor joint_compliance gives it; give the model joint stiffness, or set it by "
    "--stiffness, such as 5e4"
)
"""Why a rigid axis shows little, and what to do."""


def rigid_axes(rig: Rig) -> list[str]:
    """Return the axes, from a1 on, that have no spring."""
    springs = enumerate(rig.springs, start=1)
    return [f"a{k}" for k, stiffness in springs if stiffness >= RIGID]


def check_for_axes(flag: str, values: tuple[float, ...], axes: int) -> None:
    """Refuse what is not one number, or one for each axis, above zero.

    Raises:
        Unusable: Naming the flag.
    """
    positive = all(np.isfinite(value) and value > 0.0 for value in values)
    if len(values) not in (1, axes) or not positive:
        say = f"expected one number or {axes}, all above 0"
        raise Unusable("Flags", [f"{flag} is {values}, {say}."])


# --- Instruments ----------------------------------------------------------------------


@dataclass(frozen=True)
class Watching:
    """What watches."""

    targets: Literal["all", "flange"] = "all"
    """Bodies with markers: base, links and flange, or the flange alone."""
    noise_mm: tuple[float, ...] = (0.010,)
    """Tracker noise, one sigma, or one each for x, y, z; 0: silent."""
    volumetric_mm: float = 0.0
    """Slowly varying error of the tracker, one sigma."""
    occlusions: float = 0.0
    """Fraction of marker readings that are missing."""
    placement_mm: float = 0.0
    """How far markers sit from their nominal places, one sigma."""
    state_frame: bool = False
    """Say in the manifest where the tracker stands."""
    wrench_noise: float = 1.0
    """Noise of the force sensor, in units of what it states; 0: silent."""
    direction_deg: float = 0.0
    """Error of the force's direction that a visit shares, one sigma about each axis."""
    size_percent: float = 0.0
    """Error of the force's size that a visit shares, one sigma."""
    arrival_urad: float = 0.0
    """Scatter of what the motors reach around what they report, one sigma."""
    link_encoders: bool = False
    """Measure the angles after the gears too."""

    def instruments(self) -> Instruments:
        """Return the instruments.

        Raises:
            Unusable: Where a flag cannot be.
        """
        sigma = self.noise_mm
        if len(sigma) not in (1, 3) or (any(sigma) and not min(sigma) > 0.0):
            fault = f"--noise-mm is {sigma}, expected 0, or one or three above 0."
            raise Unusable("Flags", [fault])
        tracker = Tracker(
            noise=float(any(sigma)),
            field=self.volumetric_mm / 1e3,
            occlusions=self.occlusions,
            frame_error=STILL if self.state_frame else None,
        )
        if any(sigma):
            stated = np.broadcast_to(np.array(sigma) / 1e3, 3)
            tracker = replace(tracker, repeatability=tuple(stated.tolist()))
        return Instruments(
            tracker=tracker,
            force_sensor=ForceSensor(
                noise=self.wrench_noise,
                turn=float(np.deg2rad(self.direction_deg)),
                size=self.size_percent / 100,
            ),
            encoders=Encoders(
                arrival=self.arrival_urad / 1e6, link_side=self.link_encoders
            ),
            markers=Markers(self.targets, placement=self.placement_mm / 1e3),
        )


# --- The truth file -------------------------------------------------------------------


def truth_text(
    rig: Rig,
    name: str,
    seed: int,
    instruments: Instruments,
    memory: Memory = "forgotten",
) -> str:
    """Write what is true of a rig as JSON, in SI.

    The instruments are those before the faults among the effects.

    Returns:
        `schema`, `recording`, `robot`, `seed`, `memory`, `effects`, and `stiffness` of
        each axis in N m/rad, null where it is rigid. An effect has `effect`, `where`,
        `parameters` under the names of the diagnosis' vocabulary, its `mechanism`,
        since one name can have several, and everything that was `set`; the fields of
        `instruments` are those of `bench.instruments`.
    """
    springs = zip(rig.anatomy.axes, rig.springs, strict=True)
    truth = {
        "schema": 1,
        "recording": name,
        "robot": Path(rig.arm_file).stem,
        "seed": seed,
        "memory": memory,
        "effects": [_entry(effect) for effect in rig.effects],
        "stiffness": {
            axis: None if stiffness >= RIGID else float(stiffness)
            for axis, stiffness in springs
        },
        "instruments": msgspec.to_builtins(instruments),
    }
    return json_text(truth)


def folder_beside(out: Path | None, truth_file: Path | None) -> Path:
    """Return the recording's folder, which is there and holds no truth file.

    Raises:
        Unusable: Where no folder is named, or the truth lies in it, also through links.
    """
    if out is None:
        raise Unusable("Flags", ["--out is missing; name a folder for the recording."])
    if truth_file is None:
        return out
    if os.path.lexists(truth_file) and not truth_file.is_file():
        fault = "it is there and is no file; give another name."
        raise Unusable("Truth file", [f"--truth-file {str(truth_file)!r}: {fault}"])
    inside = truth_file.resolve().is_relative_to(out.resolve())
    if inside or out.resolve().is_relative_to(truth_file.resolve()):
        fault = (
            f"it lies inside {str(out)!r}, or that inside it; put it elsewhere, for "
            "a recording holds no truth."
        )
        raise Unusable("Truth file", [f"--truth-file {str(truth_file)!r}: {fault}"])
    return out


def written_with_truth(
    truth_file: Path | None, truth: str, write: Callable[[], None]
) -> None:
    """Write the truth and, while it waits beside its place, what belongs to it.

    `write` writes the rest, or raises.

    Raises:
        Unusable: Where the truth cannot be written; then nothing is.
    """
    if truth_file is None:
        write()
        return
    try:
        truth_file.parent.mkdir(parents=True, exist_ok=True)
        if truth_file.is_dir():
            raise IsADirectoryError(f"{str(truth_file)!r} is a folder")
        with replaced_whole(truth_file) as waiting:
            waiting.write_text(truth, encoding="utf-8")
            write()
    except OSError as error:
        fault = f"it cannot be written: {error}."
        raise Unusable(f"Truth file {str(truth_file)!r}", [fault]) from error


def _entry(effect: Effect) -> dict[str, object]:
    return {
        "effect": effect.name,
        "where": effect.where,
        "parameters": _plain(effect.parameters()),
        "mechanism": type(effect).__name__,
        "set": _plain(
            {
                f.name: getattr(effect, f.name)
                for f in fields(effect)
                if f.name != "where"
            }
        ),
    }


def _plain(values) -> dict[str, object]:
    return {k: v.item() if isinstance(v, np.generic) else v for k, v in values.items()}


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

    An axis turns either way by `widest_deg` at most, in degrees.

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

    Without a wish these are the usual loads, less where the arm carries less.

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
    refuse("The list of effects", faults)


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
