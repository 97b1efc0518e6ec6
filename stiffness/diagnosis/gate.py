"""Gates on a set of effects: poses left out, strong laws near by, limits of sizes.

What explains poses that were fitted must predict poses that were not. A name also goes
where another accepted form of a stronger law near it does as well, where it is less
than what a found load may be wrong by, or where its sizes are nothing or impossible.

==========  ==========================================================================
Equation    share = 2 (g_S - g_0) / (sum_p (q_p - n_p) - 2 g_0), g_S, g_0 gains of the
            set and of the nominal columns on poses left out, q_p a pose's whitened
            square, n_p its degrees of freedom
Source      the gate itself: `regression.predictive_gate`
Valid       poses that err independently
Ignores     that the set was chosen with the same poses
==========  ==========================================================================
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

from bench.shared.effect_catalogue import CATALOGUE, INSTRUMENTS
from bench.shared.settings import Interval
from stiffness.diagnosis.model_fit import (
    ModelFit,
    ModelTerm,
    SelectionProblem,
    training,
)
from stiffness.diagnosis.relinearisation import changes_moments
from stiffness.diagnosis.sufficient_statistics import per_pose_scores
from stiffness.effects.base import (
    Hypothesis,
    are_near,
    are_neighbours,
    site_number,
)
from stiffness.experiment.static_state import StaticState
from stiffness.regression.intervals import FittedParameters
from stiffness.regression.normal_equations import (
    losses_without,
    projection_coefficients,
    schur_complement,
)
from stiffness.regression.predictive_gate import (
    Decision,
    GatedNames,
    UnitStatistics,
    decisions_beside,
    gate_names,
    left_out_gain,
)

# --- What poses say of a set ----------------------------------------------------------


@dataclass(frozen=True, eq=False)
class PoseStatistics:
    """What each training pose says of the terms of a set.

    Attributes:
        terms: The set.
        units: Statistics of each pose; nominal columns come first.
        nominal: Their numbers.
        owned: Columns of each term.
        forms: Columns of the other accepted forms of each term's law.
        mismatch: Whitened square of each training pose beyond its degrees of freedom.
    """

    terms: tuple[ModelTerm, ...]
    units: UnitStatistics
    nominal: Int[np.ndarray, " nominal"]
    owned: tuple[Int[np.ndarray, " _"], ...]
    forms: tuple[Int[np.ndarray, " _"], ...]
    mismatch: Float[np.ndarray, " poses"]

    @cached_property
    def nominal_gain(self) -> float:
        """What the nominal columns alone gain on poses left out."""
        return float(left_out_gain(self.units, self.nominal, []).sum())

    def owned_by(self, members: Sequence[ModelTerm]) -> list[Int[np.ndarray, " _"]]:
        """Return the columns of each of some of the terms, by name."""
        place = dict(zip((term.name for term in self.terms), self.owned, strict=True))
        return [place[member.name] for member in members]

    @property
    def whole(self) -> float:
        """Whitened square of the mismatch that nominal columns do not explain."""
        return max(float(self.mismatch.sum()) - 2.0 * self.nominal_gain, 1e-12)

    def share(self, gain: Float[np.ndarray, " poses"]) -> float:
        """Return the share of the mismatch that a gain on poses left out explains."""
        return self.as_share(2.0 * (float(gain.sum()) - self.nominal_gain))

    def share_of(self, lost: Float[np.ndarray, " poses"]) -> float:
        """Return a loss of poses left out as a share of the same mismatch."""
        return self.as_share(2.0 * float(lost.sum()))

    def as_share(self, square: float) -> float:
        """Return a square as a share of it, 1 where noise hides how large it is."""
        return min(square / self.whole, 1.0)


def pose_statistics(
    case: SelectionProblem, terms: Sequence[ModelTerm]
) -> PoseStatistics:
    """Return what each training pose says of terms and of other forms of their laws.

    Args:
        case: What may be looked at.
        terms: The set.
    """
    here, held_out = case.situation, case.split.held_out
    laws = [term.jacobian(here) for term in terms]
    forms = [t.hypothesis.variants(here, t.where, t.shape) for t in terms]
    every = [part for part in (*laws, *forms) if part.columns]
    found = per_pose_scores(case.data, [*case.nominal, *every], training(case.split))
    widths = [part.columns for part in (*laws, *forms)]
    ends = np.cumsum([case.library.nominal, *widths])
    blocks = tuple(np.arange(a, b) for a, b in pairwise(ends))
    return PoseStatistics(
        tuple(terms),
        UnitStatistics(found.own, found.score, np.where(held_out, -1, case.split.fold)),
        np.arange(case.library.nominal),
        blocks[: len(laws)],
        blocks[len(laws) :],
        case.data.mismatch_of_poses[~held_out],
    )


def drop_one_gains(
    found: PoseStatistics, terms: Sequence[ModelTerm]
) -> tuple[float, ...]:
    """Return what each term explains that others do not, springs adapting.

    Args:
        found: What poses say of these terms, or of more.
        terms: The set.
    """
    blocks = found.owned_by(terms)
    used = np.concatenate([found.nominal, *blocks]).astype(int)
    some = found.units.fold >= 0
    gram = found.units.gram[some].sum(axis=0)[np.ix_(used, used)]
    score = found.units.score[some].sum(axis=0)[used]
    ends = np.cumsum([len(found.nominal), *map(len, blocks)])
    return losses_without(gram, score, [np.arange(a, b) for a, b in pairwise(ends)])


def budget_parts(found: PoseStatistics, fit: ModelFit) -> tuple[float, ...]:
    """Return each member's part of what the set explains; they add up to one.

    A part is below zero where a member's displacement goes against that of the others.

    ==========  ======================================================================
    Equation    part_k = f_k' f / f' f; f_k what the member displaces at its
                fitted size, whitened, nominal columns projected out; f their sum
    Source      Pratt 1987, "Dividing the indivisible: using simple symmetry to
                partition variance explained"
    Valid       members that are held together
    Ignores     the error of sizes
    ==========  ======================================================================

    Args:
        found: What poses say of the set, or of more.
        fit: The set.
    """
    owned = found.owned_by(fit.members)
    used = np.concatenate([np.zeros(0, dtype=int), *owned])
    gram = found.units.gram[found.units.fold >= 0].sum(axis=0)
    share = projection_coefficients(gram, found.nominal)
    inner = schur_complement(gram, found.nominal, share, used)
    size = np.concatenate([np.zeros(0), *fit.coefficients])
    along = size * (inner @ size)  # f_k' f of each column
    ends = np.cumsum([0, *map(len, owned)])
    total = max(float(along.sum()), 1e-300)
    return tuple(float(along[a:b].sum()) / total for a, b in pairwise(ends))


CANCELLED = 0.5
"""Part of what a set explains that a name may take back of it, and from which on a name
is one of those that undo each other. Chosen: of 9,758 names of concealed arms none has
a part below -0.46."""


def cancelled_names(
    members: Sequence[ModelTerm], parts: Sequence[float]
) -> list[Decision]:
    """Return the names that mostly undo what others of their set do.

    Each of them would displace the arm about as much as it is displaced, or more: they
    are large to leave a little of what none of them is.

    Args:
        members: The set.
        parts: `budget_parts` of it.
    """
    own = [both for both in zip(members, parts, strict=True) if not both[0].is_generic]
    if min((part for _, part in own), default=0.0) >= -CANCELLED:
        return []
    reason = "it and other names mostly undo each other"
    return [
        Decision(m.name, "cancelled", False, abs(part), CANCELLED, reason)
        for m, part in own
        if abs(part) > CANCELLED
    ]


# --- Gate on poses left out -----------------------------------------------------------

SECOND_ORDER = 0.0025
"""Share of what a name explains by which its columns may be wrong where a load was
found beside it: a name near it that explains less is none. Chosen: a twentieth of its
amplitude, squared."""

OTHER_FORMS = 0.1
"""Share of what a law explains that another accepted form of it may explain beside it.
Chosen: a third of its amplitude, squared."""


def gate_terms(
    statistics: PoseStatistics,
) -> tuple[GatedNames, tuple[Decision, ...]]:
    """Gate terms on poses left out, weaker ones beside other forms of stronger laws.

    Args:
        statistics: What poses say of the terms.

    Returns:
        What passed, and the decisions on what did not pass the second time.
    """
    kept = list(range(len(statistics.terms)))
    slight: list[Decision] = []
    while True:
        own = [(statistics.terms[t].name, statistics.owned[t]) for t in kept]
        gated = gate_names(statistics.units, statistics.nominal, own)
        kept = [kept[k] for k in gated.terms]
        weak = _weak_beside_forms(statistics, kept, gated)
        if weak is None:
            return gated, tuple(slight)
        slight.append(weak)
        kept = [t for t in kept if statistics.terms[t].name != weak.candidate]


def second_order_name(
    case: SelectionProblem, terms: Sequence[ModelTerm], gated: GatedNames
) -> Decision | None:
    """Return the slightest name that is less than what a found load may be wrong by.

    What a load and what gives way under it do to each other is in neither's columns,
    but where these were laid out under the load.

    Args:
        case: What may be looked at.
        terms: The set, as it was gated.
        gated: What each name's leaving costs.
    """
    here = case.situation
    loads = [t for t in terms if changes_moments(here, t)]
    acting = frozenset() if case.named is None else case.named.names
    strong = [t for t in terms if t.hypothesis.linear or t in loads] if loads else []
    lost = dict(zip(gated.names, (float(x.sum()) for x in gated.lost), strict=True))
    found = []
    for term in terms:
        near = [
            t
            for t in strong
            if are_near(t.where, term.where) and not (t in loads and t.name in acting)
        ]
        most = max((lost[t.name] for t in near), default=0.0)
        share = lost[term.name] / max(most, 1e-300)
        if share < SECOND_ORDER:
            reason = "it explains less than what a found load near it may be wrong by"
            found.append(
                Decision(term.name, "second_order", False, share, SECOND_ORDER, reason)
            )
    return min(found, key=lambda d: d.statistic, default=None)


ANYWHERE = frozenset({"angle", "load"})
"""What errors of weights, geometry and instruments depend on that show at all axes."""


def is_local(member: ModelTerm) -> bool:
    """Return whether no mechanism far away imitates a name.

    Of gears, bearings and links, and of what neither angles nor loads change: a slip, a
    drift, a lag.
    """
    info = CATALOGUE[member.name[0]]
    if info.family in ("gear", "structure"):
        return True
    return bool(info.depends_on) and ANYWHERE.isdisjoint(info.depends_on)


WEIGHTS = frozenset({"gravity_load", "mass_scale"})
"""Effects that pull at all places before theirs."""


def may_show_at(member: ModelTerm, loudest: str) -> bool:
    """Return whether a residual somewhere may be a member's own.

    A wrong wrench or tracker mimics effects anywhere, and any effect mimics them; a
    weight acts at all places before it; a single marker affects itself alone.
    """
    if loudest.startswith("marker:"):
        return member.where == loudest
    if loudest in INSTRUMENTS or member.where in INSTRUMENTS:
        return True
    of_load = site_number(member.where) - member.where.startswith("link_")
    if member.name[0] in WEIGHTS and site_number(loudest) <= of_load:
        return True
    return abs(site_number(member.where) - site_number(loudest)) <= 1


def _weak_beside_forms(
    statistics: PoseStatistics, kept: Sequence[int], gated: GatedNames
) -> Decision | None:
    """Return the weakest name that other forms of a strong law near it replace."""
    terms = statistics.terms
    lost = dict(zip(gated.names, (float(x.sum()) for x in gated.lost), strict=True))
    asked = []
    for t in kept:
        name = terms[t].name
        stronger = [
            o
            for o in kept
            if are_neighbours(terms[o].where, terms[t].where)
            and lost[name] < OTHER_FORMS * lost[terms[o].name]
            and len(statistics.forms[o])
        ]
        if stronger:
            asked.append((name, stronger))
    own = [(terms[o].name, statistics.owned[o]) for o in kept]
    found = decisions_beside(
        statistics.units, statistics.nominal, own, statistics.forms, asked
    )
    reason = "another form of a stronger law near it does as well"
    weak = [
        replace(decision, gate="other_forms", reason=reason)
        for decision in found
        if not decision.accepted
    ]
    return max(weak, key=lambda d: d.statistic, default=None)


# --- Limits and signs of sizes --------------------------------------------------------

SLIGHT = 0.01
"""Share of an interval that an estimate is nothing beside, and share of what is
physical from which on an interval is wide; chosen."""


def as_held(
    situation: StaticState, member: ModelTerm, parameters: Mapping[str, Interval]
) -> dict[str, Interval]:
    """Return parameters within their limits, without ends where no data hold them.

    As where a shape may have any value that is tried.
    """
    limits = member.hypothesis.limits_at(situation, member.where)
    names = enumerate(member.shape_names)
    tried = {name: member.grid(situation, j) for j, name in names}

    def held(name: str, p: Interval) -> bool:
        if not is_held(limits.get(name), p.estimate, (p.high - p.low) / 2.0):
            return False
        grid = tried.get(name, np.zeros(1))
        return not p.low <= grid[0] < grid[-1] <= p.high

    return {
        name: _within(limits.get(name), p)
        if held(name, p)
        else Interval(p.estimate, -np.inf, np.inf)
        for name, p in parameters.items()
    }


def _within(limits: tuple[float, float] | None, found: Interval) -> Interval:
    """Return a parameter that lies outside its limits at the nearer one."""
    if limits is None or limits[0] <= found.estimate <= limits[1]:
        return found
    low, high = limits
    half = (found.high - found.low) / 2.0
    if found.estimate < low:
        return Interval(low, low, max(low + half, found.high))
    return Interval(high, min(high - half, found.low), high)


def is_held(limits: tuple[float, float] | None, value: float, half: float) -> bool:
    """Return whether readings say more of a number than that it is physical."""
    if limits is None:
        return True
    low, high = limits
    if np.isfinite(high):
        faint = abs(value) < SLIGHT * half and half > SLIGHT * (high - low) / 2.0
        return half < (high - low) / 2.0 and not faint
    return not np.isfinite(low) or value - half > low


def cost_of_limits(
    situation: StaticState, member: ModelTerm, parameters: dict[str, Interval]
) -> float:
    """Return the whitened square that is lost if a parameter keeps to its limits.

    Of the parameter that lies furthest outside; 0 where an interval reaches inside.
    Without end where all sizes are impossible: each may be small within what the
    others explain, but no part of the effect could be there.
    """
    limits = member.hypothesis.limits_at(situation, member.where)
    worst, beyond = 0.0, set[str]()
    for name, (low, high) in limits.items():
        found = parameters.get(name)
        if found is None or (found.high >= low and found.low <= high):
            continue
        beyond.add(name)
        apart = max(low - found.estimate, found.estimate - high)
        worst = max(worst, (apart / max(found.sigma, 1e-300)) ** 2)
    sizes = member.hypothesis.magnitudes
    return np.inf if len(sizes) > 1 and beyond.issuperset(sizes) else worst


def may_be_nothing(hypothesis: Hypothesis, parameters: Mapping[str, Interval]) -> bool:
    """Return whether all that an effect could be may be nothing, by the intervals.

    A stiffness whose interval holds zero may be without end; a ratio is nothing at its
    neutral value.
    """
    nothing = hypothesis.nothing
    sizes = [(p, nothing[name]) for name, p in parameters.items() if name in nothing]
    return bool(sizes) and all(p.low <= value <= p.high for p, value in sizes)


def up_to_nothing(
    situation: StaticState, member: ModelTerm, parameters: Mapping[str, Interval]
) -> dict[str, Interval]:
    """Return parameters, sizes that are impossible with intervals that end at nothing.

    Args:
        situation: Where the arm stood.
        member: The term.
        parameters: With their intervals.
    """
    found = {
        name: replace(p, low=min(p.low, value), high=max(p.high, value))
        for name, value in _impossible(situation, member, parameters).items()
        for p in (parameters[name],)
    }
    return dict(parameters) | found


def is_beyond_nothing(
    situation: StaticState, member: ModelTerm, sizes: Mapping[str, float]
) -> bool:
    """Return whether a size has the sign that its limits leave no room for.

    Args:
        situation: Where the arm stood.
        member: The term.
        sizes: Its parameters.
    """
    points = {name: Interval(size, size, size) for name, size in sizes.items()}
    return bool(_impossible(situation, member, points))


def _impossible(
    situation: StaticState, member: ModelTerm, parameters: Mapping[str, Interval]
) -> dict[str, float]:
    """Return the sizes wholly on the side of nothing where limits leave no room.

    Each with the value at which it is nothing.
    """
    limits = member.hypothesis.limits_at(situation, member.where)
    return {
        name: value
        for name, value in member.hypothesis.nothing.items()
        if name in parameters and name in limits
        if parameters[name].high < value <= limits[name][0]
        or parameters[name].low > value >= limits[name][1]
    }


def sizes_beyond_limits(
    situation: StaticState, term: ModelTerm, parameters: Mapping[str, Interval]
) -> str:
    """Say which sizes a term would need that no arm or instrument has.

    Args:
        situation: Where the arm stood.
        term: The term.
        parameters: As the readings have them.
    """
    limits = term.hypothesis.limits_at(situation, term.where)
    told = [
        f"{name} {parameters[name].estimate:.3g} ({low:g} to {high:g} is possible)"
        for name, (low, high) in limits.items()
        if name in parameters and not low <= parameters[name].estimate <= high
    ]
    return f"it would need {' and '.join(told)}"


BEYOND = 0.1
"""Share of what a name explains that it may lose within its physical limits; chosen: a
small part of an effect may be out of place beside what was not named."""


def refused_by_sizes(
    case: SelectionProblem,
    terms: Sequence[ModelTerm],
    parameters: Sequence[FittedParameters],
    gains: Sequence[float],
    columns: Sequence[int],
) -> list[Decision]:
    """Return decisions on the names that hold nothing, or more than any arm has.

    A law of one magnitude that has the wrong sign has no other part that could be
    right: what else it has is a share of that magnitude.

    Args:
        case: What may be looked at.
        terms: The set.
        parameters: Of each term.
        gains: What each term explains that the others do not.
        columns: How many sizes each term has.
    """
    decisions = held_by_nothing(terms, parameters)
    held = {decision.candidate: decision.accepted for decision in decisions}
    every = zip(terms, parameters, gains, columns, strict=True)
    for term, fitted, gain, count in every:
        if not held.get(term.name, True):
            continue
        own = fitted.intervals
        share = cost_of_limits(case.situation, term, own) / max(gain, 1e-12)
        sizes = {name: found.estimate for name, found in own.items()}
        alone = count == 1 or len(term.hypothesis.magnitudes) == 1
        against = alone and is_beyond_nothing(case.situation, term, sizes)
        possible = up_to_nothing(case.situation, term, own)
        if share > BEYOND or (share > 0.0 and against):
            reason = sizes_beyond_limits(case.situation, term, own)
            one = Decision(term.name, "physical", False, share, BEYOND, reason, own)
            decisions.append(one)
        elif term.name in held:  # its sizes hold each other up
            continue
        elif possible != own and may_be_nothing(term.hypothesis, possible):
            reason = "none of its magnitudes is surely one that it can have"
            decisions.append(
                Decision(term.name, "magnitude", False, 0.0, 0.0, reason, own)
            )
    return decisions


def held_by_nothing(
    terms: Sequence[ModelTerm], parameters: Sequence[FittedParameters]
) -> list[Decision]:
    """Return decisions on the names whose magnitudes may each be zero.

    Accepted where there are several that can not all be zero at once.
    """
    each = "the intervals of all its magnitudes contain zero"
    held = f"{each}, but they can not all be zero at once"
    decisions = []
    for term, own in zip(terms, parameters, strict=True):
        if may_be_nothing(term.hypothesis, own.intervals):
            several = sum(name in term.hypothesis.nothing for name in own.intervals) > 1
            there = several and own.together > own.limit
            asked = ("magnitude", there, own.together, own.limit)
            reason = held if there else each
            decisions.append(Decision(term.name, *asked, reason, own.intervals))
    return decisions


def has_wrong_sign(
    case: SelectionProblem, term: ModelTerm, size: Float[np.ndarray, " columns"]
) -> bool:
    """Return whether a law of one size has a sign that it cannot have."""
    here, law = case.situation, term.hypothesis
    if len(size) > 1 or term.is_generic:
        return False
    sizes = dict(law.parameters(here, term.where, term.shape, size))
    return is_beyond_nothing(here, term, sizes)
