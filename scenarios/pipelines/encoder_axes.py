"""Axes read on both sides of their gears, judged on a motion held out of the fit.

An axis that is read twice, what lies between its encoders, and what that leaves.

A spring that a model has is nominal: it is fitted silently within a decade.

The second encoders of a stream are predicted on a motion that nothing was fitted to.

The simulator is given the angles that the second encoder tells of, a delay being no
matter of the arm; its gears turn unevenly as named. What winds up under the motor's own
torque is added to what it says: the simulator stands still and cannot make that torque.
A spring that the model has is nominal: it is fitted silently over a decade either way.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from bench.patch import Patch, PatchEffect, rig_of
from bench.shared.recording import Recording
from scenarios.pipelines.inputs import arm_of
from stiffness.dual_encoder.delays import across
from stiffness.dual_encoder.fit import EncoderComparison, columns, fitted
from stiffness.dual_encoder.motions import Motion, modelled_torque, motions_of
from stiffness.dual_encoder.residuals import beyond, noise_of
from stiffness.dual_encoder.terms import FRICTION, WOUND, plain_terms
from stiffness.robot.arm import Arm

# --- One axis and its residual --------------------------------------------------------

WINDOW = 0.1
"""Seconds that are averaged beside the full rate; chosen: gear ripple is faster."""
DECADE = 10.0
"""How far a spring of the model may be off and still be nominal."""


@dataclass(frozen=True)
class Axis:
    """One axis, what lies between its encoders, and the proof.

    Attributes:
        name: a1, a2 …
        fitted: Motions that were fitted.
        judged: The last motion, that was not.
        found: What was believed and what was refused.
        before: What the nominal simulation leaves of the judged motion, in rad.
        after: What the simulator leaves of it with what was named, in rad.
        noise: Of a row, one sigma, in rad.
        stated: Whether the recording states it.
        beyond_before: P-value of the nominal simulation leaving more than noise.
        beyond_after: The same of what was named, on the judged motion.
        model_give: Compliance of the model's spring, in rad/(N m); 0: rigid.
        give: Compliance as fitted, and half its interval; None: torque is not known.
    """

    name: str
    fitted: tuple[Motion, ...]
    judged: Motion
    found: EncoderComparison
    before: Float[np.ndarray, " rows"]
    after: Float[np.ndarray, " rows"]
    noise: float
    stated: bool
    beyond_before: float
    beyond_after: float
    model_give: float = 0.0
    give: tuple[float, float] | None = None

    @property
    def is_nominal_spring(self) -> bool:
        """Return whether the wind-up is the model's own, within a decade."""
        if self.model_give == 0.0 or self.give is None:
            return False
        low, high = self.model_give / DECADE, self.model_give * DECADE
        return low <= self.give[0] <= high


def rms(
    residual: Float[np.ndarray, " rows"], time: Float[np.ndarray, " rows"]
) -> float:
    """Return the root of the mean square of means over a window, in rad."""
    part = np.floor((time - time[0]) / WINDOW + 1e-9).astype(int)
    means = np.bincount(part, residual) / np.bincount(part)
    return float(np.sqrt(np.mean((means - means.mean()) ** 2)))


def whole_rms(residual: Float[np.ndarray, " rows"]) -> float:
    """Return the root of the mean square of all rows, in rad."""
    return float(np.sqrt(np.mean((residual - residual.mean()) ** 2)))


# --- The model's spring ---------------------------------------------------------------


def give_of(
    motions: tuple[Motion, ...], found: EncoderComparison
) -> tuple[float, float] | None:
    """Return an axis' compliance with half its interval, believed or not."""
    terms = list(found.terms)
    if not any(t.effect == WOUND for t in terms):
        terms += [t for t in plain_terms(motions) if t.effect == WOUND]
    names = [t.effect for t in terms for _ in t.parameters]
    if WOUND not in names:
        return None
    x, half = fitted(terms, [found.then(m) for m in motions])
    i = names.index(WOUND)
    return float(x[i]), float(half[i])


