"""Sizes are found on silent instruments, where an effect alone makes the difference."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bench.effects.effect import Effect
from bench.experiment import record
from bench.instruments import Encoders, Instruments
from bench.instruments.tracker import STILL
from bench.plan import Plan
from bench.recording import Recording
from bench.rig import Rig
from scenarios.trials.draw import Trial
from scenarios.trials.oracle import as_strange_as, explained
from scenarios.trials.sizes import as_large_as
from scenarios.trials.weight import Weight, scale_of


@dataclass(frozen=True)
class Bench:
    """An arm of a trial without its effects, and how large effects on it are."""

    trial: Trial
    rig: Rig
    plan: Plan
    stated: bool
    hook: bool

    def seen(self, effects: tuple[Effect, ...], instruments: Instruments) -> Recording:
        """Record the arm with effects."""
        rig = replace(self.rig, effects=effects)
        seen = record(rig, self.plan, instruments, self.trial.seed, self.trial.name)
        if not self.hook:
            return seen
        quiet = silent(self.trial.instruments)
        weight = record(self.rig, self.plan, quiet, self.trial.seed).wrench
        return replace(seen, wrench=weight)  # taken from what hangs on the hook


def sized(
    bench: Bench, effects: Sequence[Effect], draw: np.random.Generator
) -> tuple[tuple[Effect, ...], tuple[Weight, ...]]:
    """Make every effect as large as its stratum asks."""
    if not effects:
        return (), ()
    trial = bench.trial
    quiet = silent(trial.instruments)
    scale = scale_of(
        bench.rig,
        bench.seen((), quiet),
        trial.instruments.tracker.repeatability,
        bench.stated,
    )

    def weigh(effect: Effect) -> Weight:
        return scale.weigh(bench.seen((effect,), quiet))

    watching = replace(trial.instruments.tracker, occlusions=0.0)  # as it is weighed

    def captured(effect: Effect) -> float:
        seen = bench.seen((effect,), replace(trial.instruments, tracker=watching))
        return explained(seen, Path(bench.rig.arm_file), (effect.name,))

    found, weights = [], []
    for effect, least in zip(effects, trial.stratum.least, strict=True):
        if trial.stratum.known:
            larger, weight = as_large_as(effect, least, weigh)
        else:
            larger, weight = as_strange_as(effect, least, weigh, captured, draw)
        found.append(larger)
        weights.append(weight)
    return tuple(found), tuple(weights)


def silent(instruments: Instruments) -> Instruments:
    """Return instruments that make no error, with encoders after the gears."""
    tracker = replace(
        instruments.tracker,
        noise=0.0,
        field=0.0,
        occlusions=0.0,
        frame_error=instruments.tracker.frame_error or STILL,
    )
    sensor = replace(
        instruments.force_sensor, noise=0.0, turn=0.0, size=0.0, resolution=(0.0, 0.0)
    )
    encoders = Encoders(link_side=True, noise=0.0)
    return replace(instruments, tracker=tracker, force_sensor=sensor, encoders=encoders)
