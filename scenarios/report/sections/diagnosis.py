"""The report of a diagnosis: what was found, its proof, the data, and its files."""

import shutil
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec
import numpy as np
from matplotlib.figure import Figure as Picture

from bench.proof.proof_checks import ProofCheck
from bench.shared.effect_catalogue import CATALOGUE, usual
from bench.shared.errors import BenchError, UnknownName
from bench.shared.settings import MICRO
from scenarios.pipelines import schema
from scenarios.pipelines.diagnosis import Curves, Result, channel_of, curves_of
from scenarios.pipelines.patching import write_patch
from scenarios.pipelines.schema import chance, label, parameters_text, size, span
from scenarios.report import data_files, error_budget, figures, page, playback, summary
from scenarios.report.data_files import DECISIONS, FILES, write_folder
from scenarios.report.error_budget import MANY, budget_of, percent, shares_of_names
from scenarios.report.figures import of_law
from scenarios.report.page import (
    Block,
    Figure,
    Fold,
    Heading,
    Paragraph,
    Points,
    Table,
    table_of,
)
from stiffness.diagnosis.result import SCATTER, in_words, strongest_withheld

# --- The data -------------------------------------------------------------------------

MISSTATED = 1.3
"""Ratio of replicates' scatter to stated noise from which to warn; chosen."""


def data(finding: Result) -> Iterator[Block]:
    """Yield the section on the quality of the data."""
    answer, recording = finding.answer, finding.recording
    yield Heading("How good the data are")
    yield from _noise(finding)
    springs = summary.springs_of(finding)
    if springs is not None:
        header = ["axis", "stiffness [kN m/rad]", "one sigma"]
        header += ["model's [kN m/rad]", "ratio"]
        caption = (
            "Springs fitted as nuisance parameters, beside what was named: of a gear "
            "that hardens at small torques, of an asymmetric one its softer way."
        )
        yield Table(
            caption, header, list(summary.rows(springs, recording.slides or ()))
        )
    if finding.diagnosis.downweighted:
        worst = sorted(finding.diagnosis.downweighted, key=lambda x: -x[2])[:10]
        rows = [[str(row), name, f"{sigma:.0f}"] for row, name, sigma in worst]
        count = len(finding.diagnosis.downweighted)
        caption = f"Readings far beyond the noise: {count}; they counted less."
        yield Table(caption, ["row", "mark", "sigmas"], rows)
    if answer.confounded:
        rows = [[str(a), str(b)] for a, b in answer.confounded]
        caption = (
            "Pairs that displace the marks alike (cosine above 0.95); the names' "
            "probabilities and equivalents say which are told apart."
        )
        yield Table(caption, ["one", "the other"], rows)
    if answer.next_experiments:
        yield table_of(
            "What to measure next.",
            answer.next_experiments,
            {
                "pose": lambda n: n.pose_text(recording.slides),
                "load [kg]": lambda n: " ".join(f"{x:g}" for x in n.load_path_kg),
                "why": lambda n: n.why,
                "tells (log Bayes factor)": lambda n: (
                    f"{n.expected_log_bayes_factor:.1f}"
                ),
            },
        )
    rows_, poses = len(recording.time), len(np.unique(recording.posture_id))
    splits, kept = finding.diagnosis.splits, len(finding.diagnosis.held_out)
    yield Paragraph(
        f"{rows_} rows in {poses} poses; {kept} poses were kept back before anything "
        f"was fitted{f', the others in {len(splits) - 1} splits' if splits else ''}. "
        f"It took {answer.seconds:.1f} s."
    )


def _noise(finding: Result) -> Iterator[Block]:
    tracker = finding.recording.tracker
    if tracker is None:
        return
    stated = ", ".join(f"{MICRO * s:.1f}" for s in tracker.repeatability)
    text = f"The tracker states {stated} µm along its axes."
    if finding.replicates is None:
        yield Paragraph(f"{text} No pose was visited again.")
        return
    seen, freedom = finding.replicates
    shown = ", ".join(f"{MICRO * s:.1f}" for s in seen)
    frames = finding.recording.frames
    share = 1.0 if frames is None else float(np.mean(1.0 / frames)) ** 0.5
    ratio = float(np.max(seen / (share * tracker.repeatability)))
    warning = ""
    if ratio > MISSTATED:
        warning = (
            f" Warning: that is up to {ratio:.1f} times as much; arrival of the axes "
            "is in it, or the tracker is worse than it says."
        )
    yield Paragraph(
        f"{text} Replicates of poses scatter by {shown} µm ({freedom} degrees of "
        f"freedom).{warning}"
    )


