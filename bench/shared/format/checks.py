"""Checks of a recording: manifest against itself, samples against limits, repeats.

`faults_of` checks the manifest's frames, bodies and axes against each other and the
model, `faults_in` finds impossible readings, and `repeats` finds rows that repeat the
row above, its time included.
"""

import math
import re
from collections import defaultdict
from collections.abc import Callable, Mapping

import numpy as np
from jaxtyping import Float, Int

from bench.shared.format.columns import WRENCH, Layout, spread_of
from bench.shared.format.faults import SHOWN, Place, nearest, quoted
from bench.shared.format.manifest import (
    FILE,
    MAX_NUMBER,
    Manifest,
    MarkerEntry,
    Quaternion,
)
from bench.shared.format.table import (
    ENCODINGS,
    MOST_LEFT_OUT,
    is_encoding,
    is_separator,
)
from bench.shared.models import ModelFacts, axis_unit
from bench.shared.recording import STAGES, Recording

# --- Frames, bodies and axes of the manifest ------------------------------------------

UNIT_WITHIN = 1e-3
"""Tolerance of a quaternion's norm, by the format."""
MARKERS_OF_TARGET = 4
"""Number of markers in a 6D target, by the format."""


def joints_of(
    manifest: Manifest, model: ModelFacts | None
) -> tuple[tuple[int, ...] | None, list[str]]:
    """Return the model's joint of each axis; None without a model."""
    if model is None:
        return None, []
    axes = manifest.model_names.axes or model.axes
    index = {name: i for i, name in enumerate(model.joints)}
    faults = [
        f"{FILE}, robot.axes: the model has no joint {quoted(name)}."
        f"{nearest(name, model.joints)} Known: {', '.join(model.joints)}."
        for name in axes
        if name not in index
    ]
    return tuple(index[name] for name in axes if name in index), faults


def faults_of(
    manifest: Manifest, axes: int | None, model: ModelFacts | None
) -> list[str]:
    """Return every fault of a manifest.

    Axes and model are None where unknown.
    """
    faults = csv_faults(manifest)
    frame, wrench = manifest.frames.tracker, manifest.sensors.wrench
    if frame:
        faults += _turn_faults("frames.tracker", frame.quaternion_wxyz)
    if wrench:
        faults += _turn_faults("sensors.wrench", wrench.quaternion_wxyz)
    faults += _tracker_faults(manifest)
    names = manifest.model_names
    if len(set(names.axes)) < len(names.axes):
        faults.append(f"{FILE}, robot.axes: a joint is named twice.")
    if model is not None:
        faults += [
            f"{FILE}, robot.bodies.{name}: the model has no body {quoted(body)}."
            f"{nearest(body, model.bodies)} Known: {', '.join(model.bodies)}."
            for name, body in names.bodies.items()
            if body not in model.bodies
        ]
    known = [
        "base",
        *(f"link_{k}" for k in range(1, (axes or 0) + 1)),
        "flange",
        "tool",
    ]
    known += [b for b in names.bodies if b not in known]
    known += [b for b in (model.bodies if model else ()) if b not in known]
    places = {f"markers.{name}": m.body for name, m in manifest.markers.items()}
    if wrench:
        places["sensors.wrench"] = wrench.body
    for place, body in places.items():
        is_format_like = body.startswith("link_") and axes is not None
        if body not in known and (model is not None or is_format_like):
            faults.append(
                f"{FILE}, {place}.body: no body is called {quoted(body)}."
                f"{nearest(body, known)} Known: {', '.join(known)}."
            )
    return faults + _target_faults(manifest)


SAME_MARK = "separator and decimal mark."
"""How the fault ends that another separator explains."""


