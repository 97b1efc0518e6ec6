"""What was tried between two encoders and not believed is told with its reason."""

from collections.abc import Sequence

import numpy as np

from scenarios.diagnosing.units import label, size
from scenarios.reporting.page import Block, Heading, Paragraph, Table
from scenarios.two_encoders.axis import Axis, whole_rms
from stiffness.two_encoders.fitting import columns, fitted
from stiffness.two_encoders.found import Trial
from stiffness.two_encoders.judging import BORROWED
from stiffness.two_encoders.terms import FRICTION

URAD = 1e6


def refused(axes: Sequence[Axis]) -> list[Block]:
    """Return the report's section."""
    return [
        Heading("What was refused, and why"),
        Table(
            "Tried after what was believed; each must make motions that it was not "
            "fitted to better, every one, and not live on the delay of its axis. The "
            "last column was worked out after all was decided: what would be left of "
            "the judged motion, to first order.",
            (
                *("axis", "effect", "would be", "gain / its error"),
                *("reason", "would leave [µrad rms]"),
            ),
            [
                (
                    a.name,
                    _named(t),
                    _would_be(t),
                    f"{t.gain / max(t.error, 1e-30):.1f}",
                    _why(t),
                    f"{URAD * _with(a, t):.1f}",
                )
                for a in axes
                for t in a.found.refused
            ],
        ),
        *_borrowing(axes),
    ]


def _borrowing(axes: Sequence[Axis]) -> list[Block]:
    """Explain a compliance that was refused since it lives on the delay."""
    refused = [
        t for a in axes for t in a.found.refused if t.reason.startswith(BORROWED)
    ]
    if not any(t.term.effect == "joint_compliance" for t in refused):
        return []
    text = (
        "Torque is the motor's, friction included, and friction goes with speed: "
        "that is how a compliance borrows from a delay. With friction's constant "
        "part taken off, its part that grows with speed still looks like a delay: "
        "where one instrument reads all second encoders, their common delay tells."
    )
    return [Paragraph(text)]


def _named(trial: Trial) -> str:
    term = trial.term
    if term.order:
        return f"{term.effect}, order {term.order:g}"
    if term.effect == "hysteresis":
        return f"{term.effect}, slips at {term.shape[0]:.3g} N m"
    if term.effect == FRICTION:
        grows = "constant" if term.shape else "with speed"
        return f"friction in the motor's torque, {grows}"
    kinds = ["constant" if x.shape else "with speed" for x in trial.beside]
    friction = f", beside friction ({' and '.join(kinds)}) in the motor's torque"
    return term.effect + (friction if kinds else "")


def _kind(trial: Trial) -> str:
    """Return what the size of a term is called."""
    return "amplitude" if trial.term.order else label(trial.term.parameters[0])


def _would_be(trial: Trial) -> str:
    """Return the size at which a term was refused; a wave's is its amplitude."""
    known = trial.coefficients[: len(trial.term.parameters)]
    value = float(np.linalg.norm(known)) if trial.term.order else known[0]
    return f"{_kind(trial)} {size(trial.term.parameters[0], value)}"


def _why(trial: Trial) -> str:
    """Return why a term was refused, parameters called as people do."""
    first, _, rest = trial.reason.partition(" ")
    return f"its {label(first)} {rest}" if "_" in first else trial.reason


def _with(axis: Axis, trial: Trial) -> float:
    """Return what a refused term would leave of the judged motion, in rad."""
    found = axis.found
    terms = (*found.terms, trial.term, *trial.beside)
    x, _ = fitted(terms, [found.then(m) for m in axis.fitted])
    then = found.then(axis.judged)
    return whole_rms(then.apart - columns(terms, then) @ x)
