"""The proof is told with everything that might speak against it."""

from collections.abc import Iterator
from pathlib import Path

from bench.proving.trials import Trial
from scenarios.diagnosing import pictures
from scenarios.diagnosing.finding import MICRO, Finding, channel_of
from scenarios.reporting.page import Block, Figure, Heading, Paragraph, Table


def proof(finding: Finding, folder: Path) -> Iterator[Block]:
    """Say before and after, and where the error comes from."""
    proof = finding.proof
    if proof is None:
        return
    channel, unit = channel_of(proof)
    if channel is None:
        return
    yield Heading("Before and after")
    means = (
        "Readings are compared as they are."
        if proof.absolute
        else "Readings are compared as differences within each visit."
    )
    yield Paragraph(
        "The effect was put into the MuJoCo model as a mechanism, and what was done in "
        "the poses kept back was done again with the wrenches that were read there. "
        f"Springs, frames and marks were fitted on the other poses, for both. {means}"
    )
    header = ["channel", "before", "after", "stated noise", "gain", "95 % interval"]
    rows = []
    for name, one, word in (
        ("marks", proof.markers, "µm"),
        ("encoders after the gear", proof.angles, "µrad"),
    ):
        if one is not None:
            values = [f"{MICRO * x:.1f} {word}" for x in
                      (one.before, one.after, one.noise, one.gain)]  # fmt: skip
            span = f"{MICRO * one.low:.1f} to {MICRO * one.high:.1f}"
            rows.append([name, *values, span])
    caption = (
        f"Rms over {len(proof.held_out)} poses kept back; interval of the gain by "
        "BCa bootstrap over poses."
    )
    yield Table(caption, header, rows)
    pictures.of_poses(channel, unit, folder / "poses.png")
    yield Figure("Pose by pose, the worst first.", "poses.png")
    budget = [[k, f"{MICRO * v:.1f} {unit}"] for k, v in proof.budget.items()]
    yield Table(
        "Error budget of the poses kept back: what comes back when an effect is taken "
        "out, rms; squares add up where effects do not overlap.",
        ["source", "rms"],
        budget,
    )


def doubts(finding: Finding) -> Iterator[Block]:
    """Say where the patch holds and where it fails, as it should."""
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


def _trial(trial: Trial) -> list[str]:
    before, after = MICRO * trial.before, MICRO * trial.after
    what = trial.what
    if trial.kind == "taken_out":
        what = f"{what.removeprefix('without ')}, as named"
    return [what, f"{before:.1f}", f"{after:.1f}", str(trial.poses)]