def csv_faults(manifest: Manifest) -> list[str]:
    """Return the faults of the manifest's description of the CSV file."""
    about, mark, faults = manifest.csv, manifest.csv.mark, []
    separator, lines = about.separator, about.skip_rows
    if not is_separator(separator):
        say = "one plain character separates cells, such as ',' or ';'"
        faults.append(f"{FILE}, csv.separator: {quoted(separator)}; {say}.")
    if not is_encoding(about.encoding):
        known = ", ".join(ENCODINGS)
        say = f"{quoted(about.encoding)} is not one of: {known}."
        faults.append(f"{FILE}, csv.encoding: {say}")
    below = isinstance(lines, int)
    if not 0 <= lines <= MOST_LEFT_OUT if below else any(n < 1 for n in lines):
        say = "say how many rows below the header, or which lines, counted from 1"
        faults.append(f"{FILE}, csv.skip_rows: {say}.")
    if mark not in (".", ","):
        faults.append(f"{FILE}, csv.decimal: {quoted(mark)} is not '.' or ','.")
    if separator == mark:
        faults.append(f"{FILE}, csv: {mark!r} is both {SAME_MARK}")
    if isinstance(manifest.csv.decimal, str) and isinstance(
        manifest.csv.decimal_mark, str
    ):
        faults.append(f"{FILE}, csv: decimal and decimal_mark are the same thing.")
    return faults


def faults_of_rules(manifest: Manifest, layout: Layout) -> list[str]:
    """Return what a manifest lacks, or states twice, for the columns that are there."""
    faults, sensors = [], manifest.sensors
    there = {*layout.held, *manifest.columns}
    spreads = [m for m in manifest.markers if spread_of(m)[0] in there]
    forces = [name in there for name in WRENCH]
    if manifest.markers and sensors.tracker is None and not spreads:
        faults.append(f"{FILE}: there are markers but no [sensors.tracker].")
    if any(forces) and sensors.wrench is None:
        faults.append(f"{FILE}: there is a wrench but no [sensors.wrench].")
    if sensors.wrench and sensors.wrench.accuracy_nm is None and any(forces[3:]):
        faults.append(f"{FILE}, sensors.wrench.accuracy_nm: missing.")
    if manifest.pulled:
        if manifest.rows == "stream":
            say = 'each row is a pulled pose at rest; rows = "plateaus"'
            faults.append(f"{FILE}, pulled: {say}.")
        double = [n for n in ("visit", "stage", "load_time_s") if n in layout.held]
        double += [n for n in layout.held if n.endswith("_link_deg")]
        if double:
            say = "each row is a pulled pose, a visit of its own, seen by markers"
            columns = ", ".join(map(repr, double))
            faults.append(f"{FILE}, pulled: {say}; leave out {columns}.")
        if not manifest.markers:
            faults.append(f"{FILE}, pulled: there are no markers that were pulled.")
    elif manifest.number_rows and manifest.displacement == "relative":
        say = (
            "each row is a pose of one reading, and relative displacements need two; "
            "where the unloaded reading is zero by definition, say pulled = true"
        )
        faults.append(f"{FILE}, number_rows: {say}.")
    return faults


def _tracker_faults(manifest: Manifest) -> list[str]:
    tracker = manifest.sensors.tracker
    stated = tracker.repeatability_mm if tracker else 1.0
    if stated is None or all(0.0 < s <= MAX_NUMBER for s in np.ravel(stated)):
        return []
    place = f"{FILE}, sensors.tracker.repeatability_mm"
    say = f"a standard deviation is above 0 and at most {MAX_NUMBER:g}"
    return [f"{place}: {stated} is none; {say}."]


def _turn_faults(place: str, quaternion: Quaternion) -> list[str]:
    norm = math.hypot(*quaternion)
    if abs(norm - 1.0) <= UNIT_WITHIN:
        return []
    return [
        f"{FILE}, {place}.quaternion_wxyz: its norm is {norm:.6g}, not 1 within "
        f"{UNIT_WITHIN:g}."
    ]


def _target_faults(manifest: Manifest) -> list[str]:
    targets: dict[str, list[MarkerEntry]] = defaultdict(list)
    for marker in manifest.markers.values():
        if marker.target is not None:
            targets[marker.target].append(marker)
    faults = []
    for name, markers in targets.items():
        if len(markers) != MARKERS_OF_TARGET:
            faults.append(
                f"{FILE}, markers: target {quoted(name)} has {len(markers)} markers; "
                f"a 6D target is written as {MARKERS_OF_TARGET}."
            )
        if len(bodies := sorted({m.body for m in markers})) > 1:
            faults.append(
                f"{FILE}, markers: target {quoted(name)} is on {', '.join(bodies)}; "
                "a target is on one body."
            )
    return faults


