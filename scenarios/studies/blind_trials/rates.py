"""Rates over blind trials with their intervals, confusions, and calibration.

Interval of a share:

==========  ==========================================================================
Equation    Clopper and Pearson's interval; a bar is met where the share meets it
Source      Clopper and Pearson 1934, "The use of confidence or fiducial limits"
Valid       trials drawn independently
Ignores     nothing; trials that failed count as wrong
==========  ==========================================================================

Comparison of two runs of the same trials (`paired_rates`):

==========  ==========================================================================
Equation    p of as many losses or more, or as few, among the trials whose mark differs,
            each as likely a gain: Binomial(losses + gains, 1/2), both sides
Source      McNemar 1947, "Note on the sampling error of the difference between
            correlated proportions", in its exact form
Valid       trials drawn independently, tried by both
Ignores     that several marks are looked at
==========  ==========================================================================
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.stats import binomtest

from scenarios.studies.blind_trials.score import (
    VISIBLE,
    Covered,
    TrialScore,
    effect_name,
    trial_label,
)
from scenarios.studies.blind_trials.strata import BARS, SIGN, SIGNED, SIZE, STRATA, Bar
from stiffness.regression.intervals import share

# --- Rates and limits -----------------------------------------------------------------

MARKS = ("detected", "place_first", "right", "exact", "whole_set", "wrong_name")
MARKS += ("abstains", "told_apart", "declared", "listed")
MEANINGS = (
    "Detected: a difference was reported. Place first: the first place that was said "
    "is that of a true effect. Right: every true name was given or declared to do as "
    "well. Exact: the names given are the true ones. Whole set: each name given stands "
    "for a true one, none is missing. Wrong name: a name was given that is neither "
    "true nor declares it. Abstains: a difference, but no name. Told apart: the true "
    "name, and no other kind of memory beside it. Declared: the true name is given or "
    "declared, or nothing is named. Listed: every outlier is listed and no other "
    "reading, or the mistake of the set-up is said and nothing named, by the reader "
    "where angles are beyond their limits. χ²: how large an effect is in the "
    "instruments' squared sigmas, after springs took on what they can."
)
"""Explanation of the marks, for the report; see `TrialScore`."""
COVERAGE, GAIN, SECONDS = (0.90, 0.98), 0.90, 3.0
"""Bars of intervals, of the held-out gain and of the time of one answer."""


@dataclass(frozen=True)
class Rate:
    """A share of trials.

    Attributes:
        value: Share of successes; None where nothing was counted.
        low: Lower end of the 95 % interval.
        met: Whether the share meets the bar; None where nothing was counted.
    """

    what: str
    bar: str
    successes: int
    trials: int
    value: float | None
    low: float | None
    high: float | None
    met: bool | None


def rate(
    what: str, marks: Sequence[bool], least: float = 0.0, most: float = 1.0
) -> Rate:
    """Return the share of marks with its interval, compared with a bar."""
    bar = f"≤ {most:.0%}" if least == 0.0 else f"≥ {least:.0%}"
    if least > 0.0 and most < 1.0:
        bar = f"{least:.0%} to {most:.0%}"
    count, total = int(np.sum(marks)), len(marks)
    if not total:
        return Rate(what, bar, 0, 0, None, None, None, None)
    found = share(count, total)
    met = least <= found.estimate <= most
    return Rate(what, bar, count, total, found.estimate, found.low, found.high, met)


def bars(scores: Sequence[TrialScore]) -> list[Rate]:
    """Return the rate of every bar, and those of intervals, gains and seconds."""
    rates = [_of_bar(bar, scores) for bar in BARS]
    intervals = [i.holds for s in scores for i in s.intervals]
    rates.append(rate("intervals that hold their parameter", intervals, *COVERAGE))
    gains = [s.gain >= GAIN for s in scores if s.gain is not None]
    said = "proofs that gain 90 % of what the truth gains"
    rates.append(rate(said, gains, least=0.5))
    quick = [s.seconds <= SECONDS for s in scores if not s.failed and s.arm is None]
    rates.append(rate(f"answers within {SECONDS:g} s", quick, least=0.5))
    found = [*rates, *arm_bars(scores), *twin_bars(scores), *sign_bars(scores)]
    return [*found, *split_bars(scores), *noise_bars(scores)]


SURELY, POINTS = 0.05, 0.02
"""p-value below which losses outnumber gains surely, and by what share of its trials a
row may fall; both are the project's bars for a change of the method."""


