"""Weighted least squares with clustered covariance and detection of blind parameters.

==========  ==========================================================================
Equation    x = (A^T A)^-1 A^T y; cov = (A^T A)^-1 for errors of sigma one; clustered:
            cov = (G-1)/G sum_g e_g e_g^T, e_g = x less x without group g
            = (A^T A - A_g^T A_g)^-1 A_g^T r_g
            information of column k beside the others = 1 / (A^T A)^-1_kk
Source      JCGM 100:2008, H.3; Bell and McCaffrey 2002, "Bias reduction in standard
            errors for linear regression with multi-stage samples" (the jackknife)
Needs       whitened rows; groups whose errors may hang together
Assumes     groups err independently of each other
==========  ==========================================================================
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.stats import t as student

NULL = 1e-12
"""Eigenvalues of the scaled normal matrix below this are none; chosen: (1e-6)^2."""
REACHED = 1e-3
"""Part in a null direction from which a parameter counts as unseen; chosen."""


@dataclass(frozen=True)
class LeastSquares:
    """A linear solution and two opinions on its errors.

    Attributes:
        value: The solution.
        covariance: If the stated noise were all that errs; infinite where unseen.
        clustered: From how groups of rows disagree, the model's own error included.
        groups: How many groups there were.
    """

    value: Float[np.ndarray, " parameters"]
    covariance: Float[np.ndarray, "parameters parameters"]
    clustered: Float[np.ndarray, "parameters parameters"]
    groups: int

    @property
    def sigma(self) -> Float[np.ndarray, " parameters"]:
        """Standard deviations if the stated noise were all that errs."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def sigma_clustered(self) -> Float[np.ndarray, " parameters"]:
        """Standard deviations from how groups of rows disagree."""
        return np.sqrt(np.diag(self.clustered))

    def interval(
        self, value: Float[np.ndarray, " parameters"]
    ) -> tuple[Float[np.ndarray, " parameters"], Float[np.ndarray, " parameters"]]:
        """Return the ends of 95 % intervals around a value by the clustered errors."""
        reach = student.ppf(0.975, max(self.groups - 1, 1))
        return (
            value - reach * self.sigma_clustered,
            value + reach * self.sigma_clustered,
        )


def solve(
    design: Float[np.ndarray, "rows 3 parameters"], target: Float[np.ndarray, "rows 3"]
) -> tuple[
    Float[np.ndarray, " parameters"], Float[np.ndarray, "parameters parameters"]
]:
    """Solve whitened equations.

    Args:
        design: Whitened columns.
        target: Whitened values, errors of sigma one.

    Returns:
        The solution and its covariance; a parameter without information of its own has
        value zero and infinite variance.
    """
    flat, aim = design.reshape(-1, design.shape[2]), target.reshape(-1)
    size = np.linalg.norm(flat, axis=0)
    scale = np.where(size > 0.0, size, 1.0)
    flat = flat / scale
    eigenvalues, vectors = np.linalg.eigh(flat.T @ flat)
    kept = eigenvalues > NULL
    inverse = (vectors[:, kept] / eigenvalues[kept]) @ vectors[:, kept].T
    unseen = (np.abs(vectors[:, ~kept]) > REACHED).any(axis=1) | (size == 0.0)
    value = np.where(unseen, 0.0, inverse @ (flat.T @ aim) / scale)
    covariance = inverse / np.outer(scale, scale)
    covariance[unseen, unseen] = np.inf
    return value, covariance


def least_squares(
    design: Float[np.ndarray, "rows 3 parameters"],
    target: Float[np.ndarray, "rows 3"],
    group: Int[np.ndarray, " rows"],
) -> LeastSquares:
    """Solve whitened equations and take both opinions on the errors.

    Args:
        design: Whitened columns.
        target: Whitened values, errors of sigma one.
        group: Rows of one group may err together.
    """
    value, covariance = solve(design, target)
    left = target - design @ value
    order = np.argsort(group, kind="stable")
    _, start = np.unique(group[order], return_index=True)
    normal = np.einsum("rip,riq->rpq", design, design)[order]
    score = np.einsum("rip,ri->rp", design, left)[order]
    by_group = np.add.reduceat(normal, start)
    without = by_group.sum(axis=0) - by_group
    # what each group, left out, changes in the solution
    change = (
        np.linalg.pinv(without, hermitian=True)
        @ (np.add.reduceat(score, start)[:, :, None])
    )
    clustered = np.einsum("gpi,gqi->pq", change, change)
    unseen = np.isinf(np.diag(covariance))
    clustered[unseen, unseen] = np.inf
    return LeastSquares(
        value, covariance, clustered * (len(start) - 1) / len(start), len(start)
    )
