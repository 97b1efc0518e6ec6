"""What the tables of imitation show, in words that follow from their numbers."""

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from scenarios.paper.imitation.cells import Imitation
from scenarios.paper.imitation.rows import (
    MAE,
    Found,
    errors_of,
    mean_of,
    spread_of,
)

TEST = 1


def best_of(rows: Mapping, found: Found, theirs: object) -> str:
    """Say which row tests best, which cannot be told from it, and the paper's best."""
    mae = {name: mean_of(cells, found)[TEST, MAE] for name, cells in rows.items()}
    best = min(mae, key=lambda name: mae[name])
    said = f"least test MAE: {best} here, {theirs} in the paper"
    seeds = len(rows[best])
    if seeds == 1:
        return f"{said}; one seed cannot tell close ones apart"
    high = spread_of(rows[best], found)[1, TEST, MAE]
    alike = [
        str(name)
        for name, cells in rows.items()
        if name != best and spread_of(cells, found)[0, TEST, MAE] <= high
    ]
    if not alike:
        return f"{said}; no seed of another comes as near"
    return f"{said}; over the seeds {', '.join(alike)} cannot be told from it"


def of_widths(widths: Mapping[tuple[int, int], Imitation], found: Found) -> str:
    """Say at which width each depth tests best."""
    parts = []
    for depth in sorted({d for d, _ in widths}):
        mae = {
            w: errors_of(found[cell])[TEST, MAE]
            for (d, w), cell in widths.items()
            if d == depth
        }
        best = min(mae, key=lambda w: mae[w])
        parts.append(f"{best} neurons at {depth} hidden layers ({mae[best]:.4f} mm)")
    widest = max(w for _, w in widths)
    return f"of up to {widest} tried, least test MAE with {', '.join(parts)}"


def of_end(loss: Float[np.ndarray, " points"]) -> str:
    """Say what the last fifth of the steps takes off the loss."""
    fifth = max(len(loss) // 5, 1)
    few = max(fifth // 4, 1)
    end, before = np.mean(loss[-few:]), np.mean(loss[-fifth - few : -fifth or None])
    change = 100 * (end / before - 1)
    return f"the last fifth of the steps changes the loss by {change:+.0f} %"


def of_doubling(longer: Mapping[int, Sequence[Imitation]], found: Found) -> str:
    """Say from how many steps on doubling moves the test MAE by less than the seeds."""
    steps = sorted(longer)
    mae = {s: mean_of(longer[s], found)[TEST, MAE] for s in steps}
    spread = {s: np.ptp(spread_of(longer[s], found)[:, TEST, MAE]) for s in steps}
    moved = {
        few: (many, mae[many] - mae[few], max(spread[few], spread[many]))
        for few, many in pairwise(steps)
    }
    still = [few for few, (_, by, seeds) in moved.items() if abs(by) >= seeds]
    first = steps.index(still[-1]) + 1 if still else 0  # from here to the last
    few = steps[min(first, len(steps) - 2)]
    many, by, seeds = moved[few]
    verdict = "not even {} are enough" if few in still else "{} are enough"
    return (
        f"{verdict.format(few)}: {many} move the test MAE by {by:+.4f} mm, the seeds "
        f"spread by {seeds:.4f} mm"
    )
