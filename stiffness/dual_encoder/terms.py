"""Terms between two encoders: compliance, friction, hysteresis, delay, harmonics.

Stop operator of friction inside a gear (`stop`):

==========  ==========================================================================
Equation    wind-up = C τ - w/2 z; z in -1 … 1, |dz| = |dτ| / slip until it slips
Source      Visintin 1994, "Differential Models of Hysteresis", chapter III (stop);
            several add up (Iwan 1966)
Valid       slow loads; rate-independent
Ignores     the state of the contact when a motion began: taken as slack
==========  ==========================================================================

Candidate terms (`Term`, `plain_terms`):

==========  ==========================================================================
Equation    channel_delay       after(t) = before(t − delay); its correction is
                                − delay speed
            joint_compliance    after = before − compliance torque
            motor_friction      a motor's torque includes friction without wind-up:
                                after = before − compliance (torque − friction);
                                friction = constant sign(speed), or a factor speed
            hysteresis          after = before − compliance torque + width / 2 z; z: see
                                `stop`, of the torque less friction
            lost_motion         after = before − width / 2 sign(speed)
            reading_lag         after = before + lag sign(speed): the report of the
                                first encoder lags; one that leads looks like play.
                                Its other law, by share of a move, has no column: one
                                axis alone has a share of ±1, and what lags in
                                proportion to speed is a channel_delay
            transmission_error  after = before + a cos(order q) + b sin(order q)
Source      Furgale, Rehder, Siegwart 2013 (delay); Spong 1987 (wind-up); makers' lost
            motion between directions; Tuttle 1992 (transmission error)
Valid       errors that are small; a delay that all axes share is taken exactly
Ignores     resonance, inertia of the gear itself
==========  ==========================================================================

Search for waves of transmission error over all orders (`strongest_waves`):

==========  ==========================================================================
Equation    gain of an order = |A' y|² / |A|², A the wave with the known columns
            projected out, y the residual; for waves of many periods also in
            differences from row to row, which suppress slow errors
Source      Lomb 1976 (periodogram of uneven samples)
Valid       orders in half steps
Ignores     angles between 2^17 bins per double turn: 0.05 rad of the fastest wave
==========  ==========================================================================
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Complex, Float

from stiffness.dual_encoder.motions import Motion

# --- Slip of friction -----------------------------------------------------------------


def stop(torque: Float[np.ndarray, " rows"], slip: float) -> Float[np.ndarray, " rows"]:
    """Return the stop operator of a torque, in -1 … 1.

    Torques are in N m, in order of time; `slip` is from the middle to the slip limit.
    """
    state, found = 0.0, []
    for change in np.diff(torque, prepend=torque[0]).tolist():
        state = min(slip, max(-slip, state + change))
        found.append(state)
    return np.array(found) / slip


# --- Terms ----------------------------------------------------------------------------

CREEPING = 1e-3
"""Speed in rad/s at which the smoothed sign function reaches half; chosen."""
BREAKING = (1e-3, 3e-3, 1e-2, 3e-2)
"""The same of friction: how fast it reverses differs from motor to motor."""
SLIPS = (0.02, 0.04, 0.08, 0.16, 0.32, 0.64)
"""Torques at which a contact slips, as shares of the torque's largest swing."""
MANY = 5.0
"""Minimum friction of a contact in standard deviations of the torque's noise;
chosen."""
SIDES = {"lost_motion": -0.5, "reading_lag": 1.0}
"""Effects that follow the direction alone, opposite ways: what each unit does."""
WIDTHS = {
    "hysteresis": "width_rad",
    "lost_motion": "width_rad",
    "reading_lag": "lag_rad",
}
"""Effects of one size, and what it is called."""
WOUND = "joint_compliance"
FRICTION = "motor_friction"
"""A nuisance term: torque from a motor's current includes friction that winds up no
gear."""


@dataclass(frozen=True)
class Term:
    """One candidate term, with its parameters and bounds.

    Attributes:
        effect: Name in the vocabulary, or `motor_friction`.
        parameters: Name of the parameter of each column.
        least: Lower bound of its coefficient.
        order: Order of a wave; 0 for the others.
        shape: Of friction: the speed at which it reverses, in rad/s. Of hysteresis:
            slip torque, the friction that is subtracted first, both in N m,
            viscous friction in N m s/rad, its reversal speed in rad/s.
    """

    effect: str
    parameters: tuple[str, ...]
    least: float = -np.inf
    order: float = 0.0
    shape: tuple[float, ...] = ()

    def columns(self, motion: Motion) -> Float[np.ndarray, "rows columns"]:
        """Return the second encoder's displacement per unit, mean subtracted."""
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
    if term.effect in SIDES:
        return SIDES[term.effect] * np.tanh(motion.speed / CREEPING)
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


DELAY = Term("channel_delay", ("delay_s",))


def plain_terms(
    motions: tuple[Motion, ...], known: tuple[Term, ...] = ()
) -> tuple[Term, ...]:
    """Return the candidate terms that are neither waves nor delays.

    Hysteresis is searched for only in a measured torque: a load that a model does not
    include would mimic it. Where a measured torque winds the gear up, its constant
    friction does what a lag of the report would, and every motor has friction.
    """
    found, friction = [Term("lost_motion", ("width_rad",), 0.0)], False
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
        friction = True
    if not friction:
        found.append(Term("reading_lag", ("lag_rad",), 0.0))
    if any(t.effect in SIDES for t in known):
        found = [t for t in found if t.effect not in SIDES]
    have = {(t.effect, t.parameters) for t in known if t.effect != "hysteresis"}
    return tuple(t for t in found if (t.effect, t.parameters) not in have)


