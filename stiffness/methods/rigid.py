"""Rigid arm: predicts zero deflection, the baseline of all other methods.

==========  ==========================================================================
Equation    d = 0
Source      the nominal arm of the data sheet
Needs       nothing but a recording that shows deflections
Assumes     no compliance
==========  ==========================================================================
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from bench.shared.recording import Recording
from stiffness.experiment.deflections import LoadCases, usable
from stiffness.methods.method import Fitted, Method, Parameter
from stiffness.robot.arm import Arm


@dataclass(frozen=True)
class Rigid(Method):
    """Baseline that predicts no deflection.

    Attributes:
        arm: The nominal arm.
    """

    arm: Arm

    @override
    def fit(self, recording: Recording) -> "RigidFit":
        """Refuse recordings that no method could be fitted to; nothing is fitted."""
        usable(self.arm.for_recording(recording), recording)
        return RigidFit()


@dataclass(frozen=True)
class RigidFit(Fitted):
    """Prediction of no deflection."""

    @override
    def predict(self, cases: LoadCases) -> Float[np.ndarray, "cases 3"]:
        """Return zeros."""
        return np.zeros((len(cases), 3))

    @property
    @override
    def parameters(self) -> tuple[Parameter, ...]:
        """None."""
        return ()
