"""A mapping takes a further CSV's columns by NAME.column, for markers or a wrench."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from bench.format.columns import COORDINATES, COUNT, WORD, WRENCH, column_of
from scenarios.importing.mapping import Extras
from scenarios.importing.spreadsheet import columns_of


@dataclass(frozen=True)
class Wanted:
    """What a mapping takes from a file.

    Attributes:
        columns: Which may be blank, by their names there.
        groups: Names of what sees one motion, best first: a marker, a target, a force.
        tracked: Whether markers or targets are among them.
    """

    columns: Mapping[str, bool]
    groups: tuple[tuple[str, ...], ...]
    tracked: bool


def wanted_of(
    name: str, manifest: Mapping[str, Any], extras: Extras
) -> tuple[Wanted, list[str]]:
    """Find which columns a mapping takes from a file, and what it may not take."""
    columns: dict[str, bool] = {}
    markers: dict[str, list[str]] = {}
    others: dict[str, list[str]] = {}
    faults = []
    start = f"{name}."
    for said, entry in manifest.get("columns", {}).items():
        source = entry.get("from") if isinstance(entry, dict) else entry
        if not isinstance(source, str) or not source.startswith(start):
            continue
        column = column_of(said, manifest.get("markers", {}))
        if column is None:
            continue  # the format's reader says why
        turns = column.axis > 0 and said.endswith(("_deg", "_mm"))
        own = turns and not said.endswith("_link_deg")
        if own or column.kind in (COUNT, WORD, "time"):
            faults.append(
                f"columns.{said}: {source!r} cannot come from [files.{name}]; the axes,"
                " their time, counts and words stand in FILE itself."
            )
            continue
        own_name = source.removeprefix(start)
        columns[own_name] = column.may_be_blank
        if said.endswith(COORDINATES):
            markers.setdefault(said[:-5], []).append(own_name)
        elif said in WRENCH[:3] or column.axis:
            others.setdefault(said[:1] + said[-3:], []).append(own_name)
    for target in extras.targets.values():
        own = [c.removeprefix(start) for c in columns_of(target) if c.startswith(start)]
        columns |= dict.fromkeys(own, True)
        if all(c.startswith(start) for c in target.position):
            markers[f"target {target.position}"] = own[:3]
    if not columns and not faults:
        say = f'no column is taken from it; write from = "{name}.COLUMN".'
        faults.append(f"files.{name}: {say}")
    groups = tuple(tuple(g) for g in (*markers.values(), *others.values()))
    return Wanted(columns, groups, bool(markers)), faults
