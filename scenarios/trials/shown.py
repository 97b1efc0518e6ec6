"""The tables of a sweep's page: failures, bars, kinds of trials, probabilities."""

from collections.abc import Sequence
from typing import Any

from scenarios.reporting import page
from scenarios.trials.rates import MARKS, MEANINGS, Rate, by_stratum, failures, wrong
from scenarios.trials.score import Score
from scenarios.trials.strata import STRATA

SHOWN = 60
"""Failures that the page lists; all are in summary.json and trials.csv."""


def tables_of(scores: Sequence[Score], rates: Sequence[Rate]) -> list[page.Block]:
    """Return failures first, bars, and what each kind of trial got."""
    bad = failures(scores)
    listed = [
        (s.label, ", ".join(s.truth) or "nothing", said(s), ", ".join(wrong(s)))
        for s in bad[:SHOWN]
    ]
    more = f", the first {SHOWN} of {len(bad)}" if len(bad) > SHOWN else ""
    strata = [
        [
            *(name := str(row["stratum"]), STRATA[name].said),
            *(str(row[k]) for k in ("trials", *MARKS, "failed")),
        ]
        for row in by_stratum(scores)
    ]
    against = page.Table(
        f"Every trial that speaks against a bar{more}.",
        ("trial", "truth", "answer", "against"),
        listed,
    )
    return [
        page.Heading("Failures first"),
        against if listed else page.Paragraph("No trial speaks against a bar."),
        page.Heading("Bars"),
        page.Table(
            "Shares of trials with Clopper and Pearson's 95 % interval; kinds and "
            "marks are explained below.",
            ("what", "bar", "trials", "share", "interval", "met"),
            [_cells(r) for r in rates],
        ),
        page.Heading("Kinds of trials"),
        page.Table(
            f"How many trials of each kind got each mark. {MEANINGS}",
            (
                "kind",
                "what is there",
                "trials",
                *(m.replace("_", " ") for m in MARKS),
                "failed",
            ),
            strata,
        ),
    ]


def of_probabilities(rows: Sequence[dict[str, Any]]) -> list[page.Block]:
    """Return how often what was stated with a probability was true."""
    often = "How often a name is true against the probability that was stated for it"
    return [
        page.Figure(f"{often}, with 95 % intervals.", "calibration.png"),
        page.Table(
            f"{often}, with Clopper and Pearson's interval.",
            ("stated", "on average", "statements", "true", "interval"),
            [
                (
                    *(f"{r['from']:g} to {r['to']:g}", f"{r['stated']:.3f}"),
                    *(str(r["statements"]), f"{r['true']:.1%}"),
                    f"{r['low']:.1%} to {r['high']:.1%}",
                )
                for r in rows
            ],
        ),
    ]


def said(s: Score) -> str:
    """Return an answer in a few words."""
    return s.failed or f"{s.verdict}: {', '.join(s.named) or 'no name'}"


def _cells(r: Rate) -> tuple[str, ...]:
    if r.value is None or r.low is None or r.high is None:
        return (r.what, r.bar, "0", "–", "–", "not tried")
    interval = f"{r.low:.1%} to {r.high:.1%}"
    met = "yes" if r.met else "no"
    return (r.what, r.bar, str(r.trials), f"{r.value:.1%}", interval, met)
