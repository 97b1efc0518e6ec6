"""What the manifest says of frames, bodies and axes must hold together."""

import math
from collections import defaultdict

import numpy as np

from bench.format.faults import nearest, quoted
from bench.format.manifest import FILE, LARGEST, Manifest, MarkerEntry, Quaternion
from bench.model_facts import ModelFacts

UNIT_WITHIN = 1e-3
"""How far a quaternion's norm may be from one, by the format."""
MARKERS_OF_TARGET = 4
"""A 6D target is written as so many markers, by the format."""


def joints_of(
    manifest: Manifest, model: ModelFacts | None
) -> tuple[tuple[int, ...] | None, list[str]]:
    """Return which joint of the model each axis is; None without a model."""
    if model is None:
        return None, []
    axes = manifest.model_names.axes or model.joints
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
    """Name everything in a manifest that cannot be meant.

    Args:
        manifest: What was measured, with what, in which frames.
        axes: How many axes there are; None where unknown.
        model: Names to check against; None where unknown.
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


def csv_faults(manifest: Manifest) -> list[str]:
    """Name what is wrong with the separator and the decimal mark."""
    separator, mark, faults = manifest.csv.separator, manifest.csv.mark, []
    if len(separator) != 1 or not separator.isascii() or separator in '\r\n"\0':
        say = "one plain character separates cells, such as ',' or ';'"
        faults.append(f"{FILE}, csv.separator: {quoted(separator)}; {say}.")
    if mark not in (".", ","):
        faults.append(f"{FILE}, csv.decimal: {quoted(mark)} is not '.' or ','.")
    if separator == mark:
        faults.append(f"{FILE}, csv: separator and decimal mark are both {mark!r}.")
    if isinstance(manifest.csv.decimal, str) and isinstance(
        manifest.csv.decimal_mark, str
    ):
        faults.append(f"{FILE}, csv: decimal and decimal_mark are the same thing.")
    return faults


def _tracker_faults(manifest: Manifest) -> list[str]:
    tracker = manifest.sensors.tracker
    stated = tracker.repeatability_mm if tracker else 1.0
    if all(0.0 < s <= LARGEST for s in np.ravel(stated)):
        return []
    place = f"{FILE}, sensors.tracker.repeatability_mm"
    say = f"a standard deviation is above 0 and at most {LARGEST:g}"
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
