"""Runs a command: its flags, faults and progress bar, and its exit status.

`stiffness-bench NAME` (`main`) is `python -m scenarios.NAME`; alone it lists them all.

Every command ends with `run(main, Settings)`: flags are the fields of `Settings`, the
module's docstring is its manual. The exit status is 0 when done, 2 after a user's
mistake and 130 when interrupted or terminated, without a traceback. `at_least` reports
all faults of the flags at once; `progress_bar` is shown on a terminal only and vanishes
at the end; elsewhere lines say how far it is.
"""

import ast
import os
import re
import signal
import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import fields
from importlib import import_module
from io import TextIOWrapper
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args, get_origin, get_type_hints

import tyro
from rich.console import Console
from rich.progress import Progress, ProgressColumn, TaskID
from typing_extensions import override

from bench.shared.errors import BenchError, LeftOut, UnknownName, refuse
from bench.shared.format.faults import visible
from scenarios import INTERRUPTED, SAYS

# --- Flags and exit status ------------------------------------------------------------

USER_MISTAKE = 2
_usual = warnings.showwarning
_said: set[str] = set()

Settings = TypeVar("Settings")


PROGRAM = "stiffness-bench"


def commands() -> dict[str, str]:
    """Return the names of all commands, each with the first line of its manual."""
    files = sorted(Path(__file__).parents[1].glob("[a-z]*.py"))
    trees = {file.stem: ast.parse(file.read_text("utf-8")) for file in files}
    manuals = {name: ast.get_docstring(tree) or "" for name, tree in trees.items()}
    return {name: text.partition("\n")[0] for name, text in manuals.items()}


def main() -> None:
    """Run the command that the first word names, or list all of them."""
    name, known = next(iter(sys.argv[1:]), "--help"), commands()
    if name in ("--help", "-h"):
        wide = max(map(len, known))
        lines = (f"  {word:{wide}}  {text}" for word, text in known.items())
        use = f"{PROGRAM} NAME FLAGS, manuals by {PROGRAM} NAME --help"
        print("\n".join((use, *lines)))
        return
    if name not in known:
        print(UnknownName("command", name, known), file=sys.stderr)
        sys.exit(USER_MISTAKE)
    try:
        command = import_module(f"scenarios.{name}")
    except KeyboardInterrupt:
        print(SAYS, file=sys.stderr)
        sys.exit(INTERRUPTED)
    sys.argv = [f"{PROGRAM} {name}", *sys.argv[2:]]
    run(command.main, command.Settings, sys.argv[0])


def run(
    main: Callable[[Settings], object], settings: type[Settings], program: str = ""
) -> None:
    """Read the command line, run a command, and exit with its status.

    Flags are the fields of `settings`; without a program it is called as `python -m
    scenarios.NAME`.
    """
    module = sys.modules[main.__module__]
    warnings.showwarning = _noted
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")
    name = f"python -m {module.__spec__.name}" if module.__spec__ else None
    name = program or name
    manual = re.sub(r"\n(?=(Takes|Expect):)", "\n\n", module.__doc__ or "")
    try:
        _show_no_types(settings)
        given = tyro.cli(settings, prog=name, description=manual)
        _refuse_empty(given)
        main(given)
        sys.stdout.flush()
    except BenchError as error:
        print("\n".join(map(visible, str(error).split("\n"))), file=sys.stderr)
        sys.exit(USER_MISTAKE)
    except KeyboardInterrupt:
        print(SAYS, file=sys.stderr)
        sys.exit(INTERRUPTED)
    except BrokenPipeError:  # the reader of the output was closed, as by `head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except (OSError, MemoryError) as error:  # of a folder, disk or memory: not a bug
        why = str(error) or "there is too little memory"
        print(f"It cannot be done here: {why}.", file=sys.stderr)
        sys.exit(USER_MISTAKE)


WORDS = {Path: "PATH", str: "NAME", int: "INT", tuple: "INT …"}


def _show_no_types(settings: type) -> None:
    """Let the manual of flags without a default show no type of Python."""
    hints = get_type_hints(settings, include_extras=True)
    for flag in fields(settings):
        if flag.default is None:
            whole = hints[flag.name]
            has_more = get_origin(whole) is Annotated
            hint, *known = get_args(whole) if has_more else (whole,)
            kind = next(one for one in get_args(hint) if one is not type(None))
            word = WORDS.get(get_origin(kind) or kind) or "|".join(get_args(kind))
            own = tyro.conf.arg(metavar=word, help_behavior_hint="(no default)")
            hints[flag.name] = Annotated[(hint, own, *known)]
    settings.__annotations__ = hints


def _noted(message: Warning | str, category: type[Warning], *where: Any) -> None:
    if not issubclass(category, LeftOut):
        _usual(message, category, *where)
    elif str(message) not in _said:  # a model is read more than once
        _said.add(str(message))
        print(f"Note: {message}", file=sys.stderr)


# --- All faults at once ---------------------------------------------------------------


def _refuse_empty(settings: Any) -> None:
    """Refuse flags without a value that have some by default."""
    faults = [
        f"--{f.name.replace('_', '-')} is empty, expected at least one value."
        for f in fields(settings)
        if getattr(settings, f.name) == () != f.default
    ]
    refuse("Flags", faults)


def at_least(least: int, **flags: int) -> None:
    """Refuse flags whose number is below the least that is allowed.

    Raises:
        Unusable: Naming all of them.
    """
    faults = [
        f"--{name} is {value}, expected at least {least}."
        for name, value in flags.items()
        if value < least
    ]
    refuse("Flags", faults)


# --- Progress -------------------------------------------------------------------------


EVERY_S = 20.0
"""Least time in s between two lines on progress where there is no terminal; chosen."""


class _Lines(Progress):
    """Writes a line on progress now and then, where no bar can be drawn."""

    written = 0.0

    @override
    def start(self) -> None:
        self.written = time.monotonic()

    @override
    def update(self, task_id: TaskID, **changes: Any) -> None:
        super().update(task_id, **changes)
        self._write_line(task_id)

    @override
    def advance(self, task_id: TaskID, advance: float = 1) -> None:
        super().advance(task_id, advance)
        self._write_line(task_id)

    def _write_line(self, task_id: TaskID) -> None:
        if time.monotonic() < self.written + EVERY_S:
            return
        self.written, task = time.monotonic(), self._tasks[task_id]
        total = "" if task.total is None else f" of {task.total:.0f}"
        print(f"{task.description}: {task.completed:.0f}{total}", file=sys.stderr)


def progress_bar(*columns: ProgressColumn) -> Progress:
    """Return a progress bar for one command; without a terminal it writes lines."""
    console = Console(stderr=True)
    kind = Progress if console.is_terminal else _Lines
    return kind(
        *columns,
        console=console,
        transient=True,
        redirect_stdout=sys.stdout.isatty(),
        disable=not console.is_terminal,
    )
