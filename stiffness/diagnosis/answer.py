"""The answer says what was named, how surely, and what stays open."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stiffness.diagnosis.case import Case
from stiffness.diagnosis.confounding import confounded_with
from stiffness.diagnosis.detect import ALARM, Found
from stiffness.diagnosis.diagnosis import (
    Located,
    Name,
    NamedEffect,
    Nominal,
    Unexplained,
)
from stiffness.diagnosis.intervals import as_held
from stiffness.diagnosis.judge import (
    SURE,
    contradicted,
    differs,
    equivalents,
    left_over,
    posterior,
    probability_of,
    rivals_of,
)
from stiffness.diagnosis.member import Member
from stiffness.diagnosis.naming import Named
from stiffness.diagnosis.own_leftover import alone
from stiffness.diagnosis.places import places_of_map, places_of_names
from stiffness.diagnosis.prepare import Prepared
from stiffness.diagnosis.sets import white_candidates
from stiffness.diagnosis.uneven import unevenness
from stiffness.diagnosis.unnamed import law_of


def answer_of(case: Case, prepared: Prepared, found: Found, named: Named) -> dict:
    """Return verdict, places, names and what is left, by the names in `Diagnosis`.

    Args:
        case: What was looked at.
        prepared: The recording against its nominal model.
        found: The test before anything was named.
        named: What was named, and its rivals.
    """
    gains = alone(case, named.best.fit)
    uneven = unevenness(case, named.best.fit)
    taken_back = contradicted(named, gains, uneven)
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
        u.between for u, gain in zip(uneven, gains, strict=True) if differs(u, gain)
    ]
    rejects = named.left.p_value < ALARM or bool(between)
    whole = bool(sure) and len(sure) == len(taken_back)
    verdict = "unexplained"
    if sure:
        verdict = "explained" if whole and not rejects else "partly_explained"
    last = named.left if sure else found
    nominal = np.arange(case.library.nominal)
    white = white_candidates(case.library, case.evidence)
    located = places_of_names(named.best.fit, gains, found.p_value, case.situation)
    if not whole:
        of_map = places_of_map(
            case.library, case.evidence, case.evidence.score, nominal, case.seed
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
        loose = _loose(case, found, last)
        if loose is not None:
            located = (*located, loose) if sure else (loose, *located)
        members = named.best.fit.members if sure else ()
        unexplained = _unexplained(case, last, members, located, loose)
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
        "nominal": nominal_of(prepared, named.best.fit.springs, case),
    }


def _unexplained(
    case: Case,
    last: Found,
    known: Sequence[Member],
    located: tuple[Located, ...],
    loose: Located | None,
) -> Unexplained:
    where = left_over(last)
    if loose is not None:
        where = loose.where
    elif not known and located:
        where = located[0].where
    laws = [m.signature(case.situation) for m in known]
    law, look = law_of(case, (*case.nominal, *laws), where)
    words = [look] if look else []
    depends = next((one.depends_on for one in located if one.where == where), ())
    if depends:
        words.append("depends on " + ", ".join(depends))
    if loose is not None:
        words.append("against its body, from pose to pose")
    if not words and last.scatters:
        words.append(
            f"readings scatter {np.sqrt(last.scatter.dispersion):.1f} times as much as "
            "their errors, along no law of one axis' torque, angle or time"
        )
    if not words and last.dispersion > last.scatter.wild:
        words.append(
            f"poses differ {np.sqrt(last.dispersion):.1f} times as much as the stated "
            "errors, along no law of one axis' torque, angle or time"
        )
    return Unexplained(where, "; ".join(words), law)


def _loose(case: Case, found: Found, last: Found) -> Located | None:
    """Return the marker that moves against its body, where one does."""
    marker = last.scatter.marker if last.scatters else None
    if marker is None:
        return None
    name = f"marker:{case.situation.recording.markers[marker].name}"
    share = last.scatter.markers[marker].excess / max(found.excess, 1e-12)
    return Located(name, last.p_value, min(share, 1.0), ("angle",), "")


def nominal_of(
    prepared: Prepared, springs: np.ndarray, case: Case | None = None
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
        prepared.situation.arm.compliance,
        tuple(f"a{k + 1}" for k in prepared.blind),
        prepared.frames.transform,
        prepared.frames.place,
        prepared.noise,
        prepared.arrival,
    )
