"""Reads the topics of a ROS 2 bag, each with a clock of its own, as columns of a CSV.

Messages are read by the definitions that rosbags brings, never by those in the bag.
"""

import importlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bench.shared.errors import BenchError, Unusable, refuse
from bench.shared.format.columns import WRENCH
from bench.shared.format.faults import first_line
from bench.shared.models import ModelFacts
from scenarios.pipelines.importing.clocks import (
    Channel,
    Lag,
    lag_between,
    on_one_side,
    rows_of,
)
from scenarios.pipelines.importing.mapping import Extras, Topics

# --- Topics and columns ---------------------------------------------------------------

KNOWN = {
    "sensor_msgs/msg/JointState": "joints",
    "geometry_msgs/msg/WrenchStamped": "wrench",
    "geometry_msgs/msg/PoseStamped": "pose",
    "geometry_msgs/msg/PointStamped": "point",
}
FILES = (".mcap", ".db3")
"""How a bag ends that is one file."""
MISSING = "ROS 2 bags need rosbags, which is not installed: pip install '.[ros]'."


def columns_of(
    path: Path, topics: Topics, axes: Sequence[str]
) -> tuple[dict[str, np.ndarray], dict[str, Lag | None]]:
    """Read a bag as columns on the joints' clock, and the lags between its channels.

    The bag is a folder or its only file; a pose NAME becomes columns NAME.x … NAME.qz;
    without axes, joints count in their order.

    Raises:
        BenchError: Where rosbags is not installed.
        Unusable: With every topic that is missing or of another kind.
    """
    wanted = {"joints": topics.joints}
    wanted |= {"wrench": topics.wrench} if topics.wrench else {}
    wanted |= {f"pose {name}": topic for name, topic in topics.poses.items()}
    channels = _read_channels(path, wanted, axes)
    joints = channels["joints"]
    columns: dict[str, np.ndarray] = {"time_s": joints.time - joints.time[0]}
    columns["pose"] = np.zeros(len(joints.time))
    for k, angle in enumerate(joints.values.T, start=1):
        columns[f"a{k}"] = angle
    lags: dict[str, Lag | None] = {}
    covered = np.full(len(joints.time), True)
    stamps = []
    for name, channel in channels.items():
        if name == "joints":
            continue
        lags[name] = lag_between(
            joints.time, joints.values, channel.time, channel.values[:, :3]
        )
        kind, values = WRENCH, channel.at(joints.time)
        if name.startswith("pose "):
            kind = [f"{name[5:]}.{c}" for c in ("x", "y", "z", "qw", "qx", "qy", "qz")]
            stamps.append(channel.time)
            turns = Channel(channel.time, on_one_side(channel.values[:, 3:]))
            values = np.hstack([values[:, :3], turns.at(joints.time)])
        columns |= zip(kind, values.T, strict=False)
        covered &= channel.covers(joints.time, topics.gap_s)
    whole = covered & np.all([np.isfinite(c) for c in columns.values()], axis=0)
    near = rows_of(joints.time, stamps)
    rows = near[whole[near]]
    if not len(rows):
        gap = f"{topics.gap_s:g} s (gap_s)"
        fault = f"its topics share no time, or one is silent for longer than {gap}."
        raise Unusable(f"Bag {str(path)!r}", [fault])
    return {name: column[rows] for name, column in columns.items()}, lags


def text_of(columns: Mapping[str, np.ndarray]) -> bytes:
    """Write columns as CSV."""
    lines = [",".join(columns)]
    for row in zip(*columns.values(), strict=True):
        lines.append(",".join(repr(float(v)) for v in row))
    return "\n".join(lines).encode()


