"""Tilt of a joint bearing that grows stiffer with the moment, as play is taken up.

==========  ==========================================================================
Equation    as `bearing_tilt`, each moment m across the axis as s m + (1 - s) c(m), c =
            m up to moment_nm, moment_nm beyond, rounded over a tenth of it; s =
            compliance_ratio
Source      contact stiffness of rollers that grows with their load (Hertz 1881), in two
            pieces as a gear's hardening; s = 0: a play that small moments take up
Valid       as `bearing_tilt`; s between 0 and 1, the same in both directions
Ignores     what the moment about one direction changes about the other (its variant)
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.effects.base import Coeffs, Shape, Shapes
from stiffness.effects.bearing_tilt import BearingTilt, across
from stiffness.effects.hardening import LEAST, bent
from stiffness.effects.jacobian import EffectJacobian, rotation_about
from stiffness.experiment.static_state import StaticState

CENTRES = (-0.2, 0.0, 0.2)
"""Centres that are tried, in m; chosen: an arm's bearing lies nearer."""
PIECES = ((0.0, 0.06), (0.0, 0.25), (0.4, 0.25), (0.4, 0.6))
"""Ratios of compliance, each with moment_nm over the largest moment across the axis;
chosen: a play, and rollers that give way, as of a gear."""


@dataclass(frozen=True)
class HardeningTilt(BearingTilt):
    """A hinge that tilts less per moment the larger the moment is."""

    linear: ClassVar[bool] = False
    shape_names: ClassVar[tuple[str, ...]] = (
        *BearingTilt.shape_names,
        "compliance_ratio",
        "moment_nm",
    )
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        **BearingTilt.limits,
        "compliance_ratio": (0.0, 1.0),
        "moment_nm": (0.0, np.inf),
    }

    @override
    def shapes(self, situation: StaticState, where: str) -> Shapes:
        _, about, _ = across(situation, where, 0.0)
        largest = float(np.max(np.abs(about)))
        return np.array(
            [(c, ratio, k * largest) for c in CENTRES for ratio, k in PIECES]
        )

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        seat, about, centre = across(situation, where, shape[0])
        rotation = seat * hardened(about, shape)[:, None, :]
        return rotation_about(situation.axis(where) + 1, rotation, centre)

    @override
    def variants(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        """Return rollers that the whole moment loads, a smooth law, and askew tilts."""
        seat, about, centre = across(situation, where, shape[0])
        knee = max(float(shape[2]), LEAST)
        size = np.linalg.norm(about, axis=1, keepdims=True)
        whole = about * (bent(size, knee) / np.maximum(size, LEAST))
        smooth = knee * np.arctan(about / knee)
        crossed = hardened(about, shape)[:, ::-1]
        askew = np.einsum("rij,rj->ri", seat, crossed)[:, :, None]
        columns = [seat * law[:, None, :] for law in (whole, smooth)]
        rotation = np.concatenate([*columns, askew], axis=2)
        return rotation_about(situation.axis(where) + 1, rotation, centre)

    @override
    def parameters(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[str, float]:
        linear = super().parameters(situation, where, shape[:1], coefficients)
        return {**linear, "compliance_ratio": shape[1], "moment_nm": shape[2]}


def hardened(
    moment: Float[np.ndarray, "*rows"], shape: Shape
) -> Float[np.ndarray, "*rows"]:
    """Return moments that tilt as much without any hardening, in N m."""
    ratio, knee = float(shape[1]), max(float(shape[2]), LEAST)
    return ratio * moment + (1.0 - ratio) * bent(moment, knee)
