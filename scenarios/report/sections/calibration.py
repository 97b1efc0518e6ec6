"""The report of a calibration, and its files."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure as Picture

from bench.patch import FILE, rig_of, text_of, with_arm
from bench.shared.errors import BenchError
from bench.shared.settings import UM
from scenarios.pipelines import calibration
from scenarios.pipelines import schema as form
from scenarios.pipelines.calibration import GONE, CalibrationOutcome
from scenarios.pipelines.calibration_proof import CalibrationProof, ResidualSummary
from scenarios.pipelines.patching import write_patch
from scenarios.pipelines.schema import Answer, label, parameters_text, size
from scenarios.report import data_files, figures, page, playback
from scenarios.report.data_files import DECISIONS, write_folder
from scenarios.report.page import Block, Figure, Heading, Paragraph, table_of
from stiffness.calibration.result import Calibrated
from stiffness.calibration.selection import BELIEVED, Step

# --- The report -----------------------------------------------------------------------


def blocks_of(
    found: Calibrated,
    proof: CalibrationProof,
    remains: ResidualSummary,
    answer: Answer,
    folder: Path,
) -> list[Block]:
    """Draw the pictures and return the report."""
    figures.calibration_before_after(found, proof, folder / "before_after.png")
    if found.error_tables:
        figures.gears(found, folder / "gears.png")
    figures.residual_map(found, proof, remains.new_angle, folder / "residual_map.png")
    return list(_blocks(found, proof, remains, answer))


def _blocks(
    found: Calibrated, proof: CalibrationProof, remains: ResidualSummary, answer: Answer
) -> Iterator[Block]:
    regions = found.spatial_folds
    whose = "The fitted arm, not simulated," if proof.failed else "The simulator"
    yield Figure(
        f"{whose} on the poses kept back, before and after; frame and target's "
        "place fitted on the other poses for both. Places are the target's in the "
        "base's axes; dashed: how far readings of neighbouring poses differ, which no "
        "smooth law takes off.",
        "before_after.png",
    )
    yield Heading("What was left out")
    yield from _named(found, answer)
    yield from _springs(found)
    if found.error_tables:
        yield Figure(
            "Uneven gears: how far each axis stands beside its reported angle (orange) "
            "where a fitted pose is within 1°. Dots: readings, everything else taken "
            "off.",
            "gears.png",
        )
    yield Heading("How it was chosen")
    yield Paragraph(
        f"Targets' places were cut into {len(np.unique(regions.region))} regions "
        f"before anything was fitted; {len(regions.held)} of them were kept back for "
        "the proof. Among the others, effects entered one at a time, the one that "
        "gained most on regions left out first, each only if its gain was more than "
        f"two standard errors over {regions.count} folds of regions. How large an "
        "uneven gear's waves may be is learnt from the data, octave by octave."
    )
    refused = calibration.without_a_name(found, calibration.names_of(answer))
    yield table_of(
        "What was tried. Rms on regions left out of the fit, where it was believed; "
        "the gain there over its standard error. Out of bounds: the best fit is a size "
        "that the effect cannot have." + _in_6d(found),
        found.selected.steps,
        {
            "effect": lambda s: s.key[0],
            "where": lambda s: s.key[1],
            "would be": _would_be,
            "rms [µm]": lambda s: f"{UM * s.rms:.1f}" * (s.verdict == BELIEVED),
            "gain / its error": lambda s: f"{s.gain / max(s.error, 1e-30):.1f}",
            "verdict": lambda s: _verdict(s, refused.get(s.key) == GONE),
        },
    )
    if fitted := [k for k, why in refused.items() if why != GONE]:
        yield table_of(
            "Fitted and in the patch, but without a name.",
            fitted,
            {
                "effect": lambda key: key[0],
                "where": lambda key: key[1],
                "parameters": lambda key: "; ".join(
                    f"{label(n)} {size(n, x.estimate)}"
                    for n, x in found.estimates.get(key, {}).items()
                ),
                "why": refused.__getitem__,
            },
        )
    yield Heading("What remains")
    yield Paragraph(remains.signature[0].upper() + remains.signature[1:])
    yield table_of(
        "Regions kept back, one by one.",
        remains.by_region,
        {
            "region": lambda r: str(r[0]),
            "readings": lambda r: str(r[2]),
            "rms [µm]": lambda r: f"{UM * r[1]:.1f}",
            "at new angles [%]": lambda r: f"{100 * r[3]:.0f}",
        },
    )
    yield Figure(
        "Residuals on the poses kept back over the axes' angles and over time.",
        "residual_map.png",
    )
    yield Heading("What to bear in mind")
    yield Paragraph(
        f"{calibration.not_seen_text(found)} What the tracker's frame, the target's "
        "place or another number of the drawing does just as well stays as drawn too. "
        "Intervals hold what numbers that were not chosen may be off by, as stated. An "
        "uneven gear's slow waves, offsets and compliance resemble each other where an "
        "axis moves little. The side an axis came from is taken from the poses "
        "recorded; moves between them are not known, so a reading that lags and "
        "friction are alike unless commanded angles tell them apart. The simulator "
        "proves everything as mechanisms but that side, which is played as axes that "
        "stop short.".strip()
    )


def _in_6d(found: Calibrated) -> str:
    """Say how orientation counts where targets are in 6D."""
    turns = found.readings.orientations
    if turns is None:
        return ""
    metres = float(np.median(turns.metres_per_rad[turns.seen]))
    return (
        f" Orientation counts as well, 1 mrad as {metres:.3f} mm; the rms is that of "
        "three coordinates of the six."
    )


def _named(found: Calibrated, answer: Answer) -> Iterator[Block]:
    """Yield the table of named effects: parameters, and the loss without each."""
    if not answer.named:
        yield Paragraph("Nothing: no effect earned a name.")
        return
    budget = found.selected.budget
    yield table_of(
        "Named effects with 95 % intervals over regions, and what is lost on regions "
        "left out when one alone is taken out: the factor by which the mean square "
        "error grows, and the loss over its standard error.",
        answer.named,
        {
            "effect": lambda n: n.effect,
            "where": lambda n: n.where,
            "parameters": lambda n: parameters_text(n.parameters),
            "grows by ×": lambda n: f"{np.exp(budget[n.effect, n.where][0]):.2f}",
            "loss / its error": lambda n: (
                f"{np.divide(*budget[n.effect, n.where]):.1f}"
            ),
        },
    )


def _springs(found: Calibrated) -> Iterator[Block]:
    """Yield the table of springs that the arm's own weight winds up."""
    fitted = found.springs[1]
    slides = found.readings.arm.slides
    seen = [axis for axis, k in fitted.items() if np.isfinite(k.high)]
    if not seen:
        return

    def told(axis: str, stiffness: float) -> str:
        along = slides[int(axis[1:]) - 1]
        return f"{stiffness:.4g} N/m" if along else f"{1e-3 * stiffness:.4g}"

    def span(axis: str) -> str:
        return f"{told(axis, fitted[axis].low)} to {told(axis, fitted[axis].high)}"

    yield table_of(
        "Springs as the arm's own weight winds them up, nuisance parameters of the "
        "fit, with 95 % intervals over regions; without axes that it hardly loads.",
        seen,
        {
            "axis": lambda a: a,
            "stiffness [kN m/rad]": lambda a: told(a, fitted[a].estimate),
            "interval": span,
            "model's [kN m/rad]": lambda a: told(
                a, found.readings.arm.stiffness[int(a[1:]) - 1]
            ),
        },
    )


