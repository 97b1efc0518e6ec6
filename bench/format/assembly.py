"""Columns and manifest become a recording; what is not in them stays unknown."""

from collections.abc import Mapping

import numpy as np

from bench.errors import Unusable
from bench.format.columns import COORDINATES, WRENCH
from bench.format.course import STEP, load_times_of, stages_of, visits_of
from bench.format.layout import Layout
from bench.format.manifest import FILE, Manifest
from bench.recording import Marker, Payload, Recording
from bench.stated import TrackerSpec, WrenchSpec
from bench.turn import matrix_of, unit_quaternion


def assemble(
    folder: str, manifest: Manifest, layout: Layout, values: Mapping[str, np.ndarray]
) -> Recording:
    """Build the recording of a folder whose columns have no faults.

    Args:
        folder: The folder's name, for a recording that has none.
        manifest: What was measured, with what, in which frames.
        layout: Which columns there are.
        values: The columns in SI.

    Raises:
        Unusable: Where readings have no stated accuracy.
    """
    sensors, names = manifest.sensors, manifest.model_names
    wrench = _stacked(values, WRENCH)
    _refuse_unstated(manifest, wrench is not None)
    pose = values["pose"].astype(np.int64)
    visit = values["visit"].astype(np.int64) if "visit" in values else visits_of(pose)
    mass = values.get("load_kg")
    load, step = _load(manifest, visit, mass, wrench)
    axes = range(1, layout.axes + 1)
    ends = ["mm" if slides else "deg" for slides in layout.slides]
    points = [_stacked(values, [m + c for c in COORDINATES]) for m in manifest.markers]
    return Recording(
        name=manifest.name or folder,
        time=values["time_s"],
        pose=pose,
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
        link_posture=_per_axis(values, layout.axes, "link_deg"),
        axis_torque=_per_axis(values, layout.axes, "tau_nm"),
        temperature=values.get("temperature_c"),
        frames=values["frames"].astype(np.int64) if "frames" in values else None,
        base_from_tracker=_base_from_tracker(manifest),
        tracker=_tracker(manifest),
        wrench_sensor=_wrench_sensor(manifest),
        encoder_repeatability=np.deg2rad(sensors.encoder.repeatability_deg).item()
        if sensors.encoder
        else None,
        torque_accuracy=sensors.torque.accuracy_nm if sensors.torque else None,
        tool=Payload(manifest.tool.mass_kg, np.array(manifest.tool.com_mm) / 1e3)
        if manifest.tool
        else None,
        robot=names.name,
        rows=manifest.rows,
        displacement=manifest.displacement,
    )


def _refuse_unstated(manifest: Manifest, has_wrench: bool) -> None:
    faults = []
    if manifest.markers and manifest.sensors.tracker is None:
        faults.append(f"{FILE}: there are markers but no [sensors.tracker].")
    if has_wrench and manifest.sensors.wrench is None:
        faults.append(f"{FILE}: there is a wrench but no [sensors.wrench].")
    if faults:
        raise Unusable("Recording", faults)


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
    """Return the size of the load in each row, and what counts as a change of it."""
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


def _tracker(manifest: Manifest) -> TrackerSpec | None:
    stated = manifest.sensors.tracker
    if stated is None:
        return None
    sigma = np.broadcast_to(np.array(stated.repeatability_mm) / 1e3, 3).copy()
    volumetric = stated.volumetric_mm
    return TrackerSpec(sigma, None if volumetric is None else volumetric / 1e3)


def _wrench_sensor(manifest: Manifest) -> WrenchSpec | None:
    stated = manifest.sensors.wrench
    if stated is None:
        return None
    return WrenchSpec(
        accuracy_force=stated.accuracy_n,
        accuracy_torque=stated.accuracy_nm,
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
    transform = np.eye(4)
    transform[:3, :3] = matrix_of(unit_quaternion(np.array(stated.quaternion_wxyz)))
    transform[:3, 3] = np.array(stated.position_mm) / 1e3
    return transform
