"""Interface of methods that learn deflections, its contract, and the rigid arm.

`Method` fits a recording and returns a `Fitted`, which predicts. A method of your own
that keeps the contract can be compared with every other; to check it on any recording:

    from stiffness.methods.method import faults
    assert faults(MyMethod(arm), arm, recording) == []

It predicts three finite numbers for every case, the same each time; a case's prediction
depends on that case alone; fitting changes neither the method nor the recording, and
the order of visits changes nothing but rounding.

The rigid arm (`Rigid`), the baseline of all methods:

==========  ==========================================================================
Equation    d = 0
Source      the nominal arm of the data sheet
Needs       nothing but a recording that shows deflections
Assumes     no compliance
==========  ==========================================================================
"""

from abc import ABC, abstractmethod
from copy import deepcopy
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from bench.shared.recording import Recording
from stiffness.experiment.deflections import LoadCases, every_plateau, usable
from stiffness.robot.arm import Arm

# --- Method ---------------------------------------------------------------------------


@dataclass(frozen=True)
class Parameter:
    """One estimated parameter of a method, with its uncertainty.

    Attributes:
        name: Its name.
        value: In `unit`.
        sigma: Standard deviation from the stated noise alone, in `unit`.
        unit: Its unit.
        low: Lower end of the 95 % interval, which includes the model's own error.
        high: Upper end.
    """

    name: str
    value: float
    sigma: float
    unit: str
    low: float
    high: float


class Fitted(ABC):
    """A method fitted to a recording."""

    @abstractmethod
    def predict(self, cases: LoadCases) -> Float[np.ndarray, "cases 3"]:
        """Predict the displacement of the end-effector point in each case.

        Args:
            cases: Postures and loads of the arm.

        Returns:
            Loaded minus unloaded, along the base's axes, in m.
        """

    @property
    @abstractmethod
    def parameters(self) -> tuple[Parameter, ...]:
        """The estimated parameters; none where a method has no interpretable ones."""


class Method(ABC):
    """Method to learn deflections; built from a nominal arm and settings, not data."""

    @abstractmethod
    def fit(self, recording: Recording) -> Fitted:
        """Return the method fitted to a recording; the method itself does not change.

        Args:
            recording: One experiment.

        Returns:
            The fitted method, as a new object.

        Raises:
            Unusable: Where the recording cannot be used, with all faults.
            NotIdentifiable: Where a parameter of the method is not identifiable.
        """


# --- Rigid arm ------------------------------------------------------------------------


@dataclass(frozen=True)
class Rigid(Method):
    """Baseline that predicts no deflection.

    Attributes:
        arm: The nominal arm.
    """

    arm: Arm

    @override
    def fit(self, recording: Recording) -> "RigidFit":
        """Refuse recordings that no method could be fitted to; nothing is fitted."""
        usable(self.arm.for_recording(recording), recording)
        return RigidFit()


@dataclass(frozen=True)
class RigidFit(Fitted):
    """Prediction of no deflection."""

    @override
    def predict(self, cases: LoadCases) -> Float[np.ndarray, "cases 3"]:
        """Return zeros."""
        return np.zeros((len(cases), 3))

    @property
    @override
    def parameters(self) -> tuple[Parameter, ...]:
        """None."""
        return ()


# --- Contract -------------------------------------------------------------------------

ROUNDING = 1e-6
"""Share of the largest deflection that counts as rounding; chosen: single precision."""


def faults(method: Method, arm: Arm, recording: Recording) -> list[str]:
    """Return a method's violations of the contract; empty if there are none."""
    cases = every_plateau(arm, recording).cases
    before, was = deepcopy(recording), repr(method)
    try:
        fitted = method.fit(recording)
        if not isinstance(fitted, Fitted):
            kind = type(fitted).__name__
            return [f"fit returns {kind}, expected an object that derives from Fitted."]
        answer = np.asarray(fitted.predict(cases))
    except Exception as error:  # a user's method may raise anything
        return [f"fit and predict raise {error!r} on recording {recording.name!r}."]
    if answer.shape != (len(cases), 3):
        return [f"predict returns shape {answer.shape}, expected {(len(cases), 3)}."]
    if not np.isfinite(answer).all():
        row = int(np.argwhere(~np.isfinite(answer))[0][0])
        return [f"predict returns no finite number for case {row}."]
    found = []
    if repr(method) != was:
        found.append("fit changes the method; return what is learnt as a new object.")
    if not _same(before, recording):
        found.append("fit or predict changes the recording; work on a copy.")
    size = ROUNDING * float(np.abs(answer).max() or 1.0)
    alone = fitted.predict(cases.take(np.array([0])))
    if not np.allclose(alone[0], answer[0], rtol=0.0, atol=size):
        found.append("the answer for a case depends on what else is asked.")
    again = method.fit(before).predict(cases)
    if not np.array_equal(again, answer):
        found.append("learning twice from one recording differs; fix the seed.")
    shuffled = method.fit(_other_way_round(before)).predict(cases)
    if not np.allclose(shuffled, answer, rtol=0.0, atol=1e3 * size):
        found.append("the order of the visits changes the answer.")
    return found


def _same(one: Recording, other: Recording) -> bool:
    pairs = [(getattr(r, f.name) for r in (one, other)) for f in fields(one)]
    return all(
        np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
        for a, b in pairs
        if isinstance(a, np.ndarray)
    )


def _other_way_round(recording: Recording) -> Recording:
    """Return the visits in reverse order, rows and times of each as they were."""
    visits = np.unique(recording.visit)[::-1]
    rows = np.concatenate([np.flatnonzero(recording.visit == v) for v in visits])
    return recording.take(rows)
