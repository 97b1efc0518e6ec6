"""What few poses teach, as tables and in words; every draw counts for itself."""

from collections.abc import Mapping, Sequence

import numpy as np

from scenarios.paper.transfer.comparison import TITLES
from scenarios.paper.work.cells import Result
from scenarios.reporting import page

METHODS = ("vjm", "ft_mlp", "dt_cnn", "gp_residual")


def tidy(
    found: Mapping[int, Mapping[int, Result]], fresh: int
) -> list[dict[str, object]]:
    """Return one row a number.

    Args:
        found: What cells found, by number of poses and by draw; not every draw has
            every method.
        fresh: How many poses it was judged on.
    """
    rows: list[dict[str, object]] = []
    for count, draws in found.items():
        for method in METHODS:
            mine = [result for result in draws.values() if method in result]
            if not mine:
                continue
            size = np.abs([result[method] for result in mine])  # (draws, poses, 3) mm
            springs = np.abs([result["vjm"] for result in mine])
            for metric, of_draws in (("MAE", _mae), ("P99", _p99)):
                value, beside = of_draws(size), of_draws(springs)
                rows.append(
                    {
                        "poses": count,
                        "method": method,
                        "metric": metric,
                        "value_mm": float(value.mean()),
                        "low_mm": float(value.min()),
                        "high_mm": float(value.max()),
                        "springs_of_same_draws_mm": float(beside.mean()),
                        "better_than_springs": int((value < beside).sum()),
                        "held_axes": float(np.mean([r["held"].sum() for r in mine])),
                        "n": fresh,
                        "draws": len(mine),
                        "plan": "spanning",
                    }
                )
    return rows


def _mae(size: np.ndarray) -> np.ndarray:
    return size.mean(axis=(1, 2))


def _p99(size: np.ndarray) -> np.ndarray:
    return np.quantile(size, 0.99, axis=1).mean(axis=1)


def of(rows: Sequence[Mapping], method: str, metric: str = "MAE") -> list[Mapping]:
    """Return the rows of a method, one a number of poses."""
    return [r for r in rows if (r["method"], r["metric"]) == (method, metric)]


def errors(rows: Sequence[Mapping]) -> page.Table:
    """Return the table of all methods."""
    shown = [method for method in METHODS if of(rows, method)]
    cells = []
    for beside in zip(*(of(rows, method) for method in shown), strict=True):
        springs = beside[0]
        texts = [_ranged(springs)]
        texts += [
            f"{_ranged(r)}, {r['better_than_springs']} of {r['draws']}"
            for r in beside[1:]
        ]
        held = f"{springs['held_axes']:.1f}"
        cells.append([str(springs["poses"]), held, *texts])
    drawn = "; ".join(f"{TITLES[m]} {of(rows, m)[0]['draws']}" for m in shown)
    caption = (
        f"MAE over x, y and z on {rows[0]['n']} fresh poses [mm]: mean and range of "
        "the draws of the poses learnt from, and in how many of them a method was "
        f"better than the springs of the same draw. Draws: {drawn}. Axes held: how "
        "many of the six springs were taken from the model file, on average."
    )
    header = ["poses", "axes held", *(TITLES[method] for method in shown)]
    return page.Table(caption, header, cells)


def summary(rows: Sequence[Mapping]) -> str:
    """Say from how many poses on a method is better than the springs."""
    springs = of(rows, "vjm")
    most, fewest = springs[-1], springs[0]
    enough = next(r for r in springs if r["value_mm"] <= 1.1 * most["value_mm"])
    said = []
    for method in METHODS[1:]:
        mine = of(rows, method)
        if not mine:
            continue
        in_all = [r["better_than_springs"] == r["draws"] for r in mine]
        on_average = [r["value_mm"] < r["springs_of_same_draws_mm"] for r in mine]
        said.append(
            f"{TITLES[method]} on average {_from(mine, on_average)}, in each of "
            f"{mine[0]['draws']} draws {_from(mine, in_all)}"
        )
    return (
        f"With {fewest['poses']} poses the springs leave {fewest['value_mm']:.3f} mm "
        f"on fresh ones ({fewest['held_axes']:.1f} axes held on average), with "
        f"{most['poses']} {most['value_mm']:.3f} mm; from {enough['poses']} on they "
        f"are within 10 % of that. Better than springs: {'; '.join(said)}."
    )


def _from(rows: Sequence[Mapping], better: Sequence[bool]) -> str:
    worse = np.flatnonzero(~np.array(better))
    first = 0 if len(worse) == 0 else worse[-1] + 1  # better from here to the last
    return f"from {rows[first]['poses']} poses" if first < len(rows) else "never"


def _ranged(row: Mapping) -> str:
    return f"{row['value_mm']:.3f} ({row['low_mm']:.3f} to {row['high_mm']:.3f})"
