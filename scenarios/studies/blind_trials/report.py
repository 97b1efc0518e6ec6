"""The report of blind trials: failures first, limits, rates by stratum, and figures."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from scenarios.report import data_files, page
from scenarios.report.figures import BLUE, GREY, ORANGE, RED, save
from scenarios.studies.blind_trials.rates import (
    EQUAL,
    MARKS,
    MEANINGS,
    PairedAnswer,
    PairedRate,
    Rate,
    bars,
    by_arm,
    by_stratum,
    calibration,
    confusion,
    failures,
    paired_answers,
    paired_rates,
    wrong,
)
from scenarios.studies.blind_trials.score import ArmScore, TrialScore, TwinScore
from scenarios.studies.blind_trials.strata import STRATA
from scenarios.studies.sweep import Rows

# --- Tables ---------------------------------------------------------------------------

SHOWN = 60
"""Most failures that the page lists; all are in summary.json and trials.csv."""


def tables_of(scores: Sequence[TrialScore], rates: Sequence[Rate]) -> list[page.Block]:
    """Return the sections on failures, bars and strata, in this order."""
    bad = failures(scores)
    listed = [
        (s.label, ", ".join(s.truth) or "nothing", said(s), ", ".join(wrong(s)))
        for s in bad[:SHOWN]
    ]
    more = f", the first {SHOWN} of {len(bad)}" if len(bad) > SHOWN else ""
    marks = {m.replace("_", " "): _of(m) for m in MARKS}
    against = page.Table(
        f"Every trial that fails a bar{more}.",
        ("trial", "truth", "answer", "against"),
        listed,
    )
    return [
        page.Heading("Failures first"),
        against if listed else page.Paragraph("No trial fails a bar."),
        page.Heading("Bars"),
        page.Table(
            "Shares of trials with Clopper and Pearson's 95 % interval; kinds and "
            "marks are explained below.",
            ("what", "bar", "trials", "share", "interval", "met"),
            [_cells(r) for r in rates],
        ),
        page.Heading("Kinds of trials"),
        page.table_of(
            f"How many trials of each kind got each mark. {MEANINGS}",
            by_stratum(scores),
            {
                "kind": _of("stratum"),
                "what is there": lambda row: STRATA[str(row["stratum"])].said,
                "trials": _of("trials"),
                **marks,
                "failed": _of("failed"),
            },
        ),
        *of_arms(by_arm(scores)),
    ]


ARM_WORDS = (
    "Visible: effects of the vocabulary with an own χ² of 100 or more, which is lost "
    "when they alone are removed and all others are fitted again. False: neither the "
    "name nor one of its first three equivalents is true. Explained: share of the "
    "mismatch on poses kept back, in the linear model or by the proof; the oracle has "
    "all true names. Largest place: the place whose effects displace most beyond what "
    "is nominal was said first, or that of an equivalent there. Outside: the place of "
    "the mechanism outside the vocabulary was said to be unexplained. Lost: right "
    "names that the same arm without it got."
)


def of_arms(rows: Sequence[dict[str, Any]]) -> list[page.Block]:
    """Return the table of whole arms; nothing without any."""
    if not rows:
        return []
    columns: dict[str, Callable[[dict[str, Any]], str]] = {
        "kind": _of("stratum"),
        "trials": _of("trials"),
        "effects": _of("effects"),
        "visible ones named": lambda r: f"{r['visible_named']} of {r['visible']}",
        "names true": _of("names_true"),
        "false": _of("names_false"),
        "explained, median (least)": lambda r: (
            f"{r['explained_median']:.1%} ({r['explained_least']:.1%})"
        ),
        "oracle": lambda r: f"{r['oracle_median']:.1%}",
        "largest place": _of("place_first"),
        "outside": _of("outside_said"),
        "lost": _of("names_lost"),
        "intervals hold": lambda r: f"{r['intervals_hold']} of {r['intervals']}",
        "seconds": lambda r: f"{r['median_seconds']:.1f}",
    }
    return [page.Heading("Whole arms"), page.table_of(ARM_WORDS, rows, columns)]


def of_pairs(rows: Sequence[PairedRate]) -> list[page.Block]:
    """Return the table of the same trials in another run; nothing without any."""
    if not rows:
        return []
    words = (
        "The same trials in both runs. Lost and gained: trials whose mark is right in "
        "one of both alone; p: McNemar's, exact."
    )
    columns: dict[str, Callable[[PairedRate], str]] = {
        "kind": lambda r: r.stratum,
        "mark": lambda r: r.mark.replace("_", " "),
        "trials": lambda r: str(r.trials),
        "right before": lambda r: str(r.before),
        "right now": lambda r: str(r.after),
        "lost": lambda r: str(r.lost),
        "gained": lambda r: str(r.gained),
        "p": lambda r: f"{r.p_value:.2g}",
        "met": lambda r: "yes" if r.met else "NO",
    }
    return [
        page.Heading("Against the other run"),
        page.table_of(words, rows, columns),
    ]


def of_answers(answers: Sequence[PairedAnswer]) -> list[page.Block]:
    """Return what two runs answer otherwise to the same trials; nothing without any."""
    if not answers:
        return []
    other = [one for one in answers if one.differ]
    words = (
        f"Answers to the same trials that differ in the other run, {len(other)} of "
        f"{len(answers)}. Numbers: parameters, over their size or half their interval, "
        f"by more than {EQUAL:g}."
    )
    columns: dict[str, Callable[[PairedAnswer], str]] = {
        "trial": lambda one: one.trial,
        "differ": lambda one: ", ".join(one.differ),
        "largest difference": lambda one: f"{one.largest:.1g}",
    }
    heading = page.Heading("Answers in the other run")
    if not other:
        return [heading, page.Paragraph(f"All {len(answers)} answers are the same.")]
    return [heading, page.table_of(words, other, columns)]


def _of(key: str) -> Callable[[dict[str, Any]], str]:
    """Return a column: a row's entry of that name, a dash where it is None."""
    return lambda row: "–" if row[key] is None else str(row[key])


