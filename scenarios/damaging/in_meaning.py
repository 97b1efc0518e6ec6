"""Damages that only the physics shows: each has to be said, and no effect named."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations

import numpy as np

from scenarios.damaging.damage import Damage, rewritten
from scenarios.damaging.samples import Samples


def in_meaning(good: Samples, random: np.random.Generator) -> Iterator[Damage]:
    """List damages of files that are whole."""
    axes = [n for n in good.header if n.startswith("a") and n.endswith("_deg")]
    moved = [n for n in axes if _travel(good, n) > 10.0]
    for name in moved:
        yield _told(f"{name} reversed", good.scaled(-1.0, name))
    for one, other in combinations(moved, 2):
        swapped = {one: good.column(other), other: good.column(one)}
        yield _told(f"{one} and {other} swapped", good.having(**swapped))
    for one, other in combinations(moved, 2):
        yield _told(f"{one} and {other} reversed", good.scaled(-1.0, one, other))
    yield _told("angles in radians", good.scaled(np.pi / 180, *axes))
    seen = [n for n in good.header if n.endswith(("_x_mm", "_y_mm", "_z_mm"))]
    for factor in (1e-3, 1e3):
        yield _told(f"markers times {factor:g}", good.scaled(factor, *seen))
    for end in ("_x_mm", "_y_mm", "_z_mm"):
        some = [n for n in seen if n.endswith(end)]
        yield _told(f"{end} of the markers mirrored", good.scaled(-1.0, *some))
    for one, other in combinations(("_x_mm", "_y_mm", "_z_mm"), 2):
        names = [n[:-5] for n in seen if n.endswith("_x_mm")]
        cells = {m + one: good.column(m + other) for m in names}
        cells |= {m + other: good.column(m + one) for m in names}
        yield _told(f"{one} and {other} of the markers swapped", good.having(**cells))
    wrench = [n for n in good.header if n.endswith(("_n", "_nm")) and n[0] in "ft"]
    yield _told("wrench reversed", good.scaled(-1.0, *wrench))
    for factor in (1e-3, 9.81):
        yield _told(f"wrench times {factor:g}", good.scaled(factor, *wrench))
    torques = [n for n in wrench if n.endswith("_nm")]
    yield _told("torques times 1000", good.scaled(1e3, *torques))
    for number in range(3):
        order = random.permutation(len(good.rows))
        cells = {n: [good.column(n)[k] for k in order] for n in seen}
        yield _told(f"markers of other rows {number}", good.having(**cells))
    yield replace(_told("another arm's model", good), other_model=True)


def _told(name: str, samples: Samples) -> Damage:
    return rewritten(name, "physics", samples)


def _travel(good: Samples, name: str) -> float:
    values = [float(cell) for cell in good.column(name)]
    return max(values) - min(values)
