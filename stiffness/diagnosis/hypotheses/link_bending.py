"""A link under load bends and twists like a beam.

==========  ==========================================================================
Equation    with L w from axis to axis, F and M of all beyond on its end: slope = b
            (L²/2 w x F + L M_across) + t L (w . M) w, b = 1/EI, t = 1/GJ; deflection =
            b (L³/3 F_across + L²/2 M x w)
Source      Euler-Bernoulli beam: Gere, Timoshenko 1997, "Mechanics of materials", beams
Valid       a slender link, alike in all directions across
Ignores     shear, stretch, the bend under the link's own weight; that bearings may sit
            beside the origins of the model's joints
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.diagnosis.hypotheses.hypothesis import Hypothesis
from stiffness.diagnosis.signature import NOTHING, Motion, Signature, rotate, translate
from stiffness.diagnosis.situation import Situation

SHORTEST = 1e-3
"""Distance of two axes, in m, below which nothing is left to bend; chosen."""


@dataclass(frozen=True)
class LinkBending(Hypothesis):
    """A link that is a beam from its axis to the next."""

    effect: ClassVar[str] = "link_bending"
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        "bending_nm2": (1.0, np.inf),
        "torsion_nm2": (1.0, np.inf),
    }
    sizes: ClassVar[tuple[str, ...]] = ("bending_nm2", "torsion_nm2")

    @override
    def places(self, situation: Situation) -> tuple[str, ...]:
        ends = np.diff(situation.origin[:, 1:], axis=1)  # (rows, links, 3)
        length = np.linalg.norm(ends, axis=2).min(axis=0)
        found = zip(situation.links, length, strict=True)
        return tuple(link for link, distance in found if distance > SHORTEST)

    @override
    def shapes(
        self, situation: Situation, where: str
    ) -> Float[np.ndarray, "shapes parameters"]:
        return np.zeros((1, 0))

    @override
    def signature(
        self, situation: Situation, where: str, shape: Float[np.ndarray, " parameters"]
    ) -> Signature:
        place = situation.links.index(where) + 2
        tip = situation.origin[:, place]
        beam = tip - situation.origin[:, place - 1]
        length = np.linalg.norm(beam, axis=1, keepdims=True)
        w = beam / length
        force, moment = situation.force[:, place], situation.moment[:, place]
        twist = w * np.sum(w * moment, axis=1, keepdims=True)
        across = force - w * np.sum(w * force, axis=1, keepdims=True)
        slope = length**2 / 2 * np.cross(w, force) + length * (moment - twist)
        sag = length**3 / 3 * across + length**2 / 2 * np.cross(moment, w)
        turned = np.stack([slope, length * twist], axis=2)
        moved = np.stack([sag, np.zeros_like(sag)], axis=2)
        both = rotate(place, turned, tip).twist + translate(place, moved).twist
        return Signature(2, (Motion(place, both),))

    @override
    def variants(
        self, situation: Situation, where: str, shape: Float[np.ndarray, " parameters"]
    ) -> Signature:
        return NOTHING

    @override
    def parameters(
        self,
        situation: Situation,
        where: str,
        shape: Float[np.ndarray, " parameters"],
        coefficients: Float[np.ndarray, " columns"],
    ) -> Mapping[str, float]:
        bending, torsion = coefficients
        return {"bending_nm2": 1.0 / bending, "torsion_nm2": 1.0 / torsion}