def of_probabilities(rows: Sequence[dict[str, Any]]) -> list[page.Block]:
    """Return figure and table of how often statements of a probability were true."""
    often = "How often a name is true against the probability that was stated for it"
    return [
        page.Figure(f"{often}, with 95 % intervals.", "calibration.png"),
        page.table_of(
            f"{often}, with Clopper and Pearson's interval.",
            rows,
            {
                "stated": lambda r: f"{r['from']:g} to {r['to']:g}",
                "on average": lambda r: f"{r['stated']:.3f}",
                "statements": _of("statements"),
                "true": lambda r: f"{r['true']:.1%}",
                "interval": lambda r: f"{r['low']:.1%} to {r['high']:.1%}",
            },
        ),
    ]


def said(s: TrialScore) -> str:
    """Return an answer's verdict and names, or its failure, in a few words."""
    return s.failed or f"{s.verdict}: {', '.join(s.named) or 'no name'}"


def _cells(r: Rate) -> tuple[str, ...]:
    if r.value is None or r.low is None or r.high is None:
        return (r.what, r.bar, "0", "–", "–", "not tried")
    interval = f"{r.low:.1%} to {r.high:.1%}"
    met = "yes" if r.met else "no"
    return (r.what, r.bar, str(r.trials), f"{r.value:.1%}", interval, met)


# --- Figures --------------------------------------------------------------------------

TableRows = Sequence[dict[str, object]]

LIGHT = 0.5
"""Share from which a cell is too dark for black digits; chosen."""
NOTHING, NO_NAME = "nothing", ("unexplained", "failed")
"""Answers that are not the name of an effect; they come after the names."""


