"""The report of a comparison of encoders: rejected terms, tables, and its files."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure as Picture

from bench.shared.errors import BenchError, UnknownName
from bench.shared.settings import URAD
from scenarios.pipelines import schema as form
from scenarios.pipelines.compare_encoders import ComparisonOutcome
from scenarios.pipelines.encoder_axes import WINDOW, Axis, rms_of_windows, whole_rms
from scenarios.pipelines.patching import write_patch_of_axes
from scenarios.pipelines.schema import Answer, label, parameters_text, size
from scenarios.report import data_files, page
from scenarios.report.data_files import DECISIONS, write_folder
from scenarios.report.figures import encoders_before_after, followed, looks_like
from scenarios.report.page import Block, Figure, Heading, Paragraph, Table, table_of
from scenarios.report.playback import PLAYBACK, show_comparison
from stiffness.dual_encoder.fit import SelectionStep, columns, fitted
from stiffness.dual_encoder.selection import BORROWED
from stiffness.dual_encoder.terms import FRICTION

# --- Rejected terms -------------------------------------------------------------------


def rejected_terms(axes: Sequence[Axis]) -> list[Block]:
    """Return the section on terms that were tried and refused, with their reasons."""
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
            [_refused(a, t) for a in axes for t in a.found.refused],
        ),
        *_borrowing(axes),
    ]


def _refused(axis: Axis, trial: SelectionStep) -> tuple[str, ...]:
    over_error = f"{trial.gain / max(trial.error, 1e-30):.1f}"
    left = f"{URAD * _with(axis, trial):.1f}"
    kind, would_be, why = _named(trial), _would_be(trial), _why(trial)
    return (axis.name, kind, would_be, over_error, why, left)


def _borrowing(axes: Sequence[Axis]) -> list[Block]:
    """Explain a compliance that was refused since it is confounded with a delay."""
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


def _named(trial: SelectionStep) -> str:
    term = trial.term
    if term.order:
        return f"{term.effect}, order {term.order:g}"
    if term.effect == "hysteresis":
        return f"{term.effect}, slips at {term.shape[0]:.3g} N m"
    if term.effect == FRICTION:
        grows = "constant" if term.shape else "with speed"
        return f"friction in the motor's torque, {grows}"
    kinds = ["constant" if x.shape else "with speed" for x in trial.tried_with]
    friction = f", beside friction ({' and '.join(kinds)}) in the motor's torque"
    return term.effect + (friction if kinds else "")


def _kind(trial: SelectionStep) -> str:
    """Return the name of a term's size."""
    return "amplitude" if trial.term.order else label(trial.term.parameters[0])


def _would_be(trial: SelectionStep) -> str:
    """Return the size at which a term was refused; of a harmonic, its amplitude."""
    known = trial.coefficients[: len(trial.term.parameters)]
    value = float(np.linalg.norm(known)) if trial.term.order else known[0]
    return f"{_kind(trial)} {size(trial.term.parameters[0], value)}"


def _why(trial: SelectionStep) -> str:
    """Return why a term was refused, with parameters in plain words."""
    first, _, rest = trial.reason.partition(" ")
    return f"its {label(first)} {rest}" if "_" in first else trial.reason


def _with(axis: Axis, trial: SelectionStep) -> float:
    """Return the rms residual of the judged motion with a refused term, in rad."""
    found = axis.found
    terms = (*found.terms, trial.term, *trial.tried_with)
    x, _ = fitted(terms, [found.then(m) for m in axis.fitted])
    then = found.then(axis.judged)
    return whole_rms(then.apart - columns(terms, then) @ x)


# --- The report -----------------------------------------------------------------------


def first_sentence(axes: Sequence[Axis], answer: Answer) -> str:
    """Return rms before and after of each axis, and the names, in one sentence."""
    left = ", ".join(map(_magnitudes, axes))
    if len(axes) > 1:
        left += f"; most on {max(axes, key=lambda a: whole_rms(a.after)).name}"
    where: dict[str, dict[str, None]] = {}
    for n in answer.named:
        where.setdefault(n.effect, {})[n.where] = None
    names = [f"{effect} at {', '.join(at)}" for effect, at in where.items()]
    named = " and ".join(names) or "nothing"
    wrong = [w.where for w in answer.warnings if w.code == "spring"]
    more = f"; the model's springs at {', '.join(wrong)} do not show" if wrong else ""
    return (
        "On a motion that nothing was fitted to, µrad rms that are left of what the "
        f"second encoders tell: {left}. Named: {named}{more}."
    )


