"""Verdict: rejects contradicted effects, gives posteriors, and states what is left.

A name stands while nothing at its place contradicts it; else it is taken back.

The rules are those of the answer's format; what they leave open is decided here and
stands as a constant with its reason.

The answer says what was named, how surely, and what stays open.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bench.shared.effect_catalogue import INSTRUMENTS
from stiffness.diagnosis.detection import DetectionTest
from stiffness.diagnosis.localisation import (
    confounded_with,
    law_of,
    places_of_map,
    places_of_names,
)
from stiffness.diagnosis.model_evaluation import EvaluatedModel, as_held
from stiffness.diagnosis.model_fit import (
    ModelFit,
    ModelTerm,
    SelectionProblem,
    training,
)
from stiffness.diagnosis.nominal_fit import Prepared
from stiffness.diagnosis.residual_checks import (
    CONTRADICTS,
    HomogeneityTest,
    drop_one_gains,
    homogeneity_tests,
)
from stiffness.diagnosis.result import (
    Located,
    Name,
    NamedEffect,
    Nominal,
    Rival,
    Unexplained,
)
from stiffness.diagnosis.selection import ALIKE, SelectedModel, whiten_candidates
from stiffness.diagnosis.sufficient_statistics import normal_equations_of
from stiffness.regression.testing import SIGNIFICANCE, is_significant

# --- Rejection and posterior ----------------------------------------------------------

SURE = 0.95
"""Probability from which a set explains; the rule of the answer."""
RESIDUAL_SHARE_LIMIT = 0.1
"""The same, where what is left over is elsewhere or everywhere. Chosen: a name may
stand beside a stranger that is ten times weaker; one that is not may be what feigns
it."""

INHOMOGENEITY_LIMIT = 0.01
"""Share of what a name explains by which its law may differ between groups of rows.
Chosen: a tenth of its size, squared; laws are no truer than that."""


def is_contradicted(
    named: SelectedModel, gains: Sequence[float], uneven: Sequence[HomogeneityTest]
) -> list[bool]:
    """Return which members are contradicted.

    By what is left at their own place, by much that is left anywhere, or by a law that
    is another at other poses, loads or times. With a name that is taken back go all
    weaker ones: they mended a wrong law.
    """
    near = _rejected_by_residual(named, gains)
    answer = [
        gone or is_inhomogeneous(found, gain)
        for gone, found, gain in zip(near, uneven, gains, strict=True)
    ]
    wrong = max(
        (g for g, gone in zip(gains, answer, strict=True) if gone), default=-1.0
    )
    return [gone or gain < wrong for gone, gain in zip(answer, gains, strict=True)]


def is_inhomogeneous(found: HomogeneityTest, gain: float) -> bool:
    """Return whether a law that explains so much is surely and clearly uneven."""
    return found.p_value < SIGNIFICANCE and found.captured > INHOMOGENEITY_LIMIT * gain


def _rejected_by_residual(named: SelectedModel, gains: Sequence[float]) -> list[bool]:
    left = named.residual_test
    if left.p_value >= SIGNIFICANCE:
        return [False] * len(gains)
    excess = left.tested.captured - left.tested.degrees_of_freedom
    dwarfed = [left.excess > RESIDUAL_SHARE_LIMIT * gain for gain in gains]
    if left.tested.p_value >= SIGNIFICANCE:  # poses differ, but not along any law
        return dwarfed
    at = left.most_significant
    loudest = left.where[at] or largest_residual_site(left)
    return [
        gone
        or float(excess[at])
        > (CONTRADICTS if _near(m, loudest) else RESIDUAL_SHARE_LIMIT) * gain
        for m, gain, gone in zip(named.best.fit.members, gains, dwarfed, strict=True)
    ]


def _near(member: ModelTerm, loudest: str) -> bool:
    """Return whether what is left somewhere may be a member's own.

    A wrong wrench or tracker feigns effects anywhere, and any effect feigns them; a
    single marker speaks for itself.
    """
    if loudest.startswith("marker:"):
        return member.where == loudest
    if loudest in INSTRUMENTS or member.where in INSTRUMENTS:
        return True
    if _weighs_on(member, loudest):
        return True
    return abs(_site_number(member.where) - _site_number(loudest)) <= 1


def _site_number(where: str) -> int:
    """Return the place of the map where something shows: of a link, the axis after."""
    return _number(where) + where.startswith("link_")


def _weighs_on(member: ModelTerm, place: str) -> bool:
    """Return whether a weight acts at a place of the map: at all before it."""
    return member.name[0] == "gravity_load" and _number(place) <= _number(member.where)


def _number(where: str) -> int:
    """Return the number of an axis or a link; 0 for the base, far for a tool."""
    digits = where.removeprefix("link_").removeprefix("a")
    return int(digits) if digits.isdigit() else 0 if where == "base" else 99


def posterior(
    named: SelectedModel, inflation: float
) -> tuple[list[float], list[EvaluatedModel]]:
    """Return the probabilities of the refined sets of the winner's size."""
    sets = list(named.rivals)
    log = np.array([s.log_evidence for s in sets]) / inflation
    weight = np.exp(log - log.max())
    return list(weight / weight.sum()), sets


