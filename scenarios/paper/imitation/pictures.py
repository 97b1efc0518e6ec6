"""Fig. 5 of the paper: width, depth, and how the loss falls."""

from collections.abc import Mapping
from pathlib import Path

from matplotlib.figure import Figure as Picture

from scenarios.paper.imitation.cells import Imitation
from scenarios.paper.work.cells import Cell, Result
from scenarios.reporting import style

COLOURS = (style.GREY, style.ORANGE, style.BLUE)


def figure_05(
    widths: Mapping[tuple[int, int], Imitation],
    found: Mapping[Cell, Result],
    curve: Imitation,
    file: Path,
) -> None:
    """Draw test MAE and STDE over the width, and one loss curve."""
    picture = Picture(figsize=(11, 3.6), layout="constrained")
    mae, stde, loss = picture.subplots(1, 3)
    for colour, depth in zip(COLOURS, sorted({d for d, _ in widths}), strict=False):
        chosen = {
            w: found[c]["errors"][1] for (d, w), c in widths.items() if d == depth
        }
        for axes, measure in ((mae, 0), (stde, 1)):
            value = [errors[measure].mean() for errors in chosen.values()]
            axes.plot(list(chosen), value, "o-", ms=4, color=colour, label=f"{depth}")
    for axes, name in ((mae, "test MAE [mm]"), (stde, "test STDE [mm]")):
        axes.set_xlabel("neurons a layer")
        axes.set_ylabel(name)
        axes.set_ylim(bottom=0.0)
    mae.legend(title="hidden layers")
    result = found[curve]
    loss.plot(result["step"], result["loss"], color=style.ORANGE)
    loss.set_yscale("log")
    loss.set_xlabel("step of 256 rows")
    loss.set_ylabel("loss [no unit]")
    style.save(picture, file)
