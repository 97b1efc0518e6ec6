"""What each effect of a rig moves: noise-free readings with it and without it.

The instruments watch without noise, so the difference is the effect alone; effects
that sit in instruments leave the arm where it is and are not simulated again.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from bench.effects.effect import Effect, InstrumentEffect
from bench.experiment import faulty, marks_in_base
from bench.instruments import Instruments
from bench.instruments.random_streams import streams
from bench.instruments.tracker import STILL
from bench.rig import Rig, States
from bench.shared.errors import BenchError
from bench.shared.plan import Plan, evenly_spaced

VISITS = 340
"""Visits that are simulated in all; chosen: all of a usual plan for one effect, ten for
each of thirty, which leaves their size uncertain by a quarter."""


@dataclass(frozen=True)
class EffectSize:
    """Root mean square of what an effect changes in noise-free readings.

    Attributes:
        points: Of the marks' displacements in the base's frame, over marks and rows,
            in m; NaN where the other effects alone cannot be simulated.
        force: Of the change in the force sensor's force, over rows, in N.
        torque: The same in its torque, in N m.
    """

    effect: Effect
    points: float
    force: float
    torque: float
    visits: int

    def over_noise(self, instruments: Instruments) -> float:
        """Return the size in units of the noise that the instruments state.

        The largest of three ratios: displacement over the tracker's noise, force and
        torque over the force sensor's, all per coordinate. NaN where it is not known.
        What a silent instrument states counts.
        """
        sensor = instruments.force_sensor
        spread = np.sqrt(np.mean(np.square(instruments.tracker.repeatability)))
        return max(
            self.points / spread,
            self.force / sensor.accuracy_force,
            self.torque / sensor.accuracy_torque,
        )


def effect_sizes(
    rig: Rig, plan: Plan, instruments: Instruments, seed: int = 0
) -> Iterator[EffectSize]:
    """Yield how large each effect of a rig is, in the order of the rig's effects.

    As many visits of the plan count, evenly spaced over it, as make `VISITS` in all.
    Instruments are those before the faults among the effects; the seed says where marks
    are stuck and the tracker stands.

    Raises:
        BenchError: Where the arm finds no rest.
    """
    if not rig.effects:
        return
    each = min(max(VISITS // (len(rig.effects) + 1), 1), plan.visits)
    sample = _Sample(plan, evenly_spaced(plan.visits, each), instruments, seed)
    states = rig.carry_out(sample.plan)
    points, wrench = sample.read(rig, states)
    for k, effect in enumerate(rig.effects):
        others = replace(rig, effects=rig.effects[:k] + rig.effects[k + 1 :])
        try:
            same = isinstance(effect, InstrumentEffect)
            stays = states if same else others.carry_out(sample.plan)
        except BenchError:  # such as a mass that is taken from one that was added
            yield EffectSize(effect, np.nan, np.nan, np.nan, each)
            continue
        points_without, wrench_without = sample.read(others, stays)
        force, torque = np.hsplit(wrench - wrench_without, 2)
        displacement = points - points_without
        sizes = (_rms(displacement), _rms(force), _rms(torque))
        yield EffectSize(effect, *sizes, each)


class _Sample:
    """Some visits of a plan, read without noise at the times of the whole plan."""

    def __init__(
        self,
        plan: Plan,
        visits: Int[np.ndarray, " visits"],
        instruments: Instruments,
        seed: int,
    ):
        self.plan = replace(
            plan,
            posture=plan.posture[visits],
            posture_id=plan.posture_id[visits],
            pulley=plan.pulley[visits],
        )
        self.time = plan.time.reshape(plan.visits, -1)[visits].ravel()
        self.seed = seed
        quiet = instruments.without_noise()
        tracker = replace(quiet.tracker, widest_view=None, frame_error=STILL)
        self.instruments = replace(quiet, tracker=tracker)

    def read(
        self, rig: Rig, states: States
    ) -> tuple[Float[np.ndarray, "rows markers 3"], Float[np.ndarray, "rows 6"]]:
        """Return marks in the base's frame as the tracker has them, and the wrench."""
        watch, chance = faulty(self.instruments, rig), streams(self.seed)
        stuck = watch.markers.stick(rig.nominal, rig.anatomy, chance)
        marks = marks_in_base(rig, states, stuck, watch.markers, self.time)
        seen, frame = watch.tracker.read(*marks, self.time, chance)
        assert frame is not None  # it is stated: frame_error is given
        points = seen @ frame[:3, :3].T + frame[:3, 3]
        return points, watch.force_sensor.read(
            states.wrench, self.plan.row_visit, chance
        )


def _rms(vectors: Float[np.ndarray, "*rows 3"]) -> float:
    """Return the root mean square of the vectors' lengths."""
    return float(np.sqrt(np.mean(np.sum(np.square(vectors), axis=-1))))
