"""What can lie between two encoders of an axis, or seem to.

==========  ==========================================================================
Equation    channel_delay       after(t) = before(t − delay) ≈ before − delay speed
            joint_compliance    after = before − compliance torque, or
                                after = before − compliance (torque − friction
                                sign(speed)): what of the motor's torque gets through
            lost_motion         after = before − width / 2 sign(speed)
            transmission_error  after = before + a cos(order q) + b sin(order q)
Source      Furgale, Rehder, Siegwart 2013 (delay); Spong 1987 (wind-up); makers' lost
            motion between directions; Tuttle 1992 (uneven gears)
Valid       delays and errors that are small; torque of the motor, friction included
Ignores     resonance, inertia of the gear itself
==========  ==========================================================================
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from stiffness.two_encoders.motions import Motion

ORDERS = np.arange(1.0, 1025.0, 0.5)
"""Waves per turn of the axis that are looked for; chosen: four times a gear of 256."""
CREEPING = 1e-3
"""Speed in rad/s at which a direction is half decided; chosen."""
FEWEST_TURNS = 1.0
"""Periods of a wave that every motion must pass through."""


@dataclass(frozen=True)
class Term:
    """One candidate, with its number of columns.

    Attributes:
        effect: Name in the vocabulary.
        parameters: Of its columns.
        least: Smallest value that its coefficient can have.
        order: Of a wave; 0 for the others.
    """

    effect: str
    parameters: tuple[str, ...]
    least: float = -np.inf
    order: float = 0.0

    def columns(self, motion: Motion) -> Float[np.ndarray, "rows columns"]:
        """Return how it moves the second encoder, per unit, mean taken off."""
        if self.order:
            phase = self.order * motion.angle
            found = np.stack([np.cos(phase), np.sin(phase)], axis=1)
        elif self.effect == "channel_delay":
            found = -motion.speed[:, None]
        elif self.effect == "lost_motion":
            found = -0.5 * np.tanh(motion.speed / CREEPING)[:, None]
        else:
            assert motion.torque is not None
            found = -motion.torque[:, None]
            if len(self.parameters) == 2:
                lost = np.tanh(motion.speed / CREEPING)[:, None]
                found = np.concatenate([found, lost], axis=1)
        return found - found.mean(axis=0)


def plain_terms(motions: tuple[Motion, ...]) -> tuple[Term, ...]:
    """Return the candidates that are no waves."""
    found = [
        Term("channel_delay", ("delay_s",)),
        Term("lost_motion", ("width_rad",), 0.0),
    ]
    if all(m.torque is not None and np.ptp(m.torque) > 0.0 for m in motions):
        names = ("compliance_rad_per_nm", "friction_rad")
        found += [Term("joint_compliance", names[:1], 0.0)]
        found += [Term("joint_compliance", names, 0.0)]
    return tuple(found)


def wave(order: float) -> Term:
    """Return a wave of an uneven gear."""
    return Term("transmission_error", ("cos_rad", "sin_rad"), order=float(order))


def strongest_waves(
    motions: tuple[Motion, ...], left: tuple[Float[np.ndarray, " rows"], ...]
) -> tuple[Term, ...]:
    """Return, of each octave, the wave that takes most off what is left.

    Looked for in differences from row to row: what else is left changes slowly, and
    would pass for a wave where its own lies.
    """
    travel = min(float(np.ptp(m.angle)) for m in motions)
    orders = ORDERS[ORDERS * travel >= 2.0 * np.pi * FEWEST_TURNS]
    y = np.concatenate([np.diff(part) for part in left])
    gains = np.zeros(len(orders))
    for i, order in enumerate(orders):
        parts = [np.diff(wave(order).columns(m), axis=0) for m in motions]
        a = np.concatenate(parts)
        aim = a.T @ y
        gains[i] = aim @ np.linalg.solve(a.T @ a, aim)
    octave = np.floor(np.log2(orders)).astype(int)
    best = [
        np.flatnonzero(octave == o)[np.argmax(gains[octave == o])]
        for o in np.unique(octave)
    ]
    return tuple(wave(float(orders[i])) for i in best)