# --- The proof ------------------------------------------------------------------------


CONTROLLER = (
    "controller.csv holds zeros, lengths, stiffness and masses, and nothing of other "
    "effects, such as hysteresis or transmission error."
)


def proof(finding: Result, folder: Path) -> Iterator[Block]:
    """Yield the section on errors before and after the patch, and their sources."""
    proof = finding.proof
    if proof is None:
        return
    channel, unit = channel_of(proof)
    if channel is None:
        return
    folded, sizes = proof.folds > 1, summary.sizes_text(finding, proof)
    yield Heading("Before and after")
    means = (
        "Readings are compared as they are."
        if proof.absolute
        else "Readings are compared as differences within each visit."
    )
    yield Paragraph(
        "The effect was put into the MuJoCo model as a mechanism, and what was done in "
        "the poses kept back was done again with the wrenches that were read there. "
        f"Springs, frames and marks were fitted on the other poses, for both. {means} "
        f"{sizes[0].upper()}{sizes[1:]} {CONTROLLER}"
    )
    header = ["channel", "before", "after", "noise alone", "gain", "95 % interval"]
    rows = []
    for name, one, word in (
        ("marks", proof.markers, "µm"),
        ("encoders after the gear", proof.angles, "µrad"),
        ("turns of bodies that marks show", proof.rotations, "mrad"),
    ):
        if one is not None:
            by, digits = (1e3, 4) if word == "mrad" else (MICRO, 1)
            values = [f"{by * x:.{digits}f} {word}" for x in
                      (one.before, one.after, one.noise, one.gain)]  # fmt: skip
            span = f"{by * one.low:.{digits}f} to {by * one.high:.{digits}f}"
            rows.append([name, *values, span])
    caption = (
        f"Rms over {len(proof.held_out)} poses kept back; interval of the gain by "
        "BCa bootstrap over poses."
        + (f" Each pose is kept back once, in {proof.folds} fits." if folded else "")
    )
    yield Table(caption, header, rows)
    figures.of_poses(channel, unit, folder / "poses.png")
    yield Figure("Pose by pose, the worst first.", "poses.png")
    budget = [[k, f"{MICRO * v:.1f} {unit}"] for k, v in proof.budget.items()]
    yield Table(
        "Error budget of the poses kept back: what comes back when an effect is taken "
        "out, rms; squares add up where effects do not overlap.",
        ["source", "rms"],
        budget,
    )


def doubts(finding: Result) -> Iterator[Block]:
    """Yield the section on checks of the patch: data left out of it, and placebos."""
    proof = finding.proof
    trials = () if proof is None else proof.trials
    unit = "" if proof is None else channel_of(proof)[1]
    left = [t for t in trials if t.kind == "left_out"]
    fakes = [t for t in trials if t.kind in ("placebo", "taken_out")]
    if left or fakes:
        yield Heading("For the sceptic")
    if left:
        yield Table(
            "Left out of the fit of springs and patch, and judged by it: rms error.",
            ["left out", f"before [{unit}]", f"after [{unit}]", "poses"],
            [_trial(t) for t in left],
        )
    if fakes:
        yield Table(
            "Placebos: rms error without and with each effect, all others in place. As "
            "named it should help, at a neighbour it should not.",
            ["effect", f"without it [{unit}]", f"with it [{unit}]", "poses"],
            [_trial(t) for t in fakes],
        )


def _trial(trial: ProofCheck) -> list[str]:
    before, after = MICRO * trial.before, MICRO * trial.after
    what = trial.what
    if trial.kind == "taken_out":
        what = f"{what.removeprefix('without ')}, as named"
    return [what, f"{before:.1f}", f"{after:.1f}", str(trial.poses)]


# --- The whole report -----------------------------------------------------------------


