"""What a reader should know of the data is said once, in plain sentences."""

import numpy as np

from stiffness.diagnosis.detect import FEWEST, MEASURED
from stiffness.diagnosis.diagnosis import Warned
from stiffness.diagnosis.prepare import Prepared

ODD = 1.1
"""Measured over stated noise from which it is said; chosen: a tenth."""
SCATTER = "scatter"
"""Code of the remark that poses differ more than anything stated allows."""


def remarks(prepared: Prepared) -> tuple[Warned, ...]:
    """Return what is remarkable but no mistake."""
    said = []
    poses = int(prepared.situation.pose.max()) + 1
    if poses < FEWEST:
        text = (
            f"in {poses} poses only what is far beyond the stated noise can show: "
            f"bring {FEWEST} at least, forty to be told of small effects."
        )
        said.append(Warned("few_poses", "rig", text))
    if prepared.noise > ODD or prepared.noise < 1.0 / ODD:
        text = (
            f"readings scatter {prepared.noise:.2f} times as much as the tracker "
            f"states ({prepared.freedom} contrasts); the measured noise was used."
        )
        said.append(Warned("noise_misstated", "tracker", text))
    if prepared.doubtful:
        count = len(prepared.doubtful)
        text = f"{count} readings lie far beyond the noise and counted less."
        said.append(Warned("outliers", "tracker", text))
    for k in prepared.blind:
        text = f"the stiffness of a{k + 1} cannot be seen and was left at the model's."
        said.append(Warned("not_identifiable", f"a{k + 1}", text))
    return tuple(said)


def scattered(dispersion: float) -> tuple[Warned, ...]:
    """Return the remark that poses differ at random, by more than errors explain.

    A law that changes its sign from pose to pose (a stiffness that another axis' angle
    governs) averages out of every column, and random signs leave it as it is.

    Args:
        dispersion: Variance of the map's scores over that of the stated errors.
    """
    if dispersion < MEASURED:
        return ()
    text = (
        f"poses differ {np.sqrt(dispersion):.1f} times as much as the stated errors "
        "make them, after no law that was tried. Either errors are larger than stated, "
        "or something is left out that depends on what is not looked at."
    )
    return (Warned(SCATTER, "rig", text),)
