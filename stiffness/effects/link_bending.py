"""Bending and torsion of a link under load, as of a beam.

==========  ==========================================================================
Equation    with L w from axis to axis, F and M of everything beyond on its end: slope =
            b (L²/2 w x F + L M_across) + t L (w . M) w, b = 1/EI, t = 1/GJ; deflection
            = b (L³/3 F_across + L²/2 M x w)
            a marker at x on the beam, r beside it: b (x²/2 (L - x/3) F_across + x²/2 M
            x w) + (b (x (L - x/2) w x F + x M_across) + t x (w . M) w) x r
Source      Euler-Bernoulli beam: Gere, Timoshenko 1997, "Mechanics of materials", beams
            between two directions a, c across: as about a alone, slope along a by the
            moment about c and about c by that about a (`bending`)
Valid       a slender link, equal in all directions across
Ignores     shear, stretch, the bend under the link's own weight; bearings away from the
            origins of the model's joints; sections unequal across (its variants;
            `unequal_bending`)
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.effects.base import Coeffs, Hypothesis, Shape, Shapes, inside_of
from stiffness.effects.jacobian import (
    BodyTwist,
    EffectJacobian,
    MarkerDisplacement,
    hstack,
    mixture,
    rotate,
    translate,
)
from stiffness.experiment.static_state import StaticState
from stiffness.robot.kinematics import cross, point_jacobian

HINGES = (0.125, 0.375, 0.625, 0.875)
"""Shares of a link at which it may bend in other forms of the law: where the beam's
four quarters would; chosen."""
RANK = 1e-3
"""Share of the largest singular value below which markers do not determine a twist;
chosen."""
SHORTEST = 1e-3
"""Distance of two axes, in m, below which a link does not bend; chosen."""
ACROSS = 0.5**0.5
"""Part of a link's own axis across the link from which that axis tells how its section
lies; chosen: nearer across than along."""
ALONG = 1e-3
"""Part of an axis across a link below which it tells no direction there; chosen."""
EQUAL = np.array([[1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]).T
"""Columns of `bending` that an equal section has together, and torsion."""
UNEQUAL = np.array([[1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]).T
"""What sections unequal across have beside."""


@dataclass(frozen=True)
class LinkBending(Hypothesis):
    """Link that bends as a beam from its axis to the next.

    It bends beyond the markers on it, as the bench's mechanism does, or they move with
    the part of the bend that lies before them (`within`: 0 or 1).
    """

    effect: ClassVar[str] = "link_bending"
    linear: ClassVar[bool] = True
    shape_names: ClassVar[tuple[str, ...]] = ("within",)
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        "bending_nm2": (1.0, np.inf),
        "torsion_nm2": (1.0, np.inf),
    }
    magnitudes: ClassVar[tuple[str, ...]] = ("bending_nm2", "torsion_nm2")

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        found = {
            link: _beam(situation, situation.ends_of(link)) for link in situation.links
        }
        return tuple(
            link
            for link, beam in found.items()
            if np.linalg.norm(beam, axis=1).min() > SHORTEST
        )

    @override
    def shapes(self, situation: StaticState, where: str) -> Shapes:
        marked = bool(_marks(situation, situation.ends_of(where)))
        return np.array([[0.0], [1.0]] if marked else [[0.0]])

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        return mixture(bending(situation, where, bool(shape[0])), EQUAL)

    @override
    def variants(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        unequal = mixture(bending(situation, where, bool(shape[0])), UNEQUAL)
        return hstack([unequal, *hinges(situation, where)])

    @override
    def parameters(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[str, float]:
        bending, torsion = coefficients
        return {"bending_nm2": 1.0 / bending, "torsion_nm2": 1.0 / torsion}


def bending(situation: StaticState, where: str, within: bool) -> EffectJacobian:
    """Return the Jacobian of a beam: about u, about v, between them, and torsion.

    Per unit of 1/EI and 1/GJ. Of the two directions across the link, u is the one of
    its own axis, or of the next where the link lies along its own; v = w x u.

    Args:
        situation: Static state of the arm.
        where: The link.
        within: Whether its markers move with the part of it that they are on.
    """
    ends = situation.ends_of(where)
    place = ends[1]
    tip = situation.origin[:, place]
    length = np.linalg.norm(_beam(situation, ends), axis=1)
    turned, moved = _bend(situation, ends, length[:, None])
    both = rotate(place, turned, tip).twist + translate(place, moved).twist
    carried = BodyTwist(place, both)
    if not within:
        return EffectJacobian(4, (carried,))
    marks = _marks(situation, ends)
    bent = {m: _on_beam(situation, ends, spot) for m, spot in marks.items()}
    return EffectJacobian(4, (carried, *_of_marks(situation, ends, marks, bent)))


def hinges(situation: StaticState, where: str) -> list[EffectJacobian]:
    """Return a link that bends at single points; none where no marker would tell."""
    ends = situation.ends_of(where)
    if not _marks(situation, ends):
        return []
    return [_hinge(situation, ends, share) for share in HINGES]


def _across(
    situation: StaticState, ends: tuple[int, int], w: Float[np.ndarray, "rows 3"]
) -> tuple[Float[np.ndarray, "rows 3"], Float[np.ndarray, "rows 3"]]:
    """Return the two directions u and v across a link that lies along w.

    A casting is alike on both sides of the plane in which its axis swings it.
    """
    own, seat = situation.frame[:, ends[0]], situation.seat[:, ends[1]]
    axes = own[:, :, 2], seat[:, :, 2], own[:, :, 0]  # the last where both lie along
    across = [z - w * np.sum(w * z, axis=1, keepdims=True) for z in axes]
    first, second, _ = (np.linalg.norm(one[0]) for one in across)
    u = across[0 if first >= ACROSS else 1 if second >= ALONG else 2]
    u = u / np.linalg.norm(u, axis=1, keepdims=True)
    return u, cross(w, u)


def _beam(situation: StaticState, ends: tuple[int, int]) -> Float[np.ndarray, "rows 3"]:
    """Return the way from a link's own axis to the next one, in m."""
    return situation.origin[:, ends[1]] - situation.origin[:, ends[0]]


