"""Tabulated law of a gear: wind-up and loop width interpolated from a measured table.

==========  ==========================================================================
Equation    θ = τ/K + e(τ) with e straight between the table's torques and beyond them
            as at the last piece; where branches differ by w at zero torque,
            slipping springs in parallel give a loop of width w
Source      measured values, provided by the user; loop as in `hysteresis`
Valid       1/K + de/dτ > 0; a piece that falls short of it is given 2 % of 1/K
Ignores     rate and angle; e(0), which is an offset of the encoder
==========  ==========================================================================

A spring that engages where a piece ends changes the slope there by the difference in
stiffness to the next piece, negative where that is softer.
"""

from dataclasses import dataclass, replace
from typing import ClassVar

import mujoco
import numpy as np
from jaxtyping import Float
from typing_extensions import override

from bench.effects.effect import ModelEffect, assumed, size
from bench.effects.hysteresis import Hysteresis
from bench.effects.springs import NEVER, add_parallel
from bench.kinematic_chain import Anatomy
from bench.shared.errors import refuse

STEEPEST = 0.02
"""Minimum compliance of a piece over the axis' own; chosen: practically rigid."""


@dataclass(frozen=True)
class TabledLaw(ModelEffect):
    """Springs in parallel with the axis' own, each engaging at a knot of the table.

    Attributes:
        torque_nm: Increasing torques, in N m.
        wind_up_rad: Wind-up there beyond that of the axis' own spring, in rad.
        width_rad: Width of the loop at zero torque.
    """

    name: ClassVar[str] = "tabled_law"
    places: ClassVar[tuple[str, ...]] = ("axis",)
    torque_nm: tuple[float, ...] = assumed((-10.0, 0.0, 10.0))
    wind_up_rad: tuple[float, ...] = assumed((0.0, 0.0, 0.0))
    width_rad: float = size(0.0, 0.0)

    def __post_init__(self):
        """Check the table."""
        super().__post_init__()
        table = np.array([*self.torque_nm, *self.wind_up_rad])
        faults = []
        if len(self.torque_nm) != len(self.wind_up_rad) or len(self.torque_nm) < 2:
            faults.append("a table needs two torques or more, a wind-up for each.")
        elif not np.all(np.isfinite(table)) or np.any(np.diff(self.torque_nm) <= 0):
            faults.append("torques must increase, and all numbers be finite.")
        refuse(f"Law at {self.where!r}", faults)

    @override
    def off(self) -> "TabledLaw":
        nothing = (0.0,) * len(self.wind_up_rad)
        return replace(self, wind_up_rad=nothing, width_rad=0.0)

    @override
    def build(self, spec: mujoco.MjSpec, arm: Anatomy) -> None:
        axis = arm.axis(self.where)
        own = float(spec.joint(axis).stiffness[0])
        if any(self.wind_up_rad):
            knots, slopes = self.pieces(own)
            zero = int(np.searchsorted(knots, 0.0))
            name = f"{axis}_table"
            jumps = np.diff(slopes)
            for i in range(zero):  # knots below zero carry on their far side
                slack = (float(knots[i]), NEVER)
                extra = -float(jumps[i])
                add_parallel(spec, f"{name}_{i}", axis, extra, slack=slack)
            for i in range(zero, len(knots)):
                slack = (-NEVER, float(knots[i]))
                extra = float(jumps[i])
                add_parallel(spec, f"{name}_{i}", axis, extra, slack=slack)
            add_parallel(spec, f"{name}_middle", axis, float(slopes[zero]) - own)
        if self.width_rad > 0.0:
            Hysteresis(self.where, width_rad=self.width_rad).build(spec, arm)

    def pieces(
        self, own: float
    ) -> tuple[Float[np.ndarray, " knots"], Float[np.ndarray, " pieces"]]:
        """Return where the slope of τ over θ changes, in rad, and the slopes, N m/rad.

        `own` is the stiffness of the axis' own spring, in N m/rad.
        """
        torque = np.array(self.torque_nm)
        slope = 1.0 / own + np.diff(self.wind_up_rad) / np.diff(torque)
        slope = np.maximum(slope, STEEPEST / own)
        inner = torque[1:-1]
        edges = np.concatenate([[-np.inf], inner, [np.inf]])
        knots = np.array([_wound(t, edges, slope) for t in inner])
        return knots, 1.0 / slope


def _wound(torque: float, edges: np.ndarray, slope: np.ndarray) -> float:
    """Return the integral of a piecewise constant compliance from 0 to a torque."""
    low, high = min(torque, 0.0), max(torque, 0.0)
    share = np.clip(np.minimum(edges[1:], high) - np.maximum(edges[:-1], low), 0, None)
    return float(np.sign(torque) * np.sum(share * slope))
