"""Jacobian of an effect: joint rotations, body twists, marker and encoder errors.

An `EffectJacobian` is what one unit of each coefficient does to the arm, row by row: it
is a sum of blocks, each a rotation of a joint, a small rigid motion of the bodies on an
axis or on the base, a displacement of a single marker, or an error of an encoder.
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
        axis: Its index, counted from 0.
        law: Extra angle per unit of each coefficient, in rad (m where it slides).
    """

    axis: int
    law: Float[np.ndarray, "rows columns"]


@dataclass(frozen=True)
class BodyTwist:
    """A small rigid motion of all bodies that an axis or the base carries.

    Attributes:
        site: 0: the base and all bodies move; k: the bodies that axis k carries move,
            k counted from 1.
        twist: Per unit of each coefficient, along the base's axes: displacement of the
            material point at the base's origin in m, then rotation vector in rad. A
            point p then moves by twist[:3] + twist[3:] x p.
    """

    site: int
    twist: Float[np.ndarray, "rows 6 columns"]


@dataclass(frozen=True)
class MarkerDisplacement:
    """Displacement of a single marker relative to its body.

    Attributes:
        marker: Its index, counted from 0.
        displacement: Per unit of each coefficient, along the base's axes, in m.
    """

    marker: int
    displacement: Float[np.ndarray, "rows 3 columns"]


@dataclass(frozen=True)
class EncoderError:
    """Error of an encoder after the gear.

    Attributes:
        axis: Its index, counted from 0.
        angle: Per unit of each coefficient, in rad.
    """

    axis: int
    angle: Float[np.ndarray, "rows columns"]


JacobianBlock = JointRotation | BodyTwist | MarkerDisplacement | EncoderError


@dataclass(frozen=True)
class EffectJacobian:
    """Displacements per unit of each coefficient of an effect; the blocks add up.

    Attributes:
        columns: Number of coefficients.
        parts: Blocks, each with as many columns.

    Raises:
        Unusable: Where a block has another number of columns.
    """

    columns: int
    parts: tuple[JacobianBlock, ...] = ()

    def __post_init__(self):
        """Check that all blocks have the same number of coefficients."""
        faults = []
        for part in self.parts:
            found = values(part).shape[-1]
            if found != self.columns:
                faults.append(f"{type(part).__name__} has {found}, not {self.columns}.")
        if faults:
            raise Unusable("A signature's columns", faults)


NOTHING = EffectJacobian(0)
"""The Jacobian of an effect without coefficients."""


def values(part: JacobianBlock) -> np.ndarray:
    """Return the values of a block, whatever their field; columns come last."""
    if isinstance(part, JointRotation):
        return part.law
    if isinstance(part, BodyTwist):
        return part.twist
    return part.displacement if isinstance(part, MarkerDisplacement) else part.angle


def with_values(part: JacobianBlock, new: np.ndarray) -> JacobianBlock:
    """Return the same block with other values, perhaps of another number of columns."""
    if isinstance(part, JointRotation):
        return replace(part, law=new)
    if isinstance(part, BodyTwist):
        return replace(part, twist=new)
    if isinstance(part, MarkerDisplacement):
        return replace(part, displacement=new)
    return replace(part, angle=new)


def turn(axis: int, *laws: Float[np.ndarray, " rows"]) -> EffectJacobian:
    """Return the Jacobian of an axis that turns by laws, a coefficient for each."""
    return EffectJacobian(len(laws), (JointRotation(axis, np.stack(laws, axis=1)),))


def rotate(
    site: int,
    rotation: Float[np.ndarray, "rows 3 columns"],
    centre: Float[np.ndarray, "rows 3"],
) -> BodyTwist:
    """Return the twist of the bodies on a site that rotate about a point.

    The point stays: the material point at the base's origin moves by centre x rotation.

    Args:
        site: 0: the base; k: axis k.
        rotation: Rotation vectors along the base's axes, in rad per unit.
        centre: Centre of rotation, in the base's frame, in m.
    """
    shift = np.cross(centre[:, :, None], rotation, axis=1)
    return BodyTwist(site, np.concatenate([shift, rotation], axis=1))


def translate(site: int, shift: Float[np.ndarray, "rows 3 columns"]) -> BodyTwist:
    """Return the twist of the bodies on a site for a pure translation, in m."""
    return BodyTwist(site, np.concatenate([shift, np.zeros_like(shift)], axis=1))


def rotation_about(
    site: int,
    rotation: Float[np.ndarray, "rows 3 columns"],
    centre: Float[np.ndarray, "rows 3"],
) -> EffectJacobian:
    """Return the Jacobian of bodies that only rotate about a point: see `rotate`."""
    return EffectJacobian(rotation.shape[2], (rotate(site, rotation, centre),))


