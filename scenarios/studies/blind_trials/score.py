"""Scores an answer against the truth: names, sites, and coverage of intervals.

The rules were written before any trial was run. Names are `effect@where`. A name with
its first three equivalents is what the answer declares; what is right *with
equivalents* has the truth among them.

Coverage (`covered_by`) counts intervals that hold the true parameter, only for names
that are true, and only where the mechanism has the parameter: in another law of the
same name it has another meaning.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import pi

from bench.effects import OTHER_LAWS
from scenarios.studies.blind_trials.strata import MEMORY

# --- Coverage of intervals ------------------------------------------------------------

OTHER = {kind.__name__ for kind in OTHER_LAWS}
SIGNED = {"torque_nm", "amplitude_rad", "ratio"}
"""Amplitudes of harmonics: a change of sign shifts the phase by pi."""


@dataclass(frozen=True)
class Covered:
    """A parameter, its stated interval, and whether that holds the true value.

    Attributes:
        parameter: `effect.parameter`.
    """

    parameter: str
    true: float
    low: float
    high: float
    holds: bool


def covered_by(named: Sequence[Mapping], effect: Mapping) -> list[Covered]:
    """Return the intervals that an answer states for one true effect."""
    same = [
        one["parameters"]
        for one in named
        if (one["effect"], one["where"]) == (effect["effect"], effect["where"])
    ]
    if not same or effect["mechanism"] in OTHER:
        return []
    true = _true(effect)
    stated = {name: p for name, p in same[0].items() if _is_interval(p)}
    if "phase_rad" in true:
        true = _turned(true, stated)
    found = []
    for name, p in stated.items():
        if name in true:
            value, low, high = true[name], p["low"], p["high"]
            found.append(
                Covered(
                    f"{effect['effect']}.{name}", value, low, high, low <= value <= high
                )
            )
    return found


def _is_interval(parameter: Mapping) -> bool:
    """Return whether both ends are numbers and differ: an order has no interval."""
    ends = (parameter["low"], parameter["high"])
    return all(isinstance(e, int | float) for e in ends) and ends[0] < ends[1]


def _true(effect: Mapping) -> dict[str, float]:
    numbers = effect["parameters"].items()
    true = {k: float(v) for k, v in numbers if isinstance(v, int | float)}
    if "mass_kg" in true:  # its moment is stated where the mass is not identifiable
        for axis in "xyz":
            true[f"moment_{axis}_kg_m"] = true["mass_kg"] * true[f"com_{axis}_m"]
    return true


def _turned(true: dict[str, float], stated: Mapping) -> dict[str, float]:
    """Return a harmonic with the sign and the period of the phase that was stated."""
    true = dict(true)
    for name in SIGNED & true.keys() & stated.keys():
        if true[name] * (stated[name]["low"] + stated[name]["high"]) < 0.0:
            true[name], true["phase_rad"] = -true[name], true["phase_rad"] + pi
    if "phase_rad" in stated:
        middle = (stated["phase_rad"]["low"] + stated["phase_rad"]["high"]) / 2
        turns = round((middle - true["phase_rad"]) / (2 * pi))
        true["phase_rad"] += 2 * pi * turns
    return true


# --- Scores ---------------------------------------------------------------------------

COUNTED = 3
"""Number of equivalents that count, by the rule of the answer's format."""


@dataclass(frozen=True)
class TrialScore:
    """Marks of one trial; those that do not apply to its stratum are False.

    Attributes:
        verdict: Verdict of the answer; `failed` where there is none.
        failed: Why there is no answer; empty where there is one.
        place_first: Whether the first place of `located` is the place of a true effect.
        right: Whether every true name was given or declared as an equivalent.
        exact: Whether the names given are the true ones, no more and no fewer.
        whole_set: Whether each name given stands for a true one of its own, and none
            is missing.
        wrong_name: Whether a name was given that is neither true nor declares it.
        abstains: Whether a difference was reported and no name given.
        told_apart: Whether the name given is the true one, and no other kind of memory
            is declared as its equivalent.
        declared: Whether the true name is given or declared, or nothing is named.
        stated: Every stated probability, and whether its statement was true.
        intervals: Coverage of the parameters of true names that were given.
        gain: Held-out gain over that of the true effect; None without a proof.
        splits: Of each name of few poses, the share of splits that give it, and whether
            it or one of the equivalents that count is true.
        listed: Whether every outlier is listed and no other reading, or the mistake of
            the set-up is said at its axis and nothing named.
        arm: Marks of a whole arm; None for other trials.
        twin: Marks of an effect with a twin; None for other trials.
    """

    stratum: str
    label: str
    name: str
    truth: tuple[str, ...]
    chi2: tuple[float, ...]
    verdict: str
    named: tuple[str, ...]
    failed: str
    detected: bool
    place_first: bool
    right: bool
    exact: bool
    whole_set: bool
    wrong_name: bool
    abstains: bool
    told_apart: bool
    declared: bool
    stated: tuple[tuple[float, bool], ...]
    intervals: tuple[Covered, ...]
    gain: float | None
    seconds: float
    splits: tuple[tuple[float, bool], ...] = ()
    listed: bool = False
    arm: "ArmScore | None" = None
    twin: "TwinScore | None" = None