def title_of(finding: Result) -> str:
    """Return the report's title: the verdict and the recording's name."""
    answer = finding.answer
    said = schema.VERDICTS[answer.verdict]
    nothing = answer.verdict == "no_mismatch"
    if nothing and any(warning.code == SCATTER for warning in answer.warnings):
        said = "No law was found in what differs"
    if finding.diagnosis.nominal is None:
        said = "The set-up has to be mended first"
    return f"{said}: {answer.recording or 'a recording'}"


def blocks_of(finding: Result, folder: Path) -> list[Block]:
    """Return the report, its pictures drawn into a folder."""
    if len(finding.answer.named) >= MANY:
        return list(_by_place(finding, folder))
    blocks: list[Block] = [Paragraph(s) for s in list(summary.sentences(finding))[1:]]
    blocks += _what(finding)
    blocks += _pictures(finding, folder)
    blocks += proof(finding, folder)
    blocks += doubts(finding)
    blocks += data(finding)
    return blocks


def _by_place(finding: Result, folder: Path) -> Iterator[Block]:
    """Yield a report on many names: the arm, a line an effect, all else folded."""
    answer, simulated = finding.answer, finding.simulated
    budget = budget_of(answer)
    if simulated is not None:
        channel, unit = (None, "")
        if finding.proof is not None:
            channel, unit = channel_of(finding.proof)
        view = error_budget.arm_view(simulated)
        error_budget.of_arm(view, budget, channel, unit, folder / "arm.png")
        yield Figure(
            "A share is of the square, beyond noise, by which the nominal arm misses; "
            "what several names explain jointly is divided among them. Each link has "
            "the colour of its axis or its own, the darker.",
            "arm.png",
        )
    yield Points(list(summary.headlines(finding))[1:])
    yield Heading("Place by place: sizes and curves")
    curves = None
    if simulated is not None and finding.recording.markers:
        curves = curves_of(simulated)
    for where in budget.of:
        title = _names_at(answer, where, budget.of_places[where])
        yield Fold(title, list(_at(finding, where, curves, folder)))
    yield Heading("In detail")
    yield Fold("The whole story", [Points(list(summary.sentences(finding)))])
    yield Fold("Error budget", list(_budget(answer)))
    blocks: list[Block] = [*_what(finding)]
    if curves is not None and simulated is not None:
        blocks.append(Heading("Errors by body"))
        figures.of_bodies(simulated, finding.proof is not None, folder / "bodies.png")
        blocks.append(Figure("Error of the marks by body, all rows.", "bodies.png"))
    blocks += proof(finding, folder)
    blocks += doubts(finding)
    blocks += data(finding)
    yield from _folded(blocks)


def _names_at(answer: schema.Answer, where: str, share: float) -> str:
    names = [n for n in answer.named if n.where == where]
    effects = ", ".join(dict.fromkeys(n.effect.replace("_", " ") for n in names))
    return f"{where}: {effects} ({percent(share)})"


def _percent(share: float | msgspec.UnsetType) -> str:
    return percent(max(share, 0.0)) if isinstance(share, float) else "–"


def _at(
    finding: Result, where: str, curves: Curves | None, folder: Path
) -> Iterator[Block]:
    """Yield the sizes of what is named at a place, and its law's curve."""
    names = [n for n in finding.answer.named if n.where == where]
    rows = [
        [n.effect, label(k), span(k, p)] for n in names for k, p in n.parameters.items()
    ]
    yield Table(f"Named at {where}.", ["effect", "parameter", "estimate, 95 %"], rows)
    if curves is None or finding.proof is None or where not in curves.axes:
        return
    yield from _law_of(finding, where, curves, folder)


def _over(finding: Result, where: str) -> str:
    """Return what a turn is drawn over: the angle, if laws depend on it alone."""
    named = [n.effect for n in finding.answer.named if n.where == where]
    known = {
        regressor for effect in named for regressor in CATALOGUE[effect].depends_on
    }
    return "angle" if known == {"angle"} else "torque"