# --- Plausible samples ----------------------------------------------------------------

MAX_FORCE, MAX_TORQUE = 20e3, 5e3
"""N and N m, by the format."""
LARGEST_READING = {
    "time": (1e10, "s"),
    "angle": (200 * np.pi, "rad"),
    "length": (1e3, "m"),
    "mass": (1e5, "kg"),
    "torque": (1e6, "Nm"),
    "temperature": (1e3, "°C"),
    "count": (1e9, ""),
}
"""Sizes beyond which a unit is wrong, whatever the arm; chosen: stamps since 1970 in s,
a hundred turns, a kilometre, and a torque that no motor has."""
SAME_POSTURE = np.radians(0.05)
"""Tolerance of a pose's angles from row to row; chosen: a hundred times the
repeatability of an axis, and far below the difference of two poses."""
BEYOND_LIMIT = np.radians(0.5)
"""How far an angle may exceed its limit, by the format."""
SLIDE_BEYOND_LIMIT = 1e-3
"""The same for a slide, in m (chosen: the format defines angles only)."""


TRAVEL = np.radians(3.0)
"""Least range of an axis whose sign or order can be doubted, in rad (m where it
slides); chosen: an offset of half of it would be an error of the arm, not of a file."""
ZEROS = (90.0, -90.0, 180.0)
"""Degrees by which makers count an axis from different zeros; chosen."""
TURNS = 1.0
"""Turns of an axis beyond which its unit is doubted before its zero; chosen."""
ANGLES = (("degrees", np.pi / 180.0), ("mrad", 1e-3))
"""What an angle that was read as rad may be in, and its size in rad."""
COUPLED = 2
"""Axes apart that one may be counted against another; chosen: links of a parallelogram
are counted against the axis before, and wrists are coupled over two."""
SIGNS = (("+", 1.0), ("-", -1.0))
SPREAD = re.compile(r"_std_[xyz]_mm$")


def faults_in(
    values: Mapping[str, np.ndarray],
    layout: Layout,
    place: Place,
    relative: bool,
    plateaus: bool,
    model: tuple[ModelFacts, tuple[int, ...]] | None,
) -> list[str]:
    """Return every impossible reading.

    Values are in SI, NaN where already at fault. `relative`: only differences within a
    visit mean anything; `plateaus`: a pose is a posture, not a motion. The model comes
    with the joint of each axis.
    """

    def at(name: str, wrong: np.ndarray, say: str, *told: np.ndarray) -> list[str]:
        source = layout.held[name].source if name in layout.held else name
        rows = np.flatnonzero(wrong)
        return place.at(source, rows, lambda r: say.format(*(t[r] for t in told)))

    faults = []
    if "time_s" in values:
        time = values["time_s"]
        back = np.concatenate([[False], np.diff(time) < 0.0])
        say = "time runs backwards, {:g} s after {:g} s."
        faults += at("time_s", back, say, time, np.roll(time, 1))
        if "load_time_s" in values:
            late = values["load_time_s"] > time
            faults += at("load_time_s", late, "later than time_s of the same row.")
    if "stage" in values:
        unknown = ~np.isin(values["stage"], STAGES)
        shown = np.array([quoted(str(word)) for word in values["stage"]])
        say = "{} is not one of " + ", ".join(STAGES) + "."
        faults += at("stage", unknown, say, shown)
    for name, least in (("frames", 1.0), ("load_kg", 0.0)):
        if name in values:
            say = f"{{:g}} is less than {least:g}."
            faults += at(name, values[name] < least, say, values[name])
    faults += _too_strong(values, at)
    for name in (n for n in values if SPREAD.search(n)):
        say = "a spread of {:g} mm; one sigma is not below 0."
        faults += at(name, values[name] < 0.0, say, 1e3 * values[name])
    for name, held in layout.held.items():
        if (
            name in values
            and held.column.kind in LARGEST_READING
            and name not in WRENCH
        ):
            most, unit = LARGEST_READING[held.column.kind]
            size = np.abs(values[name])
            say = f"up to {{:.4g}} {unit}, beyond {most:.4g}; is its unit right?"
            largest = np.full(size.shape, np.max(size, initial=0.0, where=size > most))
            faults += at(name, size > most, say, largest)
    if "pose" in values:
        faults += _odd_visits(values, relative, at)
    if "pose" in values and plateaus:
        faults += _other_postures(values, at)
    if model is not None:
        faults += _beyond_limits(values, *model, at)
    return faults


