"""Turns a lab's CSV file into a recording by a mapping of its columns.

A target that is measured in 6D becomes four markers (`points_of`):

==========  ==========================================================================
Equation    p_i = p + R e_i, e_0 = 0, e_i = arm along the target's own axes
Source      the format: a 6D target is four markers that share their name
Valid       positions and turns in the tracker's frame; angles as Euler's, capital
            letters about axes that turn along (ZYX: Rz Ry Rx), small ones about fixed
Ignores     that position and turn may have different noise: choose arm_mm as the noise
            of positions over the noise of turns
==========  ==========================================================================
"""

import csv
import io
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from bench.shared.errors import Unusable
from bench.shared.format.cells import all_values_of, readings_of
from bench.shared.format.checks import said_of_repeats
from bench.shared.format.columns import COORDINATES, Column, Held, Layout, Unit
from bench.shared.format.faults import nearest
from bench.shared.format.folder import LEFT_ALONE, joined, open_as_said
from bench.shared.format.manifest import FILE, Csv, fill, manifest_of
from bench.shared.format.table import (
    CSV_FILE,
    MAX_BYTES,
    Cells,
    Header,
    decoded,
    is_encoding,
    open_csv,
)
from bench.shared.models import ModelFacts
from bench.shared.recording import Recording
from scenarios.pipelines.importing.mapping import Target

# --- Targets measured in 6D -----------------------------------------------------------

ENDS = ("o", "x", "y", "z")


def markers_of(targets: Mapping[str, Target]) -> dict[str, dict[str, Any]]:
    """Return the manifest's entries of the markers that stand for targets."""
    return {
        f"{name}_{end}": {"body": target.body, "target": name}
        for name, target in targets.items()
        for end in ENDS
    }


def points_of(
    name: str, target: Target, column: Callable[[str], np.ndarray]
) -> dict[str, Float[np.ndarray, " rows"]]:
    """Return the columns of a target's four markers, in mm.

    `column` gives a column of the file as numbers, NaN where it was not seen.
    """
    scale = 1.0 if target.length_unit == "mm" else 1e3
    position = scale * np.stack([column(c) for c in target.position], axis=1)
    turn = np.full((len(position), 3, 3), np.nan)
    if target.quaternion_wxyz is not None:
        values = np.stack([column(c) for c in target.quaternion_wxyz], axis=1)
        seen = np.isfinite(values).all(axis=1) & (np.linalg.norm(values, axis=1) > 0.5)
        turn[seen] = Rotation.from_quat(values[seen], scalar_first=True).as_matrix()
    else:
        assert target.rotation is not None
        values = np.stack([column(c) for c in target.rotation], axis=1)
        seen = np.isfinite(values).all(axis=1)
        degrees = target.angle_unit == "deg"
        turned = Rotation.from_euler(target.order, values[seen], degrees=degrees)
        turn[seen] = turned.as_matrix()
    arms = target.arm_mm * np.concatenate([np.zeros((1, 3)), np.eye(3)])
    points = position[:, None] + np.einsum("rij,ej->rei", turn, arms)
    return {
        f"{name}_{end}{coordinate}": points[:, e, i]
        for e, end in enumerate(ENDS)
        for i, coordinate in enumerate(COORDINATES)
    }


# --- Columns and rows -----------------------------------------------------------------


@dataclass(frozen=True)
class Read:
    """A lab's own file as it was read.

    Attributes:
        notes: What to say of it, one for each column that was left alone.
        rows: Which rows of the file the recording's are, from 0 below the header; of
            pulled poses each stands twice.
    """

    recording: Recording
    notes: tuple[str, ...]
    rows: Int[np.ndarray, " rows"]


def source_of(path: Path) -> bytes:
    """Read a lab's file whole.

    Raises:
        Unusable: Where it is missing, too large or empty.
    """
    what = f"File {str(path)!r}"
    if not path.is_file():
        raise Unusable(what, ["there is no such file."])
    if path.stat().st_size > MAX_BYTES:
        raise Unusable(what, [f"it has more than {MAX_BYTES} bytes."])
    source = _without_excel_s_line(path.read_bytes().removeprefix(b"\xef\xbb\xbf"))
    if not source.strip():
        raise Unusable(what, ["it is empty."])
    if b"\n" not in source:  # an old Macintosh's ends of lines
        source = source.replace(b"\r", b"\n")
    return source


def _without_excel_s_line(source: bytes) -> bytes:
    """Take off `sep=;`, which Excel takes in and does not show as a line."""
    return source.partition(b"\n")[2] if source[:4].lower() == b"sep=" else source


def as_utf8(
    source: bytes, manifest: Mapping[str, Any]
) -> tuple[bytes, dict[str, Any], list[str]]:
    """Return a CSV as UTF-8, what its manifest then says, and what is wrong with it."""
    about = csv_of(manifest)
    text, faults = decoded(source, about.encoding, about.separator)
    if text is None:
        return source, dict(manifest), []  # the format's reader says why
    if not is_encoding(about.encoding):
        return _without_excel_s_line(text), dict(manifest), faults
    said = {**manifest.get("csv", {}), "encoding": "utf-8"}
    return _without_excel_s_line(text), {**manifest, "csv": said}, faults


def csv_of(manifest: Mapping[str, Any]) -> Csv:
    """Return what a manifest says of the CSV, as far as it can be meant."""
    return fill(Csv, manifest.get("csv", {}), "")[0] or Csv()


