"""Errors under loads as in the experiment, and under others, as tables."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from scenarios.paper.pooled import MEASURES, pooled


def tidy(
    errors: Mapping[str, Float[np.ndarray, "seeds poses 3"]],
    loads: Sequence[str],
    seeds: Sequence[int],
) -> list[dict[str, object]]:
    """Return a row for every method, kind of loads and measure.

    Args:
        errors: Of each method, in mm; the second half of the poses is loaded otherwise.
        loads: What both kinds are called.
        seeds: Of the methods; one with fewer has the first of them.
    """
    rows = []
    for method, error in errors.items():
        n = error.shape[1] // 2
        for load, part in zip(loads, (slice(n), slice(n, None)), strict=True):
            size = np.abs(error[:, part]).mean(axis=2)  # (seeds, poses) mm
            for metric in ("MAE", "P99"):
                interval = pooled(size, MEASURES[metric]).interval
                rows.append(
                    {
                        "method": method,
                        "loads": load,
                        "metric": metric,
                        "value_mm": interval.value,
                        "low_mm": interval.low,
                        "high_mm": interval.high,
                        "n": n,
                        "seeds": " ".join(map(str, seeds[: len(error)])),
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
