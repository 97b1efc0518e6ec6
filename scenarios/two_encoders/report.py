"""The report of axes that are read on both sides of their gears."""

from collections.abc import Sequence
from pathlib import Path

from scenarios.diagnosing.schema import Answer
from scenarios.diagnosing.units import label, span
from scenarios.reporting.page import Block, Figure, Heading, Paragraph, Table
from scenarios.two_encoders.axis import WINDOW, Axis, rms, whole_rms
from scenarios.two_encoders.pictures import before_after, followed, looks_like
from stiffness.two_encoders.fitting import columns, fitted
from stiffness.two_encoders.found import Trial
from stiffness.two_encoders.judging import BORROWED
from stiffness.two_encoders.terms import FRICTION

URAD = 1e6


def first_sentence(axes: Sequence[Axis], answer: Answer) -> str:
    """Return what was found, in one sentence."""
    before = " / ".join(f"{URAD * whole_rms(a.before):.0f}" for a in axes)
    after = " / ".join(f"{URAD * whole_rms(a.after):.0f}" for a in axes)
    names = " and ".join(dict.fromkeys(n.effect for n in answer.named)) or "nothing"
    wrong = [w.where for w in answer.warnings if w.code == "spring"]
    more = f"; the model's springs at {', '.join(wrong)} do not show" if wrong else ""
    return (
        f"On a motion that nothing was fitted to, the second encoders of "
        f"{', '.join(a.name for a in axes)} are predicted to {after} instead of "
        f"{before} µrad rms; named: {names}{more}."
    )


def blocks_of(axes: Sequence[Axis], answer: Answer, folder: Path) -> list[Block]:
    """Draw the pictures and return the report."""
    before_after(axes, folder / "before_after.png")
    looks_like(axes, folder / "looks_like.png")
    return [
        Figure(
            "The second encoder beside the first on the judged motion: the nominal "
            "simulation (grey) and the simulator with what was named (orange).",
            "before_after.png",
        ),
        Table(
            f"Rms on the judged motion in µrad, of all rows and of means over "
            f"{WINDOW:g} s; one constant an axis and motion is free.",
            (
                "axis",
                "nominal",
                "named",
                f"nominal, {WINDOW:g} s",
                f"named, {WINDOW:g} s",
            ),
            [
                (
                    a.name,
                    f"{URAD * whole_rms(a.before):.1f}",
                    f"{URAD * whole_rms(a.after):.1f}",
                    f"{URAD * rms(a.before, a.judged.time):.1f}",
                    f"{URAD * rms(a.after, a.judged.time):.1f}",
                )
                for a in axes
            ],
        ),
        Heading("What was named"),
        Table(
            "Named, with 95 % intervals over stretches of time of the fitted motions.",
            ("axis", "effect", "parameters"),
            [
                (
                    n.where,
                    n.effect,
                    "; ".join(
                        f"{label(k)} {span(k, v)}" for k, v in n.parameters.items()
                    ),
                )
                for n in answer.named
            ],
        ),
        Figure(followed(axes), "looks_like.png"),
        Heading("What was refused, and why"),
        Table(
            "Tried after what was believed; each must make motions that it was not "
            "fitted to better, every one, and not live on the delay of its axis. The "
            "last column was worked out after all was decided: what would be left of "
            "the judged motion, to first order.",
            ("axis", "effect", "would be", "gain / its error", "reason", "[µrad]"),
            [
                (
                    a.name,
                    _named(t),
                    f"{t.coefficients[0]:.3g}",
                    f"{t.gain / max(t.error, 1e-30):.1f}",
                    t.reason,
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
    behind = ", with friction in the motor's torque" if trial.beside else ""
    return term.effect + behind


def _with(axis: Axis, trial: Trial) -> float:
    """Return what a refused term would leave of the judged motion, in rad."""
    found = axis.found
    terms = (*found.terms, trial.term, *trial.beside)
    x, _ = fitted(terms, [found.then(m) for m in axis.fitted])
    then = found.then(axis.judged)
    return whole_rms(then.apart - columns(terms, then) @ x)
