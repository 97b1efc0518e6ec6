"""Axes read on both sides of their gears, judged on a motion held out of the fit.

`heldout_comparison` fits all motions of an axis but the last and predicts the second
encoder on the last one; an `Axis` holds the fit and both residuals. The simulator is
given the angles that the second encoder reports, corrected for the delay, which is not
a property of the arm; its gears have the harmonics that were named. Wind-up under the
motor's own torque is added to the simulated difference, since a static simulation
cannot make that torque. The model's spring is nominal: its compliance is fitted within
a decade either way (`nominal_left`).
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from bench.patch import Patch, PatchEffect, rig_of
from bench.shared.recording import Recording
from scenarios.pipelines.inputs import arm_of
from stiffness.dual_encoder.delays import across
from stiffness.dual_encoder.fit import (
    EncoderComparison,
    columns,
    fitted,
    noise_of,
    p_value_beyond_noise,
)
from stiffness.dual_encoder.motions import Motion, modelled_torque, motions_of
from stiffness.dual_encoder.terms import FRICTION, WOUND, plain_terms
from stiffness.robot.arm import Arm

# --- One axis and its residual --------------------------------------------------------

WINDOW = 0.1
"""Length in s of the windows of `rms_of_windows`; chosen: gear ripple is faster."""
DECADE = 10.0
"""Factor within which a fitted spring counts as the model's own."""


@dataclass(frozen=True)
class Axis:
    """The comparison of one axis' two encoders, and its proof on a held-out motion.

    Attributes:
        name: a1, a2 …
        judged: The last motion, which was held out.
        before: Residual of the nominal simulation on the judged motion, in rad.
        after: Residual of the patched simulation on the judged motion, in rad.
        noise: One sigma of a row, in rad.
        stated: Whether the recording states the noise.
        p_value_before: Of the nominal residual being noise only, on all motions.
        p_value_after: Of the patched residual, on the judged motion.
        model_compliance: Compliance of the model's spring, in rad/(N m); 0: rigid.
        compliance: As fitted, and half width of its interval, in rad/(N m); None:
            torque is not known.
    """

    name: str
    fitted: tuple[Motion, ...]
    judged: Motion
    found: EncoderComparison
    before: Float[np.ndarray, " rows"]
    after: Float[np.ndarray, " rows"]
    noise: float
    stated: bool
    p_value_before: float
    p_value_after: float
    model_compliance: float = 0.0
    compliance: tuple[float, float] | None = None

    @property
    def is_nominal_spring(self) -> bool:
        """Return whether the wind-up is the model's own, within a decade."""
        if self.model_compliance == 0.0 or self.compliance is None:
            return False
        low, high = self.model_compliance / DECADE, self.model_compliance * DECADE
        return low <= self.compliance[0] <= high


def rms_of_windows(
    residual: Float[np.ndarray, " rows"], time: Float[np.ndarray, " rows"]
) -> float:
    """Return the root mean square of the means over windows, in rad."""
    part = np.floor((time - time[0]) / WINDOW + 1e-9).astype(int)
    means = np.bincount(part, residual) / np.bincount(part)
    return float(np.sqrt(np.mean((means - means.mean()) ** 2)))


def whole_rms(residual: Float[np.ndarray, " rows"]) -> float:
    """Return the root mean square of all rows about their mean, in rad."""
    return float(np.sqrt(np.mean((residual - residual.mean()) ** 2)))


# --- The model's spring ---------------------------------------------------------------


def compliance_of(
    motions: tuple[Motion, ...], found: EncoderComparison
) -> tuple[float, float] | None:
    """Return an axis' compliance and half width of its interval, accepted or not."""
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
    model_compliance: float,
    compliance: tuple[float, float] | None,
) -> Float[np.ndarray, " rows"]:
    """Return the nominal residual of a motion, the spring fitted within a decade."""
    if model_compliance == 0.0 or compliance is None or motion.torque is None:
        return motion.apart
    own = float(
        np.clip(compliance[0], model_compliance / DECADE, model_compliance * DECADE)
    )
    torque = motion.torque
    if compliance[0] > 0.0:  # the friction in it winds up nothing
        lost = [t for t in found.terms if t.effect == FRICTION]
        sizes = [x for e, _, x in found.known() if e == FRICTION]
        torque = torque - columns(lost, motion) @ np.array(sizes) / compliance[0]
    left = motion.apart + own * torque
    return left - left.mean()


# --- Harmonics of a gear --------------------------------------------------------------


def waves_of(name: str, found: EncoderComparison) -> tuple[PatchEffect, ...]:
    """Return the harmonics of an axis' gear as effects of a patch."""
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
    model_compliance = 1.0 / stiffness if stiffness > 0.0 else 0.0
    compliance = compliance_of(own[:-1], found)
    stated = recording.encoder_repeatability
    known = stated is not None
    rigid = [nominal_left(m, found, model_compliance, compliance) for m in own]
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
        p_value_before=p_value_beyond_noise(
            rigid, own, noise_of(own, None, stated), known
        ),
        p_value_after=p_value_beyond_noise(
            [left], own[-1:], noise_of(own, found, stated), known
        ),
        model_compliance=model_compliance,
        compliance=compliance,
    )


def _simulated(
    recording: Recording,
    model: Path,
    axis: int,
    motion: Motion,
    found: EncoderComparison,
) -> Float[np.ndarray, " rows"]:
    """Return the residual of the patched simulation on a motion, in rad."""
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
