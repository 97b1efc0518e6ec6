"""A name stands while nothing at its place contradicts it; else it is taken back.

The rules are those of the answer's format; what they leave open is decided here and
stands as a constant with its reason.
"""

from collections.abc import Sequence

import numpy as np

from stiffness.diagnosis.detect import ALARM, Found
from stiffness.diagnosis.diagnosis import Name, Rival
from stiffness.diagnosis.member import Member
from stiffness.diagnosis.naming import ALIKE, Named
from stiffness.diagnosis.own_leftover import CONTRADICTS
from stiffness.diagnosis.scored import Scored, is_clear
from stiffness.diagnosis.uneven import Uneven

SURE = 0.95
"""Probability from which a set explains; the rule of the answer."""
DWARFS = 0.1
"""The same, where what is left over is elsewhere or everywhere. Chosen: a name may
stand beside a stranger that is ten times weaker; one that is not may be what feigns
it."""

ANYWHERE = ("wrench_sensor", "rig", "tracker")
"""Places of instruments, whose faults show all over the arm."""
DIFFERS = 0.01
"""Share of what a name explains by which its law may differ between groups of rows.
Chosen: a tenth of its size, squared; laws are no truer than that."""


def contradicted(
    named: Named, gains: Sequence[float], uneven: Sequence[Uneven]
) -> list[bool]:
    """Return which members are contradicted.

    By what is left at their own place, by much that is left anywhere, or by a law that
    is another at other poses, loads or times. With a name that is taken back go all
    weaker ones: they mended a wrong law.
    """
    near = _contradicted_by_what_is_left(named, gains)
    answer = [
        gone or differs(found, gain)
        for gone, found, gain in zip(near, uneven, gains, strict=True)
    ]
    wrong = max(
        (g for g, gone in zip(gains, answer, strict=True) if gone), default=-1.0
    )
    return [gone or gain < wrong for gone, gain in zip(answer, gains, strict=True)]


def differs(found: Uneven, gain: float) -> bool:
    """Return whether a law that explains so much is surely and clearly uneven."""
    return found.p_value < ALARM and found.captured > DIFFERS * gain


def _contradicted_by_what_is_left(named: Named, gains: Sequence[float]) -> list[bool]:
    left = named.left
    if left.p_value >= ALARM:
        return [False] * len(gains)
    excess = left.tested.captured - left.tested.freedom
    dwarfed = [left.excess > DWARFS * gain for gain in gains]
    if left.tested.p_value >= ALARM:  # poses differ, but not along any law
        return dwarfed
    at = left.strongest
    loudest = left.where[at] or left_over(left)
    return [
        gone
        or float(excess[at]) > (CONTRADICTS if _near(m, loudest) else DWARFS) * gain
        for m, gain, gone in zip(named.best.fit.members, gains, dwarfed, strict=True)
    ]


def _near(member: Member, loudest: str) -> bool:
    """Return whether what is left somewhere may be a member's own.

    A wrong wrench or tracker feigns effects anywhere, and any effect feigns them; a
    single marker speaks for itself.
    """
    if loudest.startswith("marker:"):
        return member.where == loudest
    if loudest in ANYWHERE or member.where in ANYWHERE:
        return True
    if _weighs_on(member, loudest):
        return True
    return abs(_place(member.where) - _place(loudest)) <= 1


def _place(where: str) -> int:
    """Return the place of the map where something shows: of a link, the axis after."""
    return _number(where) + where.startswith("link_")


def _weighs_on(member: Member, place: str) -> bool:
    """Return whether a weight acts at a place of the map: at all before it."""
    return member.name[0] == "gravity_load" and _number(place) <= _number(member.where)


def _number(where: str) -> int:
    """Return the number of an axis or a link; 0 for the base, far for a tool."""
    digits = where.removeprefix("link_").removeprefix("a")
    return int(digits) if digits.isdigit() else 0 if where == "base" else 99


def posterior(named: Named, inflation: float) -> tuple[list[float], list[Scored]]:
    """Return the probabilities of the refined sets of the winner's size."""
    sets = list(named.rivals)
    log = np.array([s.log_evidence for s in sets]) / inflation
    weight = np.exp(log - log.max())
    return list(weight / weight.sum()), sets


def equivalents(
    named: Named, k: int, weights: list[float], sets: list[Scored]
) -> list[Name]:
    """Return names that would do as well as a member: the other members staying.

    What predicts unseen poses clearly worse is none, unless a name would not be
    probable enough without it.
    """
    best = named.best
    own = best.fit.members[k].name
    others = best.names - {own}
    close: list[Name] = []
    apart: list[Name] = []
    for rival in named.rivals:
        changed = rival.names - others
        if rival is best or not others <= rival.names or len(changed) != 1:
            continue
        if best.log_evidence - rival.log_evidence > ALIKE:
            continue
        name = next(iter(changed))
        if name != own:
            (apart if _predicts_worse(rival, best) else close).append(Name(*name))
    alike = list(dict.fromkeys(close))
    if probability_of(own, alike, weights, sets) < SURE:
        alike = list(dict.fromkeys([*close, *apart]))
    return alike


def _predicts_worse(rival: Scored, best: Scored) -> bool:
    """Return whether a rival predicts poses left out clearly worse."""
    gap = best.predicted - rival.predicted
    return bool(np.sum(gap) > ALIKE) and is_clear(gap)


def probability_of(
    name: tuple[str, str],
    alike: Sequence[Name],
    weights: list[float],
    sets: list[Scored],
) -> float:
    """Return the posterior of a name or one of its equivalents."""
    wanted = {name, *((n.effect, n.where) for n in alike)}
    return float(
        min(1.0, sum(w for w, s in zip(weights, sets, strict=True) if s.names & wanted))
    )


def rivals_of(
    named: Named, weights: list[float], sets: list[Scored]
) -> tuple[Rival, ...]:
    """Return the other sets with their probabilities, the first five."""
    listed = [
        Rival(float(w), tuple(Name(*n) for n in sorted(s.names)))
        for w, s in zip(weights, sets, strict=True)
        if s is not named.best and s.names
    ]
    return tuple(sorted(listed, key=lambda r: -r.probability)[:5])


def left_over(found: Found) -> str:
    """Return the place of the map where most is left."""
    z = found.of_places(found.tested.z)
    return max(z, key=lambda place: z[place]) if z else ""