def equivalents(
    named: SelectedModel, k: int, weights: list[float], models: list[EvaluatedModel]
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
    if probability_of(own, alike, weights, models) < SURE:
        alike = list(dict.fromkeys([*close, *apart]))
    return alike


def _predicts_worse(rival: EvaluatedModel, best: EvaluatedModel) -> bool:
    """Return whether a rival predicts poses left out clearly worse."""
    gap = best.predicted - rival.predicted
    return bool(np.sum(gap) > ALIKE) and is_significant(gap)


def probability_of(
    name: tuple[str, str],
    alike: Sequence[Name],
    weights: list[float],
    models: list[EvaluatedModel],
) -> float:
    """Return the posterior of a name or one of its equivalents."""
    wanted = {name, *((n.effect, n.where) for n in alike)}
    return float(
        min(
            1.0,
            sum(w for w, s in zip(weights, models, strict=True) if s.names & wanted),
        )
    )


def rivals_of(
    named: SelectedModel, weights: list[float], models: list[EvaluatedModel]
) -> tuple[Rival, ...]:
    """Return the other sets with their probabilities, the first five."""
    listed = [
        Rival(float(w), tuple(Name(*n) for n in sorted(s.names)))
        for w, s in zip(weights, models, strict=True)
        if s is not named.best and s.names
    ]
    return tuple(sorted(listed, key=lambda r: -r.probability)[:5])


def largest_residual_site(found: DetectionTest) -> str:
    """Return the place of the map where most is left."""
    z = found.of_places(found.tested.z)
    return max(z, key=lambda place: z[place]) if z else ""


# --- Assembly of the result -----------------------------------------------------------


def answer_of(
    case: SelectionProblem,
    prepared: Prepared,
    found: DetectionTest,
    named: SelectedModel,
) -> dict:
    """Return verdict, places, names and what is left, by the names in `Diagnosis`.

    Args:
        case: What was looked at.
        prepared: The recording against its nominal model.
        found: The test before anything was named.
        named: What was named, and its rivals.
    """
    gains = drop_one_gains(case, named.best.fit)
    uneven = homogeneity_tests(case, named.best.fit)
    taken_back = is_contradicted(named, gains, uneven)
    kept = [k for k, gone in enumerate(taken_back) if not gone]
    weights, sets = posterior(named, named.inflation)
    effects = []
    for k in kept:
        member = named.best.fit.members[k]
        alike = equivalents(named, k, weights, sets)
        effects.append(
            NamedEffect(
                name=Name(*member.name),
                probability=probability_of(member.name, alike, weights, sets),
                equivalents=tuple(alike),
                parameters=as_held(case.situation, member, named.best.parameters[k]),
                shape=tuple(float(v) for v in member.shape),
                coefficients=tuple(float(v) for v in named.best.fit.coefficients[k]),
            )
        )
    sure = [e for e in effects if e.probability >= SURE]
    between = [
        u.grouping
        for u, gain in zip(uneven, gains, strict=True)
        if is_inhomogeneous(u, gain)
    ]
    rejects = named.residual_test.p_value < SIGNIFICANCE or bool(between)
    whole = bool(sure) and len(sure) == len(taken_back)
    verdict = "unexplained"
    if sure:
        verdict = "explained" if whole and not rejects else "partly_explained"
    last = named.residual_test if sure else found
    nominal = np.arange(case.library.nominal)
    white = whiten_candidates(case.library, case.normal_equations)
    located = places_of_names(named.best.fit, gains, found.p_value, case.situation)
    if not whole:
        of_map = places_of_map(
            case.library,
            case.normal_equations,
            case.normal_equations.score,
            nominal,
            case.seed,
        )
        total = max(sum(c for _, _, c, _ in of_map), 1e-12)
        mapped = [Located(w, p, c / total, d, "") for w, p, c, d in of_map]
        sure_places = [
            one for one in located if one.where in {e.name.where for e in sure}
        ]
        known = {one.where for one in sure_places}
        located = tuple(sure_places + [one for one in mapped if one.where not in known])
    unexplained = None
    if verdict != "explained":
        loose = loose_marker(case, found, last)
        if loose is not None:
            located = (*located, loose) if sure else (loose, *located)
        members = named.best.fit.members if sure else ()
        unexplained = unexplained_of(case, last, members, located, loose)
        words = [unexplained.signature] if unexplained.signature else []
        words += [f"what explains it best differs between {kind}" for kind in between]
        unexplained = replace(unexplained, signature="; ".join(dict.fromkeys(words)))
        if not located and unexplained.where:
            located = (Located(unexplained.where, last.p_value, 1.0, (), ""),)
    return {
        "verdict": verdict,
        "located": located,
        "named": tuple(sorted(sure, key=lambda e: -e.probability)),
        "rivals": rivals_of(named, weights, sets),
        "unexplained": unexplained,
        "confounded": confounded_with(
            case.library, white, {(e.name.effect, e.name.where) for e in sure}
        ),
        "nominal": _nominal_beside(case, prepared, named.best.fit),
    }


def unexplained_of(
    case: SelectionProblem,
    last: DetectionTest,
    known: Sequence[ModelTerm],
    located: tuple[Located, ...],
    loose: Located | None,
) -> Unexplained:
    """Return the place where most is left, how it looks, and its law.

    Args:
        case: What was looked at.
        last: The residual test.
        known: The set that was named.
        located: Places, with what they depend on.
        loose: The marker that moves against its body, where one does.
    """
    where = largest_residual_site(last)
    if loose is not None:
        where = loose.where
    elif not known and located:
        where = located[0].where
    laws = [m.jacobian(case.situation) for m in known]
    law, look = law_of(case, (*case.nominal, *laws), where)
    words = [look] if look else []
    depends = next((one.depends_on for one in located if one.where == where), ())
    if depends:
        words.append("depends on " + ", ".join(depends))
    if loose is not None:
        words.append("against its body, from pose to pose")
    if not words and last.is_overdispersed:
        words.append(
            f"readings scatter {np.sqrt(last.scatter.dispersion):.1f} times as much as "
            "their errors, along no law of one axis' torque, angle or time"
        )
    if not words and last.dispersion > last.scatter.dispersion_limit:
        words.append(
            f"poses differ {np.sqrt(last.dispersion):.1f} times as much as the stated "
            "errors, along no law of one axis' torque, angle or time"
        )
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
    sigma = (scale * np.sqrt(np.diag(inverse)))[: len(case.springs)]
    return nominal_of(replace(prepared, sigma=sigma), fit.springs, case)


def nominal_of(
    prepared: Prepared, springs: np.ndarray, case: SelectionProblem | None = None
) -> Nominal:
    """Return what was fitted silently, `springs` more than the situation says."""
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
