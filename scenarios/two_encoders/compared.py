"""The second encoders of a stream are predicted on a motion that nothing was fitted to.

The simulator is given the angles that the second encoder tells of, a delay being no
matter of the arm; its gears turn unevenly as named. What winds up under the motor's own
torque is added to what it says: the simulator stands still and cannot make that torque.
A spring that the model has is nominal: it is fitted silently over a decade either way.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from bench.patch import Patch, rig_of
from bench.recording import Recording
from scenarios.nominal import arm_of
from scenarios.two_encoders.axis import Axis
from scenarios.two_encoders.patching import waves_of
from scenarios.two_encoders.springs import give_of, nominal_left
from stiffness.arm import Arm
from stiffness.two_encoders.delays import across
from stiffness.two_encoders.fitting import columns
from stiffness.two_encoders.found import Between
from stiffness.two_encoders.motions import Motion, motions_of
from stiffness.two_encoders.noise import beyond, noise_of
from stiffness.two_encoders.torques import modelled_torque


def compared(recording: Recording, model: Path) -> tuple[Axis, ...]:
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
    found: Between,
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
    recording: Recording, model: Path, axis: int, motion: Motion, found: Between
) -> Float[np.ndarray, " rows"]:
    """Return what the simulator leaves of a motion."""
    seen = np.flatnonzero(recording.pose == motion.pose)
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