def _read_channels(
    path: Path, wanted: Mapping[str, str], axes: Sequence[str]
) -> dict[str, Channel]:
    try:
        bags: Any = importlib.import_module("rosbags.rosbag2")
        types: Any = importlib.import_module("rosbags.typesys")
    except ImportError:
        raise BenchError(MISSING) from None
    what, faults = f"Bag {str(path)!r}", []
    store = types.get_typestore(types.Stores.ROS2_HUMBLE)
    times: dict[str, list[float]] = {name: [] for name in wanted}
    rows: dict[str, list[np.ndarray]] = {name: [] for name in wanted}
    try:
        with bags.Reader(path) as reader:
            there = {c.topic: c for c in reader.connections}
            chosen = {}
            for name, topic in wanted.items():
                if topic not in there:
                    known = ", ".join(sorted(there))
                    faults.append(f"no topic {topic!r}; there are: {known}.")
                elif there[topic].msgtype not in KNOWN:
                    kind = there[topic].msgtype
                    faults.append(
                        f"topic {topic!r} is {kind}; use: {', '.join(KNOWN)}."
                    )
                else:
                    chosen[topic] = name
            refuse(what, faults)
            some = [there[topic] for topic in chosen]
            for connection, stamp, raw in reader.messages(connections=some):
                message = store.deserialize_cdr(raw, connection.msgtype)
                name = chosen[connection.topic]
                head = message.header.stamp
                own = head.sec + 1e-9 * head.nanosec
                times[name].append(own if own > 0 else 1e-9 * stamp)
                rows[name].append(_values(message, KNOWN[connection.msgtype], axes))
    except BenchError:
        raise
    except Exception as error:  # foreign bytes make their parser raise anything
        raise Unusable(what, [f"it cannot be read: {first_line(error)}."]) from None
    faults += [f"topic {wanted[n]!r} is empty." for n, t in times.items() if not t]
    refuse(what, faults)
    return {name: _in_order(times[name], rows[name]) for name in wanted}


def _in_order(times: list[float], rows: list[np.ndarray]) -> Channel:
    order = np.argsort(times, kind="stable")
    return Channel(np.array(times)[order], np.stack(rows)[order])


def _values(message: Any, kind: str, axes: Sequence[str]) -> np.ndarray:
    if kind == "joints":
        by_name = dict(zip(message.name, message.position, strict=False))
        missing = [name for name in axes if name not in by_name]
        if missing:
            fault = (
                f"no joint {', '.join(map(repr, missing))} is told; there are: "
                f"{', '.join(by_name)}. Say in [topics] joint_names which is a1, a2 …"
            )
            raise Unusable("The joints' topic", [fault])
        return np.array([by_name[name] for name in (axes or list(by_name))])
    if kind == "wrench":
        w = message.wrench
        parts = (w.force.x, w.force.y, w.force.z, w.torque.x, w.torque.y, w.torque.z)
        return np.array(parts)
    if kind == "point":
        return np.array([message.point.x, message.point.y, message.point.z])
    p, q = message.pose.position, message.pose.orientation
    return np.array([p.x, p.y, p.z, q.w, q.x, q.y, q.z])


# --- The bag as a CSV file with its manifest ------------------------------------------


def bag_as_csv(
    path: Path, manifest: dict, extras: Extras, model: ModelFacts | None
) -> tuple[bytes, dict, dict[str, Lag | None]]:
    """Turn a bag into a CSV and a manifest that reads it."""
    if extras.topics is None:
        raise Unusable(f"Bag {str(path)!r}", ["the mapping has no [topics]."])
    robot = manifest.get("robot")
    axes = robot.get("axes", ()) if isinstance(robot, dict) else ()
    own = tuple(axes) or (model.axes if model else ())
    axes = extras.topics.joint_names or own
    columns, lags = columns_of(path, extras.topics, axes)
    slides = dict(zip(model.joints, model.slides, strict=True)) if model else {}
    said = dict(manifest.get("columns", {}))
    for k in range(1, sum(n[:1] == "a" and n[1:].isdigit() for n in columns) + 1):
        slide = bool(axes) and slides.get(axes[k - 1], False)
        unit = "m" if slide else "rad"
        said.setdefault(
            f"a{k}_{'mm' if slide else 'deg'}", {"from": f"a{k}", "unit": unit}
        )
    for name in extras.topics.poses:
        if name in manifest.get("markers", {}):
            for c in "xyz":
                said.setdefault(f"{name}_{c}_mm", {"from": f"{name}.{c}", "unit": "m"})
    return text_of(columns), {**manifest, "columns": said}, lags
