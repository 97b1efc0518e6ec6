"""A coupling joins neighbouring axes: the wrist's gears, or the first axes' frames."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bench.effects.effect import Effect
from bench.effects.wrist_coupling import WristCoupling
from bench.outsiders.axis_crosstalk import AxisCrosstalk


def partners_of(kind: type[Effect], turning: Sequence[str]) -> dict[str, Sequence[str]]:
    """Return which axes a coupling can join, by where it sits; empty for no coupling.

    Args:
        kind: Of effect.
        turning: The arm's axes that turn, from the base on.
    """
    if kind is WristCoupling:
        first, second, third = turning[-3:]
    elif kind is AxisCrosstalk:
        first, second, third = turning[:3]
    else:
        return {}
    return {second: (first,), third: (first, second)}


def coupled(
    effect: Effect, draw: np.random.Generator, partners: Sequence[str]
) -> Effect:
    """Draw which axis turns another, and which way."""
    partner = str(draw.choice(partners))
    sign = float(draw.choice([-1.0, 1.0]))
    size = sign * effect.parameters()["compliance_rad_per_nm"]  # type: ignore[operator]
    return replace(effect, with_axis=partner, compliance_rad_per_nm=size)
