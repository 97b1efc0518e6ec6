"""The mapping of a lab's own file: a manifest that also says what its columns are.

It is `recording.toml` of the format, with `[columns]`, `[csv]` and beyond them
`[targets.NAME]` (6D), `[rests]` (a stream becomes plateaus), `[files.NAME]` (more CSV
files, each with a clock of its own) and `[topics]` (bags).
"""

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Struct, field

from bench.shared.errors import Unusable
from bench.shared.format.faults import first_line, nearest_of, quoted
from bench.shared.format.manifest import ROW_RULES, Manifest, Source, fill, twice
from scenarios.pipelines.importing.clocks import GAP

MAX_BYTES = 2**20
"""Bytes of a mapping that are still read; chosen: as for a manifest."""
TABLES = ("columns", "csv", "markers")
"""Parts of the manifest without which nobody knows what the samples should be."""
SECTIONS = (
    *("columns", "csv", "markers", "sensors", "tool", "frames", "robot"),
    *("targets", "rests", "topics", "files"),
)
"""Parts of a mapping that have entries of their own."""
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
    """`[files.NAME]`: a further CSV, whose columns are NAME.column.

    It has a clock of its own, or is joined row by row.
    """

    file: str
    join: Literal["clock", "rows"] = "clock"
    time: str | Source | None = None
    offset_s: float | None = None
    clock: str | None = None
    separator: str | None = None
    decimal: str | None = None
    encoding: str | None = None
    skip_rows: int | tuple[int, ...] = 0
    gap_s: Above = GAP


class Extras(Struct, frozen=True, forbid_unknown_fields=True):
    """All that goes beyond the format's own manifest."""

    targets: dict[str, Target] = field(default_factory=dict)
    rests: Standstills | None = None
    topics: Topics | None = None
    files: dict[str, Log] = field(default_factory=dict)


@dataclass(frozen=True)
class LabMapping:
    """A mapping as far as it can be understood.

    Attributes:
        manifest: What the format's manifest says, as a table.
        faults: Of what goes beyond the manifest.
        tells: Whether it tells what to look for in the samples.
        broken_files: Names of further files that cannot be understood.
    """

    manifest: dict[str, Any]
    extras: Extras
    faults: tuple[str, ...] = ()
    tells: bool = True
    broken_files: tuple[str, ...] = ()


def mapping_of(path: Path) -> LabMapping:
    """Read a mapping; a misspelt key is a fault and taken as it was probably meant.

    Raises:
        Unusable: Where there is no mapping, or it is not TOML.
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
    own = Extras.__struct_fields__
    known = [f.encode_name for f in msgspec.structs.fields(Manifest)]
    table, faults = _spelt(table, [*known, *own])
    beyond = {n: table.pop(n) for n in own if n in table}
    tables = {n for n in own if n in beyond and not isinstance(beyond[n], dict)}
    faults += [_no_table(name) for name in sorted(tables)]
    usable = {n: value for n, value in beyond.items() if n not in tables}
    extras, found = fill(Extras, usable, "")
    faults += found
    targets = extras.targets
    for name, target in extras.targets.items():
        if (target.rotation is None) == (target.quaternion_wxyz is None):
            targets = {n: t for n, t in targets.items() if n != name}
            if not any(f.startswith(f"targets.{name}.") for f in found):
                say = "give either rotation (three angles) or quaternion_wxyz"
                faults.append(f"targets.{name}: {say}.")
    said = beyond.get("files", {})
    names = [*said] if isinstance(said, dict) else []
    unsure = {n for n in names if any(f.startswith(f"files.{n}.") for f in found)}
    joins = {n for n in unsure if any(f.startswith(f"files.{n}.join:") for f in found)}
    whole = {n: log for n, log in extras.files.items() if n not in joins}
    broken = tuple(n for n in names if n not in whole)
    sure = {n: log for n, log in whole.items() if n not in unsure}
    clocks = _clocks(sure, names)
    extras = msgspec.structs.replace(extras, targets=targets, files=whole)
    no_tables = [n for n in TABLES if not isinstance(table.get(n, {}), dict)]
    faults += [*clocks, *map(_no_table, no_tables)]
    tells = not (no_tables or tables)
    return LabMapping(table, extras, tuple(faults), tells, broken)


def _no_table(name: str) -> str:
    return f"{name}: expected a table, [{name}] and its entries below."


def _spelt(
    table: dict[str, Any], known: Sequence[str]
) -> tuple[dict[str, Any], list[str]]:
    """Give each misspelt part of a mapping the name that was probably meant."""
    spelt, faults = {n: v for n, v in table.items() if n in known}, []
    for name, value in table.items():
        if name in known or name in ROW_RULES:
            continue
        meant = nearest_of(name, [n for n in known if n not in table])
        hint = f" Did you mean {meant!r}?" if meant else ""
        say = f"nothing is called so.{hint} Known here: {', '.join(known)}."
        faults.append(f"{quoted(name)[1:-1]}: {say}")
        if meant and isinstance(value, dict) == (meant in SECTIONS):
            spelt.setdefault(meant, value)
    return spelt, faults


def _clocks(files: Mapping[str, Log], known: Sequence[str]) -> list[str]:
    """Name what is wrong with how further files are joined, of all that are known."""
    faults = []
    for name, log in files.items():
        place = f"files.{name}"
        if "." in name:
            say = "its columns are NAME.column; take a name with no dot"
            faults.append(f"{place}: {say}.")
        if log.join == "rows":
            ours = {"time": log.time, "offset_s": log.offset_s, "clock": log.clock}
            if given := [n for n, value in ours.items() if value is not None]:
                say = 'joined row by row (join = "rows") it needs no clock; leave out'
                faults.append(f"{place}: {say} {', '.join(given)}.")
            continue
        if log.time is None:
            say = 'missing; or join = "rows", where row k of both belongs together'
            faults.append(f"{place}.time: {say}.")
        if isinstance(log.time, Source) and not isinstance(log.time.from_, str | None):
            faults.append(f"{place}.time: name one column.")
        if log.offset_s is not None and log.clock is not None:
            faults.append(f"{place}: give offset_s or clock, not both.")
        own = [n for n, other in files.items() if other.clock is None]
        unclear = [n for n in known if n not in files]
        if log.clock is not None and log.clock not in (*own, *unclear):
            there = ", ".join(own) or "none"
            say = f"no file with a clock of its own is called so; there are: {there}."
            faults.append(f"{place}.clock: {say}")
    return faults


def contradictions(extras: Extras, rows: str, in_bag: bool) -> Iterator[str]:
    """Say which parts of a mapping do not go together."""
    if extras.rests and rows == "plateaus":
        yield '[rests] turns a stream into plateaus: say rows = "stream".'
    timed = [f for f in extras.files.values() if f.join == "clock" and f.time]
    if timed and rows == "plateaus":
        say = 'say rows = "stream"; or join = "rows", where row k of all is one reading'
        yield f"[files] are joined instant by instant: {say}."
    if extras.files and in_bag:
        yield "[files] go with a CSV; a bag has [topics]."