def nominal_left(
    motion: Motion,
    found: EncoderComparison,
    model_give: float,
    give: tuple[float, float] | None,
) -> Float[np.ndarray, " rows"]:
    """Return what the model leaves of a motion, its springs fitted within a decade."""
    if model_give == 0.0 or give is None or motion.torque is None:
        return motion.apart
    own = float(np.clip(give[0], model_give / DECADE, model_give * DECADE))
    torque = motion.torque
    if give[0] > 0.0:  # the friction in it winds up nothing
        lost = [t for t in found.terms if t.effect == FRICTION]
        sizes = [x for e, _, x in found.known() if e == FRICTION]
        torque = torque - columns(lost, motion) @ np.array(sizes) / give[0]
    left = motion.apart + own * torque
    return left - left.mean()


# --- Harmonics of a gear --------------------------------------------------------------


def waves_of(name: str, found: EncoderComparison) -> tuple[PatchEffect, ...]:
    """Return the waves of an axis' gear."""
    effects, i = [], 0
    for term in found.terms:
        own = found.x[i : i + len(term.parameters)]
        i += len(own)
        if term.order:
            known: dict[str, float | str | None] = {
                "amplitude_rad": float(np.hypot(*own)),
                "order": term.order,
                "phase_rad": float(np.arctan2(own[0], own[1])),
            }
            effects.append(PatchEffect("transmission_error", name, known))
    return tuple(effects)


# --- The held-out comparison ----------------------------------------------------------


def heldout_comparison(recording: Recording, model: Path) -> tuple[Axis, ...]:
    """Fit all motions but the last, and simulate the last one.

    Raises:
        Unusable: Where an axis was not read twice in three motions, or none was.
    """
    arm = arm_of(model).for_recording(recording)
    motions = motions_of(recording, modelled_torque(recording, arm))
    stated = recording.encoder_repeatability
    found = across({k: own[:-1] for k, own in motions.items()}, stated)
    return tuple(
        _axis(recording, model, arm, k, own, found[k]) for k, own in motions.items()
    )


def _axis(
    recording: Recording,
    model: Path,
    arm: Arm,
    k: int,
    own: tuple[Motion, ...],
    found: EncoderComparison,
) -> Axis:
    stiffness = float(arm.stiffness[k])
    model_give = 1.0 / stiffness if stiffness > 0.0 else 0.0
    give = give_of(own[:-1], found)
    stated = recording.encoder_repeatability
    known = stated is not None
    rigid = [nominal_left(m, found, model_give, give) for m in own]
    left = _simulated(recording, model, k, own[-1], found)
    return Axis(
        name=f"a{k + 1}",
        fitted=own[:-1],
        judged=own[-1],
        found=found,
        before=rigid[-1],
        after=left,
        noise=noise_of(own, found, stated),
        stated=known,
        beyond_before=beyond(rigid, own, noise_of(own, None, stated), known),
        beyond_after=beyond([left], own[-1:], noise_of(own, found, stated), known),
        model_give=model_give,
        give=give,
    )


def _simulated(
    recording: Recording,
    model: Path,
    axis: int,
    motion: Motion,
    found: EncoderComparison,
) -> Float[np.ndarray, " rows"]:
    """Return what the simulator leaves of a motion."""
    seen = np.flatnonzero(recording.posture_id == motion.posture_id)
    rows = seen[np.searchsorted(recording.time[seen], motion.time)]
    bare = rig_of(Patch(), model).anatomy.axes
    order = [bare.index(name) for name in recording.axes] or list(range(len(bare)))
    own, then = order[axis], found.then(motion)
    rigid: dict[str, float | None] = {f"a{i + 1}": None for i in range(len(bare))}
    waves = waves_of(f"a{own + 1}", found)
    rig = rig_of(Patch(stiffness_nm_per_rad=rigid, effects=waves), model)
    posture = np.zeros((len(rows), len(bare)))
    posture[:, order] = recording.posture[rows]
    posture[:, own] = then.angle
    still = np.zeros((len(rows), 1, 6))
    states = rig.respond(posture, still, np.full((len(rows), 1), 1e-3))
    turned = states.axis_angle[:, own] - then.angle
    keep = [not t.order for t in found.terms for _ in t.parameters]
    plain = [t for t in found.terms if not t.order]
    left = then.apart - turned - columns(plain, then) @ found.x[keep]
    return left - left.mean()
