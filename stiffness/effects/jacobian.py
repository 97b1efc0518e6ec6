"""Jacobian of an effect: joint rotations, body twists, marker and encoder errors.

A signature is what one unit of an effect does to the arm, row by row: small rigid
motions of what hangs on an axis or on the base, or displacements of single markers.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from bench.shared.errors import Unusable


@dataclass(frozen=True)
class JointRotation:
    """Motion along an axis' own direction: it turns (or slides) beyond its posture.

    Attributes:
        axis: Which one, counted from 0.
        law: Extra angle per unit of each coefficient, in rad (m where it slides).
    """

    axis: int
    law: Float[np.ndarray, "rows columns"]


@dataclass(frozen=True)
class BodyTwist:
    """Any small rigid motion of everything that a place carries.

    Attributes:
        site: 0: the base moves, and all with it; k: what axis k carries moves, k
            counted from 1.
        twist: Per unit of each coefficient, along the base's axes: displacement of the
            material point at the base's origin in m, then rotation vector in rad. A
            point p then moves by twist[:3] + twist[3:] x p.
    """

    site: int
    twist: Float[np.ndarray, "rows 6 columns"]


@dataclass(frozen=True)
class MarkerDisplacement:
    """A single marker is not where its body would take it.

    Attributes:
        marker: Which one, counted from 0.
        displacement: Per unit of each coefficient, along the base's axes, in m.
    """

    marker: int
    displacement: Float[np.ndarray, "rows 3 columns"]


@dataclass(frozen=True)
class EncoderError:
    """An encoder behind the gear reads another angle than the link has.

    Attributes:
        axis: Which one, counted from 0.
        angle: Per unit of each coefficient, in rad.
    """

    axis: int
    angle: Float[np.ndarray, "rows columns"]


JacobianBlock = JointRotation | BodyTwist | MarkerDisplacement | EncoderError


@dataclass(frozen=True)
class EffectJacobian:
    """What one unit of each coefficient of an effect does; the parts add up.

    Attributes:
        columns: How many coefficients there are.
        parts: Each with as many columns.

    Raises:
        Unusable: Where a part has another number of columns.
    """

    columns: int
    parts: tuple[JacobianBlock, ...] = ()

    def __post_init__(self):
        """Check that all parts speak of the same coefficients."""
        faults = []
        for part in self.parts:
            found = values(part).shape[-1]
            if found != self.columns:
                faults.append(f"{type(part).__name__} has {found}, not {self.columns}.")
        if faults:
            raise Unusable("A signature's columns", faults)


NOTHING = EffectJacobian(0)
"""The signature of no coefficient at all."""


def values(part: JacobianBlock) -> np.ndarray:
    """Return the numbers of a part, whatever they are called; columns come last."""
    if isinstance(part, JointRotation):
        return part.law
    if isinstance(part, BodyTwist):
        return part.twist
    return part.displacement if isinstance(part, MarkerDisplacement) else part.angle


def with_values(part: JacobianBlock, new: np.ndarray) -> JacobianBlock:
    """Return the same part with other numbers, perhaps of other columns."""
    if isinstance(part, JointRotation):
        return replace(part, law=new)
    if isinstance(part, BodyTwist):
        return replace(part, twist=new)
    if isinstance(part, MarkerDisplacement):
        return replace(part, displacement=new)
    return replace(part, angle=new)


def turn(axis: int, *laws: Float[np.ndarray, " rows"]) -> EffectJacobian:
    """Return the signature of an axis that turns by laws, a coefficient for each."""
    return EffectJacobian(len(laws), (JointRotation(axis, np.stack(laws, axis=1)),))


def rotate(
    site: int,
    rotation: Float[np.ndarray, "rows 3 columns"],
    centre: Float[np.ndarray, "rows 3"],
) -> BodyTwist:
    """Return the motion of what a place carries when it rotates about a point.

    The point stays: the material point at the base's origin moves by centre x rotation.

    Args:
        site: 0 the base, k axis k.
        rotation: Rotation vectors along the base's axes, in rad per unit.
        centre: What they turn about, in the base's frame, in m.
    """
    shift = np.cross(centre[:, :, None], rotation, axis=1)
    return BodyTwist(site, np.concatenate([shift, rotation], axis=1))


def translate(site: int, shift: Float[np.ndarray, "rows 3 columns"]) -> BodyTwist:
    """Return the motion of what a place carries when it shifts unturned, in m."""
    return BodyTwist(site, np.concatenate([shift, np.zeros_like(shift)], axis=1))


def hstack(laws: Sequence[EffectJacobian]) -> EffectJacobian:
    """Return one signature of the coefficients of several laws, one after the other."""
    columns, at = sum(law.columns for law in laws), 0
    parts: list[JacobianBlock] = []
    for law in laws:
        for part in law.parts:
            own = values(part)
            wide = np.zeros((*own.shape[:-1], columns))
            wide[..., at : at + law.columns] = own
            parts.append(with_values(part, wide))
        at += law.columns
    return EffectJacobian(columns, tuple(parts))
