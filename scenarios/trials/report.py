"""A sweep's report begins with what went wrong."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from scenarios.reporting import page, table
from scenarios.reporting.style import save
from scenarios.trials import figures
from scenarios.trials.rates import (
    MARKS,
    Rate,
    bars,
    by_stratum,
    failures,
    wrong,
)
from scenarios.trials.score import Score
from scenarios.trials.shown import of_probabilities, said, tables_of
from scenarios.trials.tables import calibration, confusion


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
    blocks = tables_of(scores, rates)
    if matrix:
        table.write(out / "confusion.csv", matrix)
        save(figures.confusion(matrix), out / "confusion.png")
        blocks.append(
            page.Figure(
                "What is true (rows) and what was said (columns): trials with one "
                "effect or none, of several names the first. Orange: the true name; "
                "grey: no name; red: another name first, which may declare the true "
                "one. Darker: more of the row.",
                "confusion.png",
            )
        )
    if calibrated:
        table.write(out / "calibration.csv", calibrated)
        save(figures.calibration(calibrated), out / "calibration.png")
        blocks += of_probabilities(calibrated)
    page.write(out, "Blind trials", _headline(scores, rates), blocks)


def _headline(scores: Sequence[Score], rates: Sequence[Rate]) -> str:
    counted = [r for r in rates if r.met is not None]
    met = sum(bool(r.met) for r in counted)
    return (
        f"{len(scores)} concealed trials; {met} of {len(counted)} bars are met, "
        f"{len(failures(scores))} trials speak against one."
    )


def _entry(s: Score) -> dict[str, object]:
    return {
        "trial": s.label,
        "name": s.name,
        "truth": s.truth,
        "chi2": s.chi2,
        "answer": said(s),
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
