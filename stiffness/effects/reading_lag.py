"""Reading lag: the reported angle is not where the axis rests, along its last move.

==========  ==========================================================================
Equation    angle of the link = reported angle + lag m + wind-up; by one law m = s = ±1,
            the direction of the last move (in a stream: of the motion), by the other
            m = Δq / max_j |Δq_j|, the axis' share of that move; the load of a sensor
            beyond turns with it, as under `encoder_offset`
Source      first-order settling: read at t after an arrival at speed v, a drive of time
            constant T has v T exp(−t / T) still to go along its move, and the axes of a
            synchronised move arrive at speeds in proportion to their ways; ISO
            9283:1998 (position stabilisation)
Valid       lags that are alike at all visits, or at all moves of the same share;
            absolute readings, since it is constant within a visit with a load
Ignores     speed and length of the whole move; a settling that goes on between the
            readings of one visit; in readings of differences alone the change of lever
            arms, a thousandth of the deflection per milliradian
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from typing_extensions import override

from stiffness.effects.base import Coeffs, Hypothesis, Shape, Shapes, absolute
from stiffness.effects.jacobian import EffectJacobian, values, with_values
from stiffness.effects.statics import encoder_offset_response
from stiffness.experiment.static_state import StaticState

LAWS = ("lag_rad", "share_lag_rad")
"""Size of each law, in the order of the shape that chooses it."""


@dataclass(frozen=True)
class ReadingLag(Hypothesis):
    """Axis that is read before it rests.

    An axis that always arrives from the same side shows an encoder offset instead.
    """

    effect: ClassVar[str] = "reading_lag"
    shape_names: ClassVar[tuple[str, ...]] = ("law",)
    turns_load: ClassVar[bool] = True
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        "lag_rad": (-0.01, 0.01),
        "share_lag_rad": (-0.01, 0.01),
    }
    magnitudes: ClassVar[tuple[str, ...]] = ("lag_rad", "share_lag_rad")

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        if not absolute(situation):
            return ()
        side = situation.recording.side
        both = (side.max(axis=0) > 0.0) & (side.min(axis=0) < 0.0)
        return tuple(situation.axes[k] for k in np.flatnonzero(both))

    @override
    def shapes(self, situation: StaticState, where: str) -> Shapes:
        return np.arange(len(LAWS), dtype=float)[:, None]

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        k = situation.axis(where)
        moves = situation.recording.moves
        along = (moves.side, moves.share)[round(shape[0])][:, k, None]
        constant = encoder_offset_response(situation, k)
        parts = (with_values(p, along * values(p)) for p in constant.parts)
        return EffectJacobian(1, tuple(parts))

    @override
    def parameters(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[str, float]:
        return {LAWS[round(shape[0])]: coefficients[0]}