def score_answer(label: str, name: str, answer: Mapping, truth: Mapping) -> TrialScore:
    """Return the marks of one answer.

    The answer is diagnosis.json, or `{"failed": …}`.
    """
    outside = truth.get("outside", {}).get("where")
    effects = truth["effects"] if outside is None else truth["effects"][:-1]
    true = {effect_name(effect) for effect in effects}
    places = {effect["where"] for effect in truth["effects"]}
    given = answer.get("named", [])
    names = [effect_name(one) for one in given]
    declared = [_declared(one) for one in given]
    verdict = answer.get("verdict", "failed")
    detected = verdict not in ("no_mismatch", "failed")
    located = answer.get("located", [])
    covering = [bool(true & options) for options in declared]
    right = bool(true) and all(any(t in d for d in declared) for t in true)
    memory = {f"{kind}@{where}" for kind in MEMORY for where in places} - true
    return TrialScore(
        stratum=truth["stratum"],
        label=label,
        name=name,
        truth=tuple(sorted(true)),
        chi2=tuple(truth["chi2"]),
        verdict=verdict,
        named=tuple(names),
        failed=answer.get("failed", ""),
        detected=detected,
        place_first=bool(located) and located[0]["where"] in places,
        right=right,
        exact=bool(true) and set(names) == true,
        whole_set=right and len(names) == len(true) and _one_each(true, declared),
        wrong_name=not all(covering),
        abstains=detected and not names,
        told_apart=bool(true)
        and true <= set(names)
        and not memory & set().union(*declared),
        declared=right or (detected and not names),
        stated=_stated(answer, true, covering),
        intervals=tuple(
            one for effect in truth["effects"] for one in covered_by(given, effect)
        ),
        gain=_gain(answer, truth),
        seconds=float(answer.get("seconds", 0.0)),
        splits=tuple(
            (float(one["split_share"]), hit)
            for one, hit in zip(given, covering, strict=True)
            if "split_share" in one
        ),
        listed=_listed(answer, truth),
        arm=_arm_score(answer, truth, effects) if "own_chi2" in truth else None,
        twin=_twin_score(answer, truth) if "twin" in truth else None,
    )


WAYS = {
    "axis_reversed": "with the other sign",
    "axis_zero": "counted from another zero",
    "axis_coupled": "uncoupled",
}
"""How the reader says of angles beyond their limits that they may be mistaken so."""


def _listed(answer: Mapping, truth: Mapping) -> bool:
    """Return whether an answer lists all that happened, and no other outlier."""
    if "mistake" in truth:
        if refusal := answer.get("failed", ""):
            every = truth["mistake"].items()
            return all(f"'{a}_deg'" in refusal and WAYS[c] in refusal for c, a in every)
        said = {(w["code"], w["where"]) for w in answer.get("warnings", [])}
        return said >= set(truth["mistake"].items()) and not answer.get("named")
    listed = Counter((o["pose"], o["marker"]) for o in answer.get("outliers", []))
    true = Counter((o["pose"], o["marker"]) for o in truth.get("outliers", []))
    return bool(true) and true == listed


def trial_label(truth: Mapping) -> str:
    """Return what a trial is called in tables: its stratum and number."""
    return f"{truth['stratum']} {truth['number']}"


def effect_name(entry: Mapping) -> str:
    """Return an effect of a truth or an answer with its place."""
    return f"{entry['effect']}@{entry['where']}"


def _declared(entry: Mapping) -> set[str]:
    """Return a name with the equivalents that count."""
    return {
        effect_name(entry),
        *map(effect_name, entry.get("equivalents", [])[:COUNTED]),
    }


