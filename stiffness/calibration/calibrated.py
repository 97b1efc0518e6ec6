"""A calibrated arm: what was believed, how sure, and what stays unexplained."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from stiffness.arm import Arm
from stiffness.calibration.blocks import SILENT, Blocks, Key
from stiffness.calibration.claims import (
    Table,
    estimates_of,
    largest_waves,
    tables_of,
)
from stiffness.calibration.columns import ORDERS, candidates_of
from stiffness.calibration.intervals import Estimate, spread
from stiffness.calibration.judging import Judge
from stiffness.calibration.neighbours import Agreement, agreement
from stiffness.calibration.normal import normals_of, total_of
from stiffness.calibration.readings import Readings
from stiffness.calibration.regions import Regions
from stiffness.calibration.ridge import learnt, solved
from stiffness.calibration.rigid_fit import fitted
from stiffness.calibration.selection import MARGIN, Selected, selected
from stiffness.calibration.stance import Drawn, Stance

CHOOSING = 129
"""Order below which tables end while effects are chosen; then they are drawn whole."""


@dataclass(frozen=True)
class Calibrated:
    """What calibration found; nothing was fitted to the regions kept back.

    Attributes:
        readings: All that was seen.
        regions: Which of it was kept back.
        before: Rigid arm as drawn: frame and places fitted.
        drawn: The drawing as corrected.
        estimates: Of every number but tables', with intervals, by effect and place.
        tables: Of uneven gears, by axis.
        wave_widths: Half the interval of each table's largest wave, in rad.
        selected: How effects were chosen.
        named: Effects that are believed, the one that matters most first.
        nominal: Residual of the arm as drawn, on all rows, in m.
        residual: What calibration leaves, on all rows, in m.
        at_first: Whether neighbours agree before.
        at_last: Whether they do after.
    """

    readings: Readings
    regions: Regions
    before: Drawn
    drawn: Drawn
    estimates: dict[Key, dict[str, Estimate]]
    tables: dict[str, Table]
    wave_widths: dict[str, float]
    selected: Selected
    named: tuple[Key, ...]
    nominal: Float[np.ndarray, "rows 3"]
    residual: Float[np.ndarray, "rows 3"]
    at_first: Agreement
    at_last: Agreement

    @property
    def held(self) -> Bool[np.ndarray, " rows"]:
        """Rows that decide."""
        return self.regions.kept_back


def calibrated(
    readings: Readings,
    regions: Regions,
    said: Callable[[str], None] = lambda _: None,
    highest: int = ORDERS[-1],
) -> Calibrated:
    """Calibrate an arm on the regions that are not kept back.

    Args:
        readings: What was seen.
        regions: Which of it is kept back.
        said: Is told what was believed.
        highest: Order below which tables of uneven gears end.

    Returns:
        What was believed, with the arm as corrected.
    """
    keep = ~regions.kept_back
    fit_on = readings.take(keep)
    before = fitted(fit_on, redraw=False).drawn
    nominal = Stance.of(readings, before).residual
    rigid = fitted(fit_on, redraw=True)
    stance = Stance.of(readings, rigid.drawn)
    sprung = _sprung(readings.arm)
    blocks = Blocks.of(
        rigid, stance, candidates_of(stance, min(CHOOSING, highest)), sprung
    )
    folds = normals_of(blocks, stance, regions.fold, regions.count)
    _, sizes = learnt(total_of(folds), blocks.band)
    chosen = selected(Judge(blocks, folds, sizes), said)
    said("drawing tables in full")
    wanted = {(blocks.owner[j], blocks.parameter[j]) for j in chosen.columns}
    keys = {owner for owner, _ in wanted}
    del folds
    every = [
        c
        for c in candidates_of(stance, highest)
        if c.key in keys or c.key in sprung
        if c.orders or (c.key, c.parameters[0]) in wanted or c.key in sprung
    ]
    full = Blocks.of(rigid, stance, every, sprung)
    known = np.array(
        [
            j
            for j, (owner, name) in enumerate(
                zip(full.owner, full.parameter, strict=True)
            )
            if full.order[j] or owner == SILENT or (owner, name) in wanted
        ]
    )
    one = np.where(keep, 0, -1)
    normal = normals_of(full, stance, one, 1)[0].only(known)
    _, sizes = learnt(normal, full.band[known])
    fit = solved(normal, full.band[known], sizes)
    left = stance.residual.copy()
    for start in range(0, len(left), 500):
        rows = np.arange(start, min(start + 500, len(left)))
        left[rows] -= (full.matrix(stance, rows)[:, known] @ fit.x).reshape(-1, 3)
    plain = np.flatnonzero(full.order[known] == 0)
    waves = largest_waves(full, known, fit.x)
    region = np.where(keep, regions.region, -1)
    asked = np.concatenate([plain, *waves.values()])
    half = spread(full, stance, region, known, fit, sizes, asked)
    by_wave = half[len(plain) :].reshape(-1, 2).max(axis=1)
    widths = dict(zip(plain.tolist(), half.tolist(), strict=False))
    estimates, drawn = estimates_of(full, rigid.drawn, known, fit.x, widths)
    tables = tables_of(full, known, fit.x)
    held = regions.kept_back
    budget = chosen.budget
    named = [k for k, (loss, error) in budget.items() if loss > MARGIN * error]
    return Calibrated(
        readings=readings,
        regions=regions,
        before=before,
        drawn=drawn,
        estimates=estimates,
        tables=tables,
        wave_widths=dict(zip(waves, by_wave.tolist(), strict=True)),
        selected=chosen,
        named=tuple(sorted(named, key=lambda k: -budget[k][0])),
        nominal=nominal,
        residual=left,
        at_first=agreement(nominal[held], readings.posture[held]),
        at_last=agreement(left[held], readings.posture[held]),
    )


def _sprung(arm: Arm) -> set[Key]:
    """Return the springs that the model has: how stiff they are is no finding."""
    springs = enumerate(arm.stiffness)
    return {("joint_compliance", f"a{k + 1}") for k, s in springs if s > 0.0}
