"""What a fit of nominal columns leaves of a signal is a projection, visit by visit.

==========  ==========================================================================
Equation    (1 + U U')^-1 = 1 - U (1 + U'U)^-1 U'; β = (G'AG + P)^-1 G'A s;
            χ² = (s - Gβ)' A (s - Gβ) + β'Pβ
Source      Sherman, Morrison and Woodbury 1950; ridge regression
Valid       signals and columns in sigmas
Ignores     nothing
==========  ==========================================================================
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import cho_factor, cho_solve


@dataclass(frozen=True)
class Projection:
    """Takes nominal columns and a common error of each visit out of signals.

    Attributes:
        nominal: Columns G of all visits.
        error: Columns U of each visit, in units of their own sigma.
        prior: Diagonal of P.
        inner: Factor of G'AG + P.
        shrink: (1 + U'U)^-1 of each visit.
        pose: Number of each visit's pose, from 0.
    """

    nominal: Float[np.ndarray, "visits n columns"]
    error: Float[np.ndarray, "visits n errors"]
    prior: Float[np.ndarray, " columns"]
    inner: tuple
    shrink: Float[np.ndarray, "visits errors errors"]
    pose: Int[np.ndarray, " visits"]

    def left(self, signal: np.ndarray) -> tuple[float, Float[np.ndarray, " poses"]]:
        """Return what is left of a signal, altogether and by pose.

        Args:
            signal: Of all visits, (visits, …), in sigmas.
        """
        asked = signal.reshape(len(self.pose), -1)
        told = np.einsum("vn,vnc->c", self._without_error(asked), self.nominal)
        fitted = cho_solve(self.inner, told)
        rest = asked - self.nominal @ fitted
        share = np.sum(rest * self._without_error(rest), axis=1)
        total = float(np.sum(share) + fitted @ (self.prior * fitted))
        return total, np.bincount(self.pose, share)

    def _without_error(self, values: np.ndarray) -> np.ndarray:
        across = np.einsum("vn,vnk->vk", values, self.error)
        inside = np.einsum("vkl,vl->vk", self.shrink, across)
        return values - np.einsum("vnk,vk->vn", self.error, inside)


def projection_of(
    nominal: np.ndarray,
    error: np.ndarray,
    prior: Float[np.ndarray, " columns"],
    pose: Int[np.ndarray, " visits"],
) -> Projection:
    """Prepare a projection.

    Args:
        nominal: (visits, …, columns), in sigmas per unit.
        error: (visits, …, errors), in sigmas per sigma of the error.
        prior: Inverse variances of the columns' coefficients.
        pose: Id of each visit's pose.
    """
    columns = nominal.reshape(len(nominal), -1, nominal.shape[-1])
    common = error.reshape(len(error), -1, error.shape[-1])
    turned = common.transpose(0, 2, 1)
    shrink = np.linalg.inv(np.eye(common.shape[2]) + turned @ common)
    mixed = turned @ columns
    flat = columns.reshape(-1, columns.shape[2])
    gram = flat.T @ flat + np.diag(prior)
    gram -= np.einsum("vkc,vkl,vld->cd", mixed, shrink, mixed, optimize=True)
    numbers = np.unique(pose, return_inverse=True)[1]
    return Projection(columns, common, prior, cho_factor(gram), shrink, numbers)
