"""Reads the nominal arm from its model file, and a recording against that arm."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from bench.model_file import load, plain_mjcf
from bench.shared.errors import Unusable
from bench.shared.format.checks import SAME_POSTURE, said_of_repeats
from bench.shared.format.faults import Place, visible
from bench.shared.format.folder import read
from bench.shared.format.table import CSV_FILE, PARQUET_FILE
from bench.shared.models import ModelFacts
from bench.shared.recording import UNLOADED, Recording
from stiffness.experiment.sensor_noise import with_measured_noise
from stiffness.robot.arm import Arm

# --- Streams of a single pose ---------------------------------------------------------

SLIDE = 1e-4
"""Travel from which a slide has moved, in m; chosen: a tenth of what a limit allows."""


def said_of_one_pose(recording: Recording) -> tuple[str, ...]:
    """Return advice on a stream that is a single pose though the arm moves.

    A diagnosis counts poses, not instants.
    """
    r = recording
    way = np.ptp(r.posture, axis=0)
    least = np.where(np.resize(r.slides or (False,), way.shape), SLIDE, SAME_POSTURE)
    if r.rows != "stream" or len(np.unique(r.posture_id)) > 1 or np.all(way <= least):
        return ()
    from stiffness.dual_encoder.motions import FEWEST

    encoders = r.link_posture is not None and not r.markers
    number = "give each motion a number of its own as its `pose`"
    if encoders:
        what = f"{number}, {FEWEST} motions or more."
    else:
        what = (
            "where the arm stopped, add [rests] to the mapping (speed_deg_per_s = 0.05,"
            f" hold_s = 1.0) and import it again; where it never stopped, {number}."
        )
    return (
        f"all {len(r.time)} instants of this stream are one pose, though the arm moves,"
        f" and a diagnosis counts poses: {what}",
    )


# --- Arm and recording ----------------------------------------------------------------


def arm_of(path: Path) -> Arm:
    """Read the nominal arm from an MJCF or URDF file.

    Raises:
        BenchError: Where it cannot be read, saying why.
    """
    text = plain_mjcf(load(path))
    try:
        return Arm.from_mjcf_text(text)
    except Unusable as error:  # which names the file that the text was put into
        raise Unusable(f"Model {str(path)!r}", error.faults) from None


def facts_of(arm: Arm) -> ModelFacts:
    """Return the names and limits that a recording of this arm is checked against."""
    return ModelFacts(
        joints=arm.axes,
        slides=tuple(bool(slides) for slides in arm.slides),
        lower=arm.limits[:, 0],
        upper=arm.limits[:, 1],
        bodies=tuple(arm.chain.places),
        followers=tuple(arm.file.followers),
    )


# --- Axes that follow others ----------------------------------------------------------


def followed(recording: Recording, arm: Arm) -> tuple[Recording, tuple[str, ...]]:
    """Add the axes that the model lets follow others and the recording leaves out.

    The recording has a column for each axis that its manifest names, or for each that
    follows no other.

    Returns:
        The recording, followers last, so that a1, a2 … stay what they are in its files;
        and a note on each.
    """
    r, notes = recording, []
    names = list(r.axes or (a for a in arm.axes if a not in arm.file.followers))
    slides = list(r.slides or (False,) * len(names))
    posture = r.posture
    for follower, (leader, law) in arm.file.followers.items():
        if follower in names or leader not in names:
            continue
        angle = np.polynomial.Polynomial(law or (0.0,))(posture[:, names.index(leader)])
        posture = np.column_stack([posture, angle])
        slides.append(bool(arm.slides[arm.axes.index(follower)]))
        names.append(follower)
        notes.append(
            f"{follower!r} follows {leader!r}, as the model has it: its column is "
            f"computed and counts as a{len(names)}. It gives way by itself."
        )
    more = posture.shape[1] - r.posture.shape[1]
    if not more:
        return r, ()

    def wider(columns: np.ndarray | None) -> np.ndarray | None:
        unread = np.full((len(r.time), more), np.nan)
        return None if columns is None else np.hstack([columns, unread])

    known = replace(
        r,
        posture=posture,
        axes=tuple(names),
        slides=tuple(slides) if any(slides) else (),
        commanded=wider(r.commanded),
        last_move=None,
        link_posture=wider(r.link_posture),
        axis_torque=wider(r.axis_torque),
    )
    return known, tuple(notes)


def under_known_loads(recording: Recording) -> tuple[Recording, tuple[str, ...]]:
    """Leave out rows under a load of which nobody says where it pulls.

    Returns:
        The recording, and a note where it is less; as it is where all of it is loaded.
    """
    loaded = recording.stage != UNLOADED
    known = recording.wrench is not None or recording.points is None
    if known or not loaded.any() or loaded.all():
        return recording, ()
    rows = f"{np.count_nonzero(loaded)} of {len(loaded)} rows"
    note = (
        f"{rows} are under a load and no wrench says where it pulls: they are left "
        "out. Give fx_n, fy_n and fz_n; of a weight that hangs on the flange that is "
        "its weight, straight down."
    )
    return recording.take(~loaded), (note,)


def legend_of(arm: Arm) -> tuple[str, ...]:
    """Return which joint each axis is, and the flange; nothing where names agree."""
    pairs = [(f"a{k}", visible(axis)) for k, axis in enumerate(arm.axes, start=1)]
    if all(name == axis for name, axis in pairs):
        return ()
    said = ", ".join(f"{name} is {axis!r}" for name, axis in pairs)
    places, ours = arm.chain.places, ("flange", "tool")
    last = [n for n, place in places.items() if place is places["flange"]]
    own = [n for n in last if n not in ours and not re.fullmatch(r"link_\d+", n)]
    if own:
        said += f", and the flange is {visible(own[0])!r}"
    return (f"axes go by the recording's columns; in the model {said}.",)


def read_for(folder: Path, arm: Arm) -> tuple[Recording, Arm, tuple[str, ...]]:
    """Read a recording of an arm.

    Returns:
        The recording, its names without the terminal's control characters; the arm with
        the recording's own names; and notes.

    Raises:
        Unusable: With every fault of the recording.
    """
    recording, notes = read(folder, facts_of(arm))
    recording, added = followed(recording, arm)
    recording, noise = with_measured_noise(recording)
    shown = replace(
        recording,
        name=visible(recording.name),
        robot=visible(recording.robot),
        markers=tuple(replace(m, name=visible(m.name)) for m in recording.markers),
    )
    in_text = (folder / CSV_FILE).exists()
    place = Place(CSV_FILE if in_text else PARQUET_FILE, in_text)
    told = (*said_of_repeats(place, recording), *said_of_one_pose(recording))
    told += (*added, noise) if noise else added
    shown, less = under_known_loads(shown)
    arm = arm.for_recording(shown)
    return shown, arm, (*notes, *told, *less, *legend_of(arm))
