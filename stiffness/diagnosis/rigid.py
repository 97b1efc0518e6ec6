"""Three or more markers of a body show its motion; what is left over is noise.

==========  ==========================================================================
Equation    y_mr = rest_m + G_m xi_r + noise: least squares over rest_m and xi_r of one
            body and visit; degrees of freedom: coordinates - 3 M - 6 (R - 1)
Source      least squares; "pure error" of a lack-of-fit test
Valid       bodies that stay rigid, three markers not on a line
Ignores     which rows a marker was missing in, when freedoms are counted
==========  ==========================================================================
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from stiffness.diagnosis.signature import levers

ENOUGH = 3
"""Markers that fix a body's motion."""
SWEEPS = 5
"""Rest positions and motions are fitted in turn so often; chosen: each sweep gains a
factor of rows."""


def rigid_motion(
    residual: Float[np.ndarray, "visits rows markers 3"],
    weight: Float[np.ndarray, "visits rows markers"],
    inverse: Float[np.ndarray, "3 3"],
    point: Float[np.ndarray, "visits markers 3"],
    body: Int[np.ndarray, " markers"],
) -> tuple[
    Float[np.ndarray, "visits rows markers 3"],
    Bool[np.ndarray, "visits rows markers"],
    float,
]:
    """Fit rest positions and rigid motions of all bodies in all visits.

    Args:
        residual: Readings less where they should be; anything where weight is 0.
        weight: Of each reading.
        inverse: Inverse covariance of one frame's reading.
        point: Where markers are.
        body: Index of each marker's body.

    Returns:
        The fitted displacement of every marker in every row, seen or not; where it
        rests on enough markers to leave something over; and the degrees of freedom.
    """
    fitted = np.zeros_like(residual)
    checked = np.zeros(weight.shape, dtype=bool)
    freedom = 0.0
    for b in np.unique(body):
        own = np.flatnonzero(body == b)
        w, y = weight[:, :, own], residual[:, :, own]
        middle = point[:, own].mean(axis=1, keepdims=True)
        lever = levers(point[:, own] - middle)  # (visits, own, 3, 6)
        pull = lever.swapaxes(2, 3) @ inverse
        visits, rows, count = w.shape
        hessian = (pull @ lever).reshape(visits, count, 36)
        stiff = (w @ hessian).reshape(visits, rows, 6, 6)
        turn = np.diag([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])
        stiff += (1e-6 * np.trace(inverse)) * (np.eye(6) + turn)
        inner = np.linalg.inv(stiff)
        total = w.sum(axis=1)
        total = np.where(total > 0, total, 1.0)[..., None]
        rest = (w[..., None] * y).sum(axis=1) / total
        flat = pull.transpose(0, 1, 3, 2).reshape(visits, 3 * count, 6)
        onto = lever.reshape(visits, 3 * count, 6).swapaxes(1, 2)
        moved = np.zeros_like(y)
        for _ in range(SWEEPS):
            ask = (w[..., None] * (y - rest[:, None])).reshape(visits, rows, -1) @ flat
            twist = (inner @ ask[..., None])[..., 0]
            moved = (twist @ onto).reshape(visits, rows, count, 3)
            rest = (w[..., None] * (y - moved)).sum(axis=1) / total
        fitted[:, :, own] = moved + rest[:, None]
        full = (w > 0).sum(axis=2) >= ENOUGH
        checked[:, :, own] = full[..., None] & (w > 0)
        lines = full.sum(axis=1)
        points = checked[:, :, own].sum(axis=(1, 2))
        free = 3 * points - 3 * count - 6 * np.maximum(lines - 1, 0)
        freedom += float(np.sum(np.where(lines > 1, free, 0)))
    return fitted, checked, max(freedom, 0.0)
