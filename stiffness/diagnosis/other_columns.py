"""A wrench's columns can be in another order, of another sign, or of another row."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import permutations

import numpy as np

from bench.recording import Recording
from stiffness.diagnosis.diagnosis import Warned

WRENCH = ("fx_n", "fy_n", "fz_n", "tx_nm", "ty_nm", "tz_nm")
"""What the format calls the columns."""
MOVED = {
    (0, 3): "pulled along and turned about that axis alone, the arm moves against it",
    (0,): "pulled along that axis alone, the arm moves against it",
    (3,): "turned about that axis alone, the arm moves against it",
}
"""What is seen where a force and its moment, forces or moments are reversed."""
PARTS = tuple(MOVED)
"""What is in another order or of another sign together: first column of each part."""
ROWS = ((1, "the row before"), (-1, "the row after"))
"""By how many rows a wrench can come late, and whose it then is."""


def of_columns(some: Recording) -> Iterator[tuple[Warned, Recording]]:
    """List in which other orders and signs the columns may be meant.

    Args:
        some: With a wrench.
    """
    wrench = some.wrench
    assert wrench is not None
    orders = [order for order in permutations(range(3)) if order != (0, 1, 2)]
    for starts in PARTS:
        for order in orders:
            columns = np.arange(6)
            for start in starts:
                columns[start : start + 3] = start + np.array(order)
            yield _read_as(some, columns, _ordered(starts, order))
    text = "the moments look given before the forces: they fit the other way round."
    yield _read_as(some, np.array([3, 4, 5, 0, 1, 2]), text)
    for starts in PARTS:
        for i in range(3):
            sign = np.ones(6)
            sign[[start + i for start in starts]] = -1.0
            names = " and ".join(WRENCH[start + i] for start in starts)
            look = "look" if len(starts) > 1 else "looks"
            text = f"{names} {look} reversed: {MOVED[starts]}."
            warned = Warned("wrench_sign", "wrench_sensor", text)
            yield warned, replace(some, wrench=wrench * sign)


def of_rows(recording: Recording) -> Iterator[tuple[Warned, Recording]]:
    """List whose row's wrench may be meant.

    Args:
        recording: Whole, of plateaus, with a wrench.
    """
    for late, whose in ROWS:
        text = (
            f"the wrench looks one row off: it fits the deflections of {whose}. Shift "
            "its columns by one row against the markers'."
        )
        warned = Warned("wrench_rows", "wrench_sensor", text)
        assert recording.wrench is not None
        yield warned, replace(recording, wrench=np.roll(recording.wrench, -late, 0))


def _ordered(starts: tuple[int, ...], order: tuple[int, ...]) -> str:
    moved = [i for i in range(3) if order[i] != i]
    parts = [" and ".join(WRENCH[start + i] for i in moved) for start in starts]
    if len(moved) == 2:
        return f"{', '.join(parts)} look exchanged: they fit the other way round."
    read = ", ".join(WRENCH[start + i] for start in starts for i in order)
    said = ", ".join(WRENCH[start + i] for start in starts for i in range(3))
    return f"{said} look out of order: they fit when read from {read}."


def _read_as(
    some: Recording, columns: np.ndarray, text: str
) -> tuple[Warned, Recording]:
    assert some.wrench is not None
    warned = Warned("wrench_columns", "wrench_sensor", text)
    return warned, replace(some, wrench=some.wrench[:, columns])