def _budget(answer: schema.Answer) -> Iterator[Block]:
    """Yield tables of the shares by effect and by kind."""
    budget = budget_of(answer)
    kinds = [
        [error_budget.FAMILIES[family][0], percent(share)]
        for family, share in budget.of_families.items()
    ]
    if budget.unexplained is not None:
        kinds.append(["no name", percent(budget.unexplained)])
    caption = "Share of the mismatch by kind of effect; noise is not in it."
    yield Table(caption, ["kind", "share"], kinds)
    alone = {(n.effect, n.where): n.share for n in answer.named}
    shares = sorted(shares_of_names(answer).items(), key=lambda one: -one[1])
    rows = [
        [at.effect, at.where, percent(share), _percent(alone[at.effect, at.where])]
        for at, share in shares
    ]
    header = ["effect", "where", "share", "comes back without it alone"]
    yield Table("Share of the mismatch by name.", header, rows)
    if answer.unexplained_places:
        yield table_of(
            "Significant, and without a name.",
            error_budget.open_places(answer),
            {
                "where": lambda p: p.where,
                "share": lambda p: percent(p.share),
                "depends on": lambda p: ", ".join(p.depends_on),
                "law": lambda p: p.law,
            },
        )


def _folded(blocks: Sequence[Block]) -> Iterator[Block]:
    """Yield a fold for each heading, with what stands below it."""
    title, below = "", []
    for block in (*blocks, Heading("")):
        if isinstance(block, Heading):
            if below:
                yield Fold(title, below)
            title, below = block.text, []
        else:
            below.append(block)


def _what(finding: Result) -> Iterator[Block]:
    answer = finding.answer
    if answer.located:
        yield Heading("Where")
        yield table_of(
            "Where arm and model differ, strongest first. Share: of the squares of "
            "what the effects of each place displace by themselves, over their noise; "
            "what two places displace alike counts at both. A name's share, elsewhere, "
            "is what it adds to all names together.",
            answer.located,
            {
                "place": lambda x: x.where,
                "share of what differs": lambda x: f"{x.share:.0%}",
                "p-value": lambda x: f"{x.p_value:.2g}",
                "depends on": lambda x: ", ".join(x.depends_on),
                "strongest": lambda x: x.zone,
            },
        )
    if answer.named:
        yield from _how_sure(answer)
    if stopped := strongest_withheld(finding.diagnosis):
        yield Heading("What was withheld, and why")
        would_be = defaultdict[tuple[str, str], str](str)
        for one in answer.refused:
            would_be[one.effect, one.where] = parameters_text(one.parameters)
        yield Table(
            "Names that came furthest without being given; all others, gate by gate, "
            f"are in {DECISIONS}.",
            ["effect", "where", "would be", "why not"],
            [[*d.candidate, would_be[d.candidate], in_words(d)] for d in stopped],
        )


def _how_sure(answer: schema.Answer) -> Iterator[Block]:
    yield Heading("What, and how sure")
    header = ["effect", "parameter", "estimate, 95 %"]
    header += ["in catalogues", "it is", "source"]
    rows = []
    for called in answer.named:
        for name, interval in called.parameters.items():
            around = inside = source = ""
            if (known := usual(called.effect, name)) is not None:
                source = known.source
                around = f"{size(name, known.low)} to {size(name, known.high)}"
                if isinstance(interval.estimate, float):
                    fits = known.low <= interval.estimate <= known.high
                    inside = "usual" if fits else "unusual"
            shown = (label(name), span(name, interval))
            rows.append([str(called), *shown, around, inside, source])
    yield Table("Each parameter beside what catalogues say.", header, rows)
    yield table_of(
        "How sure, and what would do as well.",
        answer.named,
        {
            "effect": str,
            "probability with its equivalents": lambda n: chance(n.probability),
            "equivalents": lambda n: ", ".join(map(str, n.equivalents)) or "none",
        },
    )
    if answer.rivals:
        named = {(n.effect, n.where) for n in answer.named}
        rivals = [{(e.effect, e.where) for e in r.effects} for r in answer.rivals]
        rows = [
            [_together(named - own), _together(own - named), chance(r.probability)]
            for r, own in zip(answer.rivals, rivals, strict=True)
        ]
        header = ["in place of", "would be", "probability"]
        yield Table("Rivals of the names, all others held.", header, rows)


def _together(names: set[tuple[str, str]]) -> str:
    return " + ".join(map(" at ".join, sorted(names))) or "nothing"


