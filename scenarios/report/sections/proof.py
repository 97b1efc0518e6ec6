"""The report of a patch that was judged on another recording, and its files."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from bench.proof.explained_share import Channel
from bench.shared.format import json_text
from bench.shared.settings import MM, UM
from scenarios.pipelines.judgement import FAR, FILE, Judgement
from scenarios.pipelines.schema import said_of_turns
from scenarios.report import figures, page
from scenarios.report.data_files import write_folder
from scenarios.report.page import Block, Figure, Heading, Paragraph, Table, table_of
from stiffness.experiment.outliers import Outlier, outlier_text

# --- The result in words --------------------------------------------------------------

MOST_LISTED = 20
UNKNOWN = "not known"
MOST_BEYOND = 3
"""Angles and torques beyond the fitted ranges that the first sentence names."""


def first_sentence(judgement: Judgement) -> str:
    """Return error before and after, and how much the patch covers, in words."""
    j, whole, springs = judgement, judgement.whole, judgement.springs
    poses = j.answer.proof.held_out_poses
    another = "the recording that taught it" if j.answer.taught else "another recording"
    said = (
        f"{_verdict(j)} On {poses} poses of {another}, where frame and "
        f"targets alone were fitted, the simulator misses by {_um(whole.after)} rms "
        f"with the patch and by {_um(whole.before)} as drawn: gain {_gain(whole)}; "
        f"stated noise alone leaves {_um(whole.noise)}."
    )
    if springs is not None:
        said += (
            f" With the patch's springs and nothing else of it: {_um(springs.before)}, "
            f"to which the rest adds a gain of {_gain(springs)}."
        )
    share = j.answer.covered_share
    if share is None:
        return f"{said} The patch does not say which poses it was fitted to."
    said += (
        f" In {100 * share:.0f} % of the readings every joint angle and torque that it "
        "depends on lies inside the fitted range"
    )
    if j.inside is not None and j.outside is not None:
        said += (
            f": {_um(j.inside.before)} as drawn and {_um(j.inside.after)} with "
            f"the patch there, {_um(j.outside.before)} and {_um(j.outside.after)} "
            "elsewhere"
        )
    beyond = sorted(
        ((s, f"{what} of {a.name}") for a in j.axes for what, s in a.outside.items()),
        reverse=True,
    )
    listed = [f"{what} ({100 * s:.0f} %)" for s, what in beyond[:MOST_BEYOND] if s > 0]
    return f"{said}. Outside it: {', '.join(listed)}." if listed else f"{said}."


def _verdict(j: Judgement) -> str:
    times = j.whole.after / max(j.whole.noise, 1e-12)
    said = {
        "holds": "The patch holds here.",
        "better": "The patch is better than the arm as drawn here, but leaves "
        f"{times:.1f} times the noise.",
        "not shown": "It is not shown that the patch holds here.",
        "worse": "The patch makes it worse here.",
    }[j.answer.verdict]
    if j.answer.harmful:
        said += f" These parts do not hold here: {', '.join(j.answer.harmful)}."
    if not j.answer.taught:
        return said
    return (
        "This is the recording that taught the patch, so nothing is proved: judge it "
        f"on another one. {said}"
    )


def _gain(channel: Channel) -> str:
    low, high = UM * channel.low, UM * channel.high
    return f"{_um(channel.gain)} ({low:.1f} to {high:.1f})"


def _um(value: float) -> str:
    return f"{UM * value:.1f} µm"


# --- The report -----------------------------------------------------------------------


def blocks_of(judgement: Judgement) -> Iterator[Block]:
    """Yield the report; its pictures are made by `write_judgement`."""
    j = judgement
    yield Figure(
        "Errors of targets' positions as drawn and with the patch, reading by reading. "
        "Frame and targets' places are fitted to this recording for both, and nothing "
        "else.",
        "before_after.png",
    )
    if not j.absolute:
        yield Paragraph(
            "Differences within visits are compared: each visit's mean is taken off."
        )
    channels = {
        "all": j.whole,
        "covered": j.inside,
        "not covered": j.outside,
        "all, before: its springs alone": j.springs,
    }
    yield Table(
        "Rms over readings; the interval of the gain is a bootstrap over poses.",
        ("readings", "as drawn [µm]", "patched [µm]", "noise [µm]", "gain [µm]"),
        [(name, *_numbers_of(c)) for name, c in channels.items() if c is not None],
    )
    proof = j.answer.proof
    if turned := said_of_turns(proof):
        yield Paragraph(turned)
    if j.parts:
        yield Heading("What each part of the patch is worth here")
        yield table_of(
            f"Rms of position without one part alone, where all of the patch leaves "
            f"{_um(j.parts[0].whole)}. A part that surely makes it smaller by over 1 % "
            "when it is taken out does not hold here, or makes up for another.",
            sorted(j.parts, key=lambda p: -p.rms),
            {
                "taken out": lambda p: p.name,
                "then [µm]": lambda p: f"{UM * p.rms:.1f}",
                "grows by [%]": lambda p: f"{100 * (p.rms / p.whole - 1):+.1f}",
                "does not hold": lambda p: "surely" if p.harmful else "",
            },
        )
    yield Heading("What the patch covers")
    yield table_of(
        "Range of each axis in this recording, and in the poses that the patch was "
        "fitted to, less gaps of over 2° between them; the share of readings inside, "
        "for axes with an effect of angle or torque. Other effects are taken to hold "
        "everywhere.",
        j.axes,
        {
            "axis": lambda a: a.name,
            "posture": lambda a: _range(a.angle, a.name in j.slides),
            "fitted": lambda a: (
                _stretches(a.fitted.angle_rad, a.name in j.slides)
                if a.fitted
                else UNKNOWN
            ),
            "load": lambda a: _load(a.torque, a.name in j.slides),
            "fitted ": lambda a: (
                _load(a.fitted.torque_nm, a.name in j.slides) if a.fitted else UNKNOWN
            ),
            "effects": lambda a: ", ".join(a.laws) or "none",
            "inside [%]": lambda a: f"{100 * a.share:.0f}" if a.laws else "–",
        },
    )
    yield Figure(
        "Rms error over each axis' angle, as drawn (grey) and with the patch (orange); "
        "shaded where the patch was fitted.",
        "residual_map.png",
    )
    yield from _notes(j)


def _numbers_of(c: Channel) -> tuple[str, ...]:
    *plain, low, high = (
        f"{UM * x:.1f}" for x in (c.before, c.after, c.noise, c.gain, c.low, c.high)
    )
    return (*plain[:3], f"{plain[3]} ({low} to {high})")


def _stretches(ends: tuple[tuple[float, float], ...], slides: bool) -> str:
    whole = _range((ends[0][0], ends[-1][1]), slides)
    gaps = len(ends) - 1
    return f"{whole}, {gaps} gap{'s' * (gaps > 1)}" if gaps else whole


def _range(ends: tuple[float, float], slides: bool) -> str:
    if slides:
        return f"{MM * ends[0]:.0f} to {MM * ends[1]:.0f} mm"
    low, high = np.degrees(ends)
    return f"{low:.0f}° to {high:.0f}°"


def _load(ends: tuple[float, float], slides: bool) -> str:
    return f"{ends[0]:.0f} to {ends[1]:.0f} {'N' if slides else 'N m'}"


def _notes(j: Judgement) -> Iterator[Block]:
    gone, far = j.answer.left_out, j.answer.outliers
    if gone:
        names = ", ".join(dict.fromkeys(map(str, gone)))
        yield Paragraph(
            f"Left out: {names}. They refer to the clock or the frame of the recording "
            "that the patch was fitted to."
        )
    if gone := j.answer.disregarded:
        found = [Outlier(0, o.pose, o.marker, o.size_mm / 1e3) for o in gone]
        yield Paragraph(outlier_text(found))
    if far:
        rest = j.after[np.isfinite(j.after)]
        others = np.sort(rest)[: len(rest) - len(far)]
        yield table_of(
            f"Readings more than {FAR:.0f} times as far off as the median one; they "
            f"count above. Without the {len(far)} farthest the patch leaves "
            f"{_um(float(np.sqrt(np.mean(others**2))))}.",
            far[:MOST_LISTED],
            {
                "pose": lambda o: str(o.pose),
                "target": lambda o: o.marker,
                "off by [µm]": lambda o: f"{1e3 * o.size_mm:.1f}",
            },
        )


# --- The files ------------------------------------------------------------------------


def write_judgement(folder: Path, judgement: Judgement) -> None:
    """Write proof.json, report and pictures."""

    def make(waiting: Path) -> None:
        figures.judged_before_after(judgement, waiting / "before_after.png")
        figures.judged_over_angles(judgement, waiting / "residual_map.png")
        title = f"Patch judged on {judgement.recording.name}"
        page.write(
            waiting, title, first_sentence(judgement), list(blocks_of(judgement))
        )
        (waiting / FILE).write_text(json_text(judgement.answer), encoding="utf-8")

    write_folder(folder, make)
