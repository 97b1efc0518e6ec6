"""Columns that were exchanged, rows that slipped, units of a scale: each has a name."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations

from scenarios.damaging.damage import Damage, rewritten
from scenarios.damaging.samples import Samples

FORCES, MOMENTS = ("fx_n", "fy_n", "fz_n"), ("tx_nm", "ty_nm", "tz_nm")
ENDS = ("_x_mm", "_y_mm", "_z_mm")
SCALES = (("kgf", 9.80665), ("lbf", 4.4482216))
"""N in what scales show (ISO 80000-4)."""


def in_set_up(good: Samples) -> Iterator[Damage]:
    """List mistakes that have to be said by their own name."""
    yield from _markers(good)
    for one, other in combinations(range(3), 2):
        for name, parts in (("forces", (FORCES,)), ("wrench", (FORCES, MOMENTS))):
            pairs = [(part[one], part[other]) for part in parts]
            cells = {a: good.column(b) for a, b in pairs}
            cells |= {b: good.column(a) for a, b in pairs}
            what = " and ".join(f"{a}, {b}" for a, b in pairs)
            yield _named(f"{name}: {what} swapped", "wrench_columns", good, cells)
    for by in (1, 2):
        both = (FORCES, MOMENTS)
        cells = {p[k]: good.column(p[(k + by) % 3]) for p in both for k in range(3)}
        yield _named(f"wrench's axes turned by {by}", "wrench_columns", good, cells)
    cells = dict(zip(FORCES, map(good.column, MOMENTS), strict=True))
    cells |= dict(zip(MOMENTS, map(good.column, FORCES), strict=True))
    yield _named("moments before forces", "wrench_columns", good, cells)
    for by, whose in ((1, "before"), (-1, "after")):
        cells = {n: _rolled(good.column(n), by) for n in (*FORCES, *MOMENTS)}
        yield _named(f"wrench of the row {whose}", "wrench_rows", good, cells)
    for unit, size in SCALES:
        scaled = rewritten(
            f"forces in {unit}", "physics", good.scaled(1.0 / size, *FORCES)
        )
        yield replace(scaled, code="units", word=unit)


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
            yield _named(what, "marker_names", good, cells)


def _rolled(cells: list[str], by: int) -> list[str]:
    return cells[-by:] + cells[:-by]


def _named(name: str, code: str, good: Samples, cells: dict[str, list[str]]) -> Damage:
    return replace(rewritten(name, "physics", good.having(**cells)), code=code)