def least_slip(motions: tuple[Motion, ...]) -> float:
    """Return the least slip torque that exceeds noise of the torque, in N m."""
    return MANY * max(m.scatter for m in motions)


def usual_friction() -> tuple[Term, ...]:
    """Return terms of constant and of viscous friction."""
    constant = Term(FRICTION, ("friction_rad",), 0.0, shape=(BREAKING[-2],))
    return constant, Term(FRICTION, ("friction_s",), 0.0)


def wave(order: float) -> Term:
    """Return a wave of transmission error."""
    return Term("transmission_error", ("cos_rad", "sin_rad"), order=float(order))


# --- Harmonics ------------------------------------------------------------------------

ORDER_STEP = 0.5
ORDERS = np.arange(1.0, 1025.0, ORDER_STEP)
"""Waves per turn of the axis that are searched; chosen: four times a gear of 256."""
FEWEST_TURNS = 0.125
"""Minimum periods of a wave in every motion; chosen: less looks like a line."""
MANY_TURNS = 1.0
"""Periods from which a wave is searched in differences from row to row."""
PLACES = 2**17


def turns_of(term: Term, motions: tuple[Motion, ...]) -> float:
    """Return the minimum over motions of a wave's number of periods."""
    travel = min(float(np.ptp(m.angle)) for m in motions)
    return term.order * travel / (2.0 * np.pi)


def strongest_waves(
    motions: tuple[Motion, ...],
    residual: tuple[Float[np.ndarray, " _"], ...],
    known: tuple[Float[np.ndarray, "_ columns"], ...],
) -> tuple[Term, ...]:
    """Return the waves of each octave that reduce the residual most.

    Residuals are in rad.
    """
    turns = ORDERS * turns_of(wave(1.0), motions)
    slow = turns < MANY_TURNS
    gains = np.where(
        slow, _in_levels(motions, residual, known), _in_differences(motions, residual)
    )
    gains[turns < FEWEST_TURNS] = -np.inf
    octave = np.floor(np.log2(ORDERS)).astype(int) + 100 * slow
    best = [own[np.argmax(gains[own])] for own in _groups(octave)]
    return tuple(wave(float(ORDERS[i])) for i in sorted(best) if gains[i] > 0.0)


def _groups(number: np.ndarray) -> list[np.ndarray]:
    return [np.flatnonzero(number == n) for n in np.unique(number)]


def _in_levels(
    motions: tuple[Motion, ...],
    residual: tuple[np.ndarray, ...],
    known: tuple[np.ndarray, ...],
) -> Float[np.ndarray, " orders"]:
    """Return the gain of each order, known columns projected out."""
    count = known[0].shape[1]
    aim = np.zeros((len(ORDERS), 2))
    gram = np.zeros((len(ORDERS), 2, 2))
    across = np.zeros((len(ORDERS), 2, count))
    within = np.zeros((count, count))
    for m, y, a in zip(motions, residual, known, strict=True):
        rows = len(y)
        aim += _pair(_sums(m.angle, y))
        within += a.T @ a
        for k in range(count):
            across[:, :, k] += _pair(_sums(m.angle, a[:, k]))
        mean = _pair(_sums(m.angle, np.ones(rows)))
        double = _pair(_sums(2.0 * m.angle, np.ones(rows)))
        gram[:, 0, 0] += 0.5 * (rows + double[:, 0]) - mean[:, 0] ** 2 / rows
        gram[:, 1, 1] += 0.5 * (rows - double[:, 0]) - mean[:, 1] ** 2 / rows
        gram[:, 0, 1] += 0.5 * double[:, 1] - mean[:, 0] * mean[:, 1] / rows
    gram[:, 1, 0] = gram[:, 0, 1]
    own = np.trace(gram, axis1=1, axis2=2)
    if count:
        gram = gram - across @ np.linalg.pinv(within) @ across.transpose(0, 2, 1)
    gram = gram + 1e-9 * own[:, None, None] * np.eye(2)  # what only repeats the known
    return np.einsum("oi,oi->o", aim, np.linalg.solve(gram, aim[:, :, None])[:, :, 0])


def _in_differences(
    motions: tuple[Motion, ...], residual: tuple[np.ndarray, ...]
) -> Float[np.ndarray, " orders"]:
    """Return the gain of each order in differences from row to row."""
    aim = np.zeros((len(ORDERS), 2))
    size = np.zeros(len(ORDERS))
    for m, y in zip(motions, residual, strict=True):
        step = np.diff(y)
        aim += _pair(_sums(m.angle, -np.diff(step, prepend=0.0, append=0.0)))
        still = _sums(np.diff(m.angle), np.ones(len(step)))
        size += len(step) - np.real(still)
    return (aim**2).sum(axis=1) / np.maximum(size, 1e-12)


def _sums(
    angle: Float[np.ndarray, " rows"], weight: Float[np.ndarray, " rows"]
) -> Complex[np.ndarray, " orders"]:
    """Return the sums of weight exp(i order angle)."""
    place = np.round(angle / (4.0 * np.pi) * PLACES).astype(int) % PLACES
    turned = np.fft.rfft(np.bincount(place, weight, PLACES))
    return np.conj(turned[np.round(2.0 * ORDERS).astype(int)])


def _pair(sums: Complex[np.ndarray, " orders"]) -> Float[np.ndarray, "orders 2"]:
    return np.stack([np.real(sums), np.imag(sums)], axis=1)
