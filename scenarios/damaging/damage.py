"""A damage is a folder that was a good recording."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from scenarios.damaging.samples import Samples
from scenarios.diagnosing.schema import Remark


@dataclass(frozen=True)
class Damage:
    """One way to spoil a recording.

    Attributes:
        name: What was done.
        shows: Whether the `file` itself shows it, or only the `physics`.
        make: Writes it into a folder.
        other_model: Whether the model of another arm is given.
        code: Of the warning that alone recognises it; empty: any mistake of the set-up.
        word: Has to be in that warning.
    """

    name: str
    shows: Literal["file", "physics"]
    make: Callable[[Path], None]
    other_model: bool = False
    code: str = ""
    word: str = ""

    def recognised(self, told: Iterable[Remark]) -> bool:
        """Say whether one of the warnings is of this damage."""
        return not self.code or any(
            w.code == self.code and self.word in w.text for w in told
        )


def rewritten(name: str, shows: Literal["file", "physics"], samples: Samples) -> Damage:
    """Return a damage that is other text in the same two files."""
    return Damage(name, shows, samples.write)
