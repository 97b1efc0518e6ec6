"""What is to be seen of the experiment, reading by reading."""

import numpy as np

from bench import viewer
from bench.cell import HOOK_SITE, MOUNT
from scenarios.paper.experiment import Experiment

MAGNIFIED = 50.0


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
