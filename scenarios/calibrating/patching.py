"""What calibration found is put into the simulator as mechanisms."""

import math

import numpy as np

from bench.patch import Patch
from bench.patch_effects import Named
from stiffness.calibration.calibrated import Calibrated
from stiffness.calibration.claims import Table
from stiffness.calibration.geometry import entries_of

FAINT = 1e-7
"""Amplitude in rad below which a wave is left away; chosen: 0.1 µm at a metre."""
FROM_SIDES = ("hysteresis",)
"""Effects that depend on where an axis came from; `proof` plays them as arrivals."""


def patch_of(found: Calibrated) -> Patch:
    """Return everything that was found; waves below a tenth of a µrad left away."""
    effects: list[Named] = []
    drawing: dict[tuple[str, str], dict[str, float | str | None]] = {}
    values = found.drawn.values
    for entry, value in zip(entries_of(found.readings.arm.chain), values, strict=True):
        if value != 0.0:
            own = drawing.setdefault((entry.effect, entry.where), {})
            own[entry.parameter] = float(value)
    effects += [Named(effect, where, own) for (effect, where), own in drawing.items()]
    for (effect, where), numbers in found.estimates.items():
        if (effect, where) not in drawing:
            known = {name: e.value for name, e in numbers.items()}
            effects.append(Named(effect, where, dict(known)))
    for axis, table in found.tables.items():
        effects += _waves(axis, table)
    names, places = found.readings.names, found.drawn.places
    return Patch(
        stiffness_nm_per_rad=dict(found.springs[1]),
        effects=tuple(effects),
        base_from_tracker=_rows(found.drawn.base_from_tracker),
        markers={n: _triple(p) for n, p in zip(names, places, strict=True)},
    )


def _waves(axis: str, table: Table) -> list[Named]:
    found = []
    for order, c, s in zip(table.order, table.cos, table.sin, strict=True):
        size = math.hypot(c, s)
        if size >= FAINT:
            wave = {"amplitude_rad": size, "order": float(order)}
            phase = {"phase_rad": math.atan2(c, s)}
            found.append(Named("transmission_error", axis, {**wave, **phase}))
    return found


def _rows(frame: np.ndarray) -> tuple:
    return tuple(tuple(float(x) for x in row) for row in frame)


def _triple(place: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in place)
    return x, y, z
