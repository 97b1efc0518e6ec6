"""Joins further CSV files row by row: the k-th reading of each belongs together.

Rows of units, empty lines and lines that are left out are no readings and do not count.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int

from bench.shared.format.cells import all_values_of
from bench.shared.format.columns import Column, Held, Layout, Unit
from bench.shared.format.faults import Place
from bench.shared.format.folder import LEFT_ALONE
from bench.shared.format.manifest import Csv
from bench.shared.format.readings import readings_of
from bench.shared.format.table import CSV_FILE, Cells, Header, open_csv
from scenarios.pipelines.importing import spreadsheet
from scenarios.pipelines.importing.log_files import (
    header_of,
    in_names_of,
    missing_of,
    required_columns_of,
    unread_of,
)
from scenarios.pipelines.importing.mapping import Extras, Log

_CELL = re.compile(r"line \d+ \(row (\d+) below the header\), column '([^.']+)\.(.*)")
"""How a fault of a cell begins whose column came from another file."""


@dataclass(frozen=True)
class JoinedRows:
    """Columns of further files beside the rows of the first.

    Attributes:
        columns: How many.
        files: What each is called.
        lines: For each row of the first file, from 0, the row of the other one.
    """

    columns: int = 0
    files: Mapping[str, Place] = field(default_factory=dict)
    lines: Mapping[str, Mapping[int, int]] = field(default_factory=dict)

    def in_own_lines(self, fault: str) -> str:
        """Name file and line of a cell as they are where it stands."""
        match = _CELL.search(fault)
        if match is None or match[2] not in self.files:
            return fault
        own = self.lines[match[2]].get(int(match[1]) - 1)
        place = self.files[match[2]]
        row = place.file if own is None else place.row(own)
        return f"{row}, column '{match[3]}"


def with_rows_of(
    source: bytes,
    manifest: Mapping[str, Any],
    extras: Extras,
    files: Mapping[str, Log],
    beside: Path,
) -> tuple[bytes, JoinedRows, list[str], list[str]]:
    """Add the columns of further files to a CSV, row by row.

    Args:
        source: The CSV, as UTF-8.
        manifest: What the format's manifest says of it.
        extras: Whose targets may stand in the further files.
        files: Those that are joined so.
        beside: The folder that they may not leave.

    Returns:
        The CSV with their columns; what was added; notes; and all faults, in the names
        and lines of the files.
    """
    about = spreadsheet.csv_of(manifest)
    first, _ = open_csv(source, about, spreadsheet.names_in(manifest))
    notes: list[str] = []
    faults: list[str] = []
    if first is None or not files:
        return source, JoinedRows(), notes, faults
    rows = _readings(first, [*first.names])
    places, lines, columns = {}, {}, {}
    for name, log in files.items():
        wanted, found = required_columns_of(name, manifest, extras)
        faults += found
        if not wanted.columns:
            continue
        zeros = {f"{name}.{c}": np.zeros(len(rows)) for c in wanted.columns}
        columns |= zeros  # so that a fault here makes none there
        header, found = header_of(name, log, wanted, beside, manifest)
        if header is None:
            faults += found
            continue
        found += missing_of(header, [*wanted.columns])
        notes += [
            f"{log.file}: column {c!r} {LEFT_ALONE}"
            for c in unread_of(header, wanted.columns)
        ]
        own = _readings(header, [*wanted.columns])
        if len(own) != len(rows) and not found:
            found.append(
                f"{CSV_FILE} has {_many(own)} and FILE {_many(rows)}; joined row by "
                "row they must be as many."
            )
        mark = log.decimal or about.mark
        blank = {n: about.skip_incomplete or may for n, may in wanted.columns.items()}
        values, numbers, more = _numbers(header, blank, mark)
        faults += in_names_of(log, [*found, *more])
        if not found:
            at = np.searchsorted(own, numbers)
            for c, column in values.items():
                full = np.full(len(rows), np.nan)
                full[at] = column
                columns[f"{name}.{c}"] = full
            places[name] = Place(log.file, True, above=header.location.above)
            lines[name] = dict(zip(rows.tolist(), own.tolist(), strict=True))
    joined = spreadsheet.with_columns(first, about.mark, columns, rows)
    return joined, JoinedRows(len(columns), places, lines), notes, faults


def _many(rows: Int[np.ndarray, " rows"]) -> str:
    return f"{len(rows)} {'reading' if len(rows) == 1 else 'readings'}"


def _layout(names: Mapping[str, bool]) -> Layout:
    held = {
        n: Held(Column(n, "length", may_be_blank=may), n, Unit())
        for n, may in names.items()
    }
    return Layout(held, 0, (), (), ())


def _kept(header: Header, layout: Layout) -> tuple[Cells, list[str]]:
    cells = header.read({*layout.held})
    kept, _, _, faults = readings_of(header, cells, layout, Csv())
    return kept, faults


def _readings(header: Header, names: list[str]) -> Int[np.ndarray, " rows"]:
    """Return the rows of a file that are readings, whole or not."""
    cells, _ = _kept(header, _layout(dict.fromkeys(names, True)))
    ragged = set(header.read(names).location.unread) - {*header.left_out}
    return np.array(sorted({*cells.location.rows(cells.rows).tolist(), *ragged}), int)


def _numbers(
    header: Header, names: Mapping[str, bool], mark: str
) -> tuple[dict[str, np.ndarray], Int[np.ndarray, " rows"], list[str]]:
    layout = _layout(names)
    cells, faults = _kept(header, layout)
    values, wrong = all_values_of(layout.held, cells, mark)
    rows = cells.location.rows(cells.rows)
    return values, rows, [*cells.faults, *faults, *wrong]
