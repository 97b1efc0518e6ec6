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

A *site* is where columns act: (axis, False) along an axis counted from 0, one number a
row; (place, True) at a place by any twist, six numbers a row.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float

Site: TypeAlias = tuple[int, bool]


@dataclass(frozen=True, eq=False)
class Information:
    """Information on twists, visit by visit.

    Attributes:
        body: Of each body's twists; index order row, component.
        carried: Whether a place carries a body.
        screw: Twist of what an axis carries per radian along it.
        noise: Turns of the axes, one sigma, that the wrench's errors feign; index
            order axis, row.
    """

    body: Float[np.ndarray, "bodies visits n n"]
    carried: Bool[np.ndarray, "places bodies"]
    screw: Float[np.ndarray, "visits rows axes 6"]
    noise: Float[np.ndarray, "visits turns errors"]

    @property
    def rows(self) -> int:
        """Rows of a visit."""
        return self.screw.shape[1]

    @property
    def axes(self) -> range:
        """Numbers of the axes."""
        return range(self.screw.shape[2])

    @cached_property
    def kernel(self) -> Float[np.ndarray, "visits turns turns"]:
        """U (1 + U' information U)^-1 U' of the wrench's errors."""
        turns = np.concatenate([self.to_turns((k, False)) for k in self.axes], axis=1)
        u = self.noise
        inner = np.eye(u.shape[2]) + u.swapaxes(1, 2) @ turns @ u
        return u @ np.linalg.solve(inner, u.swapaxes(1, 2))

    def between(self, one: Site, other: Site) -> Float[np.ndarray, "visits a b"]:
        """Return the information between two sites, the wrench's errors taken out."""
        if (one, other) not in self._kept:
            raw = self._raw(one, other)
            through = self.to_turns(one) @ self.kernel
            out = self.to_turns(other).swapaxes(1, 2)
            self._kept[one, other] = raw - through @ out
        return self._kept[one, other]

    def to_turns(self, site: Site) -> Float[np.ndarray, "visits a turns"]:
        """Return the raw information between a site and all axes' turns."""
        if site not in self._through:
            blocks = [self._raw(site, (k, False)) for k in self.axes]
            self._through[site] = np.concatenate(blocks, axis=2)
        return self._through[site]

    def onto(
        self, score: Float[np.ndarray, "bodies visits n"], site: Site
    ) -> Float[np.ndarray, "visits a"]:
        """Add up the scores of the bodies that a site moves."""
        at, moves = site
        on = self.carried[at if moves else at + 1].astype(float)
        total = np.tensordot(on, score, axes=1)
        if moves:
            return total
        shaped = total.reshape(len(total), self.rows, 6)
        return np.sum(shaped * self.screw[:, :, at], axis=2)

    def _raw(self, one: Site, other: Site) -> np.ndarray:
        p, q = (at if moves else at + 1 for at, moves in (one, other))
        both = np.flatnonzero(self.carried[p] & self.carried[q])
        key = tuple(both.tolist())
        if key not in self._sums:
            zero = np.zeros(self.body.shape[1:])
            self._sums[key] = sum((self.body[b] for b in both), zero)
        matrix = self._sums[key]
        visits, n, _ = matrix.shape
        if not other[1]:
            screw = self.screw[:, :, other[0]]
            shaped = matrix.reshape(visits, n, self.rows, 6).swapaxes(1, 2)
            matrix = (shaped @ screw[..., None])[..., 0].swapaxes(1, 2)
        if not one[1]:
            screw = self.screw[:, :, one[0]]
            shaped = matrix.reshape(visits, self.rows, 6, -1)
            matrix = (screw[:, :, None] @ shaped)[:, :, 0]
        return matrix

    @cached_property
    def _sums(self) -> dict[tuple[int, ...], np.ndarray]:
        return {}

    @cached_property
    def _through(self) -> dict[Site, np.ndarray]:
        return {}

    @cached_property
    def _kept(self) -> dict[tuple[Site, Site], np.ndarray]:
        return {}