At = Callable[..., list[str]]
"""Returns faults of a column where it is wrong, told with numbers of its row."""


def _too_strong(values: Mapping[str, np.ndarray], at: At) -> list[str]:
    faults = []
    kinds = (
        (WRENCH[:3], MAX_FORCE, "a force", "20 kN"),
        (WRENCH[3:], MAX_TORQUE, "a torque", "5 kNm"),
    )
    for names, limit, kind, shown in kinds:
        if not all(name in values for name in names):
            continue
        vectors = np.stack([values[name] for name in names], axis=1)
        sizes = np.linalg.norm(np.nan_to_num(vectors), axis=1)
        largest = np.argmax(np.abs(np.nan_to_num(vectors)), axis=1)
        for axis, name in enumerate(names):
            wrong = (sizes > limit) & (largest == axis)
            say = f"{kind} of {{:.4g}} is above {shown}; is its unit right?"
            faults += at(name, wrong, say, sizes)
    return faults


def _odd_visits(values: Mapping[str, np.ndarray], relative: bool, at: At) -> list[str]:
    pose = values["pose"]
    other = np.abs(np.diff(pose, prepend=pose[:1])) > 0  # not where one is at fault
    visit = values.get("visit", np.cumsum(other))
    faults = []
    if "visit" in values:
        same = np.diff(visit) == 0
        two = np.concatenate([[False], same & other[1:]])
        back = np.concatenate([[False], np.diff(visit) < 0])
        faults += at("pose", two, "visit {:.0f} has another pose above.", visit)
        say = "{:.0f} after {:.0f}; visits are counted."
        faults += at("visit", back, say, visit, np.roll(visit, 1))
    if relative:
        _, where, counts = np.unique(visit, return_inverse=True, return_counts=True)
        name = "visit" if "visit" in values else "pose"
        say = "one row in its visit, and relative displacements need two."
        faults += at(name, (counts == 1)[where], say)
    return faults


def _other_postures(values: Mapping[str, np.ndarray], at: At) -> list[str]:
    """Return where a pose's id has another posture than in its first row."""
    pose = values["pose"]
    if not np.isfinite(pose).all():
        return []
    _, first, which = np.unique(pose, return_index=True, return_inverse=True)
    axes = [n for n in values if re.fullmatch(r"a[0-9]+_deg", n)]
    if not axes:
        return []
    angle = np.degrees(np.stack([values[name] for name in axes], axis=1))
    away = np.nan_to_num(angle - angle[first[which]])
    wrong = np.abs(away) > np.degrees(SAME_POSTURE)
    several = wrong.sum(axis=1) > 1
    most = np.argmax(np.abs(away), axis=1)
    say = "{:.3g}° from where pose {:.0f} stood first; give another posture an id of "
    faults = at(
        "pose",
        several,
        f"{{}} axes stand elsewhere, {{}} {say}its own.",
        wrong.sum(axis=1),
        np.array(axes)[most],
        away[np.arange(len(most)), most],
        pose,
    )
    for axis, name in enumerate(axes):
        alone = wrong[:, axis] & ~several
        faults += at(name, alone, f"{say}its own.", away[:, axis], pose)
    return faults


