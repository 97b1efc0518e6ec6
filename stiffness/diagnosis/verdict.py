"""Verdict: rejects contradicted effects, gives posteriors, and states the residual.

Generic terms of the selected set are unexplained places. A name is withheld where the
residual near it is large beside what it explains, where a generic term near it explains
twice as much, or where its law differs between groups of rows. A residual of less than
`SMALL_RESIDUAL` of the mismatch withholds no name that explains ten times as much. No
name stands where all together explain less than twice what has no name; what is open at
one place counts against no gear or bearing elsewhere.

==========  ==========================================================================
Equation    P(name) = sum of exp(g_j / phi - c_j) over the name and its first three
            equivalents, over the same of all candidates and of none; g_j - c_j the
            worth of the set with j in the name's place, grown by one name where that is
            worth more, c_j what j's numbers and its prior cost; phi the dispersion of
            poses, or what forms of laws leave uncertain
Source      exchange probabilities of a sampler over sets (George and McCulloch 1997),
            the others held; tempered by the dispersion: Cameron and Miller 2015
Valid       a set that no single exchange makes worth more
Ignores     exchanges of two names at once
==========  ==========================================================================
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bench.shared.effect_catalogue import INSTRUMENTS
from bench.shared.settings import SETTINGS
from stiffness.diagnosis.detection import (
    WOULD_SHOW,
    DetectionTest,
    HomogeneityTest,
    ResidualEquations,
    homogeneity_tests,
    imitated_share,
    residual_test,
)
from stiffness.diagnosis.gate import (
    as_held,
    budget_parts,
    is_local,
    may_show_at,
)
from stiffness.diagnosis.localisation import (
    confounded_with,
    displaced_by_places,
    joined_places,
    law_of,
    located_by_map,
    places_of_map,
    places_of_names,
    whiten_candidates,
)
from stiffness.diagnosis.model_fit import (
    LAW_ACCURACY,
    ModelFit,
    ModelTerm,
    SelectionProblem,
    training,
)
from stiffness.diagnosis.nominal_fit import Prepared, blocks
from stiffness.diagnosis.result import (
    Decision,
    Located,
    Name,
    NamedEffect,
    Nominal,
    Rival,
    Unexplained,
    UnexplainedPlace,
)
from stiffness.diagnosis.selection import SelectedModel, exchange_search
from stiffness.diagnosis.sufficient_statistics import normal_equations_of
from stiffness.effects.base import are_near
from stiffness.regression.group_selection import LIVE, exchange_worths
from stiffness.regression.predictive_gate import last_of_each
from stiffness.regression.testing import SIGNIFICANCE

# --- Rejection ------------------------------------------------------------------------

SURE = SETTINGS.name_probability
SMALL_RESIDUAL = SETTINGS.small_residual
RESIDUAL_SHARE_LIMIT = 0.1
"""Residual near a name over what the name explains from which it is withheld. Chosen: a
name may stand beside an unknown effect that is ten times weaker; one that is not may be
what imitates it."""
GENERIC_ACCURACY = 0.05
"""Share of what a generic term explains that its mechanism may leave beside it, so that
a name there that explains half as much may imitate that. Chosen: more than a fifth of
its amplitude, squared, for a mechanism that nobody knows follows no generic law."""
NAMED_SHARE = 2.0 / 3.0
"""Share of what is explained or left that names must have together. Chosen: a mechanism
that nobody knows is seldom imitated by names to two thirds; where most has no name,
what has one is part of the same."""
IMITATED = 0.5
"""Share of what a name displaces that columns of another place must do for it to count
against a name that would be seen without that share. Chosen: half of its square."""
INHOMOGENEITY_LIMIT = 0.01
"""Share of what a name explains by which its law may differ between groups of rows.
Chosen: a tenth of its size, squared; laws are no truer than that."""


@dataclass(frozen=True, eq=False)
class JudgedModel:
    """A selected model with what contradicts its names.

    Attributes:
        model: The selected set.
        beyond: Normal equations beside it.
        residual: Test of the residual.
        unexplained_places: Where the residual is significant.
        withheld: Of each member, whether it is contradicted.
        inhomogeneous: Kinds of groups between which laws differ.
        decisions: Of all gates on all candidates.
    """

    model: SelectedModel
    beyond: ResidualEquations
    residual: DetectionTest
    unexplained_places: tuple[UnexplainedPlace, ...]
    withheld: tuple[bool, ...]
    inhomogeneous: tuple[str, ...]
    decisions: tuple[Decision, ...]

    @property
    def unexplained(self) -> bool:
        """Return whether anything significant is left beside the set."""
        left = self.residual.p_value < SIGNIFICANCE
        return left or bool(self.inhomogeneous)


def judge(model: SelectedModel) -> JudgedModel:
    """Test the residual of a selected set, and withhold what it contradicts."""
    case, members = model.case, model.fit.members
    gains = [max(gain, 1e-12) for gain in model.drop_one_gains]
    beyond = ResidualEquations.of(case, model.fit)
    left = residual_test(case, beyond)
    uneven = homogeneity_tests(case, model.fit, beyond.after)
    places = _unexplained_places(model, beyond if left.p_value < SIGNIFICANCE else None)
    excess = max(0.0, left.excess, *_excess_of_places(left).values())
    share = excess / max(excess + model.fit.gain, 1e-12)
    large = left.p_value < SIGNIFICANCE and share > SMALL_RESIDUAL
    found: dict[tuple[str, str], Decision] = {}
    kinds = list[str]()
    every = zip(members, gains, uneven, strict=True)
    for k, (member, gain, differs) in enumerate(every):
        if member.is_generic:
            continue
        near = _residual_near(k, model, left, beyond) / gain if large else 0.0
        second_order = LAW_ACCURACY * max(
            g
            for other, g in zip(members, gains, strict=True)
            if are_near(member.where, other.where)
        )
        beside = _beside_generic(k, model, beyond) / gain
        is_uneven = is_inhomogeneous(differs, gain) and differs.captured > second_order
        kinds += [differs.grouping] * is_uneven
        if max(near, beside) > RESIDUAL_SHARE_LIMIT:
            what = "unknown mechanism" if beside > near else "residual"
            reason = f"the {what} at its place is large beside what it explains"
            asked = (member.name, "residual", False, max(near, beside))
            found[member.name] = Decision(*asked, RESIDUAL_SHARE_LIMIT, reason)
        elif is_uneven:
            reason = f"its law differs between {differs.grouping}"
            asked = (member.name, "homogeneity", False, differs.captured / gain)
            found[member.name] = Decision(*asked, INHOMOGENEITY_LIMIT, reason)
    return JudgedModel(
        model,
        beyond,
        left,
        places,
        tuple(member.name in found for member in members),
        tuple(dict.fromkeys(kinds)),
        last_of_each([*model.decisions, *found.values()]),
    )


def is_inhomogeneous(found: HomogeneityTest, gain: float) -> bool:
    """Return whether a law that explains so much is surely and clearly uneven."""
    return found.p_value < SIGNIFICANCE and found.captured > INHOMOGENEITY_LIMIT * gain


def _residual_near(
    k: int, model: SelectedModel, left: DetectionTest, beyond: ResidualEquations
) -> float:
    """Return the largest significant excess that may be a member's own.

    Of one that is at no place each has the share that it has of what all explain.
    """
    places, gains = _excess_of_places(left), model.drop_one_gains
    nowhere = places.pop("", 0.0) * gains[k] / max(sum(gains), 1e-12)
    return max(nowhere, _largest_part(k, model, beyond, places.items()))


def _excess_of_places(left: DetectionTest) -> dict[str, float]:
    """Return the largest significant excess at each place; of poses alone at none."""
    excess = left.tested.captured - left.tested.degrees_of_freedom
    largest: dict[str, float] = {}
    for at in np.flatnonzero(left.tested.together < SIGNIFICANCE):
        where = left.where[at] or largest_residual_site(left)
        largest[where] = max(largest.get(where, 0.0), float(excess[at]))
    if left.tested.p_value >= SIGNIFICANCE:  # poses differ, but not along any law
        largest[""] = max(left.excess, 0.0)
    return largest


REMEMBERED = frozenset({"time", "history"})
"""What a law depends on beside what acts at the moment."""


def _beside_generic(k: int, model: SelectedModel, beyond: ResidualEquations) -> float:
    """Return the most that a mechanism without a name may leave near a member.

    What depends on time alone is imitated by no law that does not, and what depends on
    what acts at the moment alone by no law that depends on time or history.
    """
    members, gains = model.fit.members, model.drop_one_gains
    own = set(members[k].depends_on)
    some = [j for j, other in enumerate(members) if other.is_generic]
    if "time" not in own:
        some = [j for j in some if members[j].depends_on != ("time",)]
    if not REMEMBERED.isdisjoint(own):
        like = REMEMBERED | {"direction"}  # in which a load changes
        some = [j for j in some if not like.isdisjoint(members[j].depends_on)]
    generic = [(members[j].where, gains[j]) for j in some]
    return GENERIC_ACCURACY * _largest_part(k, model, beyond, generic)


def _largest_part(
    k: int,
    model: SelectedModel,
    beyond: ResidualEquations,
    places: Iterable[tuple[str, float]],
) -> float:
    """Return the largest of some squares of places that may be a member's own.

    At another place, a neighbour or one before a weight, only the part counts that
    columns of that place can do of what the member displaces: so much of the name may
    be what is unknown there.
    """
    member, most = model.fit.members[k], 0.0
    for where, here in places:
        if here > most and may_show_at(member, where):
            most = max(most, here * _part_at(k, model, beyond, where))
    return most


def _part_at(
    k: int, model: SelectedModel, beyond: ResidualEquations, at: str, left: float = 0.0
) -> float:
    """Return the share of a member that may be what is unknown at a place.

    1 at its own; 0 where most of it is beyond the place's columns, and that would be
    seen and is more than what may be `left` of the unknown beside them.
    """
    if model.fit.members[k].where == at:
        return 1.0
    share = imitated_share(beyond, model.fit, k, at)
    gain = model.drop_one_gains[k] / max(model.dispersion, 1.0)
    counts = share >= IMITATED or (1.0 - share) * gain < max(WOULD_SHOW, left)
    return share if counts else 0.0


def _unexplained_places(
    model: SelectedModel, beyond: ResidualEquations | None
) -> tuple[UnexplainedPlace, ...]:
    """Return places of generic terms, and where the residual is significant.

    Args:
        model: The set.
        beyond: Normal equations beside it; None where its residual is noise.
    """
    asked = {d.candidate: d.statistic for d in model.decisions if d.gate == "left_out"}
    found = [
        (term.where, asked[term.name], gain, term.depends_on)
        for term, gain in zip(model.fit.members, model.drop_one_gains, strict=True)
        if term.is_generic
    ]
    if beyond is not None:
        blocks, seed = beyond.library.map.blocks, model.case.seed + 2
        found += places_of_map(blocks, beyond.of_map, beyond.known, seed)
    return joined_places(
        UnexplainedPlace(where, p, model.statistics.as_share(captured), depends_on)
        for where, p, captured, depends_on in found
    )


def largest_residual_site(found: DetectionTest) -> str:
    """Return the place of the map where the residual is largest."""
    z = found.of_places(found.tested.z)
    return max(z, key=lambda place: z[place]) if z else ""


# --- Posterior ------------------------------------------------------------------------

ALIKE = SETTINGS.equivalent_log_bayes
NOT_ALIKE = 10.0
"""Log Bayes factor from which a name would not do as well, whatever was likely before;
chosen: Kass and Raftery 1995, "Bayes factors", call half of it very strong."""
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


def exchange_posteriors(model: SelectedModel) -> tuple[ExchangePosterior, ...]:
    """Return how sure each name of a selected set is."""
    search = exchange_search(model)
    some, found = range(len(model.fit.members)), list[ExchangePosterior]()
    for member, gain in zip(model.fit.members, model.drop_one_gains, strict=True):
        exchanged = exchange_worths(search.problem, some, member.name, LIVE)
        names = list(exchanged.worth)
        own = names.index(member.name)
        accuracy = LAW_ACCURACY * gain / (2.0 * ALIKE)
        phi = max(model.dispersion, 1.0 + accuracy)
        worth, price, size = (
            np.array([*part.values()])
            for part in (exchanged.worth, exchanged.price, exchanged.size)
        )
        evidence = (worth + price + size) / phi - size
        for k, name in enumerate(names):  # where all was fitted anew
            less = model.exchange_losses.get((member.name, name), np.inf)
            evidence[k] = max(evidence[k], evidence[own] - less / phi)
        behind = evidence[own] - evidence
        log = np.array([*(evidence - price), exchanged.none / phi])
        weight = np.exp(log - log.max())
        weight /= weight.sum()
        by_weight = np.argsort(-np.round(weight[:-1], 6), kind="stable")
        order = [int(k) for k in by_weight if k != own]
        less = log[own] - log[:-1]  # after the prior; or before it
        close = (behind < ALIKE) | ((less < ALIKE) & (behind < NOT_ALIKE))
        alike = [k for k in order if close[k]][:MOST_EQUIVALENTS]
        found.append(
            ExchangePosterior(
                float(min(1.0, weight[[own, *alike]].sum())),
                tuple(Name(*names[k]) for k in alike),
                tuple((float(weight[k]), Name(*names[k])) for k in order[:MOST_RIVALS]),
            )
        )
    return tuple(found)


# --- Assembly of the result -----------------------------------------------------------


def answer_of(judged: JudgedModel, prepared: Prepared, found: DetectionTest) -> dict:
    """Return verdict, places, names and residual, by the names in `Diagnosis`.

    Args:
        judged: The selected set, judged.
        prepared: The recording against its nominal model.
        found: The test before anything was named.
    """
    model = judged.model
    case, members, last = model.case, model.fit.members, judged.residual
    effects, decisions = [], list(judged.decisions)
    parts = budget_parts(model.statistics, model.fit)
    posteriors = exchange_posteriors(model)
    stands = [
        one.probability >= SURE and not judged.withheld[k] and not members[k].is_generic
        for k, one in enumerate(posteriors)
    ]
    slight = _of_slight_share(judged, parts, stands)
    decisions, less = decisions + slight, {d.candidate for d in slight}
    stands = [s and m.name not in less for m, s in zip(members, stands, strict=True)]
    for k, (member, one) in enumerate(zip(members, posteriors, strict=True)):
        if member.is_generic:
            continue
        sure = one.probability >= SURE
        reason = "probability of it or its equivalents, the other names held"
        parameters = as_held(case.situation, member, model.parameters[k])
        asked = (member.name, "posterior", sure, one.probability, SURE, reason)
        decisions = [
            replace(d, parameters=parameters)
            if d.candidate == member.name and not d.accepted
            else d
            for d in (*decisions, Decision(*asked))
        ]
        if not stands[k]:
            continue
        effects.append(
            NamedEffect(
                name=Name(*member.name),
                probability=one.probability,
                equivalents=one.equivalents,
                parameters=parameters,
                shape=tuple(float(v) for v in member.shape),
                coefficients=tuple(float(v) for v in model.fit.coefficients[k]),
                share=model.share_without(k),
                budget_share=model.share * parts[k],
            )
        )
    as_share = model.statistics.as_share
    withheld = (
        UnexplainedPlace(m.where, found.p_value, as_share(gain), m.depends_on)
        for m, gain, stood in zip(members, model.drop_one_gains, stands, strict=True)
        if not stood and not m.is_generic
    )
    open_places = joined_places([*judged.unexplained_places, *withheld])
    complete = bool(effects) and len(effects) == len(members)
    explained = complete and not judged.unexplained
    verdict = "explained" if explained else "partly_explained"
    verdict = verdict if effects else "unexplained"
    named = {(e.name.effect, e.name.where) for e in effects}
    by_gain = [members[k] for k in np.argsort(model.drop_one_gains)[::-1]]
    exactly = np.zeros(len(prepared.pose_repeatability))
    data, _ = blocks(case.situation, case.data.visits, prepared.readings, exactly)
    displaced = displaced_by_places(case, data, model.fit)
    located = places_of_names(by_gain, displaced, found.p_value, case.situation)
    located = located if effects else located_by_map(case)
    unexplained = None
    if not explained:
        loose = loose_marker(case, found, last if effects else found)
        known = [m for m in members if not m.is_generic] if effects else []
        last = last if effects else found
        unexplained = unexplained_of(case, last, known, (open_places, located), loose)
        if loose is not None:
            located = (*located, loose) if effects else (loose, *located)
        words = [unexplained.signature] if unexplained.signature else []
        words += [f"a law differs between {kind}" for kind in judged.inhomogeneous]
        unexplained = replace(unexplained, signature="; ".join(dict.fromkeys(words)))
        if not located and unexplained.where:
            located = (Located(unexplained.where, last.p_value, 1.0, (), ""),)
    white = whiten_candidates(case.library, case.normal_equations)
    return {
        "verdict": verdict,
        "located": located,
        "named": tuple(
            sorted(effects, key=lambda e: (-round(e.probability, 6), -(e.share or 0.0)))
        ),
        "rivals": _rivals(model.fit.members, posteriors, stands),
        "unexplained": unexplained,
        "confounded": confounded_with(case.library, white, named),
        "nominal": _nominal_beside(case, prepared, model.fit),
        "unexplained_places": open_places,
        "decisions": tuple(decisions),
    }


def _of_slight_share(
    judged: JudgedModel, parts: Sequence[float], stands: Sequence[bool]
) -> list[Decision]:
    """Return the names, where all together explain less than twice what has none.

    What has none are generic terms, but courses in time, and the residual: a name that
    is withheld is not sure, but no unknown mechanism. One of the arm takes no gear, no
    bearing and nothing that neither angles nor loads change far from the strongest such
    term, nor where most is beyond the columns of its place and more than the term may
    leave: there counts what is open elsewhere. No columns know how long an unknown
    mechanism remembers. Of parts below zero the size counts.
    """
    model, left = judged.model, judged.residual
    members, sizes = model.fit.members, np.abs(parts)
    own = sum(part for part, stood in zip(sizes, stands, strict=True) if stood)
    nameless = [k for k, m in enumerate(members) if m.is_generic]
    unknown = [k for k in nameless if members[k].depends_on != ("time",)]
    loudest = members[max(unknown, key=lambda k: sizes[k])].where if unknown else ""
    open_at = {members[k].where for k in unknown if loudest not in INSTRUMENTS}
    at = {where for where in open_at if are_near(where, loudest)}
    more = _excess_of_places(left) if left.p_value < SIGNIFICANCE else {}
    whole = max(model.fit.gain, 1e-12)
    reason, found = "names together explain less than twice what has no name", []
    for k, m in ((k, m) for k, m in enumerate(members) if stands[k]):
        less = at if is_local(m) and not are_near(m.where, loudest) else set[str]()
        some = (w for w in more if not any(are_near(w, one) for one in less))
        other = sum(more[w] for w in some) / whole
        for j in (j for j in unknown if members[j].where not in less):
            where, of_law = members[j].where, GENERIC_ACCURACY * model.drop_one_gains[j]
            remember = all(REMEMBERED & {*one.depends_on} for one in (m, members[j]))
            anyhow = not is_local(m) or (remember and are_near(m.where, where))
            if anyhow or _part_at(k, model, judged.beyond, where, of_law):
                other += sizes[j]
        share = own / max(own + other, 1e-12) if other > 0.0 else 1.0
        if share < NAMED_SHARE:
            asked = (m.name, "named_share", False, float(share), NAMED_SHARE)
            found.append(Decision(*asked, reason))
    return found


def _rivals(
    members: Sequence[ModelTerm],
    posteriors: Sequence[ExchangePosterior],
    stands: Sequence[bool],
) -> tuple[Rival, ...]:
    """Return the names given with one exchanged, or with one more that is not sure."""
    given = {Name(*m.name) for m, stood in zip(members, stands, strict=True) if stood}
    found = []
    for member, one, stood in zip(members, posteriors, stands, strict=True):
        if member.is_generic or (not stood and one.probability >= SURE):
            continue
        own = Name(*member.name)
        swaps = one.rivals if stood else ((one.probability, own), *one.rivals)
        for probability, other in swaps:
            names = sorted({*(given - {own}), other}, key=str)
            found.append(Rival(probability, tuple(names)))
    return tuple(sorted(found, key=lambda r: -r.probability)[:MOST_RIVALS])


NO_LAW = "errors, along no law of one axis' torque, angle or time"


def unexplained_of(
    case: SelectionProblem,
    last: DetectionTest,
    known: Sequence[ModelTerm],
    places: tuple[tuple[UnexplainedPlace, ...], tuple[Located, ...]],
    loose: Located | None,
) -> Unexplained:
    """Return the place where most is left, how it looks, and its law.

    Args:
        case: What was looked at.
        last: The residual test.
        known: The set that was named.
        places: Those without a name and those of names, the largest first.
        loose: The marker that moves against its body, where one does.
    """
    where = largest_residual_site(last)
    if loose is not None:
        where = loose.where
    elif places[0]:
        where = places[0][0].where
    elif places[1] and (not known or last.p_value >= SIGNIFICANCE):
        where = places[1][0].where
    laws = [m.jacobian(case.situation) for m in known]
    law, look = law_of(case, (*case.nominal, *laws), where)
    words = [look] if look else []
    at = (one.depends_on for one in (*places[0], *places[1]) if one.where == where)
    if depends := next(at, ()):
        words.append("depends on " + ", ".join(depends))
    if loose is not None:
        words.append("against its body, from pose to pose")
    times, differ = np.sqrt(last.scatter.dispersion), np.sqrt(last.dispersion)
    if not words and last.is_overdispersed:
        words.append(f"readings scatter {times:.1f} times as much as their {NO_LAW}")
    if not words and last.dispersion > last.scatter.dispersion_limit:
        words.append(f"poses differ {differ:.1f} times as much as the stated {NO_LAW}")
    return Unexplained(where, "; ".join(words), law)


def loose_marker(
    case: SelectionProblem, found: DetectionTest, last: DetectionTest
) -> Located | None:
    """Return the marker that moves against its body, where one does."""
    marker = last.scatter.marker if last.is_overdispersed else None
    if marker is None:
        return None
    name = f"marker:{case.situation.recording.markers[marker].name}"
    share = last.scatter.markers[marker].excess / max(found.excess, 1e-12)
    return Located(name, last.p_value, min(share, 1.0), ("angle",), "")


def _nominal_beside(
    case: SelectionProblem, prepared: Prepared, fit: ModelFit
) -> Nominal:
    """Return the nominal fit, its errors beside all members of a set."""
    own = [m.jacobian(case.situation) for m in fit.members]
    columns = [*case.nominal, *own]
    gram = normal_equations_of(case.data, columns, training(case.split)).gram[1]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(gram), 1e-300))
    inverse = np.linalg.pinv(gram * scale * scale[:, None], hermitian=True)
    variance = np.maximum(np.diag(inverse), 0.0)
    sigma = (scale * np.sqrt(variance))[: len(case.springs)]
    return nominal_of(replace(prepared, sigma=sigma), fit.springs, case)


def nominal_of(
    prepared: Prepared, springs: np.ndarray, case: SelectionProblem | None = None
) -> Nominal:
    """Return the nuisance parameters, `springs` more than the situation says."""
    compliance = (case or prepared).situation.compliance.copy()
    sigma = np.zeros(len(compliance))
    if prepared.springs:
        compliance[list(prepared.springs)] += springs
        sigma[list(prepared.springs)] = prepared.sigma
    return Nominal(
        compliance,
        sigma,
        prepared.modelled,
        tuple(f"a{k + 1}" for k in prepared.blind),
        prepared.frames.transform,
        prepared.frames.marker_positions,
        prepared.noise,
        prepared.pose_repeatability,
    )
