"""What can lie between two encoders of an axis, or seem to.

==========  ==========================================================================
Equation    channel_delay       after(t) = before(t − delay); what is left of it is
                                − delay speed
            joint_compliance    after = before − compliance torque
            motor_friction      a motor's torque holds friction that winds up nothing:
                                after = before − compliance (torque − friction);
                                friction = constant sign(speed), or a factor speed
            hysteresis          after = before − compliance torque + width / 2 z; z: see
                                `slipping`, of the torque less friction
            lost_motion         after = before − width / 2 sign(speed)
            transmission_error  after = before + a cos(order q) + b sin(order q)
Source      Furgale, Rehder, Siegwart 2013 (delay); Spong 1987 (wind-up); makers' lost
            motion between directions; Tuttle 1992 (uneven gears)
Valid       errors that are small; a delay that all axes share is taken exactly
Ignores     resonance, inertia of the gear itself
==========  ==========================================================================
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float

from stiffness.two_encoders.motions import Motion
from stiffness.two_encoders.slipping import stop

CREEPING = 1e-3
"""Speed in rad/s at which a direction is half decided; chosen."""
BREAKING = (1e-3, 3e-3, 1e-2, 3e-2)
"""The same of friction: how fast it turns round differs from motor to motor."""
SLIPS = (0.02, 0.04, 0.08, 0.16, 0.32, 0.64)
"""Torques at which a contact slips, in shares of the torque's largest swing."""
MANY = 5.0
"""How many standard deviations of the torque's noise a contact must hold; chosen."""
WOUND = "joint_compliance"
FRICTION = "motor_friction"
"""No finding: a torque told from a motor's current is not what winds up the gear."""


@dataclass(frozen=True)
class Term:
    """One candidate, with its number of columns.

    Attributes:
        effect: Name in the vocabulary, or `motor_friction`.
        parameters: Of its columns.
        least: Smallest value that its coefficient can have.
        order: Of a wave; 0 for the others.
        shape: Of friction: the speed at which it turns round, in rad/s. Of hysteresis:
            torque at which it slips, the friction that is taken off first, both in
            N m, friction's factor on speed in N m s/rad, its speed in rad/s.
    """

    effect: str
    parameters: tuple[str, ...]
    least: float = -np.inf
    order: float = 0.0
    shape: tuple[float, ...] = ()

    def columns(self, motion: Motion) -> Float[np.ndarray, "rows columns"]:
        """Return how it moves the second encoder, per unit, mean taken off."""
        return _columns(self, motion)


@lru_cache(maxsize=128)
def _columns(term: Term, motion: Motion) -> Float[np.ndarray, "rows columns"]:
    if term.order:
        phase = term.order * motion.angle
        found = np.stack([np.cos(phase), np.sin(phase)], axis=1)
    else:
        found = _plain(term, motion)[:, None]
    return found - found.mean(axis=0)


def _plain(term: Term, motion: Motion) -> Float[np.ndarray, " rows"]:
    if term.effect == "channel_delay":
        return -motion.speed
    if term.effect == "lost_motion":
        return -0.5 * np.tanh(motion.speed / CREEPING)
    assert motion.torque is not None
    if term.effect == WOUND:
        return -motion.torque
    if term.effect == FRICTION:
        return motion.smooth(
            np.tanh(motion.speed / term.shape[0]) if term.shape else motion.speed
        )
    slip, constant, factor, breaking = term.shape
    lost = constant * np.tanh(motion.speed / breaking) + factor * motion.speed
    return 0.5 * stop(motion.torque - motion.smooth(lost), slip)


LATE = Term("channel_delay", ("delay_s",))


def plain_terms(
    motions: tuple[Motion, ...], known: tuple[Term, ...] = ()
) -> tuple[Term, ...]:
    """Return the candidates that are neither waves nor delays.

    Contacts are looked for in a torque that was measured alone: a load that a model
    does not know would pass for them.

    Args:
        motions: Of one axis.
        known: What was believed of it.
    """
    found = [Term("lost_motion", ("width_rad",), 0.0)]
    if all(m.torque is not None and np.ptp(m.torque) > 0.0 for m in motions):
        found += [Term(WOUND, ("compliance_rad_per_nm",), 0.0)]
    if any(t.effect == WOUND for t in known) and all(m.measured for m in motions):
        found += [Term(FRICTION, ("friction_rad",), 0.0, shape=(v,)) for v in BREAKING]
        found += [Term(FRICTION, ("friction_s",), 0.0)]
        swing = max(0.5 * float(np.ptp(m.torque)) for m in motions)  # type: ignore[arg-type]
        least = least_slip(motions)
        found += [
            Term("hysteresis", ("width_rad",), 0.0, shape=(s * swing, 0.0, 0.0, 1.0))
            for s in SLIPS
            if s * swing >= least
        ]
    have = {(t.effect, t.parameters) for t in known if t.effect != "hysteresis"}
    return tuple(t for t in found if (t.effect, t.parameters) not in have)


def least_slip(motions: tuple[Motion, ...]) -> float:
    """Return the least torque that can slip and be no noise of the torque, in N m."""
    return MANY * max(m.scatter for m in motions)


def usual_friction() -> tuple[Term, ...]:
    """Return friction that is constant and friction that grows with speed."""
    constant = Term(FRICTION, ("friction_rad",), 0.0, shape=(BREAKING[-2],))
    return constant, Term(FRICTION, ("friction_s",), 0.0)


def wave(order: float) -> Term:
    """Return a wave of an uneven gear."""
    return Term("transmission_error", ("cos_rad", "sin_rad"), order=float(order))
