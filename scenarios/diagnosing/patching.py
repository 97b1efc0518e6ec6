"""What was named on paper is handed to the simulator as a patch.

A hypothesis and a mechanism write the same physics in different forms. Where a name's
shape bends the form, it becomes the mechanism's own setting as a first guess, which the
simulator then refines:

- hysteresis: a stop that slips at r = slip_nm and is w wide has, as springs that slip
  beside one of stiffness K, (1 + stiffening) = 1 / (1 - w K / 2r);
- lost motion: the play closes at the same torque.
"""

import numpy as np

from bench.patch import Law, Patch
from bench.patch_effects import Named, Value, can_build
from bench.recording import Recording
from stiffness.arm import Arm
from stiffness.diagnosis.diagnosis import Diagnosis, NamedEffect

SOFTEST, STIFFEST = 0.05, 10.0
"""Bounds of a stiffening's first guess; chosen."""


def patch_of(diagnosis: Diagnosis, recording: Recording, arm: Arm) -> Patch:
    """Return what a diagnosis puts into the simulator, to be refined there.

    Args:
        diagnosis: What was named, and what was fitted silently.
        recording: Whose marks were fitted.
        arm: The nominal arm.
    """
    nominal = diagnosis.nominal
    if nominal is None:
        return Patch()
    axes = [f"a{k + 1}" for k in range(len(arm.axes))]
    springs = {
        axis: None if c <= 0.0 else float(1.0 / c)
        for axis, c in zip(axes, nominal.compliance, strict=True)
    }
    frame = np.asarray(nominal.base_from_tracker, float)
    return Patch(
        stiffness_nm_per_rad=springs,
        effects=tuple(
            named(effect, springs)
            for effect in diagnosis.named
            if can_build(effect.name.effect)
        ),
        laws=laws_of(diagnosis),
        base_from_tracker=tuple((r[0], r[1], r[2], r[3]) for r in frame.tolist()),
        markers={
            marker.name: (float(x), float(y), float(z))
            for marker, (x, y, z) in zip(recording.markers, nominal.places, strict=True)
        },
    )


def named(effect: NamedEffect, springs: dict[str, float | None]) -> Named:
    """Return one named effect for the patch."""
    parameters: dict[str, Value] = {
        name: float(p.estimate) if np.isfinite(p.estimate) else None
        for name, p in effect.parameters.items()
    }
    where, settings = effect.name.where, {}
    if "with" in parameters and isinstance(parameters["with"], float):
        parameters["with"] = f"a{round(parameters['with'])}"
    if effect.name.effect == "hysteresis" and effect.shape:
        settings["stiffening"] = stiffening(
            effect.parameters["width_rad"].estimate, springs.get(where), effect.shape[0]
        )
    if effect.name.effect == "lost_motion" and effect.shape:
        settings["closing_nm"] = max(float(effect.shape[0]), 1e-6)
    return Named(effect.name.effect, where, parameters, settings)


def stiffening(width_rad: float, stiffness: float | None, slip_nm: float) -> float:
    """Return how much stiffer a gear is before anything slips: 1/(1 - w K/2r) - 1."""
    if stiffness is None:
        return 1.0
    share = width_rad * stiffness / (2.0 * max(slip_nm, 1e-9))
    if share >= 1.0:
        return STIFFEST
    return float(np.clip(1.0 / (1.0 - share) - 1.0, SOFTEST, STIFFEST))


def laws_of(diagnosis: Diagnosis) -> tuple[Law, ...]:
    """Return the table of what has no name, where one was learnt."""
    left = diagnosis.unexplained
    if left is None or not left.law.get("torque_nm"):
        return ()
    return (
        Law(
            left.where,
            tuple(map(float, left.law["torque_nm"])),
            tuple(map(float, left.law["loading_rad"])),
            tuple(map(float, left.law["unloading_rad"])),
        ),
    )
