"""The study in a paragraph: what six springs leave, and what learning takes off it."""

from collections.abc import Mapping, Sequence

import numpy as np

from scenarios.paper.linear_fit.fit import LinearFit
from scenarios.paper.transfer.comparison import Contender
from scenarios.paper.transfer.perceptron_cell import PerceptronCell
from scenarios.paper.work.cells import Cell, Result


def summary(
    found: LinearFit, methods: Sequence[Contender], results: Mapping[Cell, Result]
) -> str:
    """Return what was found in some sentences."""
    return " ".join([_springs(found), _pretrained(results), *_learnt(methods)])


def _springs(found: LinearFit) -> str:
    mae = {s.direction: s for s in found.scores["vjm"] if s.metric == "MAE"}
    floor = {s.direction: s for s in found.floor if s.metric == "MAE"}
    parts = [
        f"{d.upper()} {mae[d].value_mm:.3f} mm ({mae[d].low_mm:.3f} to "
        f"{mae[d].high_mm:.3f}; floor {floor[d].value_mm:.4f})"
        for d in mae
    ]
    times = np.mean([mae[d].value_mm / floor[d].value_mm for d in mae])
    return (
        f"Six linear springs fitted to {mae['x'].n} postures leave a mean absolute "
        f"error of {', '.join(parts)}: {times:.1f} times what the instruments alone "
        "would leave."
    )


def _pretrained(results: Mapping[Cell, Result]) -> str:
    parts = []
    for plan in sorted({c.plan for c in results if isinstance(c, PerceptronCell)}):
        test = [
            r["errors"][1, 0].mean()
            for c, r in results.items()
            if isinstance(c, PerceptronCell) and c.plan == plan
        ]
        seeds = "one seed" if len(test) == 1 else f"{len(test)} seeds"
        parts.append(f"{np.mean(test):.4f} mm ({plan} plan, {seeds})")
    return (
        "Pre-trained to imitate the springs, the network's test MAE over the three "
        f"directions is {' and '.join(parts)}; the paper's is 0.1199 mm."
    )


def _learnt(methods: Sequence[Contender]) -> list[str]:
    """Say by how much every method differs from the springs on fresh poses."""
    springs, said = methods[0], []
    for c in methods[1:]:
        if c.method in ("pretrained", "aligned", "frozen"):
            continue
        change = c.overall().change_from(springs.overall()).interval
        value, low, high = (
            f"{100 * end:+.0f}" for end in (change.value, change.low, change.high)
        )
        said.append(f"{c.name} {value} % ({low} to {high})")
    return [
        f"On {springs.unseen.shape[1]} fresh postures (seeds: "
        f"{', '.join(map(str, springs.seeds))}; 95 % intervals) MAE over all "
        f"directions differs from the springs' by: {'; '.join(said)}."
    ]
