"""What was said of what is one table, how sure it was and how right is another."""

from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from scenarios.trials.score import Score
from stiffness.intervals import share

BINS = (0.0, 0.05, 0.2, 0.5, 0.8, 0.95, 0.99, 1.0)
"""Edges of stated probabilities that are looked at together; chosen: few, and where
verdicts turn."""


def confusion(scores: Sequence[Score]) -> list[dict[str, Any]]:
    """Return how often each true effect was answered by each name, by kind of trial.

    Only trials with one effect or none; of several names the first counts.
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


def said(score: Score) -> str:
    """Return in one word what an answer says."""
    if score.named:
        return _effect(score.named[0])
    return {"no_mismatch": "nothing", "failed": "failed"}.get(
        score.verdict, "unexplained"
    )


def calibration(scores: Sequence[Score]) -> list[dict[str, Any]]:
    """Return how often what was stated with a probability was true."""
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
