"""All columns side by side, each block belonging to one cause."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from stiffness.calibration.columns import ORDERS, Candidate, stacked
from stiffness.calibration.geometry import Entry, entries_of
from stiffness.calibration.rigid_fit import RigidFit
from stiffness.calibration.stance import Stance

Key = tuple[str, str]
SILENT: Key = ("silent", "")
"""What is fitted without being a finding: frame, places, springs that the model has."""


@dataclass(frozen=True)
class Blocks:
    """How the columns of everything are laid out.

    Attributes:
        owner: Of each column, its effect and place.
        parameter: Of each column.
        order: Of each column of a table; 0 elsewhere.
        least: Smallest value of each coefficient.
        most: Largest.
        entry: Number of each column among the silent columns of a stance; −1 elsewhere.
        start: Where each column stands in the stance: the drawing's numbers as drawn
            so far, 0 elsewhere. Coefficients are whole numbers, not steps: what is
            not fitted is as the model has it.
        candidates: Whose columns follow those of the drawing.
    """

    owner: tuple[Key, ...]
    parameter: tuple[str, ...]
    order: Int[np.ndarray, " columns"]
    least: Float[np.ndarray, " columns"]
    most: Float[np.ndarray, " columns"]
    entry: Int[np.ndarray, " columns"]
    start: Float[np.ndarray, " columns"]
    candidates: tuple[Candidate, ...]

    @classmethod
    def of(
        cls,
        rigid: RigidFit,
        stance: Stance,
        candidates: Sequence[Candidate],
        sprung: Iterable[Key],
    ) -> "Blocks":
        """Lay out the drawing as far as it shows, then candidates."""
        drawing = entries_of(stance.standing.chain)
        quiet = [Entry(*SILENT, "")] * (len(rigid.kept) - len(drawing))
        shown = np.flatnonzero(rigid.kept)
        entries = [(*drawing, *quiet)[j] for j in shown]
        known = set(sprung)
        owner: list[Key] = [(e.effect, e.where) for e in entries]
        parameter = [e.parameter for e in entries]
        order, least = [0] * len(entries), [-np.inf] * len(entries)
        most = [np.inf] * len(entries)
        for c in candidates:
            count = len(c.parameters)
            owner += [SILENT if c.key in known else c.key] * count
            parameter += c.parameters
            order += c.orders or [0] * count
            least += [c.least] * count
            most += [c.most] * count
        entry = np.concatenate([shown, np.full(len(owner) - len(shown), -1)])
        start, own = np.zeros(len(owner)), shown[shown < len(drawing)]
        start[: len(own)] = stance.drawn.values[own]
        return cls(
            tuple(owner), tuple(parameter), np.array(order), np.array(least),
            np.array(most), entry, start, tuple(candidates),
        )  # fmt: skip

    @property
    def keys(self) -> tuple[Key, ...]:
        """Every effect and place that can be claimed, once."""
        return tuple(k for k in dict.fromkeys(self.owner) if k != SILENT)

    def columns_of(self, keys: Iterable[Key]) -> Int[np.ndarray, " some"]:
        """Return the numbers of the columns of some blocks, in order."""
        wanted = set(keys)
        return np.array([i for i, o in enumerate(self.owner) if o in wanted], dtype=int)

    def parts(self, key: Key) -> list[Int[np.ndarray, " some"]]:
        """Return a block's columns, parameter by parameter where they are bounded."""
        own = self.columns_of([key])
        if np.isfinite(self.least[own]).all():
            return [own[i : i + 1] for i in range(len(own))]
        return [own]

    def holds(self, columns: Int[np.ndarray, " some"], x: np.ndarray) -> bool:
        """Return whether coefficients of some columns are physically possible."""
        return bool(np.all((x >= self.least[columns]) & (x <= self.most[columns])))

    @property
    def band(self) -> Int[np.ndarray, " columns"]:
        """Of each column the band that its size is learnt with; −1: none."""
        octave = np.searchsorted(ORDERS, self.order, side="right").tolist()
        pairs = list(zip(self.owner, octave, strict=True))
        names = {pair: i for i, pair in enumerate(sorted({p for p in pairs if p[1]}))}
        return np.array([names.get(pair, -1) for pair in pairs])

    def matrix(
        self, stance: Stance, rows: Int[np.ndarray, " some"] | None = None
    ) -> Float[np.ndarray, "n columns"]:
        """Return the columns at some rows, three lines to a row."""
        return self.problem(stance, rows)[0]

    def problem(
        self, stance: Stance, rows: Int[np.ndarray, " some"] | None = None
    ) -> tuple[Float[np.ndarray, "n columns"], Float[np.ndarray, " n"]]:
        """Return the columns, and what they should add up to."""
        if rows is not None:
            stance = Stance.of(stance.readings.take(rows), stance.drawn)
        drawing = stance.silent()[:, :, self.entry[self.entry >= 0]]
        both = [drawing, stacked(self.candidates, stance)]
        a = np.concatenate(both, axis=2).reshape(-1, len(self.owner))
        return a, stance.residual.ravel() + a @ self.start