def _beyond_limits(
    values: Mapping[str, np.ndarray], model: ModelFacts, joints: tuple[int, ...], at: At
) -> list[str]:
    faults = []
    for axis, joint in enumerate(joints, start=1):
        slides = model.slides[joint]
        name = f"a{axis}_mm" if slides else f"a{axis}_deg"
        if name not in values:
            continue
        allowed = SLIDE_BEYOND_LIMIT if slides else BEYOND_LIMIT
        unit, factor = axis_unit(slides)
        low, high = model.lower[joint], model.upper[joint]
        column: Float[np.ndarray, " rows"] = values[name]
        span = (low - allowed, high + allowed)
        wrong = (column < span[0]) | (column > span[1])
        shown = f"{low * factor:g} to {high * factor:g}{unit}"
        whose = f"beyond the limits of {model.joints[joint]!r}, {shown}"
        ways = [] if not wrong.any() else _ways_inside(values, name, span)
        say, told = f"{{:.6g}}{unit} is {whose}.", column * factor
        if ways:  # the column is meant otherwise: one fault, not one for each row
            ends = [f"{end(told):.6g}{unit}" for end in (np.nanmin, np.nanmax)]
            say = f"{' to '.join(ends)}, {whose}; all rows are inside "
            say += f"{' or '.join(ways)}."
        faults += at(name, wrong, say, told)
    return faults


def _ways_inside(
    values: Mapping[str, np.ndarray], name: str, span: tuple[float, float]
) -> list[str]:
    """Return how else a column may be meant so that all rows are within limits."""

    def inside(column: np.ndarray) -> bool:
        return bool(np.all((column >= span[0]) & (column <= span[1])))

    column, unit = values[name], name.partition("_")[2]
    if unit == "deg" and np.abs(column).max() > TURNS * 2.0 * np.pi:
        fits = [word for word, size in ANGLES if inside(column * size)]
        return [f"taken for {word} (check the unit)" for word in fits[:1]]
    ways = ["with the other sign (factor = -1.0)"] if inside(-column) else []
    if unit == "deg":
        fits = [o for o in (*ZEROS, -180.0) if inside(column + np.radians(o))]
        if fits:
            added = ", ".join(f"{o:+g}°" for o in fits)
            ways.append(f"counted from another zero ({added})")
    own, fits = int(name[1 : -len(unit) - 1]), []
    for k in range(own - COUPLED, own + COUPLED + 1):
        other = values.get(f"a{k}_{unit}", column[:0])
        if k != own and len(other) and np.ptp(other) > TRAVEL:
            fits += [f"{s}a{k}" for s, f in SIGNS if inside(column + f * other)]
    return ways + [f"uncoupled ({', '.join(fits)})"] * bool(fits)


# --- Repeated rows --------------------------------------------------------------------

READ = ("posture", "wrench", "points", "load_mass", "link_posture", "axis_torque")
MORE = ("commanded", "temperature", "frames")


def repeats(recording: Recording) -> Int[np.ndarray, " repeats"]:
    """Return the rows that repeat the row above in all that was read.

    Replicates are no repeats: they have a time of their own, or noise. In a stream,
    whose clock may be coarse and whose channels may stand still, nothing is one.
    """
    r = recording
    if r.rows != "plateaus":
        return np.zeros(0, dtype=int)
    same = (np.diff(r.time) == 0) & (np.diff(r.visit) == 0)
    for name in (*READ, *MORE):
        if (values := getattr(r, name)) is not None:
            flat = np.reshape(values, (len(r.time), -1))
            alike = (flat[1:] == flat[:-1]) | (np.isnan(flat[1:]) & np.isnan(flat[:-1]))
            same &= alike.all(axis=1)
    return np.flatnonzero(same) + 1


def said_of_repeats(place: Place, recording: Recording) -> list[str]:
    """Return where a file has a reading twice, and what to do."""
    rows = repeats(recording).tolist()
    said = [
        f"{place.row(r)}: the row above once more, with the same time and the same "
        "readings; it would count twice. Delete one, or give each its own time."
        for r in rows[:SHOWN]
    ]
    if len(rows) > SHOWN:
        said.append(f"{place.file}: and {len(rows) - SHOWN} more rows like these.")
    return said
