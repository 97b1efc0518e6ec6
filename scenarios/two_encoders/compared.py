"""The second encoders of a stream are predicted on a motion that nothing was fitted to.

Delays are played as what they are: the simulator is given the angles of a moment ago,
to first order, as the term has it.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from bench.patch import Patch, rig_of
from bench.patch_effects import Named
from bench.recording import Recording
from stiffness.two_encoders.judging import Between, between, shared_delay
from stiffness.two_encoders.motions import Motion, motions_of

WINDOW = 0.1
"""Seconds that are averaged beside the full rate; chosen: gear ripple is faster."""


@dataclass(frozen=True)
class Axis:
    """One axis, what lies between its encoders, and the proof.

    Attributes:
        name: a1, a2 …
        fitted: Motions that were fitted.
        judged: The last motion, that was not.
        found: What was believed and what was refused.
        after: What the simulator leaves of the judged motion, in rad.
    """

    name: str
    fitted: tuple[Motion, ...]
    judged: Motion
    found: Between
    after: Float[np.ndarray, " rows"]

    @property
    def before(self) -> Float[np.ndarray, " rows"]:
        """What a rigid gear leaves of the judged motion, in rad."""
        return self.judged.apart


def compared(recording: Recording, model: Path) -> tuple[Axis, ...]:
    """Fit all motions but the last, and simulate the last one.

    Raises:
        Unusable: Where an axis was not read twice in three motions, or none was.
    """
    motions = motions_of(recording)
    fit = [own[:-1] for own in motions.values()]
    axes = []
    for i, (k, own) in enumerate(motions.items()):
        found = between(fit[i], shared_delay(fit, i))
        left = _simulated(recording, model, k, own[-1], found)
        axes.append(Axis(f"a{k + 1}", fit[i], own[-1], found, left))
    return tuple(axes)


def patch_of(name: str, found: Between) -> Patch:
    """Return the gear's mechanisms; a delay is the stream's, not the gear's."""
    effects, i = [], 0
    for term in found.terms:
        own = found.x[i : i + len(term.parameters)]
        i += len(own)
        if term.order:
            size, phase = np.hypot(*own), np.arctan2(own[0], own[1])
            known: dict[str, float | str | None] = {
                "amplitude_rad": float(size),
                "order": term.order,
                "phase_rad": float(phase),
            }
            effects.append(Named("transmission_error", name, known))
    return Patch(effects=tuple(effects))


def rms(left: Float[np.ndarray, " rows"], time: Float[np.ndarray, " rows"]) -> float:
    """Return the root of the mean square of means over a window, in rad."""
    part = np.floor((time - time[0]) / WINDOW + 1e-9).astype(int)
    means = np.bincount(part, left) / np.bincount(part)
    return float(np.sqrt(np.mean((means - means.mean()) ** 2)))


def whole_rms(left: Float[np.ndarray, " rows"]) -> float:
    """Return the root of the mean square of all rows, in rad."""
    return float(np.sqrt(np.mean((left - left.mean()) ** 2)))


def _simulated(
    recording: Recording, model: Path, axis: int, motion: Motion, found: Between
) -> Float[np.ndarray, " rows"]:
    rows = np.flatnonzero(np.isin(recording.time, motion.time))
    bare = rig_of(Patch(), model).anatomy.axes
    order = [bare.index(name) for name in recording.axes] or list(range(len(bare)))
    own = order[axis]
    rig = rig_of(patch_of(f"a{own + 1}", found), model)
    delay, width, give, friction = _plain(found)
    posture = np.zeros((len(rows), len(bare)))
    posture[:, order] = recording.posture[rows]
    asked = posture[:, own] - delay * motion.speed
    asked -= (0.5 * width - friction) * np.tanh(motion.speed / 1e-3)
    if motion.torque is not None:
        asked -= give * motion.torque  # what the motor winds up; no load is simulated
    posture[:, own] = asked
    still = np.zeros((len(rows), 1, 6))
    states = rig.respond(posture, still, np.full((len(rows), 1), 1e-3))
    left = motion.apart + motion.angle - states.axis_angle[:, own]
    return left - left.mean()


def _plain(found: Between) -> tuple[float, float, float, float]:
    """Return delay in s, play in rad, compliance in rad/(N m), friction's in rad."""
    names = [name for term in found.terms for name in term.parameters]
    values = dict(zip(names, found.x.tolist(), strict=True))
    wanted = ("delay_s", "width_rad", "compliance_rad_per_nm", "friction_rad")
    delay, width, give, friction = (values.get(name, 0.0) for name in wanted)
    return delay, width, give, friction
