"""The mapping of a lab's own file: a manifest that also says what its columns are.

A mapping is a manifest that also says how a lab's own file is to be understood.

It is `recording.toml` of the format, with `[columns]`, `[csv]` and beyond them
`[targets.NAME]` (6D), `[rests]` (a stream becomes plateaus), `[files.NAME]` (more CSV
files, each with a clock of its own) and `[topics]` (bags).
"""

import json
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Struct, field

from bench.shared.errors import Unusable
from bench.shared.format.faults import first_line
from bench.shared.format.manifest import Source, fill, twice
from scenarios.pipelines.importing.clocks import GAP

# --- Mapping --------------------------------------------------------------------------

MAX_BYTES = 2**20
"""Bytes of a mapping that are still read; chosen: as for a manifest."""
TABLES = ("columns", "csv", "markers")
"""Parts of the manifest that are looked into before the format's reader does."""
Above = Annotated[float, msgspec.Meta(gt=0.0)]
Triple = tuple[str, str, str]


class Target(Struct, frozen=True, forbid_unknown_fields=True):
    """`[targets.NAME]`: a target that is measured in 6D, written as four markers."""

    body: str
    position: Triple
    rotation: Triple | None = None
    quaternion_wxyz: tuple[str, str, str, str] | None = None
    order: Literal["xyz", "XYZ", "zyx", "ZYX"] = "ZYX"
    length_unit: Literal["mm", "m"] = "mm"
    angle_unit: Literal["deg", "rad"] = "deg"
    arm_mm: Above = 100.0


class Standstills(Struct, frozen=True, forbid_unknown_fields=True):
    """`[rests]`: where a stream stands still it becomes a plateau."""

    speed_deg_per_s: Above
    hold_s: Above
    speed_mm_per_s: Above = 1.0
    load_step_n: Above = 5.0
    same_pose_deg: Above = 0.05


class Topics(Struct, frozen=True, forbid_unknown_fields=True):
    """`[topics]`: which message is which."""

    joints: str = "/joint_states"
    joint_names: tuple[str, ...] = ()
    wrench: str | None = None
    poses: dict[str, str] = field(default_factory=dict)
    gap_s: Above = GAP


class Log(Struct, frozen=True, forbid_unknown_fields=True):
    """`[files.NAME]`: a CSV by a clock of its own, whose columns are NAME.column."""

    file: str
    time: str | Source
    offset_s: float | None = None
    clock: str | None = None
    separator: str | None = None
    decimal: str | None = None
    gap_s: Above = GAP


class Extras(Struct, frozen=True, forbid_unknown_fields=True):
    """All that goes beyond the format's own manifest."""

    targets: dict[str, Target] = field(default_factory=dict)
    rests: Standstills | None = None
    topics: Topics | None = None
    files: dict[str, Log] = field(default_factory=dict)


def mapping_of(path: Path) -> tuple[dict[str, Any], Extras]:
    """Read a mapping.

    Returns:
        What the format's manifest says, as a table; and the rest.

    Raises:
        Unusable: With all faults of what goes beyond the manifest.
    """
    what = f"Mapping {str(path)!r}"
    if not path.is_file():
        raise Unusable(what, ["there is no such file; give a TOML file."])
    if path.stat().st_size > MAX_BYTES:
        raise Unusable(what, [f"it has more than {MAX_BYTES} bytes."])
    text = path.read_bytes()
    try:
        table = tomllib.loads(text.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        more = twice(text.decode(errors="replace"))
        raise Unusable(what, [f"it is not TOML: {first_line(error)}.{more}"]) from None
    beyond = {n: table.pop(n) for n in Extras.__struct_fields__ if n in table}
    extras, faults = fill(Extras, beyond, "")
    for name, target in (extras.targets if extras else {}).items():
        if (target.rotation is None) == (target.quaternion_wxyz is None):
            say = "give either rotation (three angles) or quaternion_wxyz"
            faults.append(f"targets.{name}: {say}.")
    faults += _clocks(extras.files if extras else {})
    for name in TABLES:
        if not isinstance(table.get(name, {}), dict):
            faults.append(f"{name}: expected a table, [{name}] and its entries below.")
    if faults or extras is None:
        raise Unusable(what, faults)
    return table, extras


def _clocks(files: Mapping[str, Log]) -> list[str]:
    faults = []
    for name, log in files.items():
        place = f"files.{name}"
        if "." in name:
            say = "its columns are NAME.column; take a name with no dot"
            faults.append(f"{place}: {say}.")
        if log.offset_s is not None and log.clock is not None:
            faults.append(f"{place}: give offset_s or clock, not both.")
        if log.offset_s is not None and not abs(log.offset_s) < np.inf:
            faults.append(f"{place}.offset_s: not a finite number.")
        own = [n for n, other in files.items() if other.clock is None]
        if log.clock is not None and log.clock not in own:
            known = ", ".join(own) or "none"
            say = f"no file with a clock of its own is called so; there are: {known}."
            faults.append(f"{place}.clock: {say}")
    return faults


def text_of(table: Mapping[str, Any], name: str = "") -> str:
    """Write a table as TOML."""
    lines = [f"\n[{name}]"] if name else []
    inner = []
    for key, value in table.items():
        quoted = json.dumps(key)
        if isinstance(value, dict):
            inner.append(text_of(value, f"{name}.{quoted}" if name else quoted))
        else:
            lines.append(f"{quoted} = {_value(value)}")
    return "\n".join([*lines, *inner])


def _value(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, dict):
        entries = ", ".join(f"{json.dumps(k)} = {_value(v)}" for k, v in value.items())
        return f"{{{entries}}}"
    if isinstance(value, (bool, str)):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(value) if isinstance(value, (int, float)) else json.dumps(str(value))


# --- The bag as a CSV file with its manifest ------------------------------------------


def contradictions(extras: Extras, rows: str, in_bag: bool) -> Iterator[str]:
    """Say which parts of a mapping do not go together."""
    if extras.rests and rows != "stream":
        yield '[rests] turns a stream into plateaus: say rows = "stream".'
    if extras.files and rows != "stream":
        yield '[files] are joined instant by instant: say rows = "stream".'
    if extras.files and in_bag:
        yield "[files] go with a CSV; a bag has [topics]."
