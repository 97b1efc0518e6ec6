"""What methods are given, and what they are judged on, is all that a worker needs."""

from dataclasses import dataclass, fields
from hashlib import sha256

import numpy as np

from bench.recording import Recording
from scenarios.paper.experiment import Experiment
from scenarios.paper.unseen import Unseen
from stiffness.arm import Arm
from stiffness.deflections import Deflections

HELD_OUT = 0.2
"""Share of the experiment's poses that no method sees; Wu et al. 2024, section 5.3: the
models are established by 80 % of the data."""


@dataclass(frozen=True)
class Material:
    """One experiment as methods may see it, and fresh poses.

    Attributes:
        arm: The nominal arm.
        recording: What the instruments saw.
        measured: One row per posture, the paper's reading of the experiment.
        unseen: Fresh poses with their true deflection.
    """

    arm: Arm
    recording: Recording
    measured: Deflections
    unseen: Unseen

    @classmethod
    def of(cls, experiment: Experiment, unseen: Unseen) -> "Material":
        """Leave the truth of an experiment behind."""
        return cls(experiment.arm, experiment.recording, experiment.measured, unseen)

    def held_out(self, seed: int) -> np.ndarray:
        """Draw the poses that no method sees."""
        poses = np.unique(self.recording.pose)
        order = np.random.default_rng([seed, len(poses)]).permutation(poses)
        return np.sort(order[: max(round(HELD_OUT * len(poses)), 1)])

    def training(self, seed: int) -> Recording:
        """Return the recording without the poses held out; visits stay whole."""
        kept = ~np.isin(self.recording.pose, self.held_out(seed))
        return self.recording.take(kept)

    def digest(self) -> str:
        """Return what tells this material from all other."""
        told = sha256()
        for part in (self.recording, self.unseen, self.unseen.cases):
            for field in fields(part):
                value = getattr(part, field.name)
                if isinstance(value, np.ndarray) and value.dtype.kind in "fiu":
                    told.update(np.ascontiguousarray(value).tobytes())
        return told.hexdigest()
