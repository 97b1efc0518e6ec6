"""What a recording holds, how well it shows every axis, and what it can tell apart.

A pose visited twice shows the noise that the tracker really has. An axis is seen when
it travels, something turns it, and something shows it turn. An experiment can only tell
apart what its loads, poses and markers make differ.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from bench.shared.errors import Unusable
from bench.shared.recording import UNLOADED, UNLOADING, Recording
from stiffness.experiment.visits import commanded_lags
from stiffness.robot.arm import Arm
from stiffness.robot.kinematics import ArmState
from stiffness.robot.wrench import felt_body, wrench_in_base

# --- Noise from replicates ------------------------------------------------------------


def replicate_noise(recording: Recording) -> tuple[Float[np.ndarray, "3"], int] | None:
    """Compare rows of the same pose, load and place in the visit's course.

    Returns:
        Their standard deviation along x, y, z of the tracker, in m, pooled over
        markers, and how many degrees of freedom it has; None without replicates.
    """
    points, visits = recording.points, recording.visit
    if points is None:
        return None
    _, first = np.unique(visits, return_index=True)
    start = first[np.searchsorted(visits[first], visits)]
    if recording.displacement == "relative":
        points = points - points[start]
    load = recording.load_mass
    load = np.zeros(len(visits)) if load is None else load
    keys = np.stack(
        [recording.posture_id, np.arange(len(visits)) - start, load], axis=1
    )
    _, group = np.unique(keys, axis=0, return_inverse=True)
    squares, freedom = np.zeros(3), 0
    for members in (points[group == g] for g in np.flatnonzero(np.bincount(group) > 1)):
        seen = members[:, np.isfinite(members).all(axis=(0, 2))]
        squares += np.sum((seen - seen.mean(axis=0)) ** 2, axis=(0, 1))
        freedom += (len(seen) - 1) * seen.shape[1]
    return (np.sqrt(squares / freedom), freedom) if freedom else None


# --- Contents -------------------------------------------------------------------------


def contents_of(r: Recording) -> Iterator[tuple[str, str]]:
    """Say what a recording holds, row by row of a table."""
    visits = np.unique(r.visit, return_index=True)[1]
    counts = Counter(r.posture_id[visits].tolist())
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
            f"{count}{six}; places {_share(place, count)}; "
            f"{f'not seen in {blank:.1%} of readings' if blank else 'always seen'}",
        )
    if not r.markers:
        yield "markers", "none"
    known = "known" if r.base_from_tracker is not None else "unknown, to be fitted"
    yield "tracker's frame", known
    yield "tracker's noise", noise_of(r)
    yield "wrench", wrench_of(r)
    yield "load path", load_path_of(r)
    if r.commanded is not None:
        yield "commanded angles", f"{_measured(r.commanded)} axes; {lags_of(r)}"
    if r.link_posture is not None:
        yield "encoders after the gear", f"{_measured(r.link_posture)} axes"
    if r.axis_torque is not None:
        yield "motor torque", f"{_measured(r.axis_torque)} axes"
    if r.temperature is not None:
        low, high = r.temperature.min(), r.temperature.max()
        yield "temperature", f"{low:.1f} to {high:.1f} °C"


def lags_of(r: Recording) -> str:
    """Say how far reported angles lag behind commanded ones along the last move."""
    told = []
    for k, (lag, half) in enumerate(commanded_lags(r).tolist()):
        if abs(lag) > half:
            way = "lags behind" if lag > 0.0 else "leads"
            low, high = 1e3 * (abs(lag) - half), 1e3 * (abs(lag) + half)
            told.append(
                f"a{k + 1} {way} its command along its last move by "
                f"{1e3 * abs(lag):.2g} mrad ({low:.2g} to {high:.2g})"
            )
    return "; ".join(told) or "no report lags behind its command"


def noise_of(r: Recording) -> str:
    """Put the tracker's stated noise beside what replicates show."""
    if r.tracker is None:
        return "no tracker"
    frames = 1.0 if r.frames is None else float(np.mean(1.0 / r.frames)) ** 0.5
    stated = ", ".join(f"{1e3 * s * frames:.4f}" for s in r.tracker.repeatability)
    if not r.tracker.is_stated:
        return f"not stated; {stated} mm in x, y, z, measured or assumed"
    found = replicate_noise(r)
    if found is None:
        return f"stated {stated} mm in x, y, z; no pose visited again to compare"
    seen = ", ".join(f"{1e3 * s:.4f}" for s in found[0])
    return f"stated {stated} mm in x, y, z; poses visited again show {seen} mm"


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


def _share(stated: int, count: int) -> str:
    """Say how many markers' places on their body are stated."""
    if stated in (0, count):
        return "stated" if stated else "not stated"
    return f"of {stated} stated"


def _measured(columns: np.ndarray) -> int:
    return int(np.sum(~np.isnan(columns).all(axis=0)))


# --- View of every axis ---------------------------------------------------------------