def _pictures(finding: Result, folder: Path) -> Iterator[Block]:
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
    patch = " Orange: the patched simulation, without noise." if proved else ""
    means = "" if simulated.absolute else " Each visit's mean is taken off."
    if any(curves.visible):
        figures.of_axes(curves, named, folder / "axes.png")
        yield Figure(
            "Turn of every axis beyond the fitted nominal arm, against its torque; "
            f"gravity included.{means} Grey: all readings.{patch}",
            "axes.png",
        )
    else:
        yield Paragraph(
            "No axis' own turn shows beyond what noise makes of it: too few marks, or "
            "marks on too few bodies, tell the axes' turns apart. Together the marks "
            "still show what the patch does."
        )
    own = sorted(named & set(curves.axes)) if proved else []
    for name in own if any(curves.visible) else ():
        yield from _law_of(finding, name, curves, folder)
    hidden = [a for a in own if not curves.visible[curves.axes.index(a)]]
    if proved and (hidden or not any(curves.visible)):
        figures.of_marks(simulated, folder / "marks.png")
        yield Figure(
            "How far the marks stand off the fitted nominal arm along what the patch "
            f"does to them, rms over the marks of a row.{means} On the line the patch "
            "does what was measured.",
            "marks.png",
        )
    if len({marker.body for marker in finding.recording.markers}) > 1:
        figures.of_bodies(simulated, proved, folder / "bodies.png")
        yield Figure("Error of the marks by body, all rows.", "bodies.png")


def _law_of(
    finding: Result, where: str, curves: Curves, folder: Path
) -> Iterator[Block]:
    """Yield an axis' law beside what marks show of its turn, if they show it."""
    k = curves.axes.index(where)
    if not curves.visible[k]:
        unit = "µm" if curves.slides[k] else "µrad"
        yield Paragraph(
            f"No curve: of {where}'s own turn, noise alone makes more than half "
            f"(± {MICRO * curves.noise[k]:.2g} {unit})."
        )
        return
    file = f"law_{where}.png"
    of_law(curves, where, folder / file, _over(finding, where))
    caption = f"Turn about {where}'s own axis: what was put in, beside what marks show."
    yield Figure(caption, file)


# --- The files ------------------------------------------------------------------------


def write_answer(folder: Path, answer: schema.Answer) -> None:
    """Write diagnosis.json into a folder."""
    text = schema.text_of(answer)
    (folder / "diagnosis.json").write_text(text, encoding="utf-8")


def write_diagnosis(folder: Path, finding: Result) -> None:
    """Write the answer, the patch, the report and the playback into a folder."""
    write_answer(folder, finding.answer)
    data_files.write_decisions(folder / DECISIONS, finding.diagnosis.decisions)
    simulated = finding.simulated
    if simulated is not None and (simulated.patch.effects or simulated.patch.laws):
        write_patch(folder, simulated.patch, simulated.patched.rig)
    blocks = blocks_of(finding, folder)
    many = len(finding.answer.named) >= MANY
    first = next((summary.headlines if many else summary.sentences)(finding))
    page.write(folder, title_of(finding), first, blocks)
    laws = sorted(folder.glob("law_*.png"))
    others = [folder / name for name in ("axes.png", "marks.png")]
    for picture in (folder / "arm.png", *laws, *others):
        if picture.exists():
            shutil.copy(picture, folder / "picture.png")
            break
    playback.show_diagnosis(finding, folder / "diagnosis.rrd")


def write_files(folder: Path, finding: Result) -> None:
    """Write the answer, the patch, the report and the playback; a folder whole."""
    kept = (*FILES, DECISIONS)
    write_folder(folder, lambda waiting: write_diagnosis(waiting, finding), kept)


def figure(finding: Result, where: str = "") -> Picture:
    """Draw the turn of all axes beyond the nominal arm, or the law at one axis.

    Raises:
        BenchError: Where nothing was simulated that could be drawn.
        UnknownName: Where there is no such axis.
    """
    if finding.simulated is None or not finding.recording.markers:
        raise BenchError("Nothing was simulated that could be drawn.")
    curves = curves_of(finding.simulated)
    if not where:
        named = frozenset(n.where for n in finding.answer.named)
        return figures.of_axes(curves, named)
    if where not in curves.axes:
        raise UnknownName("axis", where, curves.axes)
    return figures.of_law(curves, where, over=_over(finding, where))


def show(finding: Result) -> None:
    """Open the viewer with the playback of a diagnosis."""
    playback.show_diagnosis(finding, None)
