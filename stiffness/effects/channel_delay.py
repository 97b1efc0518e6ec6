"""Delay of one channel of a stream against the others.

==========  ==========================================================================
Equation    reading(t) = truth(t - delay) ≈ truth - delay d truth/dt
Source      Furgale, Rehder, Siegwart 2013, "Unified temporal and spatial calibration
            for multi-sensor systems"; to first order
Valid       delays short against the time scale of the motion
Ignores     jitter; inertia of the arm
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.effects.base import Hypothesis, Shape, sprung
from stiffness.effects.jacobian import (
    EffectJacobian,
    EncoderError,
    JacobianBlock,
    JointRotation,
    turn,
)
from stiffness.effects.statics import (
    from_sensor_axes,
    reading,
    torque_at_sensor,
    wind_up,
)
from stiffness.experiment.static_state import StaticState


@dataclass(frozen=True)
class ChannelDelay(Hypothesis):
    """Tracker, force sensor or encoder whose clock is late."""

    effect: ClassVar[str] = "channel_delay"
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        "delay_s": (-10.0, 10.0),
    }
    magnitudes: ClassVar[tuple[str, ...]] = ("delay_s",)

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        recording = situation.recording
        if recording.rows != "stream" or not has_time_series(situation):
            return ()
        moves = np.ptp(recording.posture, axis=0) > 0.0
        found = [a for a, m in zip(situation.axes, moves, strict=True) if m]
        if recording.markers and np.any(rate(situation, situation.rest)):
            found.append("tracker")
        if sprung(situation) and np.any(rate(situation, reading(situation))):
            found.append("wrench_sensor")
        return tuple(found)

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        if where == "wrench_sensor":
            return wind_up(situation, torque_at_sensor(situation, _later(situation)))
        if where != "tracker":
            k = situation.axis(where)
            return turn(k, rate(situation, situation.recording.posture)[:, k])
        speed = rate(situation, situation.rest)
        parts: list[JacobianBlock] = []
        for k in range(len(situation.axes)):
            parts += [
                JointRotation(k, -speed[:, k, None]),
                EncoderError(k, speed[:, k, None]),
            ]
        return EffectJacobian(1, tuple(parts))


def has_time_series(situation: StaticState) -> bool:
    """Return whether every visit has enough rows, all at different times."""
    time = situation.recording.time[situation.steps]
    again = np.diff(situation.steps, axis=1) == 0  # short visits repeat their last
    return time.shape[1] > 1 and bool(np.all((np.diff(time, axis=1) > 0.0) | again))


def rate(
    situation: StaticState, values: Float[np.ndarray, "rows channels"]
) -> Float[np.ndarray, "rows channels"]:
    """Return the rate of channels, per s, by differences within each visit."""
    speed = np.zeros_like(values)
    for visit in range(len(situation.steps)):
        rows = np.unique(situation.steps[visit])
        if len(rows) > 1:
            time = situation.recording.time[rows]
            speed[rows] = np.gradient(values[rows], time, axis=0)
    return speed


def _later(situation: StaticState) -> Float[np.ndarray, "rows 6 1"]:
    """Return the wrench's rate of change, as the axes that report it see it."""
    sensor = situation.recording.wrench_sensor
    if sensor is not None and sensor.frame == "base":
        return rate(situation, situation.wrench)[:, :, None]
    return from_sensor_axes(situation, rate(situation, reading(situation))[:, :, None])
