"""Assembly of a recording from columns and manifest, and its writing back as text.

`visits_of`, `load_times_of` and `stages_of` derive visits, times under load and stages
from the order of rows; `assemble` builds the `Recording`, in which missing quantities
are unknown; `samples_table` and `manifest_text` write text that reads back as the same
numbers, quaternions too (`quaternion_of`). The truth has no column.
"""

import csv
import io
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from bench.shared.errors import Unusable
from bench.shared.format import toml_text
from bench.shared.format.columns import (
    COORDINATES,
    DEGREE,
    MILLIMETRE,
    WRENCH,
    Layout,
    spread_of,
)
from bench.shared.format.manifest import Manifest
from bench.shared.recording import (
    ASSUMED,
    LOADED,
    LOADING,
    UNLOADED,
    UNLOADING,
    DrawingAccuracy,
    Marker,
    Payload,
    Recording,
    TrackerSpec,
    WrenchSpec,
    transform_of,
)

# --- Visits, stages and ages of a load ------------------------------------------------

STEP = 0.05
"""Share of the largest load below which a measured load has not changed (chosen: well
above a sensor's noise, well below one of ten steps)."""


def visits_of(pose: Int[np.ndarray, " rows"]) -> Int[np.ndarray, " rows"]:
    """Count the runs of equal pose: a run is one visit (the format's own rule)."""
    return np.cumsum(np.diff(pose, prepend=pose[:1]) != 0)


def load_times_of(
    time: Float[np.ndarray, " rows"],
    visit: Int[np.ndarray, " rows"],
    load_mass: Float[np.ndarray, " rows"] | None,
) -> Float[np.ndarray, " rows"]:
    """Return the time of the last change of load: right after the row before.

    Where the mass on the hook is stated and is the same as in the row before of the
    same visit, it did not change there: the row is a dwell. Times are in s, masses in
    kg.
    """
    changed = np.ones(len(time), dtype=bool)
    if load_mass is not None:
        changed[1:] = (np.diff(load_mass) != 0) | (np.diff(visit) != 0)
    before = np.concatenate([time[:1], time[:-1]])
    last = np.maximum.accumulate(np.where(changed, np.arange(len(time)), 0))
    return before[last]


def stages_of(
    visit: Int[np.ndarray, " rows"],
    load: Float[np.ndarray, " rows"] | None,
    step: float,
) -> np.ndarray:
    """Return the stage of each row, from the load's course in its visit.

    Near zero is unloaded, near the visit's largest is loaded; between them the sign of
    the last change of more than a step decides between loading and unloading. The load
    is in any unit, as is the step; None where there is none but weight.
    """
    stage = np.full(len(visit), UNLOADED, dtype="<U9")
    if load is None:
        return stage
    starts = np.flatnonzero(np.diff(visit, prepend=visit[:1] - 1))
    for first, end in zip(starts, [*starts[1:], len(visit)], strict=True):
        stage[first:end] = _stages_of_visit(load[first:end], step)
    return stage


def _stages_of_visit(load: Float[np.ndarray, " rows"], step: float) -> list[str]:
    largest, turned, rising = float(np.max(load)), 0.0, True
    stages = []
    for size in load:
        if abs(size - turned) > step:
            turned, rising = size, size > turned
        if size <= step:
            stages.append(UNLOADED)
        elif size >= largest - step:
            stages.append(LOADED)
        else:
            stages.append(LOADING if rising else UNLOADING)
    return stages


# --- Assembly -------------------------------------------------------------------------


