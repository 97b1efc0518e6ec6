"""The experiment is shown as it went: the arm, its rigid ghost, the rope."""

from pathlib import Path

import numpy as np

from bench import viewer
from bench.cell import HOOK_SITE, MOUNT
from scenarios.paper.experiment import Experiment
from scenarios.paper.linear_fit import LinearFit

MAGNIFIED = 50.0


def show(
    experiment: Experiment, found: LinearFit, out: Path, seed: int, live: bool
) -> None:
    """Save the recording for the viewer as study.rrd, or stream it there.

    Args:
        experiment: What was done and seen.
        found: What the methods made of it.
        out: Folder of study.rrd.
        seed: Names the run.
        live: Whether it is streamed instead of saved.
    """
    error_mm = {
        name: 1e3 * (deflection - experiment.measured.deflection)
        for name, deflection in found.predicted.items()
        if name != "rigid"
    }
    stream = (
        viewer.live("study", seed)
        if live
        else viewer.saved(out / "study.rrd", "study", seed)
    )
    rows = experiment.measured.row
    viewer.show(stream, scene(experiment), error_mm, rows, _words(experiment, found))
    stream.flush()
    stream.disconnect()


def scene(experiment: Experiment) -> viewer.Scene:
    """Return what is to be seen of the experiment, row by row."""
    rig, plan, states = experiment.rig, experiment.plan, experiment.states
    anatomy = rig.anatomy
    bodies = (anatomy.base, *anatomy.links, anatomy.flange)
    index = [states.bodies.index(body) for body in bodies]
    actual = np.tile(np.eye(4), (len(plan.row_visit), len(bodies), 1, 1))
    actual[..., :3, :3] = states.rotation[:, index]
    actual[..., :3, 3] = states.position[:, index]
    posture = plan.posture[plan.row_visit]
    nominal = experiment.arm.placements(posture, list(bodies))
    hook = states.point(MOUNT, rig.model.site(HOOK_SITE).pos)
    pulley = plan.pulley[plan.row_visit]
    centre = rig.mounted.pulley[pulley]
    weight = np.stack([rig.model.site(f"weight_{p}").pos for p in pulley])
    mount = states.bodies.index(MOUNT)
    force = (states.rotation[:, mount] @ states.wrench[:, :3, None])[..., 0]
    return viewer.Scene(
        model=rig.nominal,
        bodies=bodies,
        nominal=nominal,
        actual=actual,
        pose=plan.row_visit,
        magnified=MAGNIFIED,
        rope=np.stack([hook, centre, weight], axis=1),
        force=force,
        markers=_markers(experiment),
    )


def _markers(experiment: Experiment) -> np.ndarray:
    points = experiment.recording.points
    assert points is not None
    frame = experiment.measured.frame.base_from_tracker
    return points @ frame[:3, :3].T + frame[:3, 3]


def _words(experiment: Experiment, found: LinearFit) -> str:
    lines = [
        "## The experiment of Table 1 on the bench",
        f"Deflection magnified **{MAGNIFIED:.0f} times**. Grey: the rigid arm. Orange: "
        "the arm as it stands. Rope, pull (red, 100 N are a third of a metre) and marks "
        "as the tracker saw them (blue) are not magnified.",
        "Drag the timeline `reading`: nine readings a posture, weights up and down.",
        "Below: error of the six-spring model, posture by posture.",
        "",
        "| axis | identified [kN m/rad] | truth, secant |",
        "|---|---|---|",
    ]
    for p, secant in zip(
        found.fitted.stiffness, experiment.secant_stiffness, strict=True
    ):
        lines.append(f"| {p.name} | {p.value / 1e3:.2f} | {secant / 1e3:.2f} |")
    return "\n\n".join(lines[:4]) + "\n" + "\n".join(lines[4:])
