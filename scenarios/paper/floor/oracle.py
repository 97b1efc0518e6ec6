"""Who knows the form of the truth has only its sizes to learn: nobody does better.

==========  ==========================================================================
Equation    theta = least squares of what was measured; error on fresh poses
            = J_fresh (J^T J)^-1 J^T (measured - true), J = d deflection / d log size
Source      Gauss-Newton's last step: Nocedal, Wright 2006, "Numerical Optimization",
            section 10.3; J by forward differences of the rig
Valid       errors small enough that deflections are linear in the sizes there
Ignores     weights of the readings: all have the same noise
==========  ==========================================================================

Sizes are: the springs' first stiffness, and for every effect how much of it there is.
What the instruments' noise makes of them is all that the oracle gets wrong.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from bench import table_one
from bench.effects.effect import Effect
from bench.plan import Plan
from bench.rig import Rig
from bench.states import States
from bench.truth import Truth, default_truth
from scenarios.paper.experiment import KR10, REVISITS
from scenarios.paper.material import Material
from scenarios.paper.unseen import fresh_plan
from scenarios.paper.work.cells import Cell, Result
from stiffness.deflections import every_plateau

NUDGE = 0.02
"""Share by which a size is changed; chosen: far above rounding, far below curvature."""
SIZES = {
    "base_compliance": ("rx_rad_per_nm", "ry_rad_per_nm"),
    "link_bending": ("bending_nm2", "torsion_nm2"),
    "hardening": ("stiffness_ratio",),
    "hysteresis": ("width_rad",),
    "creep": ("ratio",),
    "angle_dependent_stiffness": ("ratio",),
    "bearing_tilt": ("u_rad_per_nm", "v_rad_per_nm"),
}
"""What says how much of an effect there is, by its name."""


@dataclass(frozen=True)
class NudgeCell(Cell):
    """How deflections change when one size of the truth does.

    Attributes:
        size: Which; -1 for none.
        poses: Of the experiment.
        seed: Of the fresh poses.
    """

    size: int
    poses: int
    seed: int

    @property
    @override
    def cost(self) -> float:
        return 15.0

    @override
    def work(self, material: Material, scratch: Path) -> Result:
        truth = default_truth() if self.size < 0 else nudged(self.size)
        rig = Rig(KR10, truth.effects, truth.stiffness)
        experiment = table_one.plan(self.poses, revisits=min(REVISITS, self.poses))
        fresh = fresh_plan(material.unseen.cases.posture, self.seed)
        data = every_plateau(material.arm, material.recording)
        points = data.cases.point_in_flange
        rows, cases = data.row, material.unseen.cases.point_in_flange
        loaded = np.arange(1, fresh.visits + 1) * len(fresh.path) - 1
        return {
            "experiment": deflection(rig, experiment, rows, points),
            "unseen": deflection(rig, fresh, loaded, cases),
        }


def deflection(
    rig: Rig, plan: Plan, rows: np.ndarray, point: Float[np.ndarray, "rows 3"]
) -> Float[np.ndarray, "rows 3"]:
    """Return how far points of the flange truly move within a visit, in mm."""
    states: States = rig.carry_out(plan)
    flange = states.bodies.index(rig.anatomy.flange)
    ends = [
        states.position[r, flange]
        + np.einsum("nij,nj->ni", states.rotation[r, flange], point)
        for r in (rows, plan.row_visit[rows] * len(plan.path))
    ]
    return 1e3 * (ends[0] - ends[1])


def sizes(truth: Truth) -> list[tuple[Effect, str] | int]:
    """Return every size: an axis' stiffness by number, or an effect and its field."""
    found: list[tuple[Effect, str] | int] = list(range(len(truth.stiffness)))
    for effect in truth.effects:
        found += [(effect, name) for name in SIZES[effect.name]]
    return found


def nudged(size: int) -> Truth:
    """Return the truth with one size a little larger."""
    truth = default_truth()
    what = sizes(truth)[size]
    if isinstance(what, int):
        stiffness = truth.stiffness.copy()
        stiffness[what] *= 1.0 + NUDGE
        return Truth(truth.effects, stiffness)
    effect, name = what
    more = replace(effect, **{name: (1.0 + NUDGE) * getattr(effect, name)})
    effects = [more if e is effect else e for e in truth.effects]
    return Truth(tuple(effects), truth.stiffness)


def oracle_error(
    still: Result, moved: Sequence[Result], noise: Float[np.ndarray, "rows 3"]
) -> Float[np.ndarray, "poses 3"]:
    """Return the oracle's error on the fresh poses.

    Args:
        still: Deflections of the truth.
        moved: Of the truth with each size a little larger.
        noise: Measured less true deflections of the experiment, in mm.
    """
    j, fresh = (
        np.stack([(m[on] - still[on]).ravel() / NUDGE for m in moved], axis=1)
        for on in ("experiment", "unseen")
    )
    off, *_ = np.linalg.lstsq(j, noise.ravel())
    return (fresh @ off).reshape(-1, 3)