def assemble(
    folder: str, manifest: Manifest, layout: Layout, values: Mapping[str, np.ndarray]
) -> tuple[Recording, list[str]]:
    """Return the recording of a folder whose columns have no faults.

    Columns are in SI; the folder's name is that of a recording without one.

    Returns:
        The recording, and what to note of how its rows were understood.

    Raises:
        Unusable: Where spreads of readings say nothing.
    """
    sensors, names = manifest.sensors, manifest.model_names
    wrench, notes = _wrench(values), []
    if wrench is not None and WRENCH[3] not in values:
        notes.append("no torque columns: the wrench is a pure force at its origin.")
    tracker, said = _tracker(manifest, values)
    notes += said
    pose = values["pose"].astype(np.int64)
    visit = values["visit"].astype(np.int64) if "visit" in values else visits_of(pose)
    mass = values.get("load_kg")
    load, step = _load(manifest, visit, mass, wrench)
    axes = range(1, layout.axes + 1)
    ends = ["mm" if slides else "deg" for slides in layout.slides]
    points = [_stacked(values, [m + c for c in COORDINATES]) for m in manifest.markers]
    recording = Recording(
        name=manifest.name or folder,
        time=values["time_s"],
        posture_id=pose,
        visit=visit,
        posture=np.stack(
            [values[f"a{k}_{end}"] for k, end in zip(axes, ends, strict=True)], axis=1
        ),
        load_time=values["load_time_s"]
        if "load_time_s" in values
        else load_times_of(values["time_s"], visit, mass),
        stage=values["stage"].astype("<U9")
        if "stage" in values
        else stages_of(visit, load, step),
        axes=names.axes,
        bodies=names.bodies,
        slides=layout.slides if any(layout.slides) else (),
        wrench=wrench,
        load_mass=mass,
        markers=_markers(manifest),
        points=np.stack([p for p in points if p is not None], axis=1)
        if points
        else None,
        spread=_spread(manifest, values),
        commanded=_per_axis(values, layout.axes, "cmd_deg"),
        link_posture=_per_axis(values, layout.axes, "link_deg"),
        axis_torque=_per_axis(values, layout.axes, "tau_nm"),
        temperature=values.get("temperature_c"),
        frames=values["frames"].astype(np.int64) if "frames" in values else None,
        base_from_tracker=_base_from_tracker(manifest),
        tracker=tracker,
        wrench_sensor=_wrench_sensor(manifest),
        encoder_repeatability=np.deg2rad(sensors.encoder.repeatability_deg).item()
        if sensors.encoder
        else None,
        torque_accuracy=sensors.torque.accuracy_nm if sensors.torque else None,
        tool=Payload(manifest.tool.mass_kg, np.array(manifest.tool.com_mm) / 1e3)
        if manifest.tool
        else None,
        drawing=_drawing(manifest),
        robot=names.name,
        rows=manifest.rows,
        displacement=manifest.displacement,
    )
    if not manifest.pulled:
        return recording, notes
    many = len(recording.time)
    notes.append(f"{many} pulled poses, each with its unloaded reading of zero.")
    return _with_zeros(recording), notes


def _drawing(manifest: Manifest) -> DrawingAccuracy:
    stated = manifest.model
    in_si = {
        "length": (stated.length_mm, 1e-3),
        "angle": (stated.angle_deg, np.pi / 180.0),
        "offset": (stated.offset_deg, np.pi / 180.0),
        "mass_ratio": (stated.mass_ratio, 1.0),
    }
    return DrawingAccuracy(
        **{name: x * unit for name, (x, unit) in in_si.items() if x is not None}
    )


def _with_zeros(pulled: Recording) -> Recording:
    """Put before each row the unloaded reading that is zero by definition.

    Both rows have the time of the one that was read: when the rope was slack, nobody
    said, and time may not run backwards.
    """
    rows = np.repeat(np.arange(len(pulled.time)), 2)
    zero = np.arange(len(rows)) % 2 == 0
    twice = pulled.take(rows)

    def unloaded(values: np.ndarray | None) -> np.ndarray | None:
        if values is None:
            return None
        values = values.copy()
        values[zero] = np.where(np.isnan(values[zero]), np.nan, 0.0)
        return values

    return replace(
        twice,
        visit=rows,
        load_time=twice.time,
        stage=np.where(zero, UNLOADED, LOADED).astype("<U9"),
        wrench=unloaded(twice.wrench),
        load_mass=unloaded(twice.load_mass),
        points=unloaded(twice.points),
        displacement="relative",
    )


