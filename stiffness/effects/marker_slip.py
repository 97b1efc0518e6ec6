"""Marker slip: a marker that sits elsewhere from one moment on.

==========  ==========================================================================
Equation    place on the body = place before + (x, y, z) from `time_s` on, along the
            body's axes
Source      a step in time; no source for its size
Valid       one step per marker, of those that do not wander along no law
Ignores     slow creep of the glue, its variants: 1 - exp(-(t - time_s)/T), and t;
            further steps of the same marker
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.effects.base import Coeffs, Hypothesis, Shape, Shapes, absolute, axes_of
from stiffness.effects.jacobian import EffectJacobian, MarkerDisplacement
from stiffness.experiment.static_state import StaticState

PREFIX = "marker:"
TIMES = 7
"""Number of times of a slip that are tried at first; chosen."""
SAGS = (0.03, 0.1, 0.3)
"""Time constants of a mark that sags instead of slipping, over the time that is left
from its slip on; chosen."""
EDGE = 0.05
"""Share of the visits at either end without tried times: a slip visible in a few visits
only is their own error; chosen."""


@dataclass(frozen=True)
class MarkerSlip(Hypothesis):
    """Marker that moved on its body between two visits."""

    effect: ClassVar[str] = "marker_slip"
    shape_names: ClassVar[tuple[str, ...]] = ("time_s",)
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        **dict.fromkeys(("x_m", "y_m", "z_m"), (-0.1, 0.1)),
        "time_s": (0.0, np.inf),
    }
    magnitudes: ClassVar[tuple[str, ...]] = ("x_m", "y_m", "z_m")

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        if not absolute(situation) or len(situation.steps) < 2:
            return ()
        markers = situation.recording.markers
        every = zip(markers, situation.wander, strict=True)
        return tuple(PREFIX + marker.name for marker, own in every if own == 0.0)

    @override
    def shapes(self, situation: StaticState, where: str) -> Shapes:
        begins = np.sort(situation.recording.time[situation.steps[:, 0]])[1:]
        edge = min(np.ceil(EDGE * len(begins)), (len(begins) - 1) // 2)
        chosen = np.linspace(edge, len(begins) - 1 - edge, TIMES).round()
        return begins[np.unique(chosen.astype(int)), None]

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        later = situation.recording.time >= shape[0]
        return _displacement(situation, where, later[:, None].astype(float))

    @override
    def variants(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        time = situation.recording.time
        sags = [sagged(time, shape[0], share) for share in SAGS]
        return _displacement(
            situation, where, np.stack([*sags, time / np.max(time)], axis=1)
        )

    @override
    def grain(self, situation: StaticState) -> Mapping[str, float]:
        begins = np.sort(situation.recording.time[situation.steps[:, 0]])
        return {"time_s": float(np.max(np.diff(begins), initial=0.0))}

    @override
    def parameters(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[str, float]:
        x, y, z = coefficients
        return {"x_m": x, "y_m": y, "z_m": z, "time_s": shape[0]}


def sagged(
    time: Float[np.ndarray, " times"], start: float, share: float
) -> Float[np.ndarray, " times"]:
    """Return the course of a mark that sags, from nothing towards one.

    Args:
        time: In s.
        start: When it begins, before the last time.
        share: Time constant over the time that is left then.
    """
    since, left = np.maximum(time - start, 0.0), np.max(time) - start
    return 1.0 - np.exp(-since / (share * left))


def _displacement(
    situation: StaticState, where: str, laws: Float[np.ndarray, "rows laws"]
) -> EffectJacobian:
    """Return a marker's displacement along its body's axes, by each law in turn."""
    names = [PREFIX + marker.name for marker in situation.recording.markers]
    m = names.index(where)
    axes = axes_of(situation, situation.recording.markers[m].body)
    columns = 3 * laws.shape[1]
    moved = laws[:, None, :, None] * axes[:, :, None, :]
    moved = moved.reshape(len(laws), 3, columns)
    return EffectJacobian(columns, (MarkerDisplacement(m, moved),))
