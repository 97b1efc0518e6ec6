"""What differences within visits could tell of twists, whatever the readings are.

==========  ==========================================================================
Equation    information of a body: sum over its markers of L_m (x) G_m' T^-1 G_m, with
            L_m = diag(w) - w w'/sum(w) over rows (the rest position marginalised);
            of two places: sum over the bodies that both carry; less wrench noise U:
            information - information U (1 + U' information U)^-1 U' information
Source      Gauss-Markov with nuisance marginalised; Woodbury's identity
Valid       small motions of rigid bodies; noise of rows independent but for U
Ignores     the change of a tracker's smooth error over a few millimetres
==========  ==========================================================================

A turn has one number a row, a motion of a place six; index order axis, row for turns,
row, component for motions.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int


@dataclass(frozen=True, eq=False)
class Information:
    """Information on twists in some visits, laid out when it is asked for.

    Attributes:
        weight: Of each reading.
        lever: What takes a twist to a marker's displacement.
        inverse: Inverse covariance of one frame's reading.
        body: Index of each marker's body.
        carried: Whether a place carries a body.
        screw: Twist of what an axis carries per radian along it.
    """

    weight: Float[np.ndarray, "visits rows markers"]
    lever: Float[np.ndarray, "visits markers 3 6"]
    inverse: Float[np.ndarray, "3 3"]
    body: Int[np.ndarray, " markers"]
    carried: Bool[np.ndarray, "places bodies"]
    screw: Float[np.ndarray, "visits rows axes 6"]

    @property
    def axes(self) -> int:
        """How many axes there are."""
        return self.screw.shape[2]

    @cached_property
    def laplace(self) -> Float[np.ndarray, "visits rows rows markers"]:
        """Weights of products of two rows, the rest position marginalised."""
        weight, rows = self.weight, self.weight.shape[1]
        total = weight.sum(axis=1)
        share = weight / np.where(total > 0, total, 1.0)[:, None]
        laplace = -weight[:, :, None] * share[:, None]
        laplace[:, range(rows), range(rows)] += weight
        return laplace

    @cached_property
    def on_turns(self) -> Float[np.ndarray, "visits turns turns"]:
        """Raw information between the axes' turns."""
        visits, rows = self.screw.shape[:2]
        blocks = []
        for k in range(self.axes):
            onto = self.through(k + 1).reshape(visits, -1, rows, 6)
            blocks.append(np.einsum("vtrc,vrc->vtr", onto, self.screw[:, :, k]))
        return np.concatenate(blocks, axis=2)

    def through(self, place: int) -> Float[np.ndarray, "visits turns n"]:
        """Return the raw information between the axes' turns and a place's motions."""
        if place not in self._through:
            blocks = [
                self._turned(k, self.both(k + 1, place)) for k in range(self.axes)
            ]
            self._through[place] = np.concatenate(blocks, axis=1)
        return self._through[place]

    def of(self, bodies: tuple[int, ...]) -> Float[np.ndarray, "visits n n"]:
        """Return the information on a motion that these bodies share."""
        if bodies not in self._sums:
            visits, rows = self.screw.shape[:2]
            if not bodies:
                total = np.zeros((visits, rows * 6, rows * 6))
            elif len(bodies) == 1:
                total = self._of_body(bodies[0])
            else:  # the bodies of nested places differ by one
                total = self.of(bodies[1:]) + self.of(bodies[:1])
            self._sums[bodies] = total
        return self._sums[bodies]

    def both(self, one: int, other: int) -> tuple[int, ...]:
        """Return the bodies that both places carry."""
        shared = self.carried[one] & self.carried[other]
        return tuple(int(b) for b in np.flatnonzero(shared))

    def _of_body(self, b: int) -> np.ndarray:
        own = np.flatnonzero(self.body == b)
        visits, rows = self.screw.shape[:2]
        lever = self.lever[:, own]
        hessian = lever.swapaxes(2, 3) @ self.inverse @ lever
        joined = self.laplace[..., own].reshape(visits, rows * rows, len(own))
        product = joined @ hessian.reshape(visits, len(own), 36)
        shaped = product.reshape(visits, rows, rows, 6, 6).transpose(0, 1, 3, 2, 4)
        return shaped.reshape(visits, rows * 6, rows * 6)

    def _turned(self, k: int, bodies: tuple[int, ...]) -> np.ndarray:
        if (k, bodies) not in self._rows:
            visits, rows = self.screw.shape[:2]
            shaped = self.of(bodies).reshape(visits, rows, 6, rows * 6)
            turned = (self.screw[:, :, None, k] @ shaped)[:, :, 0]
            self._rows[k, bodies] = turned
        return self._rows[k, bodies]

    @cached_property
    def _sums(self) -> dict[tuple[int, ...], np.ndarray]:
        return {}

    @cached_property
    def _rows(self) -> dict[tuple[int, tuple[int, ...]], np.ndarray]:
        return {}

    @cached_property
    def _through(self) -> dict[int, np.ndarray]:
        return {}