def _wrench(values: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Return the wrench, a pure force where no torque was read."""
    force, torque = _stacked(values, WRENCH[:3]), _stacked(values, WRENCH[3:])
    if force is None or torque is not None:
        return _stacked(values, WRENCH)
    return np.hstack([force, np.zeros_like(force)])


def _stacked(values: Mapping[str, np.ndarray], names) -> np.ndarray | None:
    if any(name not in values for name in names):
        return None
    return np.stack([values[name] for name in names], axis=1)


def _per_axis(
    values: Mapping[str, np.ndarray], axes: int, end: str
) -> np.ndarray | None:
    names = [f"a{k}_{end}" for k in range(1, axes + 1)]
    if not any(name in values for name in names):
        return None
    unmeasured = np.full(len(values["pose"]), np.nan)
    return np.stack([values.get(name, unmeasured) for name in names], axis=1)


def _load(
    manifest: Manifest,
    visit: np.ndarray,
    mass: np.ndarray | None,
    wrench: np.ndarray | None,
) -> tuple[np.ndarray | None, float]:
    """Return the size of the load in each row, and the threshold of a change."""
    if mass is not None:
        return mass, 0.0
    sensor = manifest.sensors.wrench
    if wrench is None or sensor is None:
        return None, 0.0
    force = wrench[:, :3]
    if sensor.includes_tool_weight:  # a visit begins unloaded where nothing says more
        _, first, where = np.unique(visit, return_index=True, return_inverse=True)
        force = force - force[first][where]
    size = np.linalg.norm(force, axis=1)
    return size, max(STEP * float(np.max(size)), 3.0 * sensor.accuracy_n)


def _markers(manifest: Manifest) -> tuple[Marker, ...]:
    return tuple(
        Marker(
            name,
            m.body,
            None if m.position_mm is None else np.array(m.position_mm) / 1e3,
            m.target,
        )
        for name, m in manifest.markers.items()
    )


def _tracker(
    manifest: Manifest, values: Mapping[str, np.ndarray]
) -> tuple[TrackerSpec | None, list[str]]:
    """Return the tracker's noise: that of its readings, else what it states.

    Raises:
        Unusable: Where the readings' own spread is zero throughout.
    """
    stated = manifest.sensors.tracker
    volumetric = None if stated is None else stated.volumetric_mm
    volumetric = None if volumetric is None else volumetric / 1e3
    marked = [[m + c for c in COORDINATES] for m in manifest.markers]
    pairs = [
        (_stacked(values, seen), _stacked(values, spread_of(m)))
        for m, seen in zip(manifest.markers, marked, strict=True)
    ]
    spreads = [
        np.where(np.isfinite(points), spread, np.nan)
        for points, spread in pairs
        if points is not None and spread is not None
    ]
    each = np.concatenate([*spreads, np.zeros((0, 3))])
    if "frames" in values:  # the tracker's own noise is that of one frame
        each *= np.sqrt(np.tile(values["frames"], len(spreads)))[:, None]
    if spreads and np.isfinite(each).any(axis=0).all():
        sigma = np.sqrt(np.nanmean(each**2, axis=0))
        if not np.all(sigma > 0.0):
            say = "the spreads of readings (`_std` columns) are all 0; leave them out"
            raise Unusable("Recording", [f"{say}."])
        shown = ", ".join(f"{1e3 * s:.4g}" for s in sigma)
        note = (
            f"tracker's noise from the readings' own spreads (`_std` columns): {shown} "
        )
        note += "mm in x, y, z, the root mean square; each reading counts by its own."
        return TrackerSpec(sigma, volumetric), [note]
    if stated is None or stated.repeatability_mm is None:
        if spreads:
            raise Unusable("Recording", ["the `_std` columns hold no number."])
        if not manifest.markers:
            return None, []
        sigma = np.full(3, ASSUMED)
        return TrackerSpec(sigma, volumetric, is_stated=False), []
    sigma = np.broadcast_to(np.array(stated.repeatability_mm) / 1e3, 3).copy()
    return TrackerSpec(sigma, volumetric), []


def _spread(manifest: Manifest, values: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Return one sigma of each reading, (rows, markers, 3) in m; None without."""
    each = [_stacked(values, spread_of(m)) for m in manifest.markers]
    if all(spread is None for spread in each):
        return None
    unknown = np.full((len(values["pose"]), 3), np.nan)
    return np.stack([unknown if s is None else s for s in each], axis=1)


def _wrench_sensor(manifest: Manifest) -> WrenchSpec | None:
    stated = manifest.sensors.wrench
    if stated is None:
        return None
    return WrenchSpec(
        accuracy_force=stated.accuracy_n,
        accuracy_torque=stated.accuracy_nm or 0.0,
        body=stated.body,
        position=np.array(stated.position_mm) / 1e3,
        quaternion_wxyz=unit_quaternion(np.array(stated.quaternion_wxyz)),
        frame=stated.frame,
        includes_tool_weight=stated.includes_tool_weight,
    )


def _base_from_tracker(manifest: Manifest) -> np.ndarray | None:
    stated = manifest.frames.tracker
    if stated is None:
        return None
    turn = matrix_of(unit_quaternion(np.array(stated.quaternion_wxyz)))
    return transform_of(turn, np.array(stated.position_mm) / 1e3)


# --- Writing as text ------------------------------------------------------------------


def samples_table(recording: Recording, path: Path) -> None:
    """Return the samples as CSV, in the shortest digits that read back the same."""
    columns = _columns(recording)
    with path.open("wb") as file:
        header = io.StringIO()
        csv.writer(header, lineterminator="\n").writerow(columns)
        file.write(header.getvalue().encode())
        plain = pa_csv.WriteOptions(include_header=False, quoting_style="none")
        pa_csv.write_csv(pa.table(columns), file, plain)


def _columns(recording: Recording) -> dict[str, pa.Array]:
    r = recording
    columns: dict[str, np.ndarray] = {
        "time_s": r.time,
        "load_time_s": r.load_time,
        "pose": r.posture_id,
        "visit": r.visit,
        "stage": r.stage.astype(str),
    }
    for k, posture in enumerate(r.posture.T, start=1):
        slides = bool(r.slides) and r.slides[k - 1]
        unit = MILLIMETRE if slides else DEGREE
        columns[f"a{k}_mm" if slides else f"a{k}_deg"] = unit.outward(posture)
    if r.wrench is not None:
        columns |= dict(zip(WRENCH, r.wrench.T, strict=True))
    for name, column in (
        ("load_kg", r.load_mass),
        ("temperature_c", r.temperature),
        ("frames", r.frames),
    ):
        if column is not None:
            columns[name] = column
    for end, unit, rows in (
        ("cmd_deg", DEGREE, r.commanded),
        ("link_deg", DEGREE, r.link_posture),
        ("tau_nm", None, r.axis_torque),
    ):
        for k, column in enumerate(() if rows is None else rows.T, start=1):
            if not np.all(np.isnan(column)):
                columns[f"a{k}_{end}"] = unit.outward(column) if unit else column
    if r.points is not None:
        for m, marker in enumerate(r.markers):
            for axis, end in enumerate(COORDINATES):
                point = MILLIMETRE.outward(r.points[:, m, axis])
                columns[marker.name + end] = point
            if r.spread is not None and not np.all(np.isnan(r.spread[:, m])):
                sigma = MILLIMETRE.outward(r.spread[:, m].T)
                columns |= dict(zip(spread_of(marker.name), sigma, strict=True))
    return {name: _array(column) for name, column in columns.items()}


def _array(column: np.ndarray) -> pa.Array:
    """Return an array as text, with blanks for missing values."""
    if column.dtype.kind != "f":
        return pa.array(column)
    return pa.array(column, mask=np.isnan(column))


def manifest_text(recording: Recording) -> str:
    """Return the manifest as text."""
    sections = _sections(recording)
    return "\n\n".join("\n".join(_lines(*one)) for one in sections.items()) + "\n"


Section = Mapping[str, object]
"""Entries of a part of the manifest; those that are None are not written."""


def _sections(r: Recording) -> dict[str, Section]:
    named = bool(r.axes or r.bodies)
    robot = r.robot or None
    every: dict[str, Section | None] = {
        "": {
            "format": 1,
            "name": r.name,
            "robot": None if named else robot,
            "rows": r.rows,
            "displacement": r.displacement,
        },
        "robot": {"name": robot, "axes": r.axes or None} if named else None,
        "robot.bodies": {toml_text(k): v for k, v in r.bodies.items()} or None,
        **_sensors(r),
        "tool": r.tool
        and {"mass_kg": float(r.tool.mass), "com_mm": MILLIMETRE.outward(r.tool.com)},
    }
    if r.drawing != DrawingAccuracy():
        every["model"] = {
            "length_mm": r.drawing.length * 1e3,
            "angle_deg": np.degrees(r.drawing.angle),
            "offset_deg": np.degrees(r.drawing.offset),
            "mass_ratio": r.drawing.mass_ratio,
        }
    if (frame := r.base_from_tracker) is not None:
        every["frames.tracker"] = {
            "position_mm": MILLIMETRE.outward(frame[:3, 3]),
            "quaternion_wxyz": quaternion_of(frame[:3, :3]),
        }
    for m in r.markers:
        place = None if m.position is None else MILLIMETRE.outward(m.position)
        entries = {"body": m.body, "position_mm": place, "target": m.target}
        every[f"markers.{toml_text(m.name)}"] = entries
    return {name: entries for name, entries in every.items() if entries is not None}


def _sensors(r: Recording) -> dict[str, Section | None]:
    found: dict[str, Section | None] = {}
    if (tracker := r.tracker) is not None:
        sigma, more = MILLIMETRE.outward(tracker.repeatability), tracker.volumetric
        found["sensors.tracker"] = {
            "repeatability_mm": sigma if tracker.is_stated else None,
            "volumetric_mm": None if more is None else more * 1e3,
        }
    if (sensor := r.wrench_sensor) is not None:
        found["sensors.wrench"] = {
            "accuracy_n": float(sensor.accuracy_force),
            "accuracy_nm": float(sensor.accuracy_torque),
            "body": sensor.body,
            "position_mm": MILLIMETRE.outward(sensor.position),
            "quaternion_wxyz": sensor.quaternion_wxyz,
            "frame": sensor.frame,
            "includes_tool_weight": sensor.includes_tool_weight,
        }
    if (sigma := r.encoder_repeatability) is not None:
        (degrees,) = DEGREE.outward(np.array([sigma]))
        found["sensors.encoder"] = {"repeatability_deg": degrees}
    if (sigma := r.torque_accuracy) is not None:
        found["sensors.torque"] = {"accuracy_nm": float(sigma)}
    return found


def _lines(name: str, entries: Section) -> list[str]:
    written = [f"{k} = {_value(v)}" for k, v in entries.items() if v is not None]
    return [f"[{name}]", *written] if name else written


def _value(value: object) -> str:
    """Write a value in TOML."""
    if isinstance(value, str | bool):
        return toml_text(value)
    if isinstance(value, np.ndarray | np.generic):
        value = value.astype(float).tolist()
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_value, value))}]"
    return repr(value)


