"""A recording becomes text that reads back as the same numbers; truth has no column."""

import csv
import io
import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv

from bench.format.columns import COORDINATES, DEGREE, MILLIMETRE, WRENCH
from bench.recording import Recording
from bench.turn import quaternion_of


def samples_table(recording: Recording, path: Path) -> None:
    """Write the samples as CSV, in the shortest digits that read back the same."""
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
        "pose": r.pose,
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
    return {name: _array(column) for name, column in columns.items()}


def _array(column: np.ndarray) -> pa.Array:
    """Write what was not seen as a blank."""
    if column.dtype.kind != "f":
        return pa.array(column)
    return pa.array(column, mask=np.isnan(column))


def manifest_text(recording: Recording) -> str:
    """Write the manifest."""
    r = recording
    robot = r.robot and not (r.axes or r.bodies)
    lines = [
        "format = 1",
        f"name = {_text(r.name)}",
        *([f"robot = {_text(r.robot)}"] if robot else []),
        f"rows = {_text(r.rows)}",
        f"displacement = {_text(r.displacement)}",
    ]
    if r.axes or r.bodies:
        named = {"name": _text(r.robot)} if r.robot else {}
        axes = {"axes": f"[{', '.join(map(_text, r.axes))}]"} if r.axes else {}
        lines += _section("robot", {**named, **axes})
        if r.bodies:
            bodies = {_text(k): _text(v) for k, v in r.bodies.items()}
            lines += _section("robot.bodies", bodies)
    lines += _sensors(r)
    if r.tool is not None:
        entries = {"mass_kg": _number(r.tool.mass), "com_mm": _millimetres(r.tool.com)}
        lines += _section("tool", entries)
    if r.base_from_tracker is not None:
        entries = {
            "position_mm": _millimetres(r.base_from_tracker[:3, 3]),
            "quaternion_wxyz": _list(quaternion_of(r.base_from_tracker[:3, :3])),
        }
        lines += _section("frames.tracker", entries)
    for marker in r.markers:
        entries = {"body": _text(marker.body)}
        if marker.position is not None:
            entries["position_mm"] = _millimetres(marker.position)
        if marker.target is not None:
            entries["target"] = _text(marker.target)
        lines += _section(f"markers.{_text(marker.name)}", entries)
    return "\n".join(lines) + "\n"


def _sensors(r: Recording) -> list[str]:
    lines = []
    if r.tracker is not None:
        entries = {"repeatability_mm": _millimetres(r.tracker.repeatability)}
        if r.tracker.volumetric is not None:
            entries["volumetric_mm"] = _number(r.tracker.volumetric * 1e3)
        lines += _section("sensors.tracker", entries)
    if (sensor := r.wrench_sensor) is not None:
        entries = {
            "accuracy_n": _number(sensor.accuracy_force),
            "accuracy_nm": _number(sensor.accuracy_torque),
            "body": _text(sensor.body),
            "position_mm": _millimetres(sensor.position),
            "quaternion_wxyz": _list(sensor.quaternion_wxyz),
            "frame": _text(sensor.frame),
            "includes_tool_weight": str(sensor.includes_tool_weight).lower(),
        }
        lines += _section("sensors.wrench", entries)
    if r.encoder_repeatability is not None:
        degrees = float(DEGREE.outward(np.array([r.encoder_repeatability]))[0])
        entries = {"repeatability_deg": _number(degrees)}
        lines += _section("sensors.encoder", entries)
    if r.torque_accuracy is not None:
        entries = {"accuracy_nm": _number(r.torque_accuracy)}
        lines += _section("sensors.torque", entries)
    return lines


def _section(name: str, entries: dict[str, str]) -> list[str]:
    return ["", f"[{name}]", *(f"{key} = {value}" for key, value in entries.items())]


def _text(value: str) -> str:
    """Quote as TOML does: as JSON, but for two letters that JSON lets pass."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _number(value: float) -> str:
    return repr(float(value))


def _list(values: np.ndarray) -> str:
    return f"[{', '.join(_number(v) for v in values)}]"


def _millimetres(metres: np.ndarray) -> str:
    return _list(MILLIMETRE.outward(metres))
