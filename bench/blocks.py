"""Many visits are worked in blocks, so that memory stays small."""

from dataclasses import fields

import mujoco
import numpy as np
from jaxtyping import Int

from bench import equilibrium
from bench.equilibrium import Rest, Schedule

BLOCK = 1000
"""Visits that run side by side; chosen: about 100 MB."""


def solve(
    model: mujoco.MjModel,
    axes: Int[np.ndarray, " axes"],
    creep: dict[int, float],
    schedule: Schedule,
) -> Rest:
    """Bring the arm to rest in every visit; see `bench.equilibrium.solve`."""
    rests = []
    for start in range(0, len(schedule.hold), BLOCK):
        part = {
            field.name: getattr(schedule, field.name)[start : start + BLOCK]
            for field in fields(Schedule)
        }
        rests.append(equilibrium.solve(model, axes, creep, Schedule(**part), start))
    if len(rests) == 1:
        return rests[0]
    arrays = [field.name for field in fields(Rest) if field.name != "residual"]
    joined = {n: np.concatenate([getattr(rest, n) for rest in rests]) for n in arrays}
    return Rest(**joined, residual=max(rest.residual for rest in rests))
