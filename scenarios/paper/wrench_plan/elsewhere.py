"""Loads that pull where the experiment never did show what a wrench plan was worth."""

import numpy as np
from jaxtyping import Float

from bench.cell import GRAVITY
from bench.load_path import DEFAULT_PATH
from scenarios.paper.experiment import Experiment
from scenarios.paper.unseen import Unseen
from stiffness.load_cases import LoadCases

APART = np.deg2rad(25.0)
"""Least angle to any direction the experiment used, in rad; chosen."""
TRIED = 10_000


def pulled_elsewhere(experiment: Experiment, fresh: Unseen, seed: int) -> Unseen:
    """Load fresh postures in directions that the experiment did not use.

    The hook and the load are those of the experiment; only the direction is another.

    Args:
        experiment: With the directions that were used.
        fresh: The postures.
        seed: Of the directions.
    """
    count, cases = len(fresh.cases), fresh.cases
    used = experiment.measured.cases.wrench_in_base[:, :3]
    draw = np.random.default_rng(seed).standard_normal((TRIED, 3))
    draw /= np.linalg.norm(draw, axis=1, keepdims=True)
    direction = draw[nearest(draw, used) > APART][:count]
    if len(direction) < count:
        direction = np.resize(direction, (count, 3))
    turn = experiment.arm.at(cases.posture).turn("flange")
    lever = turn @ np.array(experiment.rig.mounted.hook)
    steps = [step.mass for step in DEFAULT_PATH[:5]]
    hold = np.broadcast_to([s.hold for s in DEFAULT_PATH[:5]], (count, len(steps)))
    pull = direction[:, None] * (GRAVITY * np.array(steps))[:, None]
    wrench = np.concatenate([pull, np.cross(lever[:, None], pull)], axis=2)
    states = experiment.rig.respond(cases.posture, wrench, np.array(hold))
    flange = states.bodies.index(experiment.rig.anatomy.flange)
    place = states.position[:, flange] + np.einsum(
        "nij,nj->ni",
        states.rotation[:, flange],
        np.repeat(cases.point_in_flange, len(steps), axis=0),
    )
    place = place.reshape(count, len(steps), 3)
    asked = LoadCases(
        cases.posture,
        wrench[:, -1],
        cases.point_in_flange,
        cases.origin_in_flange,
        cases.payload,
    )
    return Unseen(asked, place[:, -1] - place[:, 0])


def nearest(
    direction: Float[np.ndarray, "rows 3"], used: Float[np.ndarray, "forces 3"]
) -> Float[np.ndarray, " rows"]:
    """Return the angle to the nearest direction that was used, in rad."""
    unit = used / np.linalg.norm(used, axis=1, keepdims=True)
    size = np.linalg.norm(direction, axis=1, keepdims=True)
    return np.arccos(np.clip((direction / size) @ unit.T, -1.0, 1.0)).min(axis=1)


def both(one: Unseen, other: Unseen) -> Unseen:
    """Return the cases of both, one after the other."""
    a, b = one.cases, other.cases
    cases = LoadCases(
        np.concatenate([a.posture, b.posture]),
        np.concatenate([a.wrench_in_base, b.wrench_in_base]),
        np.concatenate([a.point_in_flange, b.point_in_flange]),
        a.origin_in_flange,
        a.payload,
    )
    return Unseen(cases, np.concatenate([one.deflection, other.deflection]))
