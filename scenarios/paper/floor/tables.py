"""How far every method comes on the way to the floor, as a table and in words."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from scenarios.reporting import page


def shown(rows: Sequence[Mapping]) -> page.Table:
    """Return every method's error and its share of the way, as a table."""
    caption = (
        f"Errors over all directions on {rows[0]['n']} fresh poses, seed "
        f"{rows[0]['seeds']} [mm]; intervals over poses"
    )
    header = ["method", "MAE", "95 % interval", "share of the way [%]", "interval"]
    cells = [
        [
            str(r["method"]),
            f"{r['MAE_mm']:.4f}",
            f"{r['low_mm']:.4f} to {r['high_mm']:.4f}",
            f"{100 * r['share_of_the_way']:.0f}",
            f"{100 * r['share_low']:.0f} to {100 * r['share_high']:.0f}",
        ]
        for r in rows
    ]
    return page.Table(caption, header, cells)


def summary(rows: Sequence[Mapping]) -> str:
    """Say how far each method comes."""
    mae = {r["method"]: r["MAE_mm"] for r in rows}
    way = [
        f"{r['method']} {100 * r['share_of_the_way']:.0f} %"
        for r in rows
        if r["method"] not in ("VJM", "oracle")
    ]
    return (
        f"Springs leave {mae['VJM']:.4f} mm on fresh poses, one who knows the truth's "
        f"form {mae['oracle']:.4f} mm. Of the way between them go: {', '.join(way)}."
    )


def finding(
    rows: Sequence[Mapping],
    errors: Mapping[str, Float[np.ndarray, "poses 3"]],
    place: Float[np.ndarray, "poses 3"],
) -> str:
    """Say what the picture shows: who comes furthest, and where each method fails.

    Args:
        rows: With the shares of the way.
        errors: Of each method on each pose, in mm; the oracle last.
        place: Of the flange, in m.
    """
    learnt = [r for r in rows if r["method"] not in ("VJM", "oracle")]
    best = max(learnt, key=lambda r: r["share_of_the_way"])
    far = np.argsort(np.linalg.norm(place, axis=1))
    quarter = max(len(far) // 4, 1)
    size = {name: np.abs(error).mean(axis=1) for name, error in errors.items()}
    times = ", ".join(
        f"{name} {s[far[-quarter:]].mean() / s[far[:quarter]].mean():.1f}"
        for name, s in list(size.items())[:-1]
    )
    return (
        f"{best['method']} comes furthest, {100 * best['share_of_the_way']:.0f} % of "
        f"the way from the springs to the oracle (left, with 95 % intervals over "
        f"{rows[0]['n']} fresh poses). Right: mean error of each pose at the place of "
        "the flange, seen from the side; in the quarter of poses furthest from the "
        f"foot it is so many times that in the nearest quarter: {times}."
    )
