"""How far a scenario is shows on a terminal alone, and vanishes when it is done."""

import sys

from rich.console import Console
from rich.progress import Progress, ProgressColumn


def bar(*columns: ProgressColumn) -> Progress:
    """Return a bar for one command; where nobody watches it writes nothing at all.

    Args:
        columns: What it shows; none: the usual.
    """
    console = Console(stderr=True)
    return Progress(
        *columns,
        console=console,
        transient=True,
        redirect_stdout=sys.stdout.isatty(),
        disable=not console.is_terminal,
    )