def _one_each(true: set[str], declared: Sequence[set[str]]) -> bool:
    """Return whether each true name can be matched with a declared set of its own."""
    if not true:
        return True
    one = next(iter(true))
    return any(
        one in options and _one_each(true - {one}, [*declared[:k], *declared[k + 1 :]])
        for k, options in enumerate(declared)
    )


def _stated(
    answer: Mapping, true: set[str], covering: Sequence[bool]
) -> tuple[tuple[float, bool], ...]:
    """Return stated probabilities and whether true: of names, then of rivals.

    A rival is a whole set that differs from the names given by few of them. It is true
    where all that it brings is true, and nothing that it replaces: sets of whole arms
    are hardly ever true as a whole, so that the set would say nothing of the swap.
    """
    named = [
        (float(one["probability"]), hit)
        for one, hit in zip(answer.get("named", []), covering, strict=True)
    ]
    given = {effect_name(one) for one in answer.get("named", [])}
    rivals = []
    for rival in answer.get("rivals", []):
        names = {effect_name(e) for e in rival["effects"]}
        better = names - given <= true and not (given - names) & true
        rivals.append((float(rival["probability"]), better))
    return (*named, *rivals)


def _gain(answer: Mapping, truth: Mapping) -> float | None:
    """Return the held-out gain over that of the true effect in the simulator."""
    proof, oracle = answer.get("proof"), truth.get("oracle_gain_mm")
    if not proof or "gain_mm" not in proof or not oracle:
        return None
    return float(proof["gain_mm"]["estimate"]) / float(oracle)


# --- Whole arms -----------------------------------------------------------------------

VISIBLE = 100.0
"""Own χ² from which an effect of a whole arm is to be named; the rule of the bars."""


@dataclass(frozen=True)
class ArmScore:
    """Marks of a whole arm.

    Attributes:
        names: Names that were given; of each whether it or one of the equivalents that
            count is true.
        visible: True names with an own χ² of `VISIBLE` or more; of each whether it was
            given or declared.
        share: Of the mismatch on poses kept back that the names explain; in the linear
            model, or by the proof where there is one. None without an answer.
        oracle: The same of the true names, in the linear model.
        place_first: Whether the place with the largest true share, by χ² of all its
            effects together, is the first that was said, or that of an equivalent of a
            name there.
        outside: Whether the place of the mechanism outside the vocabulary is among
            those that were said to be unexplained; None where there is none.
    """

    names: tuple[tuple[str, bool], ...]
    visible: tuple[tuple[str, bool], ...]
    share: float | None
    oracle: float
    place_first: bool
    outside: bool | None


def _arm_score(answer: Mapping, truth: Mapping, effects: Sequence[Mapping]) -> ArmScore:
    """Return the marks of a whole arm."""
    given = answer.get("named", [])
    true = {effect_name(effect) for effect in effects}
    declared = [_declared(one) for one in given]
    places = truth["place_chi2"]
    located = [place["where"] for place in answer.get("located", [])]
    outside = truth.get("outside", {}).get("where")
    left = [place["where"] for place in answer.get("unexplained_places", [])]
    proved = answer.get("explained_share")
    return ArmScore(
        names=tuple(
            (effect_name(one), bool(true & options))
            for one, options in zip(given, declared, strict=True)
        ),
        visible=tuple(
            (
                effect_name(effect),
                any(effect_name(effect) in options for options in declared),
            )
            for effect, own in zip(effects, truth["own_chi2"], strict=False)
            if own >= VISIBLE
        ),
        share=proved["estimate"] if proved else answer.get("linear_share"),
        oracle=truth["oracle_share"],
        place_first=max(places, key=lambda where: places[where])
        in _places_said(located[:1], given),
        outside=None if outside is None else outside in left,
    )


def _places_said(first: Sequence[str], given: Sequence[Mapping]) -> set[str]:
    """Return some places, with those of equivalents of the names there."""
    there = [one for one in given if one["where"] in first]
    alike = {e["where"] for one in there for e in one["equivalents"][:COUNTED]}
    return {*first, *alike}


@dataclass(frozen=True)
class TwinScore:
    """Marks of an effect with a twin.

    Attributes:
        log_bayes_factor: For the effect against its twin, of noise-free readings.
    """

    log_bayes_factor: float
    declared: bool


def _twin_score(answer: Mapping, truth: Mapping) -> TwinScore:
    (effect,) = truth["effects"]
    both = {effect_name(effect), f"{effect['effect']}@{truth['twin']}"}
    declared = any(both <= _declared(one) for one in answer.get("named", []))
    return TwinScore(truth["log_bayes_factor"], declared)
