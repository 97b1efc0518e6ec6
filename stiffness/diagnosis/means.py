"""The mean of a visit's readings pulls at markers; a column feels what it moves.

==========  ==========================================================================
Equation    product of columns with mean displacements x and y of all markers:
            x'R'R y = x'Dy - (Hx)'(Hy), R, D and H of `Roots`
Source      as `Roots`
Valid       as `Between`
Ignores     as `Between`
==========  ==========================================================================
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from stiffness.diagnosis.columns import Columns, contract
from stiffness.diagnosis.roots import Roots


@dataclass(frozen=True, eq=False)
class Site:
    """Slots of one group, averaged over the rows of each visit.

    Attributes:
        slots: Where they stand among all slots.
        mean: Twists or shifts of each visit.
        place: The place that moves; -1 where a marker shifts.
        marker: The marker that shifts; -1 where bodies move.
    """

    slots: slice
    mean: Float[np.ndarray, "visits k columns"]
    place: int = -1
    marker: int = -1


@dataclass(frozen=True, eq=False)
class Means:
    """What means of some visits could say of columns.

    Attributes:
        roots: Of their inverse covariances.
        lever: What takes a twist to a marker's displacement.
        carries: Whether a place carries a marker.
        share: Weight of each row in each visit's mean.
        screw: Twist of what an axis carries per radian along it.
    """

    roots: Roots
    lever: Float[np.ndarray, "visits markers 3 6"]
    carries: Bool[np.ndarray, "places markers"]
    share: Float[np.ndarray, "visits rows"]
    screw: Float[np.ndarray, "visits rows axes 6"]

    def sites(self, columns: Columns) -> list[Site]:
        """Return the means of all groups of columns."""
        share = self.share[:, None]
        sites = []
        for group in columns.turns:
            screw = share.swapaxes(1, 2) * self.screw[:, :, group.place]
            mean = screw.swapaxes(1, 2) @ group.values
            sites.append(Site(group.slots, mean, place=group.place + 1))
        for group in (*columns.motions, *columns.shifts):
            visits, rows, k, count = group.values.shape
            flat = share @ group.values.reshape(visits, rows, k * count)
            mean = flat.reshape(visits, k, count)
            at = {"place" if k == 6 else "marker": group.place}
            sites.append(Site(group.slots, mean, **at))
        return sites

    def moved(self, columns: Columns) -> Float[np.ndarray, "visits n columns"]:
        """Return mean displacements of all markers by columns; for few."""
        visits, markers = self.lever.shape[:2]
        total = np.zeros((visits, markers, 3, len(columns.column)))
        for site in self.sites(columns):
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
        for site, at in self._at(sites, pull):
            total[:, site.slots] = contract(at, site.mean)
        return total

    def of_each(
        self, sites: list[Site], slots: int, pull: Float[np.ndarray, "visits n pulls"]
    ) -> Float[np.ndarray, "visits pulls slots"]:
        """Return the products of pulls at markers with slots, visit by visit."""
        total = np.zeros((len(pull), pull.shape[2], slots))
        for site, at in self._at(sites, pull):
            total[:, :, site.slots] = at.swapaxes(1, 2) @ site.mean
        return total

    def add_gram(
        self, sites: list[Site], total: Float[np.ndarray, "slots slots"]
    ) -> None:
        """Add the products of all slots, summed over visits."""
        visits, markers = self.lever.shape[:2]
        half, seen = self.roots.half, self.roots.shared()
        apart = self.lever.reshape(visits, 3 * markers, 6)
        shared = np.empty((visits, seen.shape[1], len(total)))
        for site in sites:
            if site.marker >= 0:
                at = seen[..., 3 * site.marker : 3 * site.marker + 3]
            else:
                at = seen @ (apart * np.repeat(self.carries[site.place], 3)[:, None])
            shared[..., site.slots] = at @ site.mean
        flat = shared.reshape(-1, len(total))
        total -= flat.T @ flat
        precision = half @ half
        heavy = precision @ self.lever
        self._of_places([s for s in sites if s.place >= 0], heavy, total)
        self._of_markers(sites, heavy, precision, total)

    def _of_places(self, sites: list[Site], heavy: np.ndarray, gram: np.ndarray):
        """Add the products of motions of bodies with each other, H left out."""
        inner = self.lever.swapaxes(2, 3) @ heavy  # (visits, markers, 6, 6)
        sums: dict[bytes, np.ndarray] = {}
        for j, far in enumerate(sites):
            pulled: dict[bytes, np.ndarray] = {}
            for near in sites[: j + 1]:
                both = self.carries[near.place] & self.carries[far.place]
                key = both.tobytes()
                if key not in sums:
                    sums[key] = inner[:, both].sum(axis=1)
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

    def _at(self, sites: list[Site], pull: np.ndarray) -> Iterator[tuple]:
        """Yield sites with what pulls at markers make of them: (visits, k, pulls)."""
        visits, markers = self.lever.shape[:2]
        apart = self.lever.reshape(visits, 3 * markers, 6)
        places: dict[int, np.ndarray] = {}
        for site in sites:
            if site.marker >= 0:
                yield site, pull[:, 3 * site.marker : 3 * site.marker + 3]
                continue
            if site.place not in places:
                on = np.repeat(self.carries[site.place], 3)
                onto = np.ascontiguousarray((apart * on[:, None]).swapaxes(1, 2))
                places[site.place] = onto @ pull
            yield site, places[site.place]