def six_motions(
    site: int,
    axes: Float[np.ndarray, "rows 3 3"],
    centre: Float[np.ndarray, "rows 3"],
) -> BodyTwist:
    """Return translations along three axes, then rotations about them, of bodies."""
    twists = translate(site, axes).twist, rotate(site, axes, centre).twist
    return BodyTwist(site, np.concatenate(twists, axis=2))


def site_number(part: JacobianBlock) -> int:
    """Return the number of the axis, place or marker where a block acts."""
    if isinstance(part, BodyTwist):
        return part.site
    return part.marker if isinstance(part, MarkerDisplacement) else part.axis


def hstack(laws: Sequence[EffectJacobian]) -> EffectJacobian:
    """Return one Jacobian with the coefficients of several, one after the other."""
    columns, at = sum(law.columns for law in laws), 0
    parts: dict[tuple[type, int], JacobianBlock] = {}
    for law in laws:
        for part in law.parts:
            own, where = values(part), (type(part), site_number(part))
            if where not in parts:
                parts[where] = with_values(part, np.zeros((*own.shape[:-1], columns)))
            values(parts[where])[..., at : at + law.columns] += own
        at += law.columns
    return EffectJacobian(columns, tuple(parts.values()))


def mixture(
    law: EffectJacobian, mix: Float[np.ndarray, "columns others"]
) -> EffectJacobian:
    """Return the Jacobian of sums of a law's columns."""
    parts = tuple(with_values(part, mixed(values(part), mix)) for part in law.parts)
    return EffectJacobian(mix.shape[1], parts)


def mixed(
    columns: Float[np.ndarray, "*many columns"],
    mix: Float[np.ndarray, "columns others"],
) -> Float[np.ndarray, "*many others"]:
    """Return sums of columns, all rows by one product of matrices."""
    flat = columns.reshape(-1, columns.shape[-1]) @ mix
    return flat.reshape(*columns.shape[:-1], mix.shape[1])


def added(*laws: EffectJacobian) -> EffectJacobian:
    """Return what Jacobians of as many coefficients displace together.

    Raises:
        Unusable: Where one has another number of coefficients than the first.
    """
    if len({law.columns for law in laws}) > 1:
        counts = [f"{law.columns} coefficients" for law in laws]
        raise Unusable("Jacobians that add up have one number of coefficients", counts)
    parts: dict[tuple[type, int], JacobianBlock] = {}
    for part in (part for law in laws for part in law.parts):
        where = type(part), site_number(part)
        before = values(parts[where]) if where in parts else 0.0
        parts[where] = with_values(part, before + values(part))
    return EffectJacobian(laws[0].columns, tuple(parts.values()))


def difference(
    high: EffectJacobian, low: EffectJacobian, weight: np.ndarray
) -> EffectJacobian:
    """Return mixtures of the columns by which two laws differ."""
    parts = []
    for one, other in zip(high.parts, low.parts, strict=True):
        parts.append(with_values(one, mixed(values(one) - values(other), weight)))
    return EffectJacobian(weight.shape[1], tuple(parts))


ROUNDING = 1e-6
"""Part of a column's length below which its remainder is rounding; chosen."""


def orthogonal_to(law: EffectJacobian, others: EffectJacobian) -> EffectJacobian:
    """Return a Jacobian less what others displace along it, all rows alike.

    ==========  ======================================================================
    Equation    A - B B^+ A, A and B the values of blocks that both have, in rad and m
    Source      least squares
    Valid       blocks of the same kind at the same site; others stay as they are
    Ignores     that rows are not equally well known; the remainder of a column that
                the others span is nothing, not rounding
    ==========  ======================================================================

    Args:
        law: Whose columns are made orthogonal.
        others: To which.
    """
    one, other = _values_of_both(law, others)
    length = np.linalg.norm(other, axis=0)
    known = np.where(length > 0.0, length, 1.0)
    share = np.linalg.lstsq(other / known, one, rcond=1e-9)[0] / known[:, None]
    left = np.linalg.norm(one - other @ share, axis=0)
    whole = np.linalg.norm(one, axis=0)
    keep = (left > ROUNDING * whole) | (whole == 0.0)
    mix = np.vstack([np.eye(law.columns), -share]) * keep
    return mixture(hstack([law, others]), mix)


def _values_of_both(
    law: EffectJacobian, others: EffectJacobian
) -> tuple[Float[np.ndarray, "_ columns"], Float[np.ndarray, "_ others"]]:
    """Return the values of blocks that both have, one below the other."""
    kinds = {(type(p), site_number(p)): values(p) for p in others.parts}
    own, far = [np.zeros((0, law.columns))], [np.zeros((0, others.columns))]
    for part in law.parts:
        beside = kinds.get((type(part), site_number(part)))
        if beside is not None:
            own.append(values(part).reshape(-1, law.columns))
            far.append(beside.reshape(-1, others.columns))
    return np.concatenate(own), np.concatenate(far)