@dataclass(frozen=True)
class PairedRate:
    """A mark of the same trials in two runs.

    Attributes:
        before: Trials that had it rightly in the run that is compared with.
        after: Trials that have it rightly now.
        lost: Trials that had it and have not.
        gained: Trials that had it not and have.
        p_value: McNemar's, exact.
        met: Whether it neither falls surely nor by more than `POINTS`.
    """

    stratum: str
    mark: str
    trials: int
    before: int
    after: int
    lost: int
    gained: int
    p_value: float
    met: bool


def paired_rates(
    scores: Sequence[TrialScore], others: Sequence[Mapping[str, str]]
) -> list[PairedRate]:
    """Compare the marks that have a bar with those of another run.

    Args:
        scores: Of this run.
        others: Rows of the other's trials.csv; trials that one of both lacks are left
            out.
    """
    known, found = {row["trial"]: row for row in others}, []
    for bar in BARS:
        for stratum in bar.strata:
            own = [s for s in scores if s.stratum == stratum and s.label in known]
            after = np.array([getattr(s, bar.mark) for s in own], bool) ^ bar.at_most
            old = [known[s.label][bar.mark] == "1" for s in own]
            before = np.array(old, bool) ^ bar.at_most
            lost, gained = int(np.sum(before & ~after)), int(np.sum(after & ~before))
            p = binomtest(lost, lost + gained).pvalue if lost + gained else 1.0
            falls = lost - gained > POINTS * len(own)
            met = not falls and not (lost > gained and p < SURELY)
            counts = len(own), int(before.sum()), int(after.sum()), lost, gained
            if own:
                found.append(PairedRate(stratum, bar.mark, *counts, float(p), met))
    return found


EQUAL = 1e-6
"""Difference of two numbers, over the larger or half their interval, up to which they
are equal; the project's bar for other processors."""


@dataclass(frozen=True)
class PairedAnswer:
    """The answers to one trial in two runs.

    Attributes:
        trial: Its label.
        differ: What differs: verdict, names, open places, numbers.
        largest: Largest difference of a parameter of a name that both give, over its
            size or half its interval, whichever is larger.
    """

    trial: str
    differ: tuple[str, ...]
    largest: float


def paired_answers(
    rows: Mapping[str, Mapping[str, Any]], others: Mapping[str, Mapping[str, Any]]
) -> list[PairedAnswer]:
    """Compare the answers of two runs to the same trials, whatever is true.

    Args:
        rows: Finished trials of this run, by key.
        others: Those of the other.
    """
    found = []
    for key in sorted(rows.keys() & others.keys()):
        one, other = rows[key]["answer"], others[key]["answer"]
        differ = [what for what, said in STATEMENTS.items() if said(one) != said(other)]
        largest = _largest_difference(one, other)
        differ += ["numbers"] if largest > EQUAL else []
        label = trial_label(rows[key]["truth"])
        found.append(PairedAnswer(label, tuple(differ), largest))
    return found