def recording_of(
    source: bytes,
    manifest: Mapping[str, Any],
    targets: Mapping[str, Target],
    model: ModelFacts | None,
    names: tuple[str, str],
) -> Read:
    """Read a CSV as the samples of a recording.

    Columns of 6D targets become markers; `names` are what the user calls the CSV and
    the mapping, for the faults.

    Raises:
        Unusable: With all faults, in the user's own names.
    """
    source, manifest, faults = as_utf8(source, manifest)
    if targets:
        markers = dict(manifest.get("markers", {})) | markers_of(targets)
        manifest = {**manifest, "markers": markers}
        source, found = _with_points(source, manifest, targets)
        faults += found
    read_as, found = manifest_of(manifest)
    header, more = open_as_said(source, read_as)
    read = joined(Path(names[0]).stem, read_as, header, [*found, *more], model)
    follow = tuple(f"{CSV_FILE}: column {c!r} is missing" for c in _points(targets))
    faults += [f for f in read.faults if not f.startswith(follow)]
    if read.recording is not None:
        faults += said_of_repeats(read.location, read.recording)
    if read.recording is None or faults:
        faults = list(dict.fromkeys(faults))
        said = [f.replace(CSV_FILE, names[0]).replace(FILE, names[1]) for f in faults]
        raise Unusable(f"{names[0]} with {names[1]}", said)
    used = {c for t in targets.values() for c in columns_of(t)}
    own = tuple(f"column {c!r} {LEFT_ALONE}" for c in used)
    notes = (n.replace(CSV_FILE, names[0]) for n in read.notes if not n.endswith(own))
    return Read(read.recording, tuple(notes), read.rows)


def _points(targets: Mapping[str, Target]) -> Iterator[str]:
    """Name the columns that are made of those of targets."""
    return (m + c for m in markers_of(targets) for c in COORDINATES)


def _with_points(
    source: bytes, manifest: Mapping[str, Any], targets: Mapping[str, Target]
) -> tuple[bytes, list[str]]:
    """Add the columns of the markers that stand for targets."""
    about = csv_of(manifest)
    own = {c for t in targets.values() for c in columns_of(t)}
    header, faults = open_csv(source, about, own | names_in(manifest))
    if header is None:
        return source, []  # the format's reader says why
    faults = []  # as it says what else is wrong with the header
    for name, target in targets.items():
        faults += [
            f"{CSV_FILE}: column {c!r} is missing, which {FILE}, targets.{name} "
            f"asks for.{nearest(c, header.names)}"
            for c in columns_of(target)
            if c not in header.names
        ]
    # all at once, for the rows of one are those of the others
    held = plain(dict.fromkeys(sorted(own.intersection(header.names)), True))
    cells, _ = kept_of(header, held)  # as it says what is wrong with rows
    numbers, found = all_values_of(held, cells, about.mark)
    faults += [*cells.faults, *found]
    if faults:
        return source, faults
    columns: dict[str, np.ndarray] = {}
    for name, target in targets.items():
        columns |= points_of(name, target, numbers.__getitem__)
    rows = cells.location.rows(cells.rows)
    return with_columns(header, about.mark, columns, rows), []


def names_in(manifest: Mapping[str, Any]) -> set[str]:
    """Return all names of columns in a mapping."""
    names: set[str] = set()
    for name, entry in manifest.get("columns", {}).items():
        said = entry.get("from", name) if isinstance(entry, dict) else entry
        names |= {n for n in (said if isinstance(said, list) else [said])}
    return {n for n in names if isinstance(n, str)}


def with_columns(
    header: Header,
    mark: str,
    columns: Mapping[str, np.ndarray],
    rows: Int[np.ndarray, " rows"],
) -> bytes:
    """Add columns to a CSV, blank where NaN; its own text stays as it is.

    Rows of the file, to which the values belong, count from 0 below the header.
    """
    if not columns:
        return header.source
    lines = header.source.split(b"\n")
    above, separator = header.location.above, header.separator
    values = np.full((len(lines), len(columns)), np.nan)
    for k, column in enumerate(columns.values()):
        values[rows + above + 1, k] = column
    written = []
    for number, line in enumerate(lines):
        added = [
            "" if np.isnan(v) else repr(float(v)).replace(".", mark)
            for v in values[number]
        ]
        if number == above:
            added = list(columns)
        if number < above or not line.strip():
            written.append(line)
            continue
        text = io.StringIO()
        csv.writer(text, delimiter=separator, lineterminator="").writerow(["", *added])
        written.append(line.rstrip(b"\r") + text.getvalue().encode())
    return b"\n".join(written)


def columns_of(target: Target) -> tuple[str, ...]:
    """Return the columns that a target is read from."""
    turned = target.rotation or target.quaternion_wxyz or ()
    return (*target.position, *turned)


def plain(columns: Mapping[str, bool]) -> dict[str, Held]:
    """Return columns of numbers as they stand, and whether each may be blank."""
    return {
        name: Held(Column(name, "length", may_be_blank=blank), name, Unit())
        for name, blank in columns.items()
    }


def kept_of(header: Header, held: Mapping[str, Held]) -> tuple[Cells, list[str]]:
    """Read the rows of a file that are readings; and what is wrong with rows."""
    cells = header.read({source for one in held.values() for source in one.sources})
    layout = Layout(held, 0, (), (), ())
    kept, _, _, faults = readings_of(header, cells, layout, Csv())
    return kept, faults


def numbers_of(
    header: Header, held: Mapping[str, Held], mark: str
) -> tuple[dict[str, np.ndarray], Cells, list[str]]:
    """Read columns as numbers, the readings alone; the cells; and all faults."""
    cells, faults = kept_of(header, held)
    numbers, wrong = all_values_of(held, cells, mark)
    return numbers, cells, [*cells.faults, *faults, *wrong]
