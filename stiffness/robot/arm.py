"""Nominal arm: a rigid chain of hinges and slides with joint compliance and limits.

All values are in the base's frame, in SI units and radians. Names of bodies are `base`,
`link_1` … `link_N`, `flange`, `tool` and the model's own.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pinocchio
from jaxtyping import Bool, Float

from bench.shared.errors import UnknownName, Unusable
from bench.shared.models import RobotModel
from bench.shared.recording import Payload, Recording
from stiffness.robot.chain import Chain, Place, chain_of
from stiffness.robot.kinematics import ArmState
from stiffness.robot.mjcf import ArmFile, read, read_text, without_other_joints


@dataclass(frozen=True)
class Arm:
    """Nominal arm: kinematics, masses, springs and limits, without a deflection model.

    Attributes:
        file: Content of its MJCF.
        axes: The model's joints for a1, a2 …, one column of a posture each.
        bodies: Names of bodies mapped to the model's own, before all other rules.
        slides: Whether each axis slides instead of turning.
        limits: Lowest and highest posture, in rad (m where it slides).
        stiffness: The model's own springs, in N m/rad (N/m); 0 = rigid.
        chain: Axes, bodies and masses.
    """

    file: ArmFile = field(repr=False)
    axes: tuple[str, ...]
    bodies: Mapping[str, str]
    slides: Bool[np.ndarray, " axes"]
    limits: Float[np.ndarray, "axes 2"]
    stiffness: Float[np.ndarray, " axes"]
    chain: Chain = field(repr=False)

    @classmethod
    def from_mjcf(
        cls,
        path: Path | str,
        axes: Sequence[str] = (),
        bodies: Mapping[str, str] | None = None,
    ) -> "Arm":
        """Read an arm from its MJCF.

        Args:
            path: A plain MJCF.
            axes: Joints for a1, a2 …; the others are held at zero. Empty: all joints,
                from base to tip.
            bodies: Names of bodies mapped to the model's own.

        Returns:
            The nominal arm.

        Raises:
            BenchError: Where the file is missing.
            Unusable: Where it is not a chain of hinges and slides.
            UnknownName: Where the model has no such joint or body.
        """
        return cls.of(read(path), axes, bodies)

    @classmethod
    def from_mjcf_text(cls, text: str) -> "Arm":
        """Read an arm from self-contained MJCF text; see `from_mjcf`."""
        return cls.of(read_text(text))

    @classmethod
    def from_model(cls, model: RobotModel) -> "Arm":
        """Read an arm from a robot's model; see `from_mjcf`."""
        return cls.from_mjcf_text(model.mjcf)

    @classmethod
    def of(
        cls,
        file: ArmFile,
        axes: Sequence[str] = (),
        bodies: Mapping[str, str] | None = None,
    ) -> "Arm":
        """Return the arm with these axes of a file already read; see `from_mjcf`."""
        axes = tuple(axes) or tuple(list(file.model.names)[1:])
        if len(set(axes)) != len(axes):
            raise Unusable("The list of axes", [f"a joint comes twice: {list(axes)}."])
        model = without_other_joints(file.model, axes)
        column = [model.joints[model.getJointId(name)].idx_q for name in axes]
        low, high = model.lowerPositionLimit, model.upperPositionLimit
        chain = chain_of(model, axes, np.array(file.gravity))
        arm = cls(
            file=file,
            axes=axes,
            bodies=_with_tool(dict(bodies or {}), model),
            slides=chain.slides,
            limits=np.stack([low[column], high[column]], axis=1),
            stiffness=np.array([file.stiffness.get(name, 0.0) for name in axes]),
            chain=chain,
        )
        for name in arm.bodies:
            arm.attachment(name)
        return arm

    @property
    def compliance(self) -> Float[np.ndarray, " axes"]:
        """The compliance of the model's own springs, in rad/(N m) (m/N); 0 = rigid."""
        k = self.stiffness
        return np.divide(1.0, k, out=np.zeros_like(k), where=k > 0.0)

    def for_recording(self, recording: Recording) -> "Arm":
        """Return the arm with the axes and body names of a recording.

        Raises:
            UnknownName: Where the model has no such joint or body.
            Unusable: Where the recording has another number of axes.
        """
        arm = self
        if recording.axes or recording.bodies:
            axes = tuple(recording.axes) or self.axes
            bodies = {**self.bodies, **recording.bodies}
            if axes != self.axes or bodies != self.bodies:
                arm = Arm.of(self.file, axes, bodies)
        count = recording.posture.shape[1]
        if count != len(arm.axes):
            fault = f"it has {count} axes, the arm has {len(arm.axes)}: {arm.axes}."
            raise Unusable(f"Recording {recording.name!r}", [fault])
        return arm

    def attachment(self, body: str) -> Place:
        """Return the axis that a body is attached to, and how.

        Raises:
            UnknownName: Where the model has no such body.
        """
        places = self.chain.places
        name = self.bodies.get(body, body)
        if (
            name not in places and name in self.chain.links
        ):  # an end of a link that forks
            name = name.partition(":")[0]
        if name not in places:
            raise UnknownName("body", name, places)
        return places[name]

    def at(self, posture: Float[np.ndarray, "cases axes"]) -> ArmState:
        """Return the arm in many postures at once.

        Args:
            posture: Joint angles, in rad (m where an axis slides).

        Returns:
            The arm in each of them: placements, Jacobians, torques.

        Raises:
            Unusable: Where a posture has another number of axes or is not finite.
        """
        if posture.ndim != 2 or posture.shape[1] != len(self.axes):
            fault = f"shape {posture.shape}; expected (cases, {len(self.axes)})."
            raise Unusable("The posture", [fault])
        if not np.isfinite(posture).all():
            row, column = np.argwhere(~np.isfinite(posture))[0]
            fault = f"row {row}, axis {self.axes[column]}: not a number."
            raise Unusable("The posture", [fault])
        return ArmState.of(self.chain, self.attachment, posture)

    def placements(
        self, posture: Float[np.ndarray, "cases axes"], bodies: Sequence[str]
    ) -> Float[np.ndarray, "cases bodies 4 4"]:
        """Return transforms from bodies to the base's frame, in m."""
        standing = self.at(posture)
        return np.stack([standing.placement(body) for body in bodies], axis=1)

    def point_in_base(
        self,
        posture: Float[np.ndarray, "cases axes"],
        body: str,
        position: Float[np.ndarray, "*cases 3"],
    ) -> Float[np.ndarray, "cases 3"]:
        """Return a point of a body in the base's frame, in m; see `ArmState.point`."""
        return self.at(posture).point(body, position)

    def jacobian(
        self,
        posture: Float[np.ndarray, "cases axes"],
        body: str,
        position: Float[np.ndarray, "*cases 3"],
    ) -> Float[np.ndarray, "cases 6 axes"]:
        """Return the geometric Jacobian at a point of a body; see `ArmState`."""
        return self.at(posture).jacobian(body, position)

    def gravity_torque(
        self, posture: Float[np.ndarray, "cases axes"], payload: Payload | None = None
    ) -> Float[np.ndarray, "cases axes"]:
        """Return the torque that gravity exerts on the axes; see `ArmState`."""
        return self.at(posture).gravity_torque(payload)

    def load_torque(
        self,
        posture: Float[np.ndarray, "cases axes"],
        wrench_in_base: Float[np.ndarray, "cases 6"],
        body: str,
        position: Float[np.ndarray, "*cases 3"],
    ) -> Float[np.ndarray, "cases axes"]:
        """Return the torque that a wrench exerts on the axes; see `ArmState`."""
        return self.at(posture).load_torque(wrench_in_base, body, position)


def _with_tool(bodies: dict[str, str], model: pinocchio.Model) -> dict[str, str]:
    """Return names of bodies in which a tool that the model lacks is on the flange."""
    body = pinocchio.FrameType.BODY
    if "flange" in bodies and not model.existFrame("tool", body):
        bodies.setdefault("tool", bodies["flange"])
    return bodies
