"""On a busy machine only ways that run in turn can be compared, and only as ratios.

==========  ==========================================================================
Equation    ratio = median over rounds of t_other / t_ours, both of the same round
Ours        runs first in every round: A B C A B C, so that a slow minute hits all
Ends        smallest and largest ratio of a round; of a few rounds no more can be said
==========  ==========================================================================
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Way:
    """One way to do a task.

    Attributes:
        name: What it is called in the report.
        run: Does the task and returns its answer.
        share: Part of the task that is run; times are scaled up by it.
    """

    name: str
    run: Callable[[], Any]
    share: float = 1.0


@dataclass(frozen=True)
class Race:
    """One task and the ways to do it.

    Attributes:
        task: What is done.
        ways: Ours first.
        differs: Says of our answer and another one how far they are apart.
        bar: What ours may take on two quiet cores, in s; None: nothing was promised.
        rounds: How often each way runs for every repeat that is asked for.
        skipped: Ways that cannot run here, and why.
    """

    task: str
    ways: tuple[Way, ...]
    differs: Callable[[Any, Any], str] = lambda _ours, _other: ""
    bar: float | None = None
    rounds: int = 1
    skipped: tuple[str, ...] = ()


@dataclass(frozen=True)
class Lap:
    """What one way took.

    Attributes:
        task: What was done.
        way: How.
        share: Part of the task that was run.
        wall: Time by the clock in each round, scaled to the whole task, in s.
        cpu: Time of all cores, scaled alike, in s.
        ratio: Over ours in each round.
        differs: How far its answer is from ours.
        bar: What ours may take, in s; None for the others.
    """

    task: str
    way: str
    share: float
    wall: Float[np.ndarray, " rounds"]
    cpu: Float[np.ndarray, " rounds"]
    ratio: Float[np.ndarray, " rounds"]
    differs: str
    bar: float | None

    @property
    def row(self) -> dict[str, object]:
        """One row of benchmark.csv."""
        return {
            "task": self.task,
            "way": self.way,
            "median_s": float(np.median(self.wall)),
            "least_s": float(self.wall.min()),
            "most_s": float(self.wall.max()),
            "cpu_s": float(np.median(self.cpu)),
            "ratio": float(np.median(self.ratio)),
            "ratio_low": float(self.ratio.min()),
            "ratio_high": float(self.ratio.max()),
            "rounds": len(self.wall),
            "share_run": self.share,
            "differs_from_ours": self.differs,
            "bar_s": self.bar,
        }


def run(race: Race, repeats: int, tick: Callable[[], object]) -> Sequence[Lap]:
    """Let every way run once unmeasured, for its answer, and then in turn.

    Args:
        race: The task and its ways.
        repeats: How often; times the race's rounds.
        tick: Called after each run.
    """
    answers = []
    for way in race.ways:
        answers.append(way.run())
        tick()
    rounds = repeats * race.rounds
    wall, cpu = np.empty((2, len(race.ways), rounds))
    for r in range(rounds):
        for w, way in enumerate(race.ways):
            begin = time.perf_counter(), time.process_time()
            way.run()
            wall[w, r] = (time.perf_counter() - begin[0]) / way.share
            cpu[w, r] = (time.process_time() - begin[1]) / way.share
            tick()
    return [
        Lap(
            task=race.task,
            way=way.name,
            share=way.share,
            wall=wall[w],
            cpu=cpu[w],
            ratio=wall[w] / wall[0],
            differs=race.differs(answers[0], answers[w]) if w else "",
            bar=None if w else race.bar,
        )
        for w, way in enumerate(race.ways)
    ]


def runs(race: Race, repeats: int) -> int:
    """Return how often `run` calls `tick`."""
    return len(race.ways) * (1 + repeats * race.rounds)