# --- The files ------------------------------------------------------------------------


def write_files(
    folder: Path, outcome: CalibrationOutcome, more: Sequence[Block] = ()
) -> None:
    """Write diagnosis.json, the patch, model.xml, pictures and the report."""
    o = outcome

    def make(waiting: Path) -> None:
        blocks = blocks_of(o.found, o.proof, o.residual, o.answer, waiting)
        first = calibration.first_sentence(o.answer, o.proof)
        title = f"{form.VERDICTS[o.answer.verdict]}: {o.answer.recording}, calibrated"
        page.write(waiting, title, first, [*blocks, *more])
        text = form.text_of(o.answer)
        (waiting / "diagnosis.json").write_text(text, encoding="utf-8")
        data_files.write_decisions(waiting / DECISIONS, o.decisions)
        if o.proof.failed:  # the simulator cannot have it, but people may
            (waiting / FILE).write_text(text_of(o.proof.patch), encoding="utf-8")
        else:
            rig = rig_of(o.proof.patch, o.model)
            write_patch(waiting, with_arm(o.proof.patch, rig), rig)
        playback.show_calibration(o.found, o.proof, first, waiting / "diagnosis.rrd")

    write_folder(folder, make)


def _verdict(step: Step, gone: bool) -> str:
    taken = gone and step.verdict == BELIEVED
    return f"{step.verdict}, then taken out" if taken else step.verdict


def _would_be(step: Step) -> str:
    """Return the size of what was tried; empty where it has many."""
    told = zip(step.parameters[: len(step.values)], step.values, strict=False)
    sizes = [f"{label(name)} {size(name, value)}" for name, value in told]
    return "; ".join(sizes) if len(sizes) < 3 else ""


def figure(outcome: CalibrationOutcome, where: str = "") -> Picture:
    """Draw the error on the regions kept back, before and after.

    Raises:
        BenchError: Where a single axis is asked for: positions show all together.
    """
    if where:
        raise BenchError("Positions show all axes together: ask for no single one.")
    return figures.calibration_before_after(outcome.found, outcome.proof)


def show(outcome: CalibrationOutcome) -> None:
    """Open the viewer with the playback of a calibration."""
    first = calibration.first_sentence(outcome.answer, outcome.proof)
    playback.show_calibration(outcome.found, outcome.proof, first, None)