SMALL_TORQUE = 1.0
"""N m of change below which an axis' wind-up hardly shows (chosen: a gear of
1e5 N m/rad then moves a point one metre away by a tracker's 10 µm)."""
SMALL_TRAVEL = np.radians(1.0)
"""Range of an angle below which nothing is seen to vary with it; chosen."""
SMALL_LEVER = 1e-3
"""m per rad below which no marker shows an axis turn (chosen: 1° moves it 17 µm)."""


@dataclass(frozen=True)
class AxisView:
    """How much of one axis a recording can see.

    Attributes:
        name: Of the axis, as in the recording's columns.
        travel: Range of its angle, in rad (m).
        torque: Range of the torque about it from weight and load, in N m; within a
            visit where displacements are relative.
        lever: Largest motion of a marker per turn, in m per rad; NaN where no marker.
        seen: Whether a marker (one of unknown place beyond it will do) or an encoder
            after the gear shows it turn.
    """

    name: str
    travel: float
    torque: float
    lever: float
    seen: bool


TOO_ALIKE = 0.95
"""Cosine above which two axes' give moves the markers alike; as in the diagnosis."""
MOST_VISITS = 500
"""Visits that are looked at for it; chosen: a second."""


def axis_views(recording: Recording, arm: Arm) -> list[AxisView]:
    """Say of each axis how far it turns, what turns it, and what would show it."""
    standing = arm.at(recording.posture)
    torque = _since_unloaded(recording, static_torque(recording, standing))
    lever = np.full(len(arm.axes), np.nan)
    seen = np.zeros(len(arm.axes), dtype=bool)
    if recording.link_posture is not None:
        seen |= np.isfinite(recording.link_posture).any(axis=0)
    for marker in recording.markers:
        place = np.zeros(3) if marker.position is None else marker.position
        jacobian = standing.jacobian(marker.body, place)[:, :3]  # (rows, 3, axes)
        if marker.position is None:
            seen[arm.chain.carriers(arm.attachment(marker.body).axis)] = True
        lever = np.fmax(lever, np.max(np.linalg.norm(jacobian, axis=1), axis=0))
    travel, turning = np.ptp(recording.posture, axis=0), np.ptp(torque, axis=0)
    seen |= np.nan_to_num(lever) > SMALL_LEVER
    each = zip(travel, turning, lever, seen, strict=True)
    return [
        AxisView(f"a{k}", float(a), float(t), float(m), bool(s))
        for k, (a, t, m, s) in enumerate(each, start=1)
    ]


