"""A damage is a folder that was a good recording."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from scenarios.damaging.samples import Samples


@dataclass(frozen=True)
class Damage:
    """One way to spoil a recording.

    Attributes:
        name: What was done.
        shows: Whether the `file` itself shows it, or only the `physics`.
        make: Writes it into a folder.
        other_model: Whether the model of another arm is given.
    """

    name: str
    shows: Literal["file", "physics"]
    make: Callable[[Path], None]
    other_model: bool = False


def rewritten(name: str, shows: Literal["file", "physics"], samples: Samples) -> Damage:
    """Return a damage that is other text in the same two files."""
    return Damage(name, shows, samples.write)
