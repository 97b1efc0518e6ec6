"""A user who made several mistakes hears of all of them at once."""

from collections.abc import Callable
from typing import Any

from bench.errors import BenchError, Unusable


def at_least(least: int, **flags: int) -> None:
    """Refuse flags below the least that they can be.

    Raises:
        Unusable: Naming all of them.
    """
    faults = [
        f"--{name} is {value}, expected at least {least}."
        for name, value in flags.items()
        if value < least
    ]
    if faults:
        raise Unusable("Flags", faults)


def collect(*makers: Callable[[], Any]) -> tuple[Any, ...]:
    """Return what each makes, or name everything that is wrong with all of them.

    Args:
        makers: Each makes one thing that the others do not need.

    Raises:
        Unusable: With the faults of all.
    """
    made, faults = [], []
    for make in makers:
        try:
            made.append(make())
        except Unusable as error:
            faults += [f"{error.what}: {fault}" for fault in error.faults]
        except BenchError as error:
            faults.append(str(error))
    if faults:
        raise Unusable("This command", faults)
    return tuple(made)
