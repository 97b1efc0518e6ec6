"""Damages that the files themselves show: each has to be refused, its place named."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pa_parquet

from bench.format.manifest import FILE
from bench.format.samples import CSV_FILE, PARQUET_FILE
from scenarios.damaging.damage import Damage, rewritten
from scenarios.damaging.samples import Samples

CELLS = (
    *("left", "NaN", "inf", "-inf", "1e999", "12 N", "0x1F", "7,5", "--3", "#REF!"),
    *("None", "1.2.3"),
)
OPTIONAL = ("load_time_s", "visit", "stage", "load_kg")


def in_files(good: Samples, random: np.random.Generator) -> Iterator[Damage]:
    """List damages that a reader can see."""
    for name in good.header:
        if name not in OPTIONAL:
            yield rewritten(f"{name} is missing", "file", good.without(name))
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
