"""What a finding is worth depends on the data: noise, springs, outliers, twins."""

from collections.abc import Iterator

import numpy as np

from scenarios.diagnosing import springs
from scenarios.diagnosing.finding import MICRO, Finding
from scenarios.reporting.page import Block, Heading, Paragraph, Table

MISSTATED = 1.3
"""Ratio of replicates' scatter to stated noise from which it is said; chosen."""


def data(finding: Finding) -> Iterator[Block]:
    """Say how good the data are."""
    answer, recording = finding.answer, finding.recording
    yield Heading("How good the data are")
    yield from _noise(finding)
    if finding.diagnosis.nominal is not None:
        rows = list(
            springs.rows(finding.diagnosis.nominal, finding.recording.slides or ())
        )
        header = [
            "axis",
            "stiffness [kN m/rad]",
            "one sigma",
            "model's [kN m/rad]",
            "ratio",
        ]
        yield Table("Springs that were fitted silently.", header, rows)
    if finding.diagnosis.doubtful:
        worst = sorted(finding.diagnosis.doubtful, key=lambda x: -x[2])[:10]
        rows = [[str(row), name, f"{sigma:.0f}"] for row, name, sigma in worst]
        count = len(finding.diagnosis.doubtful)
        caption = f"Readings far beyond the noise: {count}; they counted less."
        yield Table(caption, ["row", "mark", "sigmas"], rows)
    if answer.confounded:
        rows = [
            [f"{a.effect} at {a.where}", f"{b.effect} at {b.where}"]
            for a, b in answer.confounded
        ]
        caption = "Pairs that these data hardly tell apart."
        yield Table(caption, ["one", "the other"], rows)
    if answer.next_experiments:
        rows = [
            [
                " ".join(f"{x:.0f}" for x in n.pose_deg),
                " ".join(f"{x:g}" for x in n.load_path_kg),
                n.why,
                f"{n.expected_log_bayes_factor:.1f}",
            ]
            for n in answer.next_experiments
        ]
        header = ["pose [°]", "load [kg]", "why", "tells (log Bayes factor)"]
        yield Table("What to measure next.", header, rows)
    rows_, poses = len(recording.time), len(np.unique(recording.pose))
    yield Paragraph(
        f"{rows_} rows in {poses} poses; {len(finding.diagnosis.held_out)} poses were "
        f"kept back before anything was fitted. It took {answer.seconds:.1f} s."
    )


def _noise(finding: Finding) -> Iterator[Block]:
    tracker = finding.recording.tracker
    if tracker is None:
        return
    stated = ", ".join(f"{MICRO * s:.1f}" for s in tracker.repeatability)
    text = f"The tracker states {stated} µm along its axes."
    if finding.replicates is None:
        yield Paragraph(f"{text} No pose was visited twice to test that.")
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
