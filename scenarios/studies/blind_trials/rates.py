"""Rates over blind trials with their intervals, confusions, and calibration.

`bars` compares shares of marks with the bars of `strata`; `confusion` counts answers by
true effect; `calibration` gives how often statements of a probability were true.

Interval of a share:

==========  ==========================================================================
Equation    Clopper and Pearson's interval; a bar is met where the share meets it
Source      Clopper and Pearson 1934, "The use of confidence or fiducial limits"
Valid       trials drawn independently
Ignores     nothing; trials that failed count as wrong
==========  ==========================================================================
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from scenarios.studies.blind_trials.score import TrialScore
from scenarios.studies.blind_trials.strata import BARS, STRATA, Bar
from stiffness.regression.intervals import share

# --- Rates and limits -----------------------------------------------------------------

MARKS = ("detected", "place_first", "right", "exact", "whole_set", "wrong_name")
MARKS += ("abstains", "told_apart", "declared")
MEANINGS = (
    "Detected: a difference was reported. Place first: the first place that was said "
    "is that of a true effect. Right: every true name was given or declared to do as "
    "well. Exact: the names given are the true ones. Whole set: each name given stands "
    "for a true one, none is missing. Wrong name: a name was given that is neither "
    "true nor declares it. Abstains: a difference, but no name. Told apart: the true "
    "name, and no other kind of memory beside it. Declared: the true name is given or "
    "declared, or nothing is named. χ²: how large an effect is in the instruments' "
    "squared sigmas, after springs took on what they can."
)
"""Explanation of the marks, for the report; see `TrialScore`."""
COVERAGE, GAIN, SECONDS = (0.90, 0.98), 0.90, 3.0
"""Bars of intervals, of the held-out gain and of the time of one answer."""


@dataclass(frozen=True)
class Rate:
    """A share of trials.

    Attributes:
        what: What was counted, in words.
        bar: The bar, in words.
        successes: Number of successes.
        trials: Number of trials counted.
        value: Share of successes; None where nothing was counted.
        low: Lower end of the 95 % interval.
        high: Upper end of it.
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
    met = least <= found.value <= most
    return Rate(what, bar, count, total, found.value, found.low, found.high, met)


def bars(scores: Sequence[TrialScore]) -> list[Rate]:
    """Return the rate of every bar, and those of intervals, gains and seconds."""
    rates = [_of_bar(bar, scores) for bar in BARS]
    intervals = [i.holds for s in scores for i in s.intervals]
    rates.append(rate("intervals that hold their parameter", intervals, *COVERAGE))
    gains = [s.gain >= GAIN for s in scores if s.gain is not None]
    said = "proofs that gain 90 % of what the truth gains"
    rates.append(rate(said, gains, least=0.5))
    quick = [s.seconds <= SECONDS for s in scores if not s.failed]
    rates.append(rate(f"answers within {SECONDS:g} s", quick, least=0.5))
    return rates


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
    """Return the trials that failed or violate a bar of their stratum."""
    return [s for s in scores if s.failed or wrong(s)]


def wrong(score: TrialScore) -> tuple[str, ...]:
    """Return the bars of its stratum that a trial violates."""
    found = []
    for bar in BARS:
        counts = not bar.of or getattr(score, bar.of)
        if score.stratum in bar.strata and counts:
            if getattr(score, bar.mark) == bar.at_most:
                found.append(("" if bar.at_most else "not ") + bar.mark)
    return tuple(found)


def _of_bar(bar: Bar, scores: Sequence[TrialScore]) -> Rate:
    own = [s for s in scores if s.stratum in bar.strata]
    counted = [s for s in own if not bar.of or getattr(s, bar.of)]
    what = f"{bar.mark.replace('_', ' ')}: {' and '.join(bar.strata)}"
    what += f", of those {bar.of}" if bar.of else ""
    marks = [getattr(s, bar.mark) for s in counted]
    if bar.at_most:
        return rate(what, marks, most=bar.share)
    return rate(what, marks, least=bar.share)


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
        inside = [(p, hit) for p, hit in stated if low < p <= high]
        if inside:
            found = share(sum(hit for _, hit in inside), len(inside))
            rows.append(
                {
                    "from": low,
                    "to": high,
                    "stated": float(np.mean([p for p, _ in inside])),
                    "statements": len(inside),
                    "true": found.value,
                    "low": found.low,
                    "high": found.high,
                }
            )
    return rows


def _effect(name: str) -> str:
    return name.partition("@")[0]
