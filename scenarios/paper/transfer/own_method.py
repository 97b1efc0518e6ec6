"""A researcher's own method runs beside ours: a class that is built from an arm.

`package.module:Class` is imported from where Python finds modules, the working folder
included. The class derives from `Method` and takes the nominal arm; `fit(recording)`
returns a `Fitted`, which can `predict(cases)`: deflections in m along the base's axes.
"""

import importlib
import inspect
from collections.abc import Callable
from dataclasses import dataclass
from hashlib import sha256

from bench.errors import Unusable
from bench.recording import Recording
from stiffness.arm import Arm
from stiffness.methods.contract import faults
from stiffness.methods.method import Method

EXPECTED = (
    "expected is package.module:Class, a class that derives from "
    "stiffness.methods.method.Method and is built from a stiffness.arm.Arm."
)


@dataclass(frozen=True)
class OwnMethod:
    """Where a method is found, and what it was when the study began.

    Attributes:
        name: `package.module:Class`.
        source: Fingerprint of its module, so that kept cells of another version are
            not taken.
    """

    name: str
    source: str

    @classmethod
    def named(cls, name: str) -> "OwnMethod":
        """Find a method.

        Raises:
            Unusable: Where there is none, saying what is wrong and what is expected.
        """
        module = inspect.getsource(inspect.getmodule(_found(name)) or _found(name))
        return cls(name, sha256(module.encode()).hexdigest())

    def load(self) -> Callable[[Arm], Method]:
        """Return the class."""
        return _found(self.name)

    @property
    def title(self) -> str:
        """What tables call it."""
        return self.name.partition(":")[2]


def checked(own: OwnMethod, arm: Arm, recording: Recording) -> None:
    """Hold a method to the contract before hours are spent on it.

    Raises:
        Unusable: With everything that would spoil the comparison.
    """
    try:
        method = own.load()(arm)
    except Exception as error:  # whatever a stranger's class does when built
        fault = f"building it from an arm raises {error!r}; {EXPECTED}"
        raise Unusable(f"--method {own.name!r}", [fault]) from error
    if found := faults(method, arm, recording):
        raise Unusable(f"--method {own.name!r}", found)


def _found(name: str) -> type[Method]:
    module, _, called = name.partition(":")
    if not module or not called:
        raise Unusable(f"--method {name!r}", [f"it names no class; {EXPECTED}"])
    try:
        found = getattr(importlib.import_module(module), called, None)
    except Exception as error:  # whatever a stranger's module does when imported
        fault = f"{module!r} cannot be imported: {error!r}; {EXPECTED}"
        raise Unusable(f"--method {name!r}", [fault]) from error
    if not inspect.isclass(found):
        fault = f"{module!r} has no class {called!r}; {EXPECTED}"
        raise Unusable(f"--method {name!r}", [fault])
    if not issubclass(found, Method):
        fault = f"{called!r} does not derive from Method; {EXPECTED}"
        raise Unusable(f"--method {name!r}", [fault])
    return found
