"""How much better than springs a method is, in per cent, with an interval."""

from collections.abc import Mapping, Sequence

from scenarios.paper.transfer.comparison import Contender
from scenarios.paper.transfer.pooled import MEASURES
from scenarios.reporting.page import Table
from stiffness.intervals import Interval
from stiffness.score import DIRECTIONS

GAINS = {
    "MAE": (0.414, 0.431, 0.249),
    "STDE_signed": (0.318, 0.392, 0.142),
    "ME": (0.077, 0.209, 0.439),
}
"""What FT-MLP takes off the VJM's error in the paper's Table 10 in x, y, z; MAE and
STDE as its text says, ME as its table prints (its text says 8.5, 21.7 and 44.2 %)."""
BARS = {"MAE": 0.249, "STDE_absolute": 0.142, "STDE_signed": 0.142, "P99": 0.077}
"""The paper's least gain of any direction; that in ME is asked of the 99th percentile,
for a largest error hangs on a single pose."""
CALLED = {"STDE_absolute": "STDE, absolute", "STDE_signed": "STDE, signed"}
SURELY, YES, NO = "surely", "yes", "no"


def gain_rows(c: Contender, springs: Contender) -> list[dict[str, object]]:
    """Return by how many per cent a method's errors differ from the springs'."""
    rows = []
    for k, direction in enumerate(DIRECTIONS):
        for metric in MEASURES:
            change = c.draws(k, metric).change_from(springs.draws(k, metric)).interval
            tuned = c.method == "ft_mlp"
            paper = -100 * GAINS[metric][k] if tuned and metric in GAINS else None
            bar = -100 * BARS[metric] if tuned and metric in BARS else None
            rows.append(
                {
                    "method": c.method,
                    "plan": c.plan,
                    "direction": direction,
                    "metric": metric,
                    "change_percent": 100 * change.value,
                    "low_percent": 100 * change.low,
                    "high_percent": 100 * change.high,
                    "paper_percent": paper,
                    "bar_percent": bar,
                    "reached": None if bar is None else _reached(change, bar / 100),
                    "n": c.unseen.shape[1],
                    "seeds": " ".join(map(str, c.seeds)),
                }
            )
    return rows


def gains(tuned: Sequence[Contender], springs: Contender) -> Table:
    """Return a table of FT-MLP's gains over the springs, beside the paper's."""
    rows = []
    for c in tuned:
        for row in gain_rows(c, springs):
            if row["bar_percent"] is not None:
                rows.append(
                    (
                        c.plan,
                        str(row["direction"]).upper(),
                        _called(row),
                        f"{row['change_percent']:+.1f}",
                        f"{row['low_percent']:+.1f} to {row['high_percent']:+.1f}",
                        _percent(row["paper_percent"]),
                        _percent(row["bar_percent"]),
                        str(row["reached"]),
                    )
                )
    return Table(
        f"FT-MLP's error against the VJM's on {springs.unseen.shape[1]} fresh poses, "
        f"seeds: {_seeds(tuned)}; in per cent, negative is better. The bar is the "
        "paper's least gain in any direction; surely: the whole interval is below.",
        ("plan", "", "measure", "change", "95 % interval", "paper", "bar", "reached"),
        rows,
    )


def _seeds(tuned: Sequence[Contender]) -> str:
    each = [", ".join(map(str, c.seeds)) for c in tuned]
    if len(set(each)) == 1:
        return each[0]
    return "; ".join(f"{s} ({c.plan})" for s, c in zip(each, tuned, strict=True))


def verdict(tuned: Sequence[Contender], springs: Contender) -> str:
    """Say in words whether the paper's gains are reached, and what is missed."""
    said = [
        "The paper's least gains over the springs are 24.9 % in MAE, 14.2 % in STDE "
        "and 7.7 % in ME, which is asked of the 99th percentile here; judged on "
        f"{springs.unseen.shape[1]} fresh poses of the experiment's region."
    ]
    for c in tuned:
        rows = gain_rows(c, springs)
        rows = [row for row in rows if row["reached"] is not None]
        missed = [row for row in rows if row["reached"] == NO]
        surely = sum(row["reached"] == SURELY for row in rows)
        reached, seeds = len(rows) - len(missed), len(c.seeds)
        count = "one seed" if seeds == 1 else f"{seeds} seeds"
        text = f"Pre-trained on the {c.plan} plan ({count}) FT-MLP reaches "
        if reached == 0:
            text += f"none of these {len(rows)} gains"
        else:
            text += (
                f"{reached} of these {len(rows)} gains, {surely} of them with the "
                "whole interval"
            )
        if 0 < len(missed) < len(rows):
            text += f"; it misses {', '.join(_missed(row) for row in missed)}"
        said.append(f"{text}.")
    return " ".join(said)


def finding(tuned: Sequence[Contender], springs: Contender) -> str:
    """Say in one sentence what the two plans make of FT-MLP."""
    parts = []
    for c in tuned:
        change = [
            100 * c.draws(k, "MAE").change_from(springs.draws(k, "MAE")).value
            for k in range(3)
        ]
        x, y, z = (f"{value:+.0f}" for value in change)
        parts.append(f"{x}, {y}, {z} % where pre-trained on the {c.plan} plan")
    return (
        "Errors of VJM and FT-MLP on fresh poses (the paper's Fig. 9): MAE changes in "
        f"X, Y, Z by {'; '.join(parts)}. Bars: 95 % intervals over "
        f"{springs.unseen.shape[1]} poses and {len(springs.seeds)} "
        f"seed{'s' * (len(springs.seeds) > 1)}."
    )


def _reached(change: Interval, bar: float) -> str:
    if change.value > bar:
        return NO
    return SURELY if change.high <= bar else YES


def _called(row: Mapping[str, object]) -> str:
    return CALLED.get(str(row["metric"]), str(row["metric"]))


def _missed(row: Mapping[str, object]) -> str:
    return (
        f"{_called(row)} in {str(row['direction']).upper()} ("
        f"{row['change_percent']:+.0f} %, {row['low_percent']:+.0f} to "
        f"{row['high_percent']:+.0f})"
    )


def _percent(value: object) -> str:
    return "" if value is None else f"{value:+.1f}"
