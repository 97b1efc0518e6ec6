"""Damages of recordings: in their files, their physics or their set-up.

`Samples` is a recording as text; a `Damage` writes a folder from an altered copy.
`in_files` lists damages that the files show, which must be refused with their place;
`in_meaning` those that only the physics shows, which must be warned of without naming
an effect; `in_set_up` exchanged columns, shifted rows and wrong units, each with a
warning of its own.
"""

import csv
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pa_parquet

from bench.effects.parse import parse_all
from bench.experiment import record
from bench.rig import Rig
from bench.shared.format.folder import write
from bench.shared.format.manifest import FILE
from bench.shared.format.table import CSV_FILE, PARQUET_FILE
from bench.shared.plan import parse_path
from bench.shared.recording import Recording
from bench.standard_plans import tour
from scenarios.pipelines.schema import Remark
from scenarios.pipelines.synthetic_recording import KR10, Watching

# --- The files of a recording ---------------------------------------------------------


@dataclass(frozen=True)
class Samples:
    """The two files of a recording, as text."""

    manifest: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    @classmethod
    def of(cls, folder: Path) -> "Samples":
        """Read the files of a recording."""
        with (folder / CSV_FILE).open(newline="", encoding="utf-8") as file:
            header, *rows = (tuple(row) for row in csv.reader(file))
        text = (folder / FILE).read_text(encoding="utf-8")
        return cls(text, header, tuple(rows))

    def write(self, folder: Path) -> None:
        """Write the files into an existing folder."""
        (folder / FILE).write_text(self.manifest, encoding="utf-8")
        with (folder / CSV_FILE).open("w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows([self.header, *self.rows])

    def column(self, name: str) -> list[str]:
        """Return a column's cells."""
        k = self.header.index(name)
        return [row[k] for row in self.rows]

    def having(self, **columns: list[str]) -> "Samples":
        """Return a copy with other cells in some columns."""
        at = {self.header.index(name): cells for name, cells in columns.items()}
        rows = [
            tuple(at[k][r] if k in at else cell for k, cell in enumerate(row))
            for r, row in enumerate(self.rows)
        ]
        return replace(self, rows=tuple(rows))

    def swapping(self, *pairs: tuple[str, str]) -> "Samples":
        """Return a copy in which the columns of each pair are exchanged."""
        cells = {a: self.column(b) for a, b in pairs}
        return self.having(**cells, **{b: self.column(a) for a, b in pairs})

    def scaled(self, factor: float, *names: str) -> "Samples":
        """Return a copy with the numbers of some columns times a factor."""
        return self.having(
            **{
                name: [repr(float(c) * factor) if c else "" for c in self.column(name)]
                for name in names
            }
        )

    def cell(self, row: int, name: str, text: str) -> "Samples":
        """Return a copy with another text in one cell."""
        cells = self.column(name)
        cells[row] = text
        return self.having(**{name: cells})

    def drop_columns(self, *names: str) -> "Samples":
        """Return a copy without some columns."""
        keep = [k for k, name in enumerate(self.header) if name not in names]
        return replace(
            self,
            header=tuple(self.header[k] for k in keep),
            rows=tuple(tuple(row[k] for k in keep) for row in self.rows),
        )


# --- A damage -------------------------------------------------------------------------


@dataclass(frozen=True)
class Damage:
    """One way to damage a recording.

    Attributes:
        name: Description of the damage.
        shows: Whether the `file` itself shows it, or only the `physics`.
        write: Writes the damaged recording into a folder.
        other_model: Whether the model of another arm is given.
        code: Code of the warning that is required; empty: any mistake of the set-up.
        word: Word that this warning must contain.
    """

    name: str
    shows: Literal["file", "physics"]
    write: Callable[[Path], None]
    other_model: bool = False
    code: str = ""
    word: str = ""

    def recognised(self, told: Iterable[Remark]) -> bool:
        """Return whether one of the warnings is that of this damage."""
        return not self.code or any(
            w.code == self.code and self.word in w.text for w in told
        )


def rewritten(name: str, shows: Literal["file", "physics"], samples: Samples) -> Damage:
    """Return a damage that writes altered samples."""
    return Damage(name, shows, samples.write)


# --- Damage that the files show -------------------------------------------------------

CELLS = (
    *("left", "NaN", "inf", "-inf", "1e999", "12 N", "0x1F", "7,5", "--3", "#REF!"),
    *("None", "1.2.3"),
)
OPTIONAL = ("load_time_s", "visit", "stage", "load_kg")


def in_files(good: Samples, random: np.random.Generator) -> Iterator[Damage]:
    """Yield damages that reading the files must detect."""
    for name in good.header:
        if name not in OPTIONAL:
            yield rewritten(f"{name} is missing", "file", good.drop_columns(name))
    numbers = [n for n in good.header if n not in ("stage", *OPTIONAL)]
    for text in CELLS:
        for name in random.choice(numbers, 7, replace=False):
            row = int(random.integers(len(good.rows)))
            spoiled = good.cell(row, str(name), text)
            yield rewritten(f"{text!r} in {name}, row {row + 1}", "file", spoiled)
    for name in ("time_s", "pose", "a1_deg", "fz_n", "a6_deg"):
        row = int(random.integers(len(good.rows)))
        yield rewritten(f"{name} blank", "file", good.cell(row, name, ""))
    for name, text in (
        *(("a2_deg", "1e6"), ("a5_deg", "-1e300"), ("fx_n", "1e9"), ("tz_nm", "-1e12")),
        *(("pose", "1.5"), ("time_s", "-1e6"), ("pose", "1e30"), ("stage", "resting")),
    ):
        row = 1 + int(random.integers(len(good.rows) - 1))
        yield rewritten(f"{text} in {name}", "file", good.cell(row, name, text))
    yield rewritten("time reversed", "file", replace(good, rows=good.rows[::-1]))
    for number in range(6):
        order = random.permutation(len(good.rows))
        shuffled = replace(good, rows=tuple(good.rows[k] for k in order))
        yield rewritten(f"rows shuffled {number}", "file", shuffled)
    turned = [n for n in good.header if n.startswith("a") and n.endswith("_deg")]
    yield rewritten("angles times 57.3", "file", good.scaled(180 / np.pi, *turned))
    forces = [n for n in good.header if n.endswith("_n")]
    yield rewritten("forces times 1e6", "file", good.scaled(1e6, *forces))
    twice = replace(good, header=(*good.header[:-1], good.header[-2]))
    yield rewritten("a column twice", "file", twice)
    yield rewritten("no rows", "file", replace(good, rows=()))
    ragged = replace(good, rows=(*good.rows[:5], good.rows[5][:-2], *good.rows[6:]))
    yield rewritten("a row too short", "file", ragged)
    yield from _manifests(good)
    yield from _bytes(good, random)


def _manifests(good: Samples) -> Iterator[Damage]:
    for old, new in (
        *(("format = 1", "format = 2"), ("format = 1", ""), ("plateaus", "rests")),
        *(("absolute", "perhaps"), ("repeatability_mm = [", "repeatability_mm = [-")),
        *(("accuracy_n = ", 'accuracy_n = "a" #'), ('"flange"', '"flansch"')),
        *(("[sensors.tracker]", "[sensors.trakcer]"), ("[markers.", "[marker.")),
        *(("quaternion_wxyz = [1.0", "quaternion_wxyz = [3.0"), ("]", "")),
    ):
        spoiled = replace(good, manifest=good.manifest.replace(old, new, 1))
        yield rewritten(f"manifest: {old} becomes {new}", "file", spoiled)


def _bytes(good: Samples, random: np.random.Generator) -> Iterator[Damage]:
    def overwritten(file: str, content: bytes) -> Damage:
        def make(folder: Path) -> None:
            good.write(folder)
            (folder / file).write_bytes(content)

        return Damage(f"{file} is {content[:8]!r}…", "file", make)

    def cut(share: float) -> Damage:
        def make(folder: Path) -> None:
            good.write(folder)
            columns = zip(*good.rows, strict=True)
            table = pa.table(dict(zip(good.header, map(list, columns), strict=True)))
            pa_parquet.write_table(table, folder / PARQUET_FILE)
            (folder / CSV_FILE).unlink()
            whole = (folder / PARQUET_FILE).read_bytes()
            (folder / PARQUET_FILE).write_bytes(whole[: int(share * len(whole))])

        return Damage(f"parquet cut at {share:.0%}", "file", make)

    def removed(file: str) -> Damage:
        def make(folder: Path) -> None:
            good.write(folder)
            (folder / file).unlink()

        return Damage(f"no {file}", "file", make)

    for file in (CSV_FILE, FILE):
        yield removed(file)
        for content in (b"", b"PK\x03\x04", b"\xff\xfea\0", random.bytes(500)):
            yield overwritten(file, content)
    for share in (0.0, 0.02, 0.3, 0.6, 0.9, 0.999):
        yield cut(share)


# --- Damage that only the physics shows -----------------------------------------------


def in_meaning(good: Samples, random: np.random.Generator) -> Iterator[Damage]:
    """Yield damages of valid files that contradict the physics."""
    axes = [n for n in good.header if n.startswith("a") and n.endswith("_deg")]
    moved = [n for n in axes if _travel(good, n) > 10.0]
    for name in moved:
        yield _physics_damage(f"{name} reversed", good.scaled(-1.0, name))
    for one, other in combinations(moved, 2):
        swapped = good.swapping((one, other))
        yield _physics_damage(f"{one} and {other} swapped", swapped)
    for one, other in combinations(moved, 2):
        both = good.scaled(-1.0, one, other)
        yield _physics_damage(f"{one} and {other} reversed", both)
    yield _physics_damage("angles in radians", good.scaled(np.pi / 180, *axes))
    seen = [n for n in good.header if n.endswith(("_x_mm", "_y_mm", "_z_mm"))]
    for factor in (1e-3, 1e3):
        yield _physics_damage(f"markers times {factor:g}", good.scaled(factor, *seen))
    for end in ENDS:
        some = good.scaled(-1.0, *(n for n in seen if n.endswith(end)))
        yield _physics_damage(f"{end} of the markers mirrored", some)
    for one, other in combinations(ENDS, 2):
        names = [n[:-5] for n in seen if n.endswith(ENDS[0])]
        swapped = good.swapping(*((m + one, m + other) for m in names))
        yield _physics_damage(f"{one} and {other} of the markers swapped", swapped)
    wrench = [n for n in good.header if n.endswith(("_n", "_nm")) and n[0] in "ft"]
    yield _physics_damage("wrench reversed", good.scaled(-1.0, *wrench))
    for factor in (1e-3, 9.81):
        yield _physics_damage(f"wrench times {factor:g}", good.scaled(factor, *wrench))
    torques = [n for n in wrench if n.endswith("_nm")]
    yield _physics_damage("torques times 1000", good.scaled(1e3, *torques))
    for number in range(3):
        order = random.permutation(len(good.rows))
        cells = {n: [good.column(n)[k] for k in order] for n in seen}
        yield _physics_damage(f"markers of other rows {number}", good.having(**cells))
    yield replace(_physics_damage("another arm's model", good), other_model=True)


def _physics_damage(name: str, samples: Samples) -> Damage:
    return rewritten(name, "physics", samples)


def _travel(good: Samples, name: str) -> float:
    values = [float(cell) for cell in good.column(name)]
    return max(values) - min(values)


# --- Mistakes of the set-up -----------------------------------------------------------

FORCES, MOMENTS = ("fx_n", "fy_n", "fz_n"), ("tx_nm", "ty_nm", "tz_nm")
ENDS = ("_x_mm", "_y_mm", "_z_mm")
SCALES = (("kgf", 9.80665), ("lbf", 4.4482216))
"""Newtons per unit of force (ISO 80000-4)."""


def in_set_up(good: Samples) -> Iterator[Damage]:
    """Yield mistakes of the set-up, each with the code of its warning."""
    yield from _markers(good)
    for one, other in combinations(range(3), 2):
        for name, parts in (("forces", (FORCES,)), ("wrench", (FORCES, MOMENTS))):
            pairs = [(part[one], part[other]) for part in parts]
            what = " and ".join(f"{a}, {b}" for a, b in pairs)
            swapped = good.swapping(*pairs)
            yield _set_up(f"{name}: {what} swapped", "wrench_columns", swapped)
    for by in (1, 2):
        both = (FORCES, MOMENTS)
        cells = {p[k]: good.column(p[(k + by) % 3]) for p in both for k in range(3)}
        turned = good.having(**cells)
        yield _set_up(f"wrench's axes turned by {by}", "wrench_columns", turned)
    first = good.swapping(*zip(FORCES, MOMENTS, strict=True))
    yield _set_up("moments before forces", "wrench_columns", first)
    for by, whose in ((1, "before"), (-1, "after")):
        own = {n: good.column(n) for n in (*FORCES, *MOMENTS)}
        rolled = good.having(**{n: c[-by:] + c[:-by] for n, c in own.items()})
        yield _set_up(f"wrench of the row {whose}", "wrench_rows", rolled)
    for unit, size in SCALES:
        scaled = good.scaled(1.0 / size, *FORCES)
        yield replace(_set_up(f"forces in {unit}", "units", scaled), word=unit)


def _markers(good: Samples) -> Iterator[Damage]:
    names = [n[:-5] for n in good.header if n.endswith(ENDS[0])]
    half = len(good.rows) // 2
    for one, other in combinations(names, 2):
        for much, start in (("", 0), (" from the middle on", half)):
            cells = {}
            for end in ENDS:
                a, b = good.column(one + end), good.column(other + end)
                cells[one + end] = a[:start] + b[start:]
                cells[other + end] = b[:start] + a[start:]
            what = f"{one} and {other} swapped{much}"
            yield _set_up(what, "marker_names", good.having(**cells))
        for end in ENDS:
            swapped = good.swapping((one + end, other + end))
            what = f"{one}{end} and {other}{end} swapped"
            yield _set_up(what, "marker_columns", swapped)
    for name, end in product(names, ENDS):
        mirrored = good.scaled(-1.0, name + end)
        yield _set_up(f"{name}{end} reversed", "marker_columns", mirrored)


def _set_up(name: str, code: str, samples: Samples) -> Damage:
    return replace(_physics_damage(name, samples), code=code)


# --- Draws and outcomes ---------------------------------------------------------------

MISTAKES = (
    *("axis_reversed", "axis_order", "axis_zero", "mirrored", "units", "wrong_model"),
    *("wrench_sign", "wrench_frame", "wrench_columns", "wrench_rows"),
    *("tracker_frame", "marker_places", "marker_names", "marker_columns"),
)
"""Codes of warnings with which no effect may be named."""
WHAT = ("refused", "warned", "misnamed", "diagnosed", "half written", "crashed")
"""Possible outcomes of a damage."""
RIGHT = {"file": ("refused",), "physics": ("warned", "refused")}
"""Right outcomes by kind; an angle of the wrong sign may also exceed its limits."""


@dataclass(frozen=True)
class DamageOutcome:
    """The outcome of one damage."""

    damage: Damage
    what: str
    said: str

    @property
    def right(self) -> bool:
        """Whether the outcome is a right one."""
        return self.what in RIGHT[self.damage.shows]


def own_names(outcomes: Sequence[DamageOutcome]) -> list[str]:
    """Return by code how many mistakes of the set-up got their own warning."""
    planted = Counter(o.damage.code for o in outcomes if o.damage.code)
    said = Counter(o.damage.code for o in outcomes if o.what == "warned")
    return [f"{code}: {said[code]} of {n} said." for code, n in sorted(planted.items())]


def damages(good: Samples, variants: int, seed: int) -> list[Damage]:
    """Draw damages at random from all kinds."""
    random = np.random.default_rng(seed)
    every = [*in_files(good, random), *in_meaning(good, random), *in_set_up(good)]
    order = random.permutation(len(every))[:variants]
    return [every[k] for k in sorted(order)]


def good_recording(folder: Path, poses: int) -> Samples:
    """Record a KR10 with hysteresis, with markers at the flange, into a folder."""
    effect = ("hysteresis@a2,width_rad=3e-4",)
    watch = Watching(targets="flange", state_frame=True)
    bare = Rig(KR10)
    rig = replace(bare, effects=parse_all(effect, bare.nominal))
    plan = tour(rig, poses, parse_path("0,10,0"))
    write(folder, record(rig, plan, watch.instruments()))
    return Samples.of(folder)


# --- Recordings of blind trials -------------------------------------------------------

NEAREST, FARTHEST = 1e-3, 0.3
"""Distance of an outlier from the sound reading, in m; drawn log-uniformly: from a
hundred sigmas to the reflection of another target."""
COUPLED = 2
"""Axes apart that one may be counted against another: parallelograms and wrists."""
ZEROS = (90.0, -90.0, 180.0)
"""Degrees by which an axis is counted from another zero."""


def with_outliers(
    recording: Recording, share: float, chance: np.random.SeedSequence
) -> tuple[Recording, dict[str, Any]]:
    """Return a recording with outliers, one at least, and which they are."""
    assert recording.points is not None
    draw = np.random.default_rng(chance)
    seen = np.argwhere(np.isfinite(recording.points).all(axis=2))
    count = max(round(share * len(seen)), 1)
    rows, marks = seen[np.sort(draw.choice(len(seen), count, replace=False))].T
    span = np.log(FARTHEST / NEAREST)
    size = NEAREST * np.exp(span * draw.uniform(size=count))
    along = draw.normal(size=(count, 3))
    points = recording.points.copy()
    points[rows, marks] += (
        size[:, None] * along / np.linalg.norm(along, axis=1)[:, None]
    )
    outliers = [
        {
            "pose": int(recording.posture_id[row]),
            "marker": recording.markers[m].name,
            "size_mm": 1e3 * float(s),
        }
        for row, m, s in zip(rows, marks, size, strict=True)
    ]
    return replace(recording, points=points), {"outliers": outliers}


PAUSE = 10.0
"""Way from one visit to the next where they are told in another order, in s; chosen."""


def in_another_order(recording: Recording, chance: np.random.SeedSequence) -> Recording:
    """Return a recording with its visits in an order in which no arm went to them.

    What was before each visit is then not to be seen from the recording. Times and
    numbers of visits run on as if they had been carried out so.
    """
    order = np.random.default_rng(chance).permutation(np.unique(recording.visit))
    rows = [np.flatnonzero(recording.visit == visit) for visit in order]
    told = recording.take(np.concatenate(rows))
    arrival = np.array([recording.load_time[own[0]] for own in rows])
    long = np.array([recording.time[own[-1]] for own in rows]) - arrival
    later = np.cumsum([0.0, *(long[:-1] + PAUSE)]) - arrival
    lengths = [len(own) for own in rows]
    later = np.repeat(later, lengths)
    return replace(
        told,
        visit=np.repeat(np.arange(len(rows)), lengths),
        time=told.time + later,
        load_time=told.load_time + later,
        last_move=None,
    )


def as_differences(recording: Recording) -> Recording:
    """Return a recording whose readings count from the first row of their visit."""
    assert recording.points is not None
    start = np.searchsorted(recording.visit, recording.visit)
    points = recording.points - recording.points[start]
    return replace(recording, points=points, displacement="relative")


def with_axis_mistaken(
    recording: Recording, axes: tuple[str, ...], chance: np.random.SeedSequence
) -> tuple[Recording, dict[str, Any]]:
    """Return a recording with an axis coupled, reversed or of another zero."""
    draw, posture = np.random.default_rng(chance), recording.posture.copy()
    where = str(draw.choice(axes))
    k = int(where[1:]) - 1
    others = [int(a[1:]) - 1 for a in axes if 0 < k - int(a[1:]) + 1 <= COUPLED]
    codes = ["axis_reversed", "axis_zero", *(["axis_coupled"] if others else [])]
    code = str(draw.choice(codes))
    if code == "axis_coupled":
        posture[:, k] += draw.choice([-1.0, 1.0]) * posture[:, int(draw.choice(others))]
    elif code == "axis_zero":
        posture[:, k] += np.radians(draw.choice(ZEROS))
    else:
        posture[:, k] *= -1.0
    return replace(recording, posture=posture), {"mistake": {code: where}}
