"""The mean of a visit's readings pulls at markers; a column feels what it moves.

==========  ==========================================================================
Equation    product of columns with mean displacements x and y of all markers:
            x'R'R y = x'Dy - (Hx)'(Hy), R, D and H of `Roots`
Source      as `Roots`
Valid       as `Between`
Ignores     as `Between`
==========  ==========================================================================
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

from stiffness.diagnosis.columns import Columns, contract
from stiffness.diagnosis.roots import Roots
from stiffness.diagnosis.sites import Site, sites_of


@dataclass(frozen=True, eq=False)
class Means:
    """What means of some visits could say of columns.

    Attributes:
        roots: Of their inverse covariances.
        lever: What takes a twist to a marker's displacement.
        carries: Whether a place carries a marker.
        share: Weight of each row in each visit's mean.
        screw: Twist of what an axis carries per radian along it.
        unknown: Displacement of the markers per unit of each unknown.
    """

    roots: Roots
    lever: Float[np.ndarray, "visits markers 3 6"]
    carries: Bool[np.ndarray, "places markers"]
    share: Float[np.ndarray, "visits rows"]
    screw: Float[np.ndarray, "visits rows axes 6"]
    unknown: Float[np.ndarray, "visits n unknowns"]

    def moved(self, columns: Columns) -> Float[np.ndarray, "visits n columns"]:
        """Return mean displacements of all markers by columns; for few."""
        visits, markers = self.lever.shape[:2]
        total = np.zeros((visits, markers, 3, len(columns.column)))
        for site in sites_of(columns, self.share, self.screw):
            if site.marker >= 0:
                total[:, site.marker, :, site.slots] = site.mean
            else:
                on = np.flatnonzero(self.carries[site.place])
                moved = self.lever[:, on] @ site.mean[:, None]
                total[:, on, :, site.slots] = moved
        return columns.joined(total.reshape(visits, 3 * markers, -1))

    def products(
        self, sites: list[Site], slots: int, pull: Float[np.ndarray, "visits n pulls"]
    ) -> Float[np.ndarray, "pulls slots"]:
        """Return the products of pulls at markers with slots, added up."""
        total = np.zeros((pull.shape[2], slots))
        places: dict[int, np.ndarray] = {}
        for site in sites:
            at = self._at(site, pull, places)
            total[:, site.slots] = contract(at, site.mean)
        return total

    def of_unknown(
        self, sites: list[Site], slots: int
    ) -> Float[np.ndarray, "unknowns slots"]:
        """Return the products of the unknown with slots, added up."""
        total = np.zeros((self.unknown.shape[2], slots))
        for site in sites:
            at = self._at(site, self._unknown_pull, self._unknown_at)
            total[:, site.slots] = contract(at, site.mean)
        return total

    def of_each(
        self, sites: list[Site], slots: int, pull: Float[np.ndarray, "visits n pulls"]
    ) -> Float[np.ndarray, "visits pulls slots"]:
        """Return the products of pulls at markers with slots, visit by visit."""
        total = np.zeros((len(pull), pull.shape[2], slots))
        places: dict[int, np.ndarray] = {}
        for site in sites:
            at = self._at(site, pull, places)
            total[:, :, site.slots] = at.swapaxes(1, 2) @ site.mean
        return total

    def add_gram(
        self, sites: list[Site], total: Float[np.ndarray, "slots slots"]
    ) -> None:
        """Add the products of all slots, summed over visits."""
        seen, precision = self._shared, self._precision
        shared = np.empty((*seen.shape[:2], len(total)))
        for site in sites:
            if site.marker >= 0:
                at = seen[..., 3 * site.marker : 3 * site.marker + 3]
            else:
                at = seen @ self._onto(site.place)
            shared[..., site.slots] = at @ site.mean
        flat = shared.reshape(seen.shape[0] * seen.shape[1], len(total))
        total -= flat.T @ flat
        heavy = precision @ self.lever
        self._of_places([s for s in sites if s.place >= 0], heavy, total)
        self._of_markers(sites, heavy, precision, total)

    def _of_places(self, sites: list[Site], heavy: np.ndarray, gram: np.ndarray):
        """Add the products of motions of bodies with each other, H left out."""
        sums = self._inner
        for j, far in enumerate(sites):
            pulled: dict[bytes, np.ndarray] = {}
            for near in sites[: j + 1]:
                both = self.carries[near.place] & self.carries[far.place]
                key = both.tobytes()
                if key not in sums:
                    lever = self.lever[:, both].swapaxes(2, 3)
                    sums[key] = (lever @ heavy[:, both]).sum(axis=1)
                if key not in pulled:
                    pulled[key] = sums[key] @ far.mean
                block = contract(near.mean, pulled[key])
                gram[near.slots, far.slots] += block
                if near is not far:
                    gram[far.slots, near.slots] += block.T

    def _of_markers(self, sites, heavy, precision, gram) -> None:
        """Add the products of shifts with motions and with each other, H left out."""
        shifts = [s for s in sites if s.marker >= 0]
        if not shifts:
            return
        start, end = shifts[0].slots.start, shifts[-1].slots.stop
        count = end - start
        twists = np.empty((len(heavy), 6, count))
        marker = np.empty(count, dtype=int)
        for shift in shifts:
            m, mean = shift.marker, shift.mean
            own = slice(shift.slots.start - start, shift.slots.stop - start)
            marker[own] = m
            twists[..., own] = heavy[:, m].swapaxes(1, 2) @ mean
            gram[shift.slots, shift.slots] += contract(mean, precision[:, m] @ mean)
        for site in sites:
            if site.place < 0:
                continue
            on = self.carries[site.place][marker]
            block = np.where(on, contract(site.mean, twists), 0.0)
            gram[site.slots, start:end] += block
            gram[start:end, site.slots] += block.T

    def _at(
        self, site: Site, pull: np.ndarray, places: dict[int, np.ndarray]
    ) -> np.ndarray:
        """Return what pulls at markers make at a site: (visits, k, pulls)."""
        if site.marker >= 0:
            return pull[:, 3 * site.marker : 3 * site.marker + 3]
        if site.place not in places:
            places[site.place] = self._onto(site.place).swapaxes(1, 2) @ pull
        return places[site.place]

    def _onto(self, place: int) -> np.ndarray:
        """Return what takes a place's twist to displacements: (visits, n, 6)."""
        visits, markers = self.lever.shape[:2]
        apart = self.lever.reshape(visits, 3 * markers, 6)
        return apart * np.repeat(self.carries[place], 3)[:, None]

    @cached_property
    def _unknown_pull(self) -> np.ndarray:
        return self.roots.back(self.roots.white(self.unknown))

    @cached_property
    def _unknown_at(self) -> dict[int, np.ndarray]:
        return {}

    @cached_property
    def _shared(self) -> np.ndarray:
        return self.roots.shared()

    @cached_property
    def _precision(self) -> np.ndarray:
        return self.roots.half @ self.roots.half

    @cached_property
    def _inner(self) -> dict[bytes, np.ndarray]:
        """What markers seen by the noise alone make of twists, by who carries them."""
        return {}
