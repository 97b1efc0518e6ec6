"""Turns a lab's CSV file into a recording by a mapping of its columns.

A target that is measured in 6D is four points that move together.

==========  ==========================================================================
Equation    p_i = p + R e_i, e_0 = 0, e_i = arm along the target's own axes
Source      the format: a 6D target is four markers that share their name
Valid       positions and turns in the tracker's frame; angles as Euler's, capital
            letters about axes that turn along (ZYX: Rz Ry Rx), small ones about fixed
Ignores     that position and turn may have different noise: choose arm_mm as the noise
            of positions over the noise of turns
==========  ==========================================================================

A spreadsheet's CSV becomes a recording when a mapping says what its columns are.
"""

import csv
import io
from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from bench.shared.errors import Unusable
from bench.shared.format.cells import all_values_of
from bench.shared.format.checks import said_of_repeats
from bench.shared.format.columns import COORDINATES, Column, Held, Unit
from bench.shared.format.faults import Place, nearest
from bench.shared.format.folder import read
from bench.shared.format.manifest import FILE
from bench.shared.format.table import CSV_FILE, MAX_BYTES, Header, open_csv
from bench.shared.models import ModelFacts
from bench.shared.recording import Recording
from scenarios.pipelines.importing.mapping import Target, text_of

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

    Args:
        name: Of the target.
        target: Where its columns are.
        column: Gives a column of the file as numbers, NaN where it was not seen.
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

Read = tuple[Recording, tuple[str, ...]]


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
    source = path.read_bytes().removeprefix(b"\xef\xbb\xbf")
    if source[:4].lower() == b"sep=":  # Excel's own first line
        source = source.partition(b"\n")[2]
    if not source.strip():
        raise Unusable(what, ["it is empty."])
    return source


def recording_of(
    source: bytes,
    manifest: Mapping[str, Any],
    targets: Mapping[str, Target],
    model: ModelFacts | None,
    names: tuple[str, str],
) -> Read:
    """Read a CSV as the samples of a recording.

    Args:
        source: The CSV.
        manifest: What the format's manifest says.
        targets: Targets in 6D, whose columns become markers.
        model: Names and limits of the robot; None checks neither.
        names: What the user calls the CSV and the mapping, for the faults.

    Raises:
        Unusable: With all faults, in the user's own names.
    """
    faults: list[str] = []
    if targets:
        markers = dict(manifest.get("markers", {})) | markers_of(targets)
        manifest = {**manifest, "markers": markers}
        source, faults = _with_points(source, manifest, targets)
    try:
        with TemporaryDirectory(prefix="import-") as folder:
            (Path(folder) / FILE).write_text(text_of(manifest), encoding="utf-8")
            (Path(folder) / CSV_FILE).write_bytes(source)
            recording, notes = read(folder, model)
            faults += said_of_repeats(Place(CSV_FILE, True), recording)
    except Unusable as error:
        faults += [f for f in error.faults if not f.startswith(_follow(targets))]
        recording, notes = None, ()
    if recording is None or faults:
        faults = list(dict.fromkeys(faults))
        said = [f.replace(CSV_FILE, names[0]).replace(FILE, names[1]) for f in faults]
        raise Unusable(f"{names[0]} with {names[1]}", said)
    used = {c for t in targets.values() for c in columns_of(t)}
    notes = tuple(n for n in notes if not any(f"{c!r} left" in n for c in used))
    return recording, tuple(n.replace(CSV_FILE, names[0]) for n in notes)


def _follow(targets: Mapping[str, Target]) -> tuple[str, ...]:
    """Return how faults begin that only follow from those of a target's columns."""
    columns = (m + c for m in markers_of(targets) for c in COORDINATES)
    return tuple(f"{CSV_FILE}: column {c!r} is missing" for c in columns)


def _with_points(
    source: bytes, manifest: Mapping[str, Any], targets: Mapping[str, Target]
) -> tuple[bytes, list[str]]:
    """Add the columns of the markers that stand for targets."""
    separator, mark = marks_of(manifest)
    header, faults = open_csv(source, separator)
    if header is None:
        return source, []  # the format's reader says why
    columns: dict[str, np.ndarray] = {}
    for name, target in targets.items():
        missing = [c for c in columns_of(target) if c not in header.names]
        if missing:
            faults += [
                f"{CSV_FILE}: column {c!r} is missing, which {FILE}, targets.{name} "
                f"asks for.{nearest(c, header.names)}"
                for c in missing
            ]
            continue
        numbers, found = _numbers(header, target, mark)
        faults += found
        columns |= points_of(name, target, numbers.__getitem__)
    if faults:
        return source, faults
    return with_columns(source, header.separator, mark, columns), []


def marks_of(manifest: Mapping[str, Any]) -> tuple[str, str]:
    """Return what stands between cells, and the decimal mark."""
    about = manifest.get("csv", {})
    separator = str(about.get("separator", ","))[:1] or ","
    return separator, str(about.get("decimal", about.get("decimal_mark", ".")))


def with_columns(
    source: bytes, separator: str, mark: str, columns: Mapping[str, np.ndarray]
) -> bytes:
    """Add columns to a CSV, blank where NaN."""
    rows = list(csv.reader(io.StringIO(source.decode()), delimiter=separator))
    while rows and not any(cell.strip() for cell in rows[-1]):
        rows.pop()
    text = io.StringIO()
    writer = csv.writer(text, delimiter=separator, lineterminator="\n")
    writer.writerow([*rows[0], *columns])
    for row, values in zip(rows[1:], zip(*columns.values(), strict=True), strict=False):
        cells = ["" if np.isnan(v) else repr(float(v)) for v in values]
        writer.writerow([*row, *(c.replace(".", mark) for c in cells)])
    return text.getvalue().encode()


def columns_of(target: Target) -> tuple[str, ...]:
    """Return the columns that a target is read from."""
    turned = target.rotation or target.quaternion_wxyz or ()
    return (*target.position, *turned)


def _numbers(
    header: Header, target: Target, mark: str
) -> tuple[dict[str, np.ndarray], list[str]]:
    names = sorted(set(columns_of(target)))
    cells = header.read(names)
    held = {n: Held(Column(n, "length", may_be_blank=True), n, Unit()) for n in names}
    numbers, faults = all_values_of(held, cells, mark)
    return numbers, [*cells.faults, *faults]
