"""Ridge regression whose prior variances and noise are learnt from the data.

==========  ==========================================================================
Equation    x = (A'A / s² + P)⁻¹ A'y / s², P = 1 / v of a column's band, as stated
            elsewhere; v = sum x² / sum (1 - P C), s² = rest / (n - sum (1 - P C))
Source      MacKay 1992, "Bayesian interpolation", Neural Computation 4, 415
Valid       many coefficients a band; residuals of one size
Ignores     that neighbouring poses err together: intervals are made elsewhere
==========  ==========================================================================
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import cho_factor, cho_solve, get_lapack_funcs

from stiffness.regression.normal_equations import Normal

FIRST_SIZE = 3e-5
"""Of a coefficient before the data have spoken, in rad; 6 arc seconds."""
SMALLEST, GREATEST = 1e-8, 1e-3
"""Bounds of the size of a band's coefficients, in rad."""
ROUNDS, STILL = 12, 0.1
"""Rounds at most; change of the logarithm of a variance that ends them."""
FAINT = 1e-9
"""Share of a column's own square that is added to it, against rounding."""


@dataclass(frozen=True)
class VarianceComponents:
    """How large things are.

    Attributes:
        noise: Variance of a coordinate, in m^2.
        variance: Of the coefficients of each band, in rad^2.
    """

    noise: float
    variance: Float[np.ndarray, " bands"]


@dataclass(frozen=True)
class Solved:
    """A regularised problem, factored.

    Attributes:
        x: Coefficients.
        factor: Cholesky factor of A'A / s² + P, as scipy has it.
        precision: P.
    """

    x: Float[np.ndarray, " columns"]
    factor: tuple
    precision: Float[np.ndarray, " columns"]

    def inverse(self, columns: Int[np.ndarray, " some"]) -> np.ndarray:
        """Return some columns of (A'A / s² + P)⁻¹."""
        unit = np.zeros((len(self.x), len(columns)))
        unit[columns, np.arange(len(columns))] = 1.0
        return cho_solve(self.factor, unit)

    def spread(self) -> Float[np.ndarray, " columns"]:
        """Return the diagonal of (A'A / s² + P)⁻¹."""
        lower = np.tril(self.factor[0])
        (trtri,) = get_lapack_funcs(("trtri",), (lower,))
        under, _ = trtri(lower, lower=1)
        return np.sum(under**2, axis=0)


def precision_of(
    square: Float[np.ndarray, " columns"],
    band: Int[np.ndarray, " columns"],
    variances: VarianceComponents,
    stated: Float[np.ndarray, " columns"] | float = 0.0,
    design: Float[np.ndarray, " columns"] | float = 1.0,
) -> Float[np.ndarray, " columns"]:
    """Return P of columns with these sums of squares, and with what is stated.

    Where readings err together, a prior counts by the `design` effect more.
    """
    diagonal = square / variances.noise
    tabled = band >= 0
    precision = FAINT * np.where(diagonal > 0.0, diagonal, 1.0) + stated
    precision[tabled] = 1.0 / variances.variance[band[tabled]]
    return precision * design


def solved(
    normal: Normal,
    band: Int[np.ndarray, " columns"],
    variances: VarianceComponents,
    stated: Float[np.ndarray, " columns"] | float = 0.0,
    design: Float[np.ndarray, " columns"] | float = 1.0,
) -> Solved:
    """Solve with sizes as they are."""
    precision = precision_of(np.diag(normal.gram), band, variances, stated, design)
    h = normal.gram / variances.noise
    h[np.diag_indices(len(h))] += precision
    factor = cho_factor(h, lower=True, overwrite_a=True)
    return Solved(cho_solve(factor, normal.aim / variances.noise), factor, precision)


def learnt(
    normal: Normal,
    band: Int[np.ndarray, " columns"],
    stated: Float[np.ndarray, " columns"] | float = 0.0,
    design: Float[np.ndarray, " columns"] | float = 1.0,
) -> tuple[Solved, VarianceComponents]:
    """Learn the sizes that are not stated and solve."""
    count = int(band.max(initial=-1)) + 1
    tabled = band >= 0
    sizes = VarianceComponents((5e-5) ** 2, np.full(count, FIRST_SIZE**2))
    for _ in range(ROUNDS):
        found = solved(normal, band, sizes, stated, design)
        used = 1.0 - found.precision * found.spread()
        square = np.bincount(band[tabled], (found.x**2)[tabled], count)
        freedom = np.bincount(band[tabled], used[tabled], count)
        variance = square / np.maximum(freedom, 1e-9)
        variance = np.clip(variance, SMALLEST**2, GREATEST**2)
        noise = max(normal.residual_square(found.x), 0.0) / max(
            normal.count - used.sum(), 1.0
        )
        change = np.abs(np.log(variance / sizes.variance))
        sizes = VarianceComponents(max(noise, 1e-18), variance)
        if change.max(initial=0.0) < STILL:
            break
    return solved(normal, band, sizes, stated, design), sizes