def draw_confusion(rows: TableRows) -> Figure:
    """Draw how often each truth was answered by each name: right, none or another."""
    truths, answers = ({str(r[k]) for r in rows} for k in ("truth", "answer"))
    down = sorted(truths, key=lambda name: (name == NOTHING, name not in answers, name))
    shared = [name for name in down if name in answers]
    others = sorted(answers - truths - {NOTHING, *NO_NAME})
    last = [n for n in (NOTHING, *NO_NAME) if n in answers and n not in shared]
    across = [*shared, *others, *last]
    count = np.zeros((len(down), len(across)), dtype=int)
    for r in rows:
        at = down.index(str(r["truth"])), across.index(str(r["answer"]))
        count[at] += int(str(r["trials"]))
    share = count / count.sum(axis=1, keepdims=True)
    picture = np.ones((*count.shape, 3))
    for i, j in zip(*np.nonzero(count), strict=True):
        kind = GREY if across[j] in NO_NAME else RED
        full = np.array(to_rgb(ORANGE if across[j] == down[i] else kind))
        picture[i, j] = 1.0 - (0.25 + 0.75 * share[i, j]) * (1.0 - full)
    size = (2.7 + 0.3 * len(across), 2.2 + 0.28 * len(down))
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots()
    axes.imshow(picture, aspect="auto")
    for i, j in zip(*np.nonzero(count), strict=True):
        ink = "white" if share[i, j] > LIGHT else "black"
        axes.text(j, i, str(count[i, j]), color=ink, ha="center", va="center", size=8)
    words = [[name.replace("_", " ") for name in names] for names in (across, down)]
    axes.set_xticks(range(len(across)), words[0], rotation=90, fontsize=8)
    axes.set_yticks(range(len(down)), words[1], fontsize=8)
    axes.set_xticks(np.arange(0.5, len(across)), minor=True)
    axes.set_yticks(np.arange(0.5, len(down)), minor=True)
    axes.grid(visible=False)
    axes.grid(visible=True, which="minor")
    axes.tick_params(which="minor", length=0)
    axes.set_xlabel("what was said")
    axes.set_ylabel("what is true")
    return figure


def draw_calibration(rows: TableRows) -> Figure:
    """Draw how often statements are true against their probability."""
    stated, true, low, high = (
        np.array([float(str(r[k])) for r in rows])
        for k in ("stated", "true", "low", "high")
    )
    figure = Figure(figsize=(4.8, 4.4), layout="constrained")
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], color=GREY, lw=1, label="true as often as stated")
    reach = np.maximum([true - low, high - true], 0.0)
    look = {"fmt": "o", "color": ORANGE, "ecolor": BLUE, "capsize": 3}
    axes.errorbar(stated, true, reach, **look, label="names, 95 % interval")
    axes.set_xlabel("stated probability")
    axes.set_ylabel("share that is true")
    axes.legend(loc="upper left")
    return figure


# --- Another run ----------------------------------------------------------------------

TABLE = "trials.csv"
"""Marks of each trial, in the folder of a run."""


def faults_of_another_run(folder: Path, asked: Mapping[str, object]) -> list[str]:
    """Return why the trials of a folder are not those of some flags; empty: they are.

    Args:
        folder: Of the other run.
        asked: Values of the flags from which trials are drawn.
    """
    needed = (TABLE, "run.json")
    lacking = [name for name in needed if not (folder / name).is_file()]
    if lacking:
        return [f"--against {folder} is no run of blind trials: no {lacking[0]}."]
    told = json.loads((folder / "run.json").read_text(encoding="utf-8"))["settings"]
    return [
        f"--against {folder} has --{flag} {told[flag]}, this run {mine}: other trials."
        for flag, mine in asked.items()
        if told[flag] != mine
    ]


@dataclass(frozen=True)
class AnotherRun:
    """Marks of, and answers to, the same trials in another run; both may be empty."""

    rates: Sequence[PairedRate] = ()
    answers: Sequence[PairedAnswer] = ()


ALONE = AnotherRun()
"""No other run."""


def another_run(
    folder: Path | None, scores: Sequence[TrialScore], rows: Rows
) -> AnotherRun:
    """Compare a run with another of the same trials; a run without rows by its marks.

    Args:
        folder: Of the other run; None: with none.
        scores: Of this one.
        rows: Finished trials of this one.
    """
    if folder is None:
        return ALONE
    rates = paired_rates(scores, data_files.read_table(folder / TABLE))
    others = Rows(folder / rows.folder.name).read()
    return AnotherRun(rates, paired_answers(rows.read(), others))


# --- The report -----------------------------------------------------------------------


