"""An experiment can only tell apart what its loads, poses and markers make differ."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from bench.errors import Unusable
from bench.recording import UNLOADING, Recording
from scenarios.axis_view import SMALL_TORQUE, SMALL_TRAVEL, AxisView, alike
from scenarios.replicates import replicate_noise
from stiffness.arm import Arm
from stiffness.two_encoders.motions import FEWEST, motions_of


@dataclass(frozen=True)
class Ability:
    """One question, and whether a recording can answer it.

    Attributes:
        question: What one would like to know.
        can: Whether the recording can tell.
        why: What it has or lacks.
        add: What to add; empty where nothing is missing.
    """

    question: str
    can: bool
    why: str
    add: str = ""


def abilities(
    recording: Recording, arm: Arm, views: list[AxisView]
) -> Iterator[Ability]:
    """Say what a recording can and cannot show, and what to add.

    Args:
        recording: What was done and seen.
        arm: The nominal arm with the recording's names.
        views: Its axes as the recording sees them.
    """
    r = recording
    falls = UNLOADING in r.stage
    yield Ability(
        "hysteresis, lost motion",
        falls,
        "the load rises and falls" if falls else "the load never reverses in a visit",
        "" if falls else "unload in the same steps as you load",
    )
    stood = (np.diff(r.visit) == 0) & (r.load_time[1:] < r.time[:-1])
    dwell = float(np.max(np.diff(r.time)[stood], initial=0.0))
    yield Ability(
        "creep",
        dwell > 0,
        f"read again up to {dwell:.0f} s later" if dwell else "each load is read once",
        "" if dwell else "read twice under one load, minutes apart (load_time_s)",
    )
    axes = {arm.place(m.body).axis for m in r.markers}
    links = len(axes - {-1}) > 1 or r.link_posture is not None
    yield Ability(
        "on which link it gives way",
        links,
        "markers or encoders on several bodies" if links else "one body is watched",
        "" if links else "three markers on each link; till then places are inferred",
    )
    loaded = r.wrench is not None
    yield Ability(
        "how it gives way to a load",
        loaded,
        "the wrench is measured" if loaded else "no wrench: weight is the only load",
        "" if loaded else "a force sensor, fx_n … tz_nm",
    )
    warm, absolute = r.temperature is not None, r.displacement == "absolute"
    found = replicate_noise(r)
    yield Ability(
        "whether the stated noise is real",
        found is not None,
        f"{found[1]} degrees of freedom" if found else "no pose is visited twice",
        "" if found else "visit five poses again at the end; noise is taken as stated",
    )
    yield Ability(
        "drift with temperature",
        warm and absolute,
        ("temperature is recorded" if warm else "no temperature_c")
        + ("" if absolute else "; displacements are relative"),
        ("" if absolute else "absolute places")
        or ("" if warm else "temperature_c; till then drift is in time"),
    )
    if r.link_posture is not None and not r.markers:
        yield _between_encoders(r)
    shown = absolute and bool(r.markers)
    yield Ability("geometry, offsets of encoders", shown, *_of_places(r))
    yield from _of_axes(views, absolute)
    pairs = [f"{a} and {b}" for a, b in alike(r, arm)]
    yield Ability(
        "which of two axes gives way",
        not pairs,
        f"{', '.join(pairs)} move the markers alike"
        if pairs
        else "no two axes move the markers alike",
        "other directions of load, or a marker between these axes" if pairs else "",
    )


def _between_encoders(r: Recording) -> Ability:
    what, add = "what lies between an axis' encoders", f"a stream of {FEWEST} motions"
    try:
        motions_of(r)
    except Unusable as refusal:
        return Ability(what, False, " ".join(refusal.faults), add)
    return Ability(what, True, "motions are read on both sides of gears")


def _of_places(r: Recording) -> tuple[str, str]:
    if r.displacement != "absolute":
        return "displacements are relative", "absolute places of the unloaded arm"
    if not r.markers:
        return "nothing was tracked", "a target on the flange, seen by a tracker"
    if r.base_from_tracker is not None:
        return "places are absolute", ""
    return (
        "places are absolute; the tracker's frame is unknown and fitted, so the first "
        "axis' offset and the base's tilt go into it",
        "where the tracker stands ([frames.tracker]), for these two",
    )


def _of_axes(views: list[AxisView], absolute: bool) -> Iterator[Ability]:
    idle = [v.name for v in views if v.torque < SMALL_TORQUE]
    yield Ability(
        "how soft each axis is",
        not idle,
        f"{', '.join(idle)}: torque hardly varies" if idle else "its torque varies",
        "a load whose line of action passes beside these axes" if idle else "",
    )
    hidden = [v.name for v in views if not v.seen]
    yield Ability(
        "how far each axis really turns",
        not hidden,
        f"{', '.join(hidden)}: nothing shows it turn"
        if hidden
        else "each moves a marker, or has an encoder after its gear",
        "a marker beside these axes, beyond them" if hidden else "",
    )
    still = [v.name for v in views if v.travel < SMALL_TRAVEL]
    yield Ability(
        "errors that vary with an axis' angle",
        absolute and not still,
        "displacements are relative"
        if not absolute
        else f"{', '.join(still)}: moved by less than 1°"
        if still
        else "each moves by 1° or more",
        "absolute places"
        if not absolute
        else "poses in which these axes move"
        if still
        else "",
    )