def _names(answer: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """Return the parameters of each name that was given."""
    return {effect_name(one): one["parameters"] for one in answer.get("named", [])}


STATEMENTS: dict[str, Callable[[Mapping[str, Any]], Any]] = {
    "verdict": lambda answer: answer.get("verdict", answer.get("failed")),
    "names": lambda answer: set(_names(answer)),
    "open places": lambda answer: {
        one["where"] for one in answer.get("unexplained_places", [])
    },
}
"""What an answer says that is no number."""


def _largest_difference(one: Mapping[str, Any], other: Mapping[str, Any]) -> float:
    """Return the largest difference of parameters that both answers give."""
    mine, theirs = _names(one), _names(other)
    largest = 0.0
    for name in mine.keys() & theirs.keys():
        for parameter in mine[name].keys() & theirs[name].keys():
            first, second = mine[name][parameter], theirs[name][parameter]
            largest = max(largest, _difference(first, second))
    return largest


def _difference(one: Mapping[str, Any], other: Mapping[str, Any]) -> float:
    """Return the difference of two parameters; 1 of words that are not the same."""
    if isinstance(one["estimate"], str):
        return 0.0 if one == other else 1.0
    ends = ("estimate", "low", "high")  # none, where no readings hold it, counts as 0
    a, b = (np.array([x[end] or 0.0 for end in ends]) for x in (one, other))
    size = max(abs(a[0]), abs(b[0]), 0.5 * (a[2] - a[1]), 1e-300)
    return float(np.max(np.abs(a - b)) / size)


def by_stratum(scores: Sequence[TrialScore]) -> list[dict[str, object]]:
    """Return one row for each stratum: how often each mark was given."""
    rows = []
    for name in STRATA:
        own = [s for s in scores if s.stratum == name]
        if own:
            counts = {mark: sum(getattr(s, mark) for s in own) for mark in MARKS}
            seconds = float(np.median([s.seconds for s in own]))
            failed = sum(bool(s.failed) for s in own)
            rows.append(
                {"stratum": name, "trials": len(own)}
                | counts
                | {"failed": failed, "median_seconds": seconds}
            )
    return rows


def failures(scores: Sequence[TrialScore]) -> list[TrialScore]:
    """Return the trials that failed, but by a mistake said, or violate a bar."""
    return [s for s in scores if (s.failed and not s.listed) or wrong(s)]


def wrong(score: TrialScore) -> tuple[str, ...]:
    """Return the bars of its stratum that a trial violates."""
    found = []
    for bar in BARS:
        counts = not bar.of or getattr(score, bar.of)
        if score.stratum in bar.strata and counts:
            if getattr(score, bar.mark) == bar.at_most:
                found.append(("" if bar.at_most else "not ") + bar.mark)
    return (*found, *_wrong_of_arm(score))


def _wrong_of_arm(score: TrialScore) -> list[str]:
    """Return what a whole arm, or a twin, fails in."""
    found, arm, twin = [], score.arm, score.twin
    if arm is not None:
        false = [name for name, hit in arm.names if not hit]
        missed = [name for name, hit in arm.visible if not hit]
        found += [f"false: {', '.join(false)}"] if false else []
        found += [f"not named: {', '.join(missed)}"] if missed else []
        if arm.outside is None and (arm.share or 0.0) < EXPLAINED:
            found.append(f"explained {arm.share or 0.0:.1%}")
        if arm.outside is False:
            found.append("place outside not said")
    if twin is not None:
        if twin.log_bayes_factor < ALIKE and not twin.declared:
            found.append("twin not declared")
        if twin.log_bayes_factor > APART and twin.declared:
            found.append("twin declared")
    return found


def _of_bar(bar: Bar, scores: Sequence[TrialScore]) -> Rate:
    own = [s for s in scores if s.stratum in bar.strata]
    counted = [s for s in own if not bar.of or getattr(s, bar.of)]
    what = f"{bar.mark.replace('_', ' ')}: {' and '.join(bar.strata)}"
    what += f", of those {bar.of}" if bar.of else ""
    marks = [getattr(s, bar.mark) for s in counted]
    if bar.at_most:
        return rate(what, marks, most=bar.share)
    return rate(what, marks, least=bar.share)


# --- Whole arms and twins -------------------------------------------------------------


@dataclass(frozen=True)
class ArmBar:
    """Bars of whole arms, counted over some strata together.

    Attributes:
        named: Required share of visible effects that are named.
        false: Largest share of names that are false.
        place_first: Whether the first place is counted; by a flange target alone places
            follow from laws.
        outside: Required share of places outside the vocabulary that are said; None
            where the vocabulary has all.
    """

    what: str
    strata: tuple[str, ...]
    named: float
    false: float
    place_first: bool = True
    outside: float | None = None


def _arms(start: str, end: str = "") -> tuple[str, ...]:
    return tuple(f"{start}_{many}{end}" for many in ("6", "12", "all"))


ARM_BARS = (
    ArmBar("whole arms", _arms("arm"), 0.92, 0.03),
    ArmBar("the study's arm", ("study_arm",), 0.92, 0.03),
    ArmBar("whole arms by the flange", _arms("flange_arm"), 0.70, 0.04, False),
    ArmBar("whole arms, laws of other forms", _arms("arm", "_other_laws"), 0.92, 0.03),
    ArmBar(
        "whole arms, laws of other forms, by the flange",
        _arms("flange_arm", "_other_laws"),
        0.70,
        0.04,
        False,
    ),
    ArmBar(
        "whole arms with a mechanism outside",
        _arms("arm", "_outside"),
        0.0,
        0.05,
        outside=0.80,
    ),
    ArmBar(
        "whole arms with a mechanism outside by the flange",
        _arms("flange_arm", "_outside"),
        0.0,
        0.05,
        False,
        outside=0.80,
    ),
)
EXPLAINED, EXPLAINED_TRIALS = 0.97, 0.95
"""Explained share, and the share of whole arms that have it."""
ARM_COVERAGE = (0.92, 0.98)
FIRST_PLACE, LOST = 0.95, 0.10
ALIKE, APART, DECLARED = 3.0, 10.0, 0.95
"""Log Bayes factors below which twins are to be declared, above which they are not, and
the share of trials in which it is so."""


def arm_bars(scores: Sequence[TrialScore]) -> list[Rate]:
    """Return the rates of whole arms; none where none were tried."""
    rates = []
    for bar in ARM_BARS:
        own = [s for s in scores if s.stratum in bar.strata and s.arm is not None]
        if not own:
            continue
        arms = [s.arm for s in own if s.arm is not None]
        visible = [hit for arm in arms for _, hit in arm.visible]
        wrong_names = [not hit for arm in arms for _, hit in arm.names]
        held = [i.holds for s in own for i in s.intervals]
        rates.append(
            rate(f"names that are false: {bar.what}", wrong_names, most=bar.false)
        )
        if bar.outside is None:
            said = f"effects with an own χ² of {VISIBLE:g} or more named: {bar.what}"
            rates.append(rate(said, visible, least=bar.named))
            explained = [(arm.share or 0.0) >= EXPLAINED for arm in arms]
            said = f"arms of which {EXPLAINED:.0%} are explained: {bar.what}"
            rates.append(rate(said, explained, least=EXPLAINED_TRIALS))
            if bar.place_first:
                said = f"largest place first: {bar.what}"
                rates.append(
                    rate(said, [a.place_first for a in arms], least=FIRST_PLACE)
                )
            said = f"intervals that hold their parameter: {bar.what}"
            rates.append(rate(said, held, *ARM_COVERAGE))
        else:
            said = f"places outside the vocabulary said: {bar.what}"
            seen = [bool(arm.outside) for arm in arms]
            rates.append(rate(said, seen, least=bar.outside))
            said = f"right names lost by it: {bar.what}"
            rates.append(rate(said, lost_names(scores, own), most=LOST))
    return rates


def lost_names(
    scores: Sequence[TrialScore], outside: Sequence[TrialScore]
) -> list[bool]:
    """Return which right names of arms are not given with a mechanism outside.

    All scores include those of the same arms without that mechanism.
    """
    by_label = {s.label: s for s in scores}
    lost = []
    for one in outside:
        name, _, number = one.label.partition(" ")
        same = by_label.get(f"{STRATA[name].arm_of} {number}")
        if same is None or same.arm is None or one.arm is None:
            continue
        if same.truth == one.truth:
            now = dict(one.arm.visible)
            lost += [not now.get(k, False) for k, hit in same.arm.visible if hit]
    return lost


def by_arm(scores: Sequence[TrialScore]) -> list[dict[str, Any]]:
    """Return one row for each stratum of whole arms."""
    rows = []
    for name in STRATA:
        own = [s for s in scores if s.stratum == name and s.arm is not None]
        arms = [s.arm for s in own if s.arm is not None]
        if not arms:
            continue
        visible = [hit for arm in arms for _, hit in arm.visible]
        names = [hit for arm in arms for _, hit in arm.names]
        held = [i.holds for s in own for i in s.intervals]
        outside = [arm.outside for arm in arms if arm.outside is not None]
        shares = [arm.share or 0.0 for arm in arms]
        rows.append(
            {
                "stratum": name,
                "trials": len(own),
                "effects": sum(len(s.truth) for s in own),
                "visible": len(visible),
                "visible_named": sum(visible),
                "names_true": sum(names),
                "names_false": len(names) - sum(names),
                "explained_median": float(np.median(shares)),
                "explained_least": float(np.min(shares)),
                "oracle_median": float(np.median([arm.oracle for arm in arms])),
                "place_first": sum(arm.place_first for arm in arms),
                "outside_said": sum(outside) if outside else None,
                "names_lost": sum(lost_names(scores, own)) if outside else None,
                "intervals": len(held),
                "intervals_hold": sum(held),
                "median_seconds": float(np.median([s.seconds for s in own])),
            }
        )
    return rows


def twin_bars(scores: Sequence[TrialScore]) -> list[Rate]:
    """Return how often twins are declared where they are alike; none without any."""
    rates = []
    for name in STRATA:
        twins = [s.twin for s in scores if s.stratum == name and s.twin is not None]
        if twins:
            alike = [t.declared for t in twins if t.log_bayes_factor < ALIKE]
            apart = [not t.declared for t in twins if t.log_bayes_factor > APART]
            said = f"{name}: declared where the log Bayes factor is below {ALIKE:g}"
            rates.append(rate(said, alike, least=DECLARED))
            said = f"{name}: not declared where it is above {APART:g}"
            rates.append(rate(said, apart, least=DECLARED))
    return rates


def sign_bars(scores: Sequence[TrialScore]) -> list[Rate]:
    """Return how often effects with a sign are named with it; none without any."""
    rates = []
    for name in SIGNED:
        own = [s for s in scores if s.stratum == name]
        if own:
            sizes = [i for s in own for i in s.intervals]
            signs = [bool(s.intervals) and all(map(_signed, s.intervals)) for s in own]
            rates.append(rate(f"{name}: named with its sign", signs, least=SIGN))
            held = [i.holds for i in sizes]
            rates.append(rate(f"{name}: intervals that hold it", held, least=SIZE))
    return rates


def _signed(size: Covered) -> bool:
    """Return whether both ends of an interval have the true sign."""
    return min(size.low * size.true, size.high * size.true) > 0.0


# --- Few poses, and noise that is stated wrongly --------------------------------------

MOST_SPLITS, TRUE, SAID = 0.9, 0.95, 0.60
"""Share of the splits from which a name is stable, the share of such names that is to
be true, and the share of effects of `LARGE` that is to be said."""
LARGE = 400.0
AS_OFTEN, ALARMS = 0.90, 0.02
"""Share of the names that are right with the true noise stated that is right without,
and the share of recordings of nothing that may alarm."""


def split_bars(scores: Sequence[TrialScore]) -> list[Rate]:
    """Return how often stable names of few poses are true, and how many are said."""
    if not any(s.splits for s in scores):
        return []
    stable = [hit for s in scores for share, hit in s.splits if share >= MOST_SPLITS]
    own = [s for s in scores if len(s.truth) == 1 and min(s.chi2, default=0.0) >= LARGE]
    said = [s.right for s in own if s.arm is None and STRATA[s.stratum].known]
    return [
        rate(f"names of {MOST_SPLITS:.0%} of the splits true", stable, least=TRUE),
        rate(f"effects with a χ² of {LARGE:g} or more said", said, least=SAID),
    ]


def noise_bars(scores: Sequence[TrialScore]) -> list[Rate]:
    """Return what another noise than the true one does to names; none where untried."""
    right = {s.label: s.right for s in scores}
    rates = []
    for name, stratum in STRATA.items():
        own = [s for s in scores if s.stratum == name]
        if not own or not stratum.marks:
            continue
        if not stratum.least:
            alarms = [s.detected for s in own]
            rates.append(rate(f"detected: {name}", alarms, most=ALARMS))
        elif stratum.arm_of:
            wrong_names = [s.wrong_name for s in own]
            rates.append(rate(f"wrong name: {name}", wrong_names, most=ALARMS))
            pairs = ((s, s.label.replace(name, stratum.arm_of)) for s in own)
            both = [s.right for s, other in pairs if right.get(other, False)]
            said = f"right of those right with the true noise: {name}"
            rates.append(rate(said, both, least=AS_OFTEN))
    return rates


# --- Confusion and calibration --------------------------------------------------------

BINS = (0.0, 0.05, 0.2, 0.5, 0.8, 0.95, 0.99, 1.0)
"""Edges of the bins of stated probabilities; chosen: few, and where verdicts change."""


def confusion(scores: Sequence[TrialScore]) -> list[dict[str, Any]]:
    """Return how often each true effect was answered by each name, by stratum.

    Only trials with one effect or none count; of several names the first.
    """
    counts = Counter(
        (s.stratum, _effect(s.truth[0]) if s.truth else "nothing", said(s))
        for s in scores
        if len(s.truth) <= 1
    )
    return [
        {"stratum": stratum, "truth": truth, "answer": answer, "trials": count}
        for (stratum, truth, answer), count in sorted(counts.items())
    ]


def said(score: TrialScore) -> str:
    """Return an answer as one word: a name, nothing, unexplained or failed."""
    if score.named:
        return _effect(score.named[0])
    return {"no_mismatch": "nothing", "failed": "failed"}.get(
        score.verdict, "unexplained"
    )


def calibration(scores: Sequence[TrialScore]) -> list[dict[str, Any]]:
    """Return how often statements were true, by bins of their stated probability."""
    stated = [pair for s in scores if s.truth for pair in s.stated]
    rows = []
    for low, high in pairwise(BINS):
        inside = [(p, hit) for p, hit in stated if low < max(p, 1e-12) <= high]
        if inside:
            found = share(sum(hit for _, hit in inside), len(inside))
            rows.append(
                {
                    "from": low,
                    "to": high,
                    "stated": float(np.mean([p for p, _ in inside])),
                    "statements": len(inside),
                    "true": found.estimate,
                    "low": found.low,
                    "high": found.high,
                }
            )
    return rows


def _effect(name: str) -> str:
    return name.partition("@")[0]