def confounded_axes(recording: Recording, arm: Arm) -> list[tuple[str, str]]:
    """Return pairs of axes whose give moves all markers in nearly the same way.

    An axis of compliance c moves a marker by J c τ. Its mean over the rows of a visit
    (over all rows, where each visit has one) is taken off: frames and places take it.
    """
    _, visit = np.unique(recording.visit, return_inverse=True)
    step = -(-(visit.max() + 1) // MOST_VISITS)
    r = recording.take(np.flatnonzero(visit % step == 0))
    if not r.markers:
        return []
    standing = arm.at(r.posture)
    torque = static_torque(r, standing)
    _, visit, count = np.unique(r.visit, return_inverse=True, return_counts=True)
    if count.max() == 1:
        visit, count = np.zeros_like(visit), np.array([len(visit)])
    columns = []
    for marker in r.markers:
        place = np.zeros(3) if marker.position is None else marker.position
        moved = standing.jacobian(marker.body, place)[:, :3] * torque[:, None]
        mean = np.zeros((len(count), *moved.shape[1:]))
        np.add.at(mean, visit, moved)
        moved = moved - (mean / count[:, None, None])[visit]
        columns.append(moved.reshape(-1, len(arm.axes)))
    moved = np.vstack(columns)
    product = moved.T @ moved
    size = np.sqrt(np.diag(product))
    apart = np.outer(size, size)
    cosine = np.divide(product, apart, out=np.zeros_like(apart), where=apart > 0.0)
    return [
        (f"a{i + 1}", f"a{j + 1}")
        for i, j in zip(*np.triu_indices(len(size), 1), strict=True)
        if abs(cosine[i, j]) > TOO_ALIKE
    ]


def static_torque(recording: Recording, standing: ArmState) -> np.ndarray:
    """Return the torque about each axis from weight and load, (rows, axes), N m."""
    torque = standing.gravity_torque(recording.tool)
    if (sensor := recording.wrench_sensor) is not None and recording.wrench is not None:
        wrench = wrench_in_base(recording, standing)
        torque = torque + standing.load_torque(wrench, sensor.body, sensor.position)
    return torque


def _since_unloaded(recording: Recording, torque: np.ndarray) -> np.ndarray:
    if recording.displacement == "absolute":
        return torque
    _, first, visit = np.unique(recording.visit, return_index=True, return_inverse=True)
    return torque - torque[first[visit]]


# --- What can be told apart -----------------------------------------------------------


@dataclass(frozen=True)
class Ability:
    """One question, and whether a recording can answer it."""

    question: str
    can: bool
    why: str
    add: str = ""


def _ability(question: str, can: object, yes: str, no: str, add: str) -> Ability:
    """Say why a question can be answered; or why not, and what to add."""
    return Ability(question, True, yes) if can else Ability(question, False, no, add)


def _is_unloaded_again(recording: Recording) -> bool:
    """Return whether a load falls within a visit, if only to nothing."""
    stage, same = recording.stage, np.diff(recording.visit) == 0
    after_load = same & (stage[:-1] != UNLOADED) & (stage[1:] == UNLOADED)
    return UNLOADING in stage or bool(np.any(after_load))


def abilities(
    recording: Recording, arm: Arm, views: list[AxisView]
) -> Iterator[Ability]:
    """Say what a recording can and cannot show, and what to add."""
    r = recording
    yield _ability(
        "hysteresis, lost motion",
        _is_unloaded_again(r),
        "the load rises and falls",
        "the load never reverses in a visit",
        "read once more without the load, or unload in the steps that you load in",
    )
    stood = (np.diff(r.visit) == 0) & (r.load_time[1:] < r.time[:-1])
    dwell = float(np.max(np.diff(r.time)[stood], initial=0.0))
    yield _ability(
        "creep",
        dwell,
        f"read again up to {dwell:.0f} s later",
        "each load is read once",
        "read twice under one load, minutes apart (load_time_s)",
    )
    axes = {arm.attachment(m.body).axis for m in r.markers}
    yield _ability(
        "on which link it gives way",
        len(axes - {-1}) > 1 or r.link_posture is not None,
        "markers or encoders on several bodies",
        "one body is watched",
        "three markers on each link; till then places are inferred",
    )
    yield _ability(
        "how it gives way to a load",
        r.wrench is not None,
        "the wrench is measured",
        "no wrench: weight is the only load",
        "a force sensor, fx_n … tz_nm",
    )
    if r.wrench is not None and (others := unpulled_axes(r, arm)):
        yield Ability(
            "how the other arm gives way to a load",
            False,
            f"one wrench is read, and it pulls none of {', '.join(others)}",
            "a recording of its own with the other hand pulled",
        )
    found = replicate_noise(r)
    yield _ability(
        "whether the stated noise is real",
        found,
        f"{found[1]} degrees of freedom" if found else "",
        "no pose is visited twice",
        "visit five poses again at the end; noise is taken as stated",
    )
    warm, absolute = r.temperature is not None, r.displacement == "absolute"
    heat = "temperature is recorded" if warm else "no temperature_c"
    yield _ability(
        "drift with temperature",
        warm and absolute,
        heat,
        heat if absolute else f"{heat}; displacements are relative",
        "temperature_c; till then drift is in time" if absolute else "absolute places",
    )
    if r.link_posture is not None and not r.markers:
        yield _between_encoders(r)
    if r.axis_torque is not None and r.link_posture is None:
        yield Ability(
            "masses and friction of the axes",
            False,
            f"torque of {_measured(r.axis_torque)} axes is read, which shows them "
            "along motions; this tool weighs displacements alone",
            "markers, or encoders after the gears",
        )
    shown = absolute and bool(r.markers)
    yield Ability("geometry, offsets of encoders", shown, *_of_places(r))
    yield from _of_axes(views, absolute)
    pairs = [f"{a} and {b}" for a, b in confounded_axes(r, arm)]
    yield _ability(
        "which of two axes gives way",
        not pairs,
        "no two axes move the markers alike",
        f"{', '.join(pairs)} move the markers alike",
        "other directions of load, or a marker between these axes",
    )


def unpulled_axes(recording: Recording, arm: Arm) -> tuple[str, ...]:
    """Return the axes of other arms of a torso than the one that the wrench is on."""
    chain = arm.chain
    end = arm.attachment(felt_body(recording)).axis
    pulled, every = chain.carriers(end), range(len(arm.axes))
    other = [k for k in every if k not in pulled and end not in chain.carriers(k)]
    return tuple(f"a{k + 1}" for k in other) if pulled else ()


def _between_encoders(r: Recording) -> Ability:
    from stiffness.dual_encoder.motions import FEWEST, motions_of

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
    idle = ", ".join(v.name for v in views if v.torque < SMALL_TORQUE)
    yield _ability(
        "how soft each axis is",
        not idle,
        "its torque varies",
        f"{idle}: torque hardly varies",
        "a load whose line of action passes beside these axes",
    )
    hidden = ", ".join(v.name for v in views if not v.seen)
    yield _ability(
        "how far each axis really turns",
        not hidden,
        "each moves a marker, or has an encoder after its gear",
        f"{hidden}: nothing shows it turn",
        "a marker beside these axes, beyond them",
    )
    still = ", ".join(v.name for v in views if v.travel < SMALL_TRAVEL)
    yield _ability(
        "errors that vary with an axis' angle",
        absolute and not still,
        "each moves by 1° or more",
        f"{still}: moved by less than 1°" if absolute else "displacements are relative",
        "poses in which these axes move" if absolute else "absolute places",
    )
