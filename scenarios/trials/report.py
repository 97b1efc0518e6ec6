"""A sweep's report begins with what went wrong."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from scenarios.reporting import page, table
from scenarios.reporting.style import save
from scenarios.trials import figures
from scenarios.trials.rates import MARKS, Rate, bars, by_stratum, failures, wrong
from scenarios.trials.score import Score
from scenarios.trials.tables import calibration, confusion

SHOWN = 60
"""Failures that the page lists; all are in summary.json and trials.csv."""


def write(out: Path, scores: Sequence[Score], facts: dict[str, object]) -> None:
    """Write summary.json, tables, pictures and the page.

    Args:
        out: The folder.
        scores: Of all trials that are finished; at least one.
        facts: How they came about.
    """
    rates, calibrated = bars(scores), calibration(scores)
    matrix = confusion(scores)
    summary = facts | {
        "trials": len(scores),
        "failures": [_entry(s) for s in failures(scores)],
        "bars": [asdict(r) for r in rates],
        "strata": by_stratum(scores),
        "calibration": calibrated,
    }
    text = json.dumps(summary, indent=2, ensure_ascii=False)
    (out / "summary.json").write_text(text + "\n", encoding="utf-8")
    table.write(out / "trials.csv", [_row(s) for s in scores])
    blocks = _blocks(scores, rates)
    if matrix:
        table.write(out / "confusion.csv", matrix)
        save(figures.confusion(matrix), out / "confusion.png")
        blocks.append(
            page.Figure(
                "What is true (rows) and what was said (columns).", "confusion.png"
            )
        )
    if calibrated:
        table.write(out / "calibration.csv", calibrated)
        save(figures.calibration(calibrated), out / "calibration.png")
        caption = "How often a statement is true against its stated probability."
        blocks.append(page.Figure(caption, "calibration.png"))
    page.write(out, "Blind trials", _headline(scores, rates), blocks)


def _headline(scores: Sequence[Score], rates: Sequence[Rate]) -> str:
    counted = [r for r in rates if r.met is not None]
    met = sum(bool(r.met) for r in counted)
    return (
        f"{len(scores)} concealed trials; {met} of {len(counted)} bars are met, "
        f"{len(failures(scores))} trials speak against one."
    )


def _blocks(scores: Sequence[Score], rates: Sequence[Rate]) -> list[page.Block]:
    bad = failures(scores)
    listed = [
        (s.label, ", ".join(s.truth) or "nothing", _said(s), ", ".join(wrong(s)))
        for s in bad[:SHOWN]
    ]
    more = f", the first {SHOWN} of {len(bad)}" if len(bad) > SHOWN else ""
    strata = [
        [str(row["stratum"]), *(str(row[k]) for k in ("trials", *MARKS, "failed"))]
        for row in by_stratum(scores)
    ]
    return [
        page.Heading("Failures first"),
        page.Table(
            f"Every trial that speaks against a bar{more}.",
            ("trial", "truth", "answer", "against"),
            listed,
        ),
        page.Heading("Bars"),
        page.Table(
            "Shares of trials with Clopper and Pearson's 95 % interval.",
            ("what", "bar", "trials", "share", "interval", "met"),
            [_cells(r) for r in rates],
        ),
        page.Heading("Kinds of trials"),
        page.Table(
            "How many trials of each kind got each mark.",
            ("kind", "trials", *(m.replace("_", " ") for m in MARKS), "failed"),
            strata,
        ),
    ]


def _cells(r: Rate) -> tuple[str, ...]:
    if r.value is None or r.low is None or r.high is None:
        return (r.what, r.bar, "0", "–", "–", "–")
    interval = f"{r.low:.1%} to {r.high:.1%}"
    met = "yes" if r.met else "no"
    return (r.what, r.bar, str(r.trials), f"{r.value:.1%}", interval, met)


def _said(s: Score) -> str:
    return s.failed or f"{s.verdict}: {', '.join(s.named) or 'no name'}"


def _entry(s: Score) -> dict[str, object]:
    return {
        "trial": s.label,
        "name": s.name,
        "truth": s.truth,
        "chi2": s.chi2,
        "answer": _said(s),
        "against": wrong(s),
    }


def _row(s: Score) -> dict[str, object]:
    marks = {mark: int(getattr(s, mark)) for mark in MARKS}
    return {
        "trial": s.label,
        "stratum": s.stratum,
        "truth": " ".join(s.truth),
        "chi2": " ".join(f"{c:.0f}" for c in s.chi2),
        "verdict": s.verdict,
        "named": " ".join(s.named),
        **marks,
        "intervals": len(s.intervals),
        "intervals_hold": sum(i.holds for i in s.intervals),
        "seconds": s.seconds,
    }
