"""Angles can be read in other ways: other signs, orders, zeros, units.

A reading is a way to take them as somebody may have meant them who wrote the file
otherwise than the format asks.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from stiffness.diagnosis.diagnosis import Warned

TRAVEL = np.radians(3.0)
"""Least range of an axis whose sign or order can be doubted, in rad (m where it
slides); chosen: an offset of half of it would be an error of the arm, not of a file."""
OFFSETS = (90.0, -90.0, 180.0)
"""Degrees by which makers count an axis from different zeros; chosen."""


@dataclass(frozen=True)
class Angles:
    """Another way to read the axes' angles.

    Attributes:
        warned: What to say if it is the right one.
        meant: Turns postures as written, (rows, axes), into those meant.
    """

    warned: Warned
    meant: Callable[[np.ndarray], np.ndarray]


def of_angles(posture: np.ndarray, slides: np.ndarray) -> Iterator[Angles]:
    """List how else the angles may be meant.

    Args:
        posture: As written.
        slides: Whether each axis slides.
    """
    axes = range(posture.shape[1])
    travel = np.ptp(posture, axis=0)
    for k in axes:
        if travel[k] > TRAVEL:
            text = f"a{k + 1} looks reversed: it fits the readings with the other sign."
            yield Angles(
                Warned("axis_reversed", f"a{k + 1}", text), _scaled(axes, [k], -1.0)
            )
    for i, j in combinations(axes, 2):
        apart = posture[:, i] - posture[:, j]
        if slides[i] == slides[j] and np.ptp(apart) > TRAVEL:
            text = f"a{i + 1} and a{j + 1} look swapped: they fit the other way round."
            order = list(axes)
            order[i], order[j] = j, i
            yield Angles(Warned("axis_order", f"a{i + 1}", text), _ordered(order))
    count = len(axes)
    if count > 2 and len(set(slides.tolist())) == 1:
        for order in (
            list(reversed(axes)),
            [*axes[1:], 0],
            [count - 1, *axes[: count - 1]],
        ):
            said = ", ".join(f"a{k + 1}" for k in order)
            text = f"the axes look out of order: they fit when read as {said}."
            yield Angles(Warned("axis_order", "a1", text), _ordered(order))
    turning = np.flatnonzero(~slides).tolist()
    yield from _in_units(travel, turning, np.flatnonzero(slides).tolist())
    for k in turning:
        for offset in OFFSETS:
            text = (
                f"a{k + 1} looks counted from another zero: it fits with "
                f"{offset:+.0f}° added."
            )
            yield Angles(
                Warned("axis_zero", f"a{k + 1}", text), _shifted(k, np.radians(offset))
            )


def _in_units(
    travel: np.ndarray, turning: list[int], sliding: list[int]
) -> Iterator[Angles]:
    """List in which units all axes may be meant, or one unlike the others."""
    axes = range(len(travel))
    for factor, words in (
        (180 / np.pi, "radians where degrees are expected"),
        (np.pi / 180, "degrees that were taken for radians"),
    ):
        text = f"axis angles look like {words}: they fit times {factor:.4g}."
        yield Angles(Warned("units", "axes", text), _scaled(axes, turning, factor))
    for k in turning:
        for factor, words in (
            (180 / np.pi, "its radians were taken for degrees"),
            (np.pi / 180, "its degrees were taken for radians"),
        ):
            if travel[k] * abs(factor - 1.0) > TRAVEL:
                text = (
                    f"a{k + 1} looks as if {words}, unlike the others: it fits times "
                    f"{factor:.4g}. Check the unit in the mapping or the file."
                )
                one = _scaled(axes, [k], factor)
                yield Angles(Warned("units", f"a{k + 1}", text), one)
    for factor, words in ((1e3, "m where mm are expected"), (1e-3, "µm, not mm")):
        if sliding:
            text = f"axes that slide look given in {words}: they fit times {factor:g}."
            yield Angles(Warned("units", "axes", text), _scaled(axes, sliding, factor))


def of_signs(posture: np.ndarray) -> Iterator[tuple[tuple[Warned, ...], np.ndarray]]:
    """List postures with two axes or more reversed, and what to say of each."""
    axes = [k for k in range(posture.shape[1]) if np.ptp(posture[:, k]) > TRAVEL]
    for count in range(2, len(axes) + 1):
        for some in combinations(axes, count):
            said = " and ".join(f"a{k + 1}" for k in some)
            text = f"{said} look reversed: they fit with the other signs."
            sign = np.ones(posture.shape[1])
            sign[list(some)] = -1.0
            warned = tuple(Warned("axis_reversed", f"a{k + 1}", text) for k in some)
            yield warned, posture * sign


def _scaled(axes: range, some: list[int], factor: float):
    scale = np.ones(len(axes))
    scale[some] = factor
    return lambda posture: posture * scale


def _ordered(order: list[int]):
    return lambda posture: posture[:, order]


def _shifted(axis: int, offset: float):
    return lambda posture: posture + offset * (np.arange(posture.shape[1]) == axis)
