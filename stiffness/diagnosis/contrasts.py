"""Differences within some visits pull at bodies; a column feels the pull where it acts.

==========  ==========================================================================
Equation    pull of a motion: information of each body times its motion, less that of
            the turns U (1 + U' information U)^-1 U' (pull on turns) which the wrench's
            errors would feign; product of two columns: the one's motion times the
            other's pull; of two turns at once from the information between turns
Source      as `Information`
Valid       as `Information`
Ignores     as `Information`
==========  ==========================================================================
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from stiffness.diagnosis.columns import Columns, Group, contract
from stiffness.diagnosis.information import Information


@dataclass(frozen=True, eq=False)
class Contrasts:
    """What differences within some visits say about twists.

    Attributes:
        information: What they could say.
        kernel: U (1 + U' information U)^-1 U' of the wrench's errors U.
        raw: Information between turns.
        turns: The same with the wrench's errors taken out.
        pull: Of the readings, without what the wrench's errors feigned.
    """

    information: Information
    kernel: Float[np.ndarray, "visits turns turns"]
    raw: Float[np.ndarray, "visits turns turns"]
    turns: Float[np.ndarray, "visits turns turns"]
    pull: Float[np.ndarray, "bodies visits n 1"]

    def add_gram(
        self, columns: Columns, total: Float[np.ndarray, "slots slots"]
    ) -> None:
        """Add the products of all slots, summed over visits; shifts have none."""
        self._of_turns(columns, total)
        if columns.motions:
            self._of_motions(columns, total)

    def pulls(self, columns: Columns) -> Float[np.ndarray, "bodies visits n columns"]:
        """Return the pull of each column; for few columns."""
        return self.cleaned(self.raw_pulls(self.moved(columns)))

    def products(self, columns: Columns, pull: np.ndarray) -> np.ndarray:
        """Return the products of pulls with slots, added up: (pulls, slots)."""
        total = np.zeros((pull.shape[3], len(columns.column)))
        for group, at in self._sites(columns, pull):
            visits, n, k = at.shape
            laid = group.values.reshape(visits * n, -1)
            total[:, group.slots] = at.reshape(visits * n, k).T @ laid
        return total

    def of_each(self, columns: Columns, pull: np.ndarray) -> np.ndarray:
        """Return the products of pulls with slots: (visits, pulls, slots)."""
        shape = (pull.shape[1], pull.shape[3], len(columns.column))
        total = np.zeros(shape)
        for group, at in self._sites(columns, pull):
            laid = group.values.reshape(*at.shape[:2], -1)
            total[:, :, group.slots] = at.swapaxes(1, 2) @ laid
        return total

    def moved(self, columns: Columns) -> Float[np.ndarray, "bodies visits n columns"]:
        """Return how columns move the bodies."""
        info = self.information
        visits, rows = info.screw.shape[:2]
        bodies = info.carried.shape[1]
        total = np.zeros((bodies, visits, rows, 6, len(columns.column)))
        for group in columns.turns:
            screw = info.screw[:, :, group.place, :, None]
            on = info.carried[group.place + 1]
            total[on, ..., group.slots] = screw * group.values[:, :, None]
        for group in columns.motions:
            total[info.carried[group.place], ..., group.slots] = group.values
        return columns.joined(total.reshape(bodies, visits, rows * 6, -1))

    def raw_pulls(self, moved: np.ndarray) -> np.ndarray:
        """Return the pull of motions of bodies, what errors feign included."""
        info = self.information
        return np.stack([info.of((b,)) @ own for b, own in enumerate(moved)])

    def cleaned(self, pull: np.ndarray) -> np.ndarray:
        """Return pulls without what the wrench's errors most likely feign."""
        info = self.information
        visits, rows = info.screw.shape[:2]
        feigned = self.kernel @ self.on_turns(pull)
        shaped = feigned.reshape(visits, info.axes, rows, 1, -1)
        moved = np.zeros((len(pull), visits, rows, 6, pull.shape[3]))
        for k in range(info.axes):
            moved[info.carried[k + 1]] += info.screw[:, :, k, :, None] * shaped[:, k]
        return pull - self.raw_pulls(moved.reshape(pull.shape))

    def on_turns(self, pull: np.ndarray) -> np.ndarray:
        """Return pulls along all axes: (visits, turns, pulls)."""
        along = [self._along(k, pull) for k in range(self.information.axes)]
        return np.concatenate(along, axis=1)

    def _along(self, k: int, pull: np.ndarray) -> np.ndarray:
        info = self.information
        visits, rows = info.screw.shape[:2]
        total = pull[info.carried[k + 1]].sum(axis=0)
        shaped = total.reshape(visits, rows, 6, -1)
        return (info.screw[:, :, None, k] @ shaped)[:, :, 0]

    def _sites(
        self, columns: Columns, pull: np.ndarray
    ) -> Iterator[tuple[Group, np.ndarray]]:
        for group in columns.turns:
            yield group, self._along(group.place, pull)
        for group in columns.motions:
            on = self.information.carried[group.place]
            yield group, pull[on].sum(axis=0)

    def _of_turns(self, columns: Columns, gram: np.ndarray) -> None:
        """Add the products of turns with turns."""
        visits, rows = self.information.screw.shape[:2]
        end = columns.turns[-1].slots.stop if columns.turns else 0
        for i, near in enumerate(columns.turns):
            one = slice(near.place * rows, near.place * rows + rows)
            pulled = np.empty((visits, rows, end - near.slots.start))
            for far in columns.turns[i:]:
                other = slice(far.place * rows, far.place * rows + rows)
                at = slice(
                    far.slots.start - near.slots.start,
                    far.slots.stop - near.slots.start,
                )
                pulled[..., at] = self.turns[:, one, other] @ far.values
            block = contract(near.values, pulled)
            after = slice(near.slots.stop, end)
            gram[near.slots, near.slots.start : end] += block
            gram[after, near.slots] += block[:, near.values.shape[2] :].T

    def _of_motions(self, columns: Columns, gram: np.ndarray) -> None:
        """Add the products of motions with turns and with motions."""
        info = self.information
        visits, rows = info.screw.shape[:2]
        start, end = columns.motions[0].slots.start, columns.motions[-1].slots.stop
        laid = [g.values.reshape(visits, rows * 6, -1) for g in columns.motions]
        through = [info.through(g.place) for g in columns.motions]
        along = np.concatenate(
            [t @ x for t, x in zip(through, laid, strict=True)], axis=2
        )
        feigned = self.kernel @ along
        own = slice(start, end)
        left = along - self.raw @ feigned
        for near in columns.turns:
            one = slice(near.place * rows, near.place * rows + rows)
            block = contract(near.values, left[:, one])
            gram[near.slots, own] += block
            gram[own, near.slots] += block.T
        gram[own, own] -= contract(along, feigned)
        for j, (far, y) in enumerate(zip(columns.motions, laid, strict=True)):
            pulled: dict[tuple[int, ...], np.ndarray] = {}
            for near, x in zip(columns.motions[: j + 1], laid, strict=False):
                bodies = info.both(near.place, far.place)
                if bodies not in pulled:
                    pulled[bodies] = info.of(bodies) @ y
                block = contract(x, pulled[bodies])
                gram[near.slots, far.slots] += block
                if near is not far:
                    gram[far.slots, near.slots] += block.T
