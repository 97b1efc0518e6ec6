"""Errors under loads as in the experiment, and under others, as tables."""

from collections.abc import Sequence

import numpy as np

from scenarios.paper.transfer.comparison import Contender
from scenarios.paper.transfer.pooled import MEASURES, pooled


def tidy(methods: Sequence[Contender], loads: Sequence[str]) -> list[dict[str, object]]:
    """Return a row for every method, kind of loads and measure.

    Args:
        methods: The second half of their fresh poses is loaded otherwise.
        loads: What both kinds are called.
    """
    rows = []
    for c in methods:
        error, n = c.unseen, c.unseen.shape[1] // 2
        for load, part in zip(loads, (slice(n), slice(n, None)), strict=True):
            size = np.abs(error[:, part]).mean(axis=2)  # (seeds, poses) mm
            for metric in ("MAE", "P99"):
                interval = pooled(size, MEASURES[metric]).interval
                rows.append(
                    {
                        "method": c.name,
                        "loads": load,
                        "metric": metric,
                        "value_mm": interval.value,
                        "low_mm": interval.low,
                        "high_mm": interval.high,
                        "n": n,
                        "seeds": " ".join(map(str, c.seeds)),
                    }
                )
    return rows


def shown(rows: Sequence[dict]) -> tuple[list[str], list[list[str]]]:
    """Return header and cells of the report's table."""
    header = ["method", "loads", "measure", "value", "95 % interval"]
    names = ("method", "loads", "metric")
    return header, [
        [str(r[name]) for name in names]
        + [f"{r['value_mm']:.3f}", f"{r['low_mm']:.3f} to {r['high_mm']:.3f}"]
        for r in rows
    ]


def finding(rows: Sequence[dict]) -> str:
    """Say who errs least under either kind of loads, and what other loads cost."""
    kinds = dict.fromkeys(r["loads"] for r in rows)
    mae = {
        load: {
            r["method"]: r["value_mm"]
            for r in rows
            if r["metric"] == "MAE" and r["loads"] == load
        }
        for load in kinds
    }
    least = " and ".join(
        f"{min(m, key=m.__getitem__)} {load} ({min(m.values()):.3f} mm)"
        for load, m in mae.items()
    )
    used, other = mae.values()
    grows = ", ".join(f"{name} {other[name] / used[name]:.1f}" for name in used)
    return f"Least wrong: {least}. Times the error in other directions: {grows}."