# --- Quaternions ----------------------------------------------------------------------

_NORM_ROUNDING = 1e-14
MAX_ROUNDS = 200
"""Maximum number of rounds; in trials of 4,000 rotations ten were the most."""


def unit_quaternion(wxyz: Float[np.ndarray, "4"]) -> Float[np.ndarray, "4"]:
    """Return a quaternion of norm one; unchanged where it has that up to rounding."""
    norm = float(np.linalg.norm(wxyz))
    return wxyz if abs(norm - 1.0) < _NORM_ROUNDING else wxyz / norm


def matrix_of(wxyz: Float[np.ndarray, "4"]) -> Float[np.ndarray, "3 3"]:
    """Return the rotation matrix of a quaternion."""
    return Rotation.from_quat(np.roll(wxyz, -1)).as_matrix()


def quaternion_of(matrix: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "4"]:
    """Return the quaternion that does not change when written and read again.

    Rounding moves a quaternion by a few units in the last place each time it goes
    through its matrix, until it comes back to itself; the least of those it then
    comes back to is returned.
    """
    seen: list[tuple[float, ...]] = []
    found = _undrifted(matrix)
    while found not in seen and len(seen) < MAX_ROUNDS:
        seen.append(found)
        found = _undrifted(matrix_of(np.array(found)))
    start = seen.index(found) if found in seen else 0
    return np.array(min(seen[start:]))


def _undrifted(matrix: Float[np.ndarray, "3 3"]) -> tuple[float, ...]:
    """Return the quaternion of a matrix, corrected for the drift of one more round.

    Small turns and turns by nearly half a circle otherwise move by the same few 1e-19
    in every round, for a hundred thousand rounds and more.
    """
    once = np.array(_raw(matrix))
    again = np.array(_raw(matrix_of(once)))
    return tuple((2.0 * once - again).tolist())


def _raw(matrix: Float[np.ndarray, "3 3"]) -> tuple[float, ...]:
    xyzw = Rotation.from_matrix(matrix).as_quat(canonical=True)
    return tuple(float(x) for x in np.roll(xyzw, 1))
