"""The report of axes that are read on both sides of their gears."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from scenarios.diagnosing.schema import Answer
from scenarios.diagnosing.units import label, span
from scenarios.reporting.page import Block, Figure, Heading, Table
from scenarios.two_encoders.axis import WINDOW, Axis, rms, whole_rms
from scenarios.two_encoders.pictures import before_after, followed, looks_like
from scenarios.two_encoders.refusals import refused

URAD = 1e6


def first_sentence(axes: Sequence[Axis], answer: Answer) -> str:
    """Return what was found, in one sentence."""
    left = ", ".join(map(_sizes, axes))
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


def _sizes(axis: Axis) -> str:
    before, after = (f"{URAD * whole_rms(x):.0f}" for x in (axis.before, axis.after))
    if np.array_equal(axis.before, axis.after):
        return f"{before} on {axis.name}"
    return f"{after} instead of {before} on {axis.name}"


def blocks_of(axes: Sequence[Axis], answer: Answer, folder: Path) -> list[Block]:
    """Draw the pictures and return the report."""
    before_after(axes, folder / "before_after.png")
    looks_like(axes, folder / "looks_like.png")
    return [
        Figure(
            "How far the second encoder of each axis is from what is simulated, on the "
            "judged motion: as modelled (grey) and with what was named (orange).",
            "before_after.png",
        ),
        Table(
            f"Rms on the judged motion in µrad, of all rows and of means over "
            f"{WINDOW:g} s; one constant an axis and motion is free.",
            (
                "axis",
                "as modelled",
                "with what was named",
                f"as modelled, {WINDOW:g} s",
                f"with what was named, {WINDOW:g} s",
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
        *refused(axes),
    ]
