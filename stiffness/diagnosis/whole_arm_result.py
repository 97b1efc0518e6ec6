"""Result of a diagnosis that names many effects: probabilities, shares, what is open.

==========  ==========================================================================
Equation    P(name) = sum of exp(w_j / phi) over the name and its first three
            equivalents, over the same of all candidates and of none; w_j the worth of
            the set with j in the name's place, phi the dispersion of poses
Source      exchange probabilities of a sampler over sets (George and McCulloch 1997),
            the others held; tempered by the dispersion: Cameron and Miller 2015
Valid       a set that no single exchange makes worth more
Ignores     exchanges of two names at once; that candidates have coarse shapes where
            the names of the set have fitted ones
==========  ==========================================================================
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stiffness.diagnosis.detection import DetectionTest, detect, scatter_of
from stiffness.diagnosis.localisation import (
    confounded_with,
    places_of_map,
    places_of_names,
)
from stiffness.diagnosis.model_evaluation import as_held
from stiffness.diagnosis.nominal_fit import Prepared
from stiffness.diagnosis.residual_checks import ResidualEquations, residual_equations
from stiffness.diagnosis.result import (
    Decision,
    Located,
    Name,
    NamedEffect,
    Rival,
    UnexplainedPlace,
)
from stiffness.diagnosis.selection import ALIKE, whiten_candidates
from stiffness.diagnosis.verdict import (
    SURE,
    loose_marker,
    nominal_of,
    unexplained_of,
)
from stiffness.diagnosis.whole_arm import Search, WholeArm
from stiffness.regression.group_selection import exchange_worths
from stiffness.regression.normal_equations import NormalEquations
from stiffness.regression.testing import SIGNIFICANCE

MOST_EQUIVALENTS = 3
"""Equivalents that are counted with a name; the rule of the answer."""
MOST_RIVALS = 5


@dataclass(frozen=True)
class ExchangePosterior:
    """How sure a name of a set is while the others stay.

    Attributes:
        probability: Of the name or one of its equivalents.
        equivalents: Names that would do as well, most probable first.
        rivals: Probability of each other name in its place, most probable first.
    """

    probability: float
    equivalents: tuple[Name, ...]
    rivals: tuple[tuple[float, Name], ...]


def exchange_posteriors(whole: WholeArm) -> tuple[ExchangePosterior, ...]:
    """Return how sure each name is.

    Args:
        whole: The set.
    """
    search = Search.of(whole.case, whole.fit.members)
    some = range(len(whole.fit.members))
    found = []
    for member in whole.fit.members:
        worth, without = exchange_worths(search.problem, some, member.name)
        names = list(worth)
        own = names.index(member.name)
        log = np.array([*worth.values(), without]) / whole.dispersion
        weight = np.exp(log - log.max())
        weight /= weight.sum()
        order = [int(k) for k in np.argsort(-weight[:-1], kind="stable") if k != own]
        alike = [k for k in order if log[own] - log[k] < ALIKE][:MOST_EQUIVALENTS]
        found.append(
            ExchangePosterior(
                float(weight[[own, *alike]].sum()),
                tuple(Name(*names[k]) for k in alike),
                tuple((float(weight[k]), Name(*names[k])) for k in order[:MOST_RIVALS]),
            )
        )
    return tuple(found)


def answer_of_whole_arm(
    whole: WholeArm, prepared: Prepared, found: DetectionTest
) -> dict:
    """Return verdict, places, names and residual, by the names in `Diagnosis`.

    Args:
        whole: The set.
        prepared: The recording against its nominal model.
        found: The test before anything was named.
    """
    case, members = whole.case, whole.fit.members
    posteriors = exchange_posteriors(whole)
    effects, rivals, decisions = [], [], list(whole.decisions)
    shares: dict[Name, float] = {}
    every = {member.name for member in members}
    for k, (member, one) in enumerate(zip(members, posteriors, strict=True)):
        sure = one.probability >= SURE
        reason = "probability of it or its equivalents, the other names held"
        decisions.append(
            Decision(member.name, "posterior", sure, one.probability, SURE, reason)
        )
        others = every - {member.name}
        for probability, other in one.rivals:
            names = sorted({*others, (other.effect, other.where)})
            rivals.append(Rival(probability, tuple(Name(*n) for n in names)))
        if not sure:
            continue
        name = Name(*member.name)
        shares[name] = whole.statistics.share_of(whole.lost[k])
        effects.append(
            NamedEffect(
                name=name,
                probability=one.probability,
                equivalents=one.equivalents,
                parameters=as_held(case.situation, member, whole.parameters[k]),
                shape=tuple(float(v) for v in member.shape),
                coefficients=tuple(float(v) for v in whole.fit.coefficients[k]),
            )
        )
    beyond = residual_equations(case, whole.fit)
    last = _residual_test(whole, beyond)
    complete = len(effects) == len(members)
    explained = complete and last.p_value >= SIGNIFICANCE
    gains = [max(2.0 * float(lost.sum()), 0.0) for lost in whole.lost]
    located = places_of_names(whole.fit, gains, found.p_value, case.situation)
    unexplained, places = None, ()
    if not explained:
        loose = loose_marker(case, found, last)
        places = _unexplained_places(whole, beyond)
        shown = (
            *(Located(x.where, x.p_value, x.share, x.depends_on, "") for x in places),
            *located,
        )
        unexplained = unexplained_of(case, last, members, shown, loose)
        located = located if loose is None else (*located, loose)
    white = whiten_candidates(case.library, case.normal_equations)
    named = {(e.name.effect, e.name.where) for e in effects}
    return {
        "verdict": _verdict(explained, effects),
        "located": located,
        "named": tuple(
            sorted(effects, key=lambda e: (-e.probability, -shares[e.name]))
        ),
        "rivals": tuple(sorted(rivals, key=lambda r: -r.probability)[:MOST_RIVALS]),
        "unexplained": unexplained,
        "confounded": confounded_with(case.library, white, named),
        "nominal": nominal_of(prepared, whole.fit.springs, case),
        "shares": shares,
        "unexplained_places": places,
        "decisions": tuple(decisions),
    }


def _verdict(explained: bool, effects: Sequence[NamedEffect]) -> str:
    if not effects:
        return "unexplained"
    return "explained" if explained else "partly_explained"


def _residual_test(whole: WholeArm, beyond: ResidualEquations) -> DetectionTest:
    case, equations = whole.case, beyond.normal_equations
    scatter = scatter_of(beyond.after.data, case.dispersion_limit)
    return detect(
        beyond.library,
        equations,
        equations.score,
        beyond.known,
        ~case.split.held_out,
        case.seed + 1,
        scatter,
    )


def _unexplained_places(
    whole: WholeArm, beyond: ResidualEquations
) -> tuple[UnexplainedPlace, ...]:
    """Return the places of the map where the residual is significant."""
    mask, given = ~whole.case.split.held_out, beyond.normal_equations
    fold = given.fold[mask] - 1
    fitted = NormalEquations(given.gram[1:], given.score[mask], fold, given.raw)
    found = places_of_map(
        beyond.library, fitted, fitted.score, beyond.known, whole.case.seed + 2
    )
    total = whole.statistics.whole
    return tuple(
        UnexplainedPlace(where, p, float(captured) / total, depends_on)
        for where, p, captured, depends_on in found
    )