def write(
    out: Path,
    scores: Sequence[TrialScore],
    facts: dict[str, object],
    other: AnotherRun = ALONE,
) -> None:
    """Write summary.json, tables, pictures and the page, with another run beside it."""
    rates, calibrated = bars(scores), calibration(scores)
    matrix = confusion(scores)
    summary = facts | {
        "trials": len(scores),
        "failures": [_entry(s) for s in failures(scores)],
        "bars": [asdict(r) for r in rates],
        "strata": by_stratum(scores),
        "whole_arms": by_arm(scores),
        "calibration": calibrated,
        "against": [asdict(r) for r in other.rates],
        "answers_against": [asdict(one) for one in other.answers],
    }
    text = json.dumps(summary, indent=2, ensure_ascii=False)
    (out / "summary.json").write_text(text + "\n", encoding="utf-8")
    data_files.write_table(out / TABLE, [_row(s) for s in scores])
    arms = [_row_of_arm(s, s.arm) for s in scores if s.arm is not None]
    twins = [_row_of_twin(s, s.twin) for s in scores if s.twin is not None]
    for name, rows in (("arms", arms), ("twins", twins)):
        if rows:
            data_files.write_table(out / f"{name}.csv", rows)
    blocks = [
        *tables_of(scores, rates),
        *of_pairs(other.rates),
        *of_answers(other.answers),
    ]
    if matrix:
        data_files.write_table(out / "confusion.csv", matrix)
        save(draw_confusion(matrix), out / "confusion.png")
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
        data_files.write_table(out / "calibration.csv", calibrated)
        save(draw_calibration(calibrated), out / "calibration.png")
        blocks += of_probabilities(calibrated)
    page.write(out, "Blind trials", _headline(scores, rates), blocks)


def _headline(scores: Sequence[TrialScore], rates: Sequence[Rate]) -> str:
    counted = [r for r in rates if r.met is not None]
    met = sum(bool(r.met) for r in counted)
    return (
        f"{len(scores)} concealed trials; {met} of {len(counted)} bars are met, "
        f"{len(failures(scores))} trials fail one."
    )


def _entry(s: TrialScore) -> dict[str, object]:
    return {
        "trial": s.label,
        "name": s.name,
        "truth": s.truth,
        "chi2": s.chi2,
        "answer": said(s),
        "against": wrong(s),
    }


def _row(s: TrialScore) -> dict[str, object]:
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


def _row_of_arm(s: TrialScore, arm: ArmScore) -> dict[str, object]:
    return {
        "trial": s.label,
        "visible": len(arm.visible),
        "visible_missed": " ".join(n for n, hit in arm.visible if not hit),
        "names": len(arm.names),
        "names_false": " ".join(n for n, hit in arm.names if not hit),
        "explained": arm.share,
        "oracle": arm.oracle,
        "largest_place_first": int(arm.place_first),
        "outside_said": None if arm.outside is None else int(arm.outside),
        "seconds": s.seconds,
    }


def _row_of_twin(s: TrialScore, twin: TwinScore) -> dict[str, object]:
    return {
        "trial": s.label,
        "truth": " ".join(s.truth),
        "log_bayes_factor": twin.log_bayes_factor,
        "declared": int(twin.declared),
    }


# --- The terminal ---------------------------------------------------------------------


def print_summary(scores: list[TrialScore], other: AnotherRun, out: Path) -> None:
    """Print the trials that failed, what another run answers, where the report is."""
    for one in failures(scores):
        print(f"{one.label}: {', '.join(one.truth) or 'nothing'} -> "
              f"{one.failed or one.verdict} {', '.join(one.named)}")  # fmt: skip
    for r in bars(scores):
        if r.value is not None:
            met = "met" if r.met else "MISSED"
            span = f"{r.low:.3f} to {r.high:.3f}"
            print(f"{met:6} {r.what}: {r.successes}/{r.trials} ({span}), bar {r.bar}")
    if other.answers:
        same = sum(not one.differ for one in other.answers)
        largest = max(one.largest for one in other.answers)
        print(f"Answers as in the other run: {same} of {len(other.answers)}; numbers "
              f"differ by up to {largest:.1g}")  # fmt: skip
    print(out / "report.html")
