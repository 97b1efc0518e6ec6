"""A report that an engineer can hand to a colleague, and to a sceptic."""

from collections.abc import Iterator
from pathlib import Path

from scenarios.diagnosing import pictures, story
from scenarios.diagnosing.catalogue import usual
from scenarios.diagnosing.finding import Finding, curves_of
from scenarios.diagnosing.picture_of_law import of_law
from scenarios.diagnosing.report_data import data
from scenarios.diagnosing.report_proof import doubts, proof
from scenarios.diagnosing.units import chance, label, size, span
from scenarios.reporting.page import Block, Figure, Heading, Paragraph, Table
from stiffness.diagnosis.remarks import SCATTER

VERDICTS = {
    "no_mismatch": "Simulation and recording agree",
    "unproved": "A cause is named, but not proved",
    "explained": "The difference is explained",
    "partly_explained": "The difference is explained in part",
    "unexplained": "The difference has no name",
}


def title_of(finding: Finding) -> str:
    """Return the headline."""
    answer = finding.answer
    said = VERDICTS[answer.verdict]
    calm = answer.verdict == "no_mismatch"
    if calm and any(warning.code == SCATTER for warning in answer.warnings):
        said = "No law was found in what differs"
    return f"{said}: {answer.recording or 'a recording'}"


def blocks_of(finding: Finding, folder: Path) -> list[Block]:
    """Return the report, its pictures drawn into a folder."""
    blocks: list[Block] = [Paragraph(s) for s in list(story.sentences(finding))[1:]]
    blocks += _what(finding)
    blocks += _pictures(finding, folder)
    blocks += proof(finding, folder)
    blocks += doubts(finding)
    blocks += data(finding)
    return blocks


def _what(finding: Finding) -> Iterator[Block]:
    answer = finding.answer
    if answer.located:
        yield Heading("Where")
        rows = [
            [
                x.where,
                f"{x.share:.0%}",
                f"{x.p_value:.2g}",
                ", ".join(x.depends_on),
                x.zone,
            ]
            for x in answer.located
        ]
        header = [
            "place",
            "share of what differs",
            "p-value",
            "depends on",
            "strongest",
        ]
        yield Table("Where arm and model differ, strongest first.", header, rows)
    if not answer.named:
        return
    yield Heading("What, and how sure")
    header = [
        "effect",
        "parameter",
        "estimate, 95 %",
        "in catalogues",
        "it is",
        "source",
    ]
    rows = []
    for called in answer.named:
        for name, interval in called.parameters.items():
            known = usual(called.effect, name)
            inside = ""
            if known is not None and isinstance(interval.estimate, float):
                fits = known.low <= interval.estimate <= known.high
                inside = "usual" if fits else "unusual"
            around = ""
            if known is not None:
                around = f"{size(name, known.low)} to {size(name, known.high)}"
            where = f"{called.effect} at {called.where}"
            source = "" if known is None else known.source
            shown = span(name, interval)
            rows.append([where, label(name), shown, around, inside, source])
    yield Table("Each parameter beside what catalogues say.", header, rows)
    rows = [
        [
            f"{n.effect} at {n.where}",
            chance(n.probability),
            ", ".join(f"{e.effect} at {e.where}" for e in n.equivalents) or "none",
        ]
        for n in answer.named
    ]
    yield Table(
        "How sure, and what would do as well.",
        ["effect", "probability with its equivalents", "equivalents"],
        rows,
    )
    if answer.rivals:
        rows = [
            [
                " + ".join(f"{e.effect} at {e.where}" for e in r.effects),
                chance(r.probability),
            ]
            for r in answer.rivals
        ]
        yield Table("Rivals that were tried.", ["set", "probability"], rows)


def _pictures(finding: Finding, folder: Path) -> Iterator[Block]:
    simulated = finding.simulated
    if simulated is None or not finding.recording.markers:
        return
    proved = finding.proof is not None
    yield Heading("What the marks show")
    named = frozenset(n.where for n in finding.answer.named)
    law = finding.diagnosis.unexplained
    if law is not None and law.law:
        named |= {law.where}
    curves = curves_of(simulated)
    pictures.of_axes(curves, named, folder / "axes.png")
    patch = " Orange: the patched simulation, without noise." if proved else ""
    means = "" if simulated.absolute else " Each visit's mean is taken off."
    yield Figure(
        "Turn of every axis beyond the fitted nominal arm, against its torque; gravity "
        f"included.{means} Grey: all readings.{patch}",
        "axes.png",
    )
    for name in sorted(named & set(curves.axes)) if proved else ():
        file = f"law_{name}.png"
        of_law(curves, name, folder / file)
        yield Figure(
            f"Turn about {name}'s own axis: what was put in, beside what marks show.",
            file,
        )
    pictures.of_bodies(simulated, proved, folder / "bodies.png")
    yield Figure("Error of the marks by body, all rows.", "bodies.png")
