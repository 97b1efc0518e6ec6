"""Errors of users, each with what is allowed and what to do."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

import numpy as np


class BenchError(Exception):
    """Error that the user can correct; its message says how."""


class UnknownName(BenchError):
    """A joint, body, effect, method or instrument that does not exist."""

    def __init__(self, kind: str, name: str, known: Iterable[str]):
        """Name what was asked for, the nearest match and everything known."""
        known = sorted(known)
        guess = get_close_matches(name, known, n=1)
        hint = f" Did you mean {guess[0]!r}?" if guess else ""
        listed = ", ".join([*guess, *(k for k in known if k not in guess)])
        super().__init__(f"No {kind} is called {name!r}.{hint} Known: {listed}.")


class Unusable(BenchError):
    """A recording, a model or a setting with faults; the message lists them all."""

    def __init__(self, what: str, faults: Sequence[str]):
        """Keep the faults, one sentence each, and join them into one message."""
        self.what, self.faults = what, tuple(faults)
        count = "1 fault" if len(self.faults) == 1 else f"{len(self.faults)} faults"
        lines = "\n".join(f"  - {fault}" for fault in self.faults)
        super().__init__(f"{what} cannot be used, {count}:\n{lines}")


class NotIdentifiable(BenchError):
    """The data carry no information about a parameter that was asked for."""

    def __init__(self, message: str, axes: Sequence[str] = ()):
        """Keep the axes that the message names, for a caller that may fix them."""
        self.axes = tuple(axes)
        super().__init__(message)


class LeftOut(UserWarning):
    """Content of a model that neither the bench nor a claim uses."""


@dataclass(frozen=True)
class Warned:
    """A mistake of the set-up, or something that the reader should know."""

    code: str
    where: str
    text: str


def refuse(what: str, faults: list[str]) -> None:
    """Raise all faults at once, where there are any."""
    if faults:
        raise Unusable(what, faults)


COMMAND, EFFECTS = "This command", "The list of effects"
"""Of what there are faults that need no heading, since each names what it is of."""


def collect(*makers: Callable[[], Any]) -> tuple[Any, ...]:
    """Return the results of some functions, or raise the faults of all of them.

    Raises:
        Unusable: With the faults of all.
    """
    made, faults = [], []
    for make in makers:
        try:
            made.append(make())
        except Unusable as error:
            what = "" if error.what in (COMMAND, EFFECTS) else f"{error.what}: "
            faults += [f"{what}{fault}" for fault in error.faults]
        except BenchError as error:
            faults.append(str(error))
    refuse(COMMAND, faults)
    return tuple(made)


# --- Sizes of settings ----------------------------------------------------------------


MAX_SIZE = 1e6
"""Largest size of any setting, in SI; chosen: beyond it is no instrument."""


def not_sizes(sizes: Mapping[str, object]) -> list[str]:
    """Name every entry that is not from 0 to `MAX_SIZE`."""
    return [
        f"{name} is {value}, expected at least 0 and at most {MAX_SIZE:g}."
        for name, value in sizes.items()
        if not np.all(
            (np.asarray(value, float) >= 0.0) & (np.asarray(value) <= MAX_SIZE)
        )
    ]


def not_vectors(vectors: Mapping[str, tuple[float, ...]], length: int) -> list[str]:
    """Name every entry that is not a vector of this length within `MAX_SIZE`."""
    return [
        f"{name} is {value}, expected {length} numbers from {-MAX_SIZE:g} to "
        f"{MAX_SIZE:g}."
        for name, value in vectors.items()
        if len(value) != length or not np.all(np.abs(value) <= MAX_SIZE)
    ]
