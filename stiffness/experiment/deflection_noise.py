"""Noise covariance of deflections that share an unloaded reading, and its whitening.

==========  ==========================================================================
Equation    cov(d_i, d_j) = (delta_ij own_i + shared_i . shared_j) T
            + (delta_ij + 1) A_i S A_j^T within a visit, 0 between visits
            T: tracker, one reading; S: force sensor; A: deflection per wrench
Source      propagation of errors through loaded minus unloaded; JCGM 100:2008, 5.2
Valid       readings of different rows err independently
Ignores     the tracker's volumetric error, which cancels over a few millimetres
==========  ==========================================================================
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from bench.shared.recording import Recording


@dataclass(frozen=True)
class Noise:
    """Stated noise of deflections, as contributions of tracker and force sensor.

    Attributes:
        tracker: Covariance of one reading of one target along the base's axes, m^2.
        own: Factor of it in each row from the loaded reading.
        shared: Factor of each target in a row's error from the unloaded reading.
        force: Standard deviation of a force, in N.
        torque: Standard deviation of a torque, in N m.
        visit: Index of the visit; its rows share their unloaded reading.
    """

    tracker: Float[np.ndarray, "3 3"]
    own: Float[np.ndarray, " rows"]
    shared: Float[np.ndarray, "rows targets"]
    force: float
    torque: float
    visit: Int[np.ndarray, " rows"]

    def sigma(self) -> Float[np.ndarray, "rows 3"]:
        """Return each row's standard deviation along the base's axes, in m."""
        share = self.own + np.sum(self.shared**2, axis=1)
        return np.sqrt(share[:, None] * np.diag(self.tracker))

    def whitener(
        self, per_wrench: Float[np.ndarray, "rows 3 6"] | None = None
    ) -> "Whitener":
        """Return the transform that makes errors independent with unit variance.

        Args:
            per_wrench: Deflection per wrench of each row, in m/N and m/(N m), which
                carries the force sensor's errors; None = no such errors.
        """
        visits, first, count = np.unique(
            self.visit, return_index=True, return_counts=True
        )
        order = np.argsort(self.visit, kind="stable")
        start = np.cumsum(count) - count
        assert len(first) == len(visits)
        blocks = []
        for n in np.unique(count):
            rows = order[start[count == n][:, None] + np.arange(n)]
            lower = np.linalg.cholesky(self._covariance(rows, per_wrench))
            blocks.append((rows, np.linalg.inv(lower)))
        return Whitener(tuple(blocks))

    def _covariance(
        self,
        rows: Int[np.ndarray, "visits n"],
        per_wrench: Float[np.ndarray, "rows 3 6"] | None,
    ) -> Float[np.ndarray, "visits coordinates coordinates"]:
        """Return the covariance of all coordinates of some visits of n rows each."""
        visits, n = rows.shape
        shared = self.shared[rows]
        share = shared @ shared.swapaxes(1, 2)
        share[:, np.arange(n), np.arange(n)] += self.own[rows]
        covariance = np.einsum("vij,ab->viajb", share, self.tracker)
        if per_wrench is not None:
            sigma = np.repeat([self.force, self.torque], 3)
            moved = per_wrench[rows] * sigma
            pairs = np.einsum("viaw,vjbw->viajb", moved, moved)
            covariance += pairs * (1.0 + np.eye(n))[:, None, :, None]
        return covariance.reshape(visits, 3 * n, 3 * n)


@dataclass(frozen=True)
class Whitener:
    """Transform of deflections to values with independent errors of unit variance.

    Attributes:
        blocks: Rows of equally long visits, and the inverse Cholesky factor of each.
    """

    blocks: tuple[tuple[np.ndarray, np.ndarray], ...]

    def __call__(
        self, values: Float[np.ndarray, "rows 3 columns"]
    ) -> Float[np.ndarray, "rows 3 columns"]:
        """Whiten each column; rows are combined within a visit only."""
        white = np.empty_like(values)
        for rows, inverse in self.blocks:
            visits, n = rows.shape
            stacked = values[rows].reshape(visits, 3 * n, -1)
            white[rows] = (inverse @ stacked).reshape(visits, n, 3, -1)
        return white


def noise_of_pairs(
    recording: Recording,
    chosen: Int[np.ndarray, " markers"],
    weight: Float[np.ndarray, "rows markers"],
    pair: tuple[np.ndarray, np.ndarray],
    turn: Float[np.ndarray, "3 3"],
) -> Noise:
    """Return the noise of deflections from that of readings, by targets.

    Args:
        recording: With the stated noise of tracker and force sensor.
        chosen: The markers that were averaged; those of a target share their error.
        weight: Weight of each marker in each row's mean.
        pair: The recording's loaded rows, and the row each is compared with.
        turn: Rotation from the tracker's axes to the base's.
    """
    tracker, sensor = recording.tracker, recording.wrench_sensor
    assert tracker is not None and sensor is not None
    markers = [recording.markers[k] for k in chosen]
    names = [m.name if m.target is None else f"target {m.target}" for m in markers]
    belongs = np.array(names)[:, None] == np.unique(names)
    by_target = weight @ belongs.astype(float)
    loaded, unloaded = pair
    count = (
        np.ones(len(recording.time)) if recording.frames is None else recording.frames
    )
    return Noise(
        tracker=(turn * tracker.repeatability**2) @ turn.T,
        own=np.sum(by_target**2, axis=1) / count[loaded],
        shared=by_target / np.sqrt(count[unloaded])[:, None],
        force=sensor.accuracy_force,
        torque=sensor.accuracy_torque,
        visit=recording.visit[loaded],
    )
