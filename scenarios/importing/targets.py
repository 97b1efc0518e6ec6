"""A target that is measured in 6D is four points that move together.

==========  ==========================================================================
Equation    p_i = p + R e_i, e_0 = 0, e_i = arm along the target's own axes
Source      the format: a 6D target is four markers that share their name
Valid       positions and turns in the tracker's frame; angles as Euler's, capital
            letters about axes that turn along (ZYX: Rz Ry Rx), small ones about fixed
Ignores     that position and turn may have different noise: choose arm_mm as the noise
            of positions over the noise of turns
==========  ==========================================================================
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from bench.format.columns import COORDINATES
from scenarios.importing.mapping import Target

ENDS = ("o", "x", "y", "z")


def markers_of(targets: Mapping[str, Target]) -> dict[str, dict[str, Any]]:
    """Return the manifest's entries of the markers that stand for targets."""
    return {
        f"{name}_{end}": {"body": target.body, "target": name}
        for name, target in targets.items()
        for end in ENDS
    }


def points_of(
    name: str, target: Target, column: Callable[[str], np.ndarray]
) -> dict[str, Float[np.ndarray, " rows"]]:
    """Return the columns of a target's four markers, in mm.

    Args:
        name: Of the target.
        target: Where its columns are.
        column: Gives a column of the file as numbers, NaN where it was not seen.
    """
    scale = 1.0 if target.length_unit == "mm" else 1e3
    position = scale * np.stack([column(c) for c in target.position], axis=1)
    turn = np.full((len(position), 3, 3), np.nan)
    if target.quaternion_wxyz is not None:
        values = np.stack([column(c) for c in target.quaternion_wxyz], axis=1)
        seen = np.isfinite(values).all(axis=1) & (np.linalg.norm(values, axis=1) > 0.5)
        turn[seen] = Rotation.from_quat(values[seen], scalar_first=True).as_matrix()
    else:
        assert target.rotation is not None
        values = np.stack([column(c) for c in target.rotation], axis=1)
        seen = np.isfinite(values).all(axis=1)
        degrees = target.angle_unit == "deg"
        turned = Rotation.from_euler(target.order, values[seen], degrees=degrees)
        turn[seen] = turned.as_matrix()
    arms = target.arm_mm * np.concatenate([np.zeros((1, 3)), np.eye(3)])
    points = position[:, None] + np.einsum("rij,ej->rei", turn, arms)
    return {
        f"{name}_{end}{coordinate}": points[:, e, i]
        for e, end in enumerate(ENDS)
        for i, coordinate in enumerate(COORDINATES)
    }
