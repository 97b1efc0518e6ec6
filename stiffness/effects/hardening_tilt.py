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

from stiffness.effects.base import Coeffs, Hypothesis, Shape, Shapes
from stiffness.effects.bearing_tilt import BearingTilt, across
from stiffness.effects.hardening import bent
from stiffness.effects.jacobian import EffectJacobian, rotate
from stiffness.experiment.static_state import StaticState

LINEAR = BearingTilt()
CENTRES = (-0.2, 0.0, 0.2)
"""Centres that are tried, in m; chosen: an arm's bearing lies nearer."""
PIECES = ((0.0, 0.06), (0.0, 0.25), (0.4, 0.25), (0.4, 0.6))
"""Ratios of compliance, each with moment_nm over the largest moment across the axis;
chosen: a play, and rollers that give way, as of a gear."""
LEAST = 1e-9
"""Least moment_nm, of an axis that is never loaded."""


@dataclass(frozen=True)
class HardeningTilt(Hypothesis):
    """A hinge that tilts less per moment the larger the moment is."""

    effect: ClassVar[str] = BearingTilt.effect
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
    magnitudes: ClassVar[tuple[str, ...]] = BearingTilt.magnitudes

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        return LINEAR.places(situation)

    @override
    def shapes(self, situation: StaticState, where: str) -> Shapes:
        seat, moment, _ = across(situation, where, 0.0)
        largest = float(np.max(np.abs(np.einsum("rij,ri->rj", seat, moment))))
        return np.array(
            [(c, ratio, k * largest) for c in CENTRES for ratio, k in PIECES]
        )

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        seat, moment, centre = across(situation, where, shape[0])
        about = hardened(np.einsum("rij,ri->rj", seat, moment), shape)
        tilt = rotate(situation.axis(where) + 1, seat * about[:, None, :], centre)
        return EffectJacobian(2, (tilt,))

    @override
    def variants(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        """Return rollers that the whole moment loads, a smooth law, and askew tilts."""
        seat, moment, centre = across(situation, where, shape[0])
        about = np.einsum("rij,ri->rj", seat, moment)
        whole = np.linalg.norm(about, axis=1, keepdims=True)
        least = max(float(shape[2]), LEAST)
        share = bent(whole, least) / np.maximum(whole, LEAST)
        smooth = least * np.arctan(about / least)
        laws = [about * share, smooth, hardened(about, shape)[:, ::-1]]
        columns = [seat * law[:, None, :] for law in laws[:2]]
        askew = np.einsum("rij,rj->ri", seat, laws[2])[:, :, None]
        rotation = np.concatenate([*columns, askew], axis=2)
        tilt = rotate(situation.axis(where) + 1, rotation, centre)
        return EffectJacobian(rotation.shape[2], (tilt,))

    @override
    def parameters(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[str, float]:
        linear = LINEAR.parameters(situation, where, shape[:1], coefficients)
        return {**linear, "compliance_ratio": shape[1], "moment_nm": shape[2]}


def hardened(
    moment: Float[np.ndarray, "*rows"], shape: Shape
) -> Float[np.ndarray, "*rows"]:
    """Return moments that tilt as much without any hardening, in N m."""
    ratio, knee = float(shape[1]), max(float(shape[2]), LEAST)
    return ratio * moment + (1.0 - ratio) * bent(moment, knee)
