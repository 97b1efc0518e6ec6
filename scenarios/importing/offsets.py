"""A log's time and its offset is the axes' time: stated, shared, or seen in motion."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bench.recording import Recording
from scenarios.importing.clocks import Channel
from scenarios.importing.epoch import shift_of
from scenarios.importing.lag import Lag, lag_between, said
from scenarios.importing.mapping import Log
from scenarios.importing.wanted import Wanted


@dataclass(frozen=True)
class Read:
    """A file as it was read.

    Attributes:
        name: In the mapping.
        log: What the mapping says of it.
        wanted: What is taken from it.
        channel: Its readings, by its own clock.
    """

    name: str
    log: Log
    wanted: Wanted
    channel: Channel

    @property
    def motion(self) -> Channel | None:
        """The marker, or what else, that was read most often; None for none."""
        order, values = list(self.wanted.columns), self.channel.values
        groups = [values[:, [order.index(c) for c in g]] for g in self.wanted.groups]
        seen = [np.isfinite(v).all(axis=1) for v in groups]
        if not groups:
            return None
        best = max(range(len(groups)), key=lambda k: int(seen[k].sum()))
        return Channel(self.channel.time[seen[best]], groups[best][seen[best]])


def offsets_of(
    axes: Recording, reads: Sequence[Read], mapping: str
) -> tuple[dict[str, float], list[str], list[str]]:
    """Find what to add to each file's time.

    Args:
        axes: By the clock that is wanted.
        reads: The files.
        mapping: What the user calls the mapping, for the faults.

    Returns:
        The offsets in s, what to say of them, and a fault for each that nothing tells.
    """
    offsets: dict[str, float] = {}
    told, faults = [], []
    for read in sorted(reads, key=lambda r: r.log.clock is not None):
        log, motion = read.log, read.motion
        clock = next((r for r in reads if r.name == log.clock), None)
        if log.offset_s is None and clock is None:
            shift: Lag | str = "nothing in it moves with the arm"
            if motion is not None:
                shift = shift_of(axes.time, axes.posture, motion.time, motion.values)
            if isinstance(shift, str):
                say = f"say offset_s or clock in {mapping}, files.{read.name}"
                why = f"its clock cannot be told from the motion: {shift}; {say}."
                faults.append(f"{log.file}: {why}")
                continue
            offsets[read.name] = -shift.seconds
            how = f"found from the motion, {shift.within()}; its own lag is in it"
        elif clock is None:
            offsets[read.name] = log.offset_s or 0.0
            how = "as stated"
        elif clock.name in offsets:
            offsets[read.name] = offsets[clock.name]
            how = f"by the clock of {clock.log.file}"
        else:
            continue  # that file's fault is said
        offset = offsets[read.name]
        told.append(f"{log.file}: its time {offset:+.4f} s is that of the axes, {how}.")
        if motion is not None and (log.offset_s is not None or clock is not None):
            time = motion.time + offset
            lag = lag_between(axes.time, axes.posture, time, motion.values)
            told.append(f"Lag of {log.file} behind the axes: {said(lag)}.")
    return offsets, told, faults