def _marks(situation: StaticState, ends: tuple[int, int]) -> dict[int, np.ndarray]:
    """Return a link's markers before its end, positions in its frame, in m.

    None of a link that ends at several axes: they do not lie on one beam.
    """
    if situation.arm.chain.parent.count(ends[0] - 1) > 1:
        return {}
    found = {}
    for m, marker in enumerate(situation.recording.markers):
        spot = situation.marker_position(m)
        if (
            situation.arm.attachment(marker.body).axis == ends[0] - 1
            and spot is not None
        ):
            found[m] = inside_of(situation, marker.body, spot)
    return found


def _of_marks(
    situation: StaticState,
    ends: tuple[int, int],
    marks: Mapping[int, np.ndarray],
    moved: Mapping[int, np.ndarray],
) -> list[BodyTwist | MarkerDisplacement]:
    """Return the motion of a link's markers: their common twist, and each one's rest.

    Differences within visits are taken per body; the markers of a bending link move
    nearly as one body, and their deviations from it are visible in visit means.

    Args:
        situation: Static state of the arm.
        ends: The places of the link's own axis and of the one that it carries.
        marks: Positions of the markers in its frame, in m.
        moved: Displacement of each, per unit of each coefficient: (rows, 3, columns).
    """
    own_place, place = ends
    at, frame = situation.origin[:, own_place], situation.frame[:, own_place]
    lever = np.concatenate([point_jacobian(spot) for spot in marks.values()])
    turned = frame.swapaxes(1, 2)
    bent = np.concatenate([turned @ moved[m] for m in marks], axis=1)
    own = np.linalg.pinv(lever, rcond=RANK) @ bent
    twist = rotate(0, frame @ own[:, 3:], at).twist
    twist += translate(0, frame @ own[:, :3]).twist
    rest = [frame @ one for one in np.split(bent - lever @ own, len(marks), axis=1)]
    each = [MarkerDisplacement(m, one) for m, one in zip(marks, rest, strict=True)]
    return [BodyTwist(own_place, twist), BodyTwist(place, -twist), *each]


def _hinge(
    situation: StaticState, ends: tuple[int, int], share: float
) -> EffectJacobian:
    """Return the Jacobian of a link that bends at one point only."""
    own_place, place = ends
    start, end = situation.origin[:, own_place], situation.origin[:, place]
    point = start + share * (end - start)
    w = (end - start) / np.linalg.norm(end - start, axis=1, keepdims=True)
    force, moment = situation.force[:, place], situation.moment[:, place]
    moment = moment + cross(end - point, force)
    twist = w * np.sum(w * moment, axis=1, keepdims=True)
    turned = np.stack([moment - twist, twist], axis=2)
    marks, bent = _marks(situation, ends), {}
    for m, spot in marks.items():
        away = start + situation.frame[:, own_place] @ spot - point
        beyond = np.sum(w * away, axis=1) > 0.0
        bent[m] = np.cross(turned, away[:, :, None], axis=1) * beyond[:, None, None]
    carried = rotate(place, turned, point)
    return EffectJacobian(2, (carried, *_of_marks(situation, ends, marks, bent)))


def _on_beam(
    situation: StaticState,
    ends: tuple[int, int],
    marker_position: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "rows 3 4"]:
    """Return a point's displacement on a link, in m, by the columns of `bending`."""
    beam = _beam(situation, ends)
    length = np.linalg.norm(beam, axis=1, keepdims=True)
    w = beam / length
    away = situation.frame[:, ends[0]] @ marker_position
    x = np.clip(np.sum(w * away, axis=1, keepdims=True), 0.0, length)
    turned, moved = _bend(situation, ends, x)
    return moved + np.cross(turned, (away - x * w)[:, :, None], axis=1)


def _bend(
    situation: StaticState, ends: tuple[int, int], x: Float[np.ndarray, "rows 1"]
) -> tuple[Float[np.ndarray, "rows 3 4"], Float[np.ndarray, "rows 3 4"]]:
    """Return slope and deflection of a link x from its axis, as in `bending`."""
    beam = _beam(situation, ends)
    length = np.linalg.norm(beam, axis=1, keepdims=True)
    w = beam / length
    force, moment = situation.force[:, ends[1]], situation.moment[:, ends[1]]
    two = np.stack(_across(situation, ends, w), axis=2)
    slope = x * (length - x / 2) * cross(w, force) + x * moment
    sag = x**2 / 2 * ((length - x / 3) * force + cross(moment, w))
    away = np.cross(two, w[:, :, None], axis=1)  # where a turn about each moves the end
    about, aside = (
        np.einsum("ri,rij->rj", law, along)[:, None]
        for law, along in ((slope, two), (sag, away))
    )
    twist = x * w * np.sum(w * moment, axis=1, keepdims=True)
    swapped = np.sum(two * about[:, :, ::-1], axis=2, keepdims=True)
    turned = np.concatenate([two * about, swapped, twist[:, :, None]], axis=2)
    swapped = np.sum(away * aside[:, :, ::-1], axis=2, keepdims=True)
    none = np.zeros_like(swapped)
    return turned, np.concatenate([away * aside, swapped, none], axis=2)
