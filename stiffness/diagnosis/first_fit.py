"""Some visits are enough to learn nearly where everything is and how it bends."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from bench.recording import Recording
from stiffness.arm import Arm
from stiffness.diagnosis.blocks import Residuals, blocks, spring_columns, spring_step
from stiffness.diagnosis.columns import columns_of
from stiffness.diagnosis.first_frames import first_frames
from stiffness.diagnosis.readings import (
    Frames,
    bodies_of,
    expected,
    seen_in_base,
    weight_of,
)
from stiffness.diagnosis.situation import Situation
from stiffness.diagnosis.standing_under_load import situation_of
from stiffness.diagnosis.unknowns import frames_after
from stiffness.diagnosis.visits import visits_of

ROUNDS = 3
"""How often springs and frames are fitted at the equilibrium that they imply; chosen:
each gains a factor of a hundred."""
FEW = 30
"""Visits that these rounds look at; chosen for time, the last step takes them all."""
LEAST, MOST = 0.02, 50.0
"""Bounds of a compliance over the model's; chosen: well over a decade either way."""
BLIND = 1.0
"""A compliance whose sigma is above this share of the model's own is left nominal."""


@dataclass(frozen=True)
class FirstFit:
    """A good start.

    Attributes:
        frames: Tracker and markers.
        compliance: Of each axis, in rad/(N m).
    """

    frames: Frames
    compliance: Float[np.ndarray, " axes"]


def first_fit(recording: Recording, arm: Arm) -> FirstFit:
    """Fit frames and springs to some visits, at the equilibrium that they imply.

    Args:
        recording: With markers and a tracker.
        arm: The nominal arm, with the recording's names.
    """
    ids = np.unique(recording.visit)
    chosen = ids[:: max(1, len(ids) // FEW)]
    some = recording.take(np.isin(recording.visit, chosen))
    compliance = model_compliance(arm)
    springs = np.flatnonzero(compliance > 0)
    model = compliance[springs]
    frames = first_frames(arm, some, compliance)
    names, _ = bodies_of(arm, some)
    for _ in range(ROUNDS):
        situation = situation_of(arm, some, compliance, names)
        visits = visits_of(situation.visit, situation.pose)
        readings = residuals_of(situation, frames)
        data, _ = blocks(situation, visits, readings, np.zeros(len(compliance)), False)
        step = np.zeros(0)
        if len(springs):
            step, sigma = spring_step(situation, data, springs)
            new = np.clip(compliance[springs] + step, LEAST * model, MOST * model)
            new = np.where(sigma > BLIND * model, model, new)
            step = new - compliance[springs]
            compliance = compliance.copy()
            compliance[springs] = new
        if data.between is not None:
            columns = columns_of(spring_columns(situation, springs), visits.row)
            known = some.base_from_tracker is not None
            frames = frames_after(frames, data.between, columns, step, known)
    return FirstFit(frames, compliance)


def model_compliance(arm: Arm) -> Float[np.ndarray, " axes"]:
    """Return the compliance of the model's own springs, 0 where rigid."""
    stiff = arm.stiffness
    return np.where(stiff > 0, 1.0 / np.where(stiff > 0, stiff, 1.0), 0.0)


def residuals_of(situation: Situation, frames: Frames) -> Residuals:
    """Return readings less where they should be, with the stated noise.

    Relative readings are counted from where a visit's first row should be.
    """
    recording = situation.recording
    assert recording.tracker is not None
    point, should = seen_in_base(recording, frames), expected(situation, frames)
    if recording.displacement == "relative":
        first = situation.steps[situation.visit, 0]
        point = point - frames.shift + should[first]
    inverse = (frames.turn / recording.tracker.repeatability**2) @ frames.turn.T
    _, body = bodies_of(situation.arm, recording)
    return Residuals(
        value=point - should,
        point=point,
        weight=weight_of(recording),
        inverse=inverse,
        body=body,
    )
