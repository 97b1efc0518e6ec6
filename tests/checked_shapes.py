"""Shapes in annotations, checked at the first calls of a function and now and then.

jaxtyping checks every call. A diagnosis makes hundreds of thousands, and to check them
took longer than the diagnosis; and to compile the checks of functions that no test of a
process calls took longer than the imports.
"""

from collections import Counter
from collections.abc import Callable
from functools import partial, wraps
from types import CodeType, FunctionType
from typing import Any

import jaxtyping
from jaxtyping import _decorator

FIRST, EVERY = 50, 64
"""Calls of a function that are checked in each process: the first so many, and one of
so many later ones; chosen: a twentieth of the time of checking all."""

DEFINED = 5
"""Times that a function within a function is defined and checked; chosen: each time its
checks are compiled anew, which took longer than all that a diagnosis computes."""

_checked: Callable[..., Any] = _decorator.jaxtyped
_definitions: Counter[CodeType] = Counter()


def check_sparingly() -> None:
    """Have jaxtyping's hook on imports check some calls instead of all."""
    jaxtyping.jaxtyped = _decorator.jaxtyped = _jaxtyped


def _jaxtyped(fn: Any = None, *, typechecker: Any) -> Any:
    if fn is None:
        return partial(_jaxtyped, typechecker=typechecker)
    if isinstance(fn, FunctionType):
        if "<locals>" in fn.__qualname__:
            _definitions[fn.__code__] += 1
            if _definitions[fn.__code__] > DEFINED:
                return fn
        return sparingly(fn, typechecker)
    return _checked(fn, typechecker=typechecker)  # comes back with what it holds


def sparingly(function: FunctionType, typechecker: Any) -> Callable[..., Any]:
    """Return a function of which some calls are checked, compiled at the first."""
    calls = 0
    checking: Any = None

    @wraps(function)
    def called(*args: Any, **kwargs: Any) -> Any:
        __tracebackhide__ = True
        nonlocal calls, checking
        calls += 1
        if calls > FIRST and calls % EVERY:
            return function(*args, **kwargs)
        if checking is None:
            checking = _checked(function, typechecker=typechecker)
        return checking(*args, **kwargs)

    return called