def _magnitudes(axis: Axis) -> str:
    before, after = (f"{URAD * whole_rms(x):.0f}" for x in (axis.before, axis.after))
    if np.array_equal(axis.before, axis.after):
        return f"{before} on {axis.name}"
    return f"{after} instead of {before} on {axis.name}"


def blocks_of(axes: Sequence[Axis], answer: Answer, folder: Path) -> list[Block]:
    """Draw the pictures and return the report."""
    encoders_before_after(axes, folder / "before_after.png")
    looks_like(axes, folder / "looks_like.png")
    return [
        Figure(
            "How far the second encoder of each axis is from what is simulated, on the "
            "judged motion: as modelled (grey) and with what was named (orange).",
            "before_after.png",
        ),
        table_of(
            f"Rms on the judged motion in µrad, of all rows and of means over "
            f"{WINDOW:g} s; one constant an axis and motion is free.",
            axes,
            {
                "axis": lambda a: a.name,
                "as modelled": lambda a: f"{URAD * whole_rms(a.before):.1f}",
                "with what was named": lambda a: f"{URAD * whole_rms(a.after):.1f}",
                f"as modelled, {WINDOW:g} s": lambda a: (
                    f"{URAD * rms_of_windows(a.before, a.judged.time):.1f}"
                ),
                f"with what was named, {WINDOW:g} s": lambda a: (
                    f"{URAD * rms_of_windows(a.after, a.judged.time):.1f}"
                ),
            },
        ),
        Heading("What was named"),
        table_of(
            "Named, with 95 % intervals over stretches of time of the fitted motions.",
            answer.named,
            {
                "axis": lambda n: n.where,
                "effect": lambda n: n.effect,
                "parameters": lambda n: parameters_text(n.parameters),
            },
        ),
        Figure(followed(axes), "looks_like.png"),
        *rejected_terms(axes),
    ]


# --- The files ------------------------------------------------------------------------


def headline(outcome: ComparisonOutcome) -> str:
    """Return the result in one sentence, or what has to be corrected."""
    if not outcome.axes:
        return " ".join(w.text for w in outcome.answer.warnings)
    return first_sentence(outcome.axes, outcome.answer)


def figure(outcome: ComparisonOutcome, where: str) -> Picture:
    """Draw the difference of the encoders of one axis, or of all, before and after.

    Raises:
        BenchError: Where nothing was compared.
        UnknownName: Where there is no such axis.
    """
    if not outcome.axes:
        raise BenchError("Nothing was compared: the set-up is wrong.")
    axes = {axis.name: axis for axis in outcome.axes}
    if where and where not in axes:
        raise UnknownName("axis with two encoders", where, axes)
    return encoders_before_after([axes[where]] if where else outcome.axes)


def write_files(folder: Path, outcome: ComparisonOutcome) -> None:
    """Write diagnosis.json, pictures, the report, a playback and the patch, if any.

    Where the set-up is wrong, the report says what has to be corrected.
    """
    o = outcome

    def make(waiting: Path) -> None:
        first = "Nothing is named: the set-up is wrong."
        blocks: list[Block] = [Paragraph(w.text) for w in o.answer.warnings]
        if o.axes:
            first = first_sentence(o.axes, o.answer)
            blocks = blocks_of(o.axes, o.answer, waiting)
            show_comparison(o.axes, waiting / PLAYBACK)
        if o.patch is not None:
            write_patch_of_axes(waiting, o.patch, o.model)
        page.write(
            waiting, f"Two encoders an axis: {o.answer.recording}", first, blocks
        )
        text = form.text_of(o.answer)
        (waiting / "diagnosis.json").write_text(text, encoding="utf-8")
        data_files.write_decisions(waiting / DECISIONS, o.decisions)

    write_folder(folder, make)


def show(outcome: ComparisonOutcome) -> None:
    """Open the viewer, where encoders were compared."""
    if outcome.axes:
        show_comparison(outcome.axes, None)
