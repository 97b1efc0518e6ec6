"""Faults of a file: their places, quotes and suggestions, the first few of a kind."""

from bisect import bisect_right
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches

import numpy as np

# --- Faults ---------------------------------------------------------------------------

SHOWN = 5
"""Rows named one by one before the rest is counted (chosen: fits a screen)."""

LONGEST = 60
"""Characters of a user's own text that a message repeats (chosen)."""


@dataclass(frozen=True)
class Place:
    """A file of samples, for messages with file, row and column.

    Attributes:
        file: Its name.
        has_lines: Whether a row is also a line of text, below a line of header.
        unread: Rows of the file that are not in the table, ascending, from zero.
        above: Lines above the header.
        twice: Whether each row of the file stands twice in the table.
    """

    file: str
    has_lines: bool
    unread: tuple[int, ...] = ()
    above: int = 0
    twice: bool = False

    def row(self, index: int) -> str:
        """Return a row's name as a spreadsheet numbers it; the first line is line 1."""
        row = self._row_of_file(index)
        where = line_of(row, self.above) if self.has_lines else f"row {row + 1}"
        return f"{self.file}, {where}"

    def _row_of_file(self, index: int) -> int:
        index //= 2 if self.twice else 1
        return index + bisect_right([u - i for i, u in enumerate(self.unread)], index)

    def rows(self, count: int) -> np.ndarray:
        """Return which rows of the file so many rows of the table are, from zero."""
        every = np.arange(count + len(self.unread))
        return every[~np.isin(every, self.unread)]

    def at(
        self, column: str, rows: Iterable[int] | np.ndarray, say: Callable[[int], str]
    ) -> list[str]:
        """Return messages on some rows of one column, the first few by name.

        What is said alike of several rows is said once, of the first. Rows count from
        zero; `say` gives what is wrong in one, a clause without its subject.
        """
        alike: dict[str, list[int]] = {}
        for row in rows:
            alike.setdefault(say(int(row)), []).append(int(row))
        told = [*alike.items()]
        faults = [
            f"{self.row(same[0])}, column {column!r}: {what}"
            + (f" The same in {self._further(same[1:])}." if len(same) > 1 else "")
            for what, same in told[:SHOWN]
        ]
        if len(told) > SHOWN:
            more = sum(len(same) for _, same in told[SHOWN:])
            rest = f"{more} more {'row' if more == 1 else 'rows'} like these."
            faults.append(f"{self.file}, column {column!r}: and {rest}")
        return faults

    def _further(self, rows: Sequence[int]) -> str:
        """Return rows as a list of numbers, the first few, and how many more."""
        first = 2 + self.above if self.has_lines else 1
        word = "line" if self.has_lines else "row"
        shown = [str(self._row_of_file(r) + first) for r in rows[:SHOWN]]
        more = len(rows) - len(shown)
        parts = [*shown, f"{more} more"] if more else shown
        listed = f"{', '.join(parts[:-1])} and {parts[-1]}" if parts[1:] else parts[0]
        return f"{word if len(rows) == 1 else f'{word}s'} {listed}"


def line_of(row: int, above: int = 0) -> str:
    """Return a row's name, counted from zero below the header's line."""
    below = f" (row {row + 1} below the header)" if row >= 0 else ""
    return f"line {row + 2 + above}{below}"


def quoted(text: object) -> str:
    """Return a user's text safe to print: no control characters, never long."""
    shown = repr(text)
    return shown if len(shown) <= LONGEST else shown[: LONGEST - 1] + "…"


def visible(text: str) -> str:
    """Return a text with control characters escaped for a terminal."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


SHORT = 4
"""Letters of a name in which two exchanged ones are much (`cvs` for `csv`; chosen)."""


def nearest_of(name: str, known: Sequence[str]) -> str | None:
    """Return the known name that was probably meant; None where none is near."""
    folded = {k.casefold(): k for k in known}
    cutoff = 0.65 if len(name) <= SHORT else 0.7
    guess = get_close_matches(name.casefold(), folded, n=1, cutoff=cutoff)
    return folded[guess[0]] if guess else None


def nearest(name: str, known: Sequence[str]) -> str:
    """Return a question for the nearest known name; empty where none is near."""
    guess = nearest_of(name, known)
    return f" Did you mean {guess!r}?" if guess else ""


# --- Sections -------------------------------------------------------------------------


LONGEST_LINE = 200
"""Characters of another library's message; chosen: two lines of a terminal."""


def first_line(error: Exception) -> str:
    """Return the message of an error, on one line."""
    return visible(str(error).split("\n")[0])[:LONGEST_LINE] or type(error).__name__
