"""How a network was trained is a curve over its steps."""

from dataclasses import dataclass

import numpy as np
import rerun as rr
from jaxtyping import Float

from scenarios.paper.transfer.convolution_cell import ConvolutionCell
from scenarios.paper.transfer.perceptron_cell import PerceptronCell
from scenarios.paper.work.cells import Cell, Result

STEP = "step"
LEARNT = ("learnt", "held_back")


@dataclass(frozen=True)
class Curve:
    """One training.

    Attributes:
        name: Of the network; a path of a recording.
        step: Steps or epochs that are done.
        value: Loss, or error in mm.
    """

    name: str
    step: Float[np.ndarray, " points"]
    value: Float[np.ndarray, " points"]


def curves(cell: Cell, result: Result) -> list[Curve]:
    """Return the trainings of a cell that the study's comparison rests on."""
    if not isinstance(cell, PerceptronCell | ConvolutionCell):
        return []
    kind = "ft_mlp" if isinstance(cell, PerceptronCell) else "dt_cnn"
    name = f"{kind}/{cell.plan.replace(' ', '_')}/seed_{cell.seed}"
    found = [Curve(f"loss/{name}", result["step"], result["loss"])]
    if "best/curve" in result:
        epoch = np.arange(1.0, 1.0 + result["best/curve"].shape[1])
        for part, value in zip(LEARNT, result["best/curve"], strict=True):
            found.append(Curve(f"tuning_mae_mm/{name}/{part}", epoch, value))
    return found


def show(recording: rr.RecordingStream, curve: Curve) -> None:
    """Log a curve on the timeline of steps."""
    path = f"/training/{curve.name}"
    recording.send_columns(
        path,
        indexes=[rr.TimeColumn(STEP, sequence=curve.step.astype(int))],
        columns=rr.Scalars.columns(scalars=curve.value),
    )
    recording.log(path, rr.SeriesLines(names=curve.name), static=True)
