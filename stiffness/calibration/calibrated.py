"""A calibrated arm: what was believed, how sure, and what stays unexplained."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from stiffness.arm import Arm
from stiffness.calibration.blocks import SILENT, Blocks, Key
from stiffness.calibration.claims import (
    Table,
    Wave,
    estimates_of,
    largest_waves,
    tables_of,
    wave_of,
)
from stiffness.calibration.columns import ORDERS, candidates_of
from stiffness.calibration.intervals import Estimate, spread
from stiffness.calibration.judging import Judge
from stiffness.calibration.naming import named
from stiffness.calibration.neighbours import Agreement, agreement
from stiffness.calibration.normal import normals_of, total_of
from stiffness.calibration.readings import Readings
from stiffness.calibration.regions import Regions
from stiffness.calibration.ridge import learnt
from stiffness.calibration.rigid_fit import RigidFit, fitted
from stiffness.calibration.selection import Selected, selected
from stiffness.calibration.stance import Drawn, Stance
from stiffness.calibration.whole_fit import springs_of, whole_fit

CHOOSING = 129
"""Order below which tables end while effects are chosen; then they are drawn whole."""

WAVES = 5
"""Of each table the waves that get an interval, the largest ones."""


@dataclass(frozen=True)
class Calibrated:
    """What calibration found; nothing was fitted to the regions kept back.

    Attributes:
        readings: All that was seen.
        regions: Which of it was kept back.
        before: Arm as drawn: frame, places and springs fitted.
        drawn: The drawing as corrected.
        springs: Stiffness of springs that the model has, in N m/rad, by axis: as
            fitted to the arm as drawn, and to the corrected one.
        estimates: Of every number but tables', with intervals, by effect and place.
        tables: Of uneven gears, by axis.
        waves: Of each table the largest wave that is clearly there, by axis.
        selected: How effects were chosen.
        named: Effects that are believed and whose numbers are clearly not zero, the
            one that matters most first.
        nominal: Residual of the arm as drawn, on all rows, in m.
        residual: What calibration leaves, on all rows, in m.
        used: Coefficients settled for each coordinate that was fitted.
        at_first: Whether neighbours agree before.
        at_last: Whether they do after.
    """

    readings: Readings
    regions: Regions
    before: Drawn
    drawn: Drawn
    springs: tuple[dict[str, float], ...]
    estimates: dict[Key, dict[str, Estimate]]
    tables: dict[str, Table]
    waves: dict[str, Wave]
    selected: Selected
    named: tuple[Key, ...]
    nominal: Float[np.ndarray, "rows 3"]
    residual: Float[np.ndarray, "rows 3"]
    used: float
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
    sprung = _sprung(readings.arm)
    plain = fitted(fit_on, redraw=False)
    before = whole_fit(readings, keep, plain, set(), sprung, highest)
    rigid = fitted(fit_on, redraw=True)
    stance = Stance.of(readings, rigid.drawn)
    some = candidates_of(stance, min(CHOOSING, highest))
    blocks = Blocks.of(rigid, stance, some, sprung)
    folds = normals_of(blocks, stance, regions.fold, regions.count)
    _, sizes = learnt(total_of(folds), blocks.band)
    chosen = selected(Judge(blocks, folds, sizes), said)
    said("drawing tables in full")
    wanted = {(blocks.owner[j], blocks.parameter[j]) for j in chosen.columns}
    del folds
    if not any(blocks.entry[j] >= 0 and blocks.owner[j] != SILENT
               for j in chosen.columns):  # fmt: skip
        rigid = RigidFit(before.drawn, rigid.kept)
    after = whole_fit(readings, keep, rigid, wanted, sprung, highest)
    full, known, x = after.blocks, after.known, after.fit.x
    numbers = np.flatnonzero(full.order[known] == 0)
    waves = largest_waves(full, known, x, WAVES)
    asked = [numbers, *(w.ravel() for w in waves.values())]
    region = np.where(keep, regions.region, -1)
    half = spread(
        full, after.stance, region, known, after.fit, after.sizes,
        np.concatenate(asked),
    )  # fmt: skip
    ends = np.cumsum([len(a) for a in asked])
    by_wave = zip(waves.items(), np.split(half, ends)[1:], strict=False)
    widths = dict(zip(numbers.tolist(), half.tolist(), strict=False))
    estimates = estimates_of(full, known, x, widths)
    clearest = {
        axis: wave_of(full, known, x, own, h.reshape(-1, 2))
        for (axis, own), h in by_wave
    }
    count = len(np.unique(regions.region[keep]))
    return Calibrated(
        readings=readings,
        regions=regions,
        before=before.drawn,
        drawn=after.drawn,
        springs=tuple(springs_of(f, readings.arm.stiffness) for f in (before, after)),
        estimates=estimates,
        tables=tables_of(full, known, x),
        waves=clearest,
        selected=chosen,
        named=tuple(named(chosen, estimates, clearest, count)),
        nominal=before.residual,
        residual=after.residual,
        used=after.used,
        at_first=agreement(before.residual, readings.posture),
        at_last=agreement(after.residual[~keep], readings.posture[~keep]),
    )


def _sprung(arm: Arm) -> set[Key]:
    """Return the springs that the model has: how stiff they are is no finding."""
    springs = enumerate(arm.stiffness)
    return {("joint_compliance", f"a{k + 1}") for k, s in springs if s > 0.0}
