"""Fitted networks: prediction at one point of the flange, carried to others by springs.

==========  ==========================================================================
Equation    d(p) = network(q, w) + d_VJM(p) - d_VJM(p_0); p_0, the network's point;
            torque about o_0 = torque about o + R (o - o_0) x force
Source      Wu et al. 2024, Fig. 2: joint angles and a wrench go in, three deflections
            come out; the second term is a rigid body's motion between two points
Needs       a network, and the springs it was pre-trained on
Assumes     the flange turns as the springs predict; nothing where p = p_0
==========  ==========================================================================
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.experiment.deflections import LoadCases
from stiffness.methods.method import Fitted, Parameter
from stiffness.methods.vjm import VjmFit
from stiffness.networks.model import DeflectionNetwork
from stiffness.robot.arm import Arm

SAME_POINT = 1e-6
"""Points closer than this are one, in m; chosen: a turn of 1 mrad moves it 1 nm."""


@dataclass(frozen=True)
class NetworkFit(Fitted):
    """A trained network, and the springs that it was pre-trained on.

    Attributes:
        network: Predicts the deflection of its own point.
        springs: Predict the deflection of other points relative to it.
    """

    network: DeflectionNetwork
    springs: VjmFit

    @override
    def predict(self, cases: LoadCases) -> Float[np.ndarray, "cases 3"]:
        """Predict with the network, and carry the result to each case's point."""
        wrench = wrench_about(self.springs.arm, cases, self.network.origin_in_flange)
        answer = self.network.predict(cases.posture, wrench)
        return answer + relative_deflection(
            self.springs, cases, self.network.point_in_flange
        )

    @property
    @override
    def parameters(self) -> tuple[Parameter, ...]:
        """None: weights have no meaning one by one."""
        return ()


def wrench_about(
    arm: Arm, cases: LoadCases, origin_in_flange: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "cases 6"]:
    """Return the wrenches with torques about another point of the flange.

    Args:
        arm: The nominal arm.
        cases: Wrenches about their own origin.
        origin_in_flange: The other point, in m.
    """
    apart = cases.origin_in_flange - origin_in_flange
    if np.linalg.norm(apart) < SAME_POINT:
        return cases.wrench_in_base
    lever = arm.at(cases.posture).turn("flange") @ apart
    force, torque = cases.wrench_in_base[:, :3], cases.wrench_in_base[:, 3:]
    return np.hstack([force, torque + np.cross(lever, force)])


def relative_deflection(
    springs: VjmFit, cases: LoadCases, point_in_flange: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "cases 3"]:
    """Return the deflection of each case's point relative to a common point, in m.

    Args:
        springs: Predict the rotation of the flange.
        cases: Cases with their end-effector points.
        point_in_flange: The common point, in m.
    """
    apart = np.linalg.norm(cases.point_in_flange - point_in_flange, axis=1)
    farther = np.zeros((len(cases), 3))
    far = np.flatnonzero(apart > SAME_POINT)
    if len(far):
        meant = cases.take(far)
        common = np.broadcast_to(point_in_flange, (len(far), 3))
        answers = [
            springs.predict(c) for c in (meant, replace(meant, point_in_flange=common))
        ]
        farther[far] = answers[0] - answers[1]
    return farther
