"""Normal equations: Gram matrices by fold, score vectors by pose, sums of squares.

What readings say about columns is their Gram matrix and each pose's score.

==========  ==========================================================================
Equation    gram = X' S^-1 X by fold; score_p = X_p' S^-1 y_p by pose;
            without K: gram~ = gram - gram_cK gram_KK^-1 gram_Kc, score~ likewise
Source      Gauss-Markov; Frisch-Waugh-Lovell
Valid       S as stated, block A (within visits) and B (between) independent
Ignores     nothing that is linear
==========  ==========================================================================

A least-squares problem is its normal equations, fold by fold.

Known columns are eliminated: projections, Schur complements, block Cholesky.

A regularised least-squares problem is eliminated block by block, as blocks come in.

==========  ==========================================================================
Equation    H = A'A / s² + P = U'U on the known columns; a block c that joins brings
            S = H_cc − V_c'V_c, V = U'⁻¹ H: its own coefficients are
            S⁻¹ (b_c − V_c'y), y = U'⁻¹ b, and the known ones' U⁻¹ (y − V_c x_c)
Source      block Cholesky and Schur complements: Golub, Van Loan 2013, "Matrix
            Computations", 4th ed., 4.2
Valid       P that makes H positive definite
Ignores     nothing: the same solution as solving anew, but for rounding
==========  ==========================================================================

A sum of squares is minimised within bounds, by steps on normal equations.

==========  ==========================================================================
Equation    step = argmin d'(A + λD)d - 2 g'd within bounds; A = J'J + P, g = J'r - P x,
            D = diag A; λ falls where a step gains what A and g say, and grows where it
            gains less than a quarter of that, or nothing
Source      Levenberg 1944; Marquardt 1963, "An algorithm for least-squares estimation
            of nonlinear parameters"; bounds: Stark and Parker 1995 (scipy's BVLS)
Valid       residuals that are smooth over a step
Ignores     minima elsewhere
==========  ==========================================================================
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import cholesky, get_lapack_funcs, solve_triangular
from scipy.optimize import lsq_linear

# --- Normal equations -----------------------------------------------------------------


@dataclass(frozen=True)
class NormalEquations:
    """Gram matrices by fold of poses, scores by pose.

    Attributes:
        gram: Of each fold.
        score: Of each pose.
        fold: Of each pose.
        raw: Each column's information before the unknown was projected out.
    """

    gram: Float[np.ndarray, "folds columns columns"]
    score: Float[np.ndarray, "poses columns"]
    fold: Int[np.ndarray, " poses"]
    raw: Float[np.ndarray, " columns"]


# --- Normal equations by fold ---------------------------------------------------------


@dataclass(frozen=True)
class Normal:
    """Sums over rows.

    Attributes:
        gram: A'A, in m^2 per square of each column's unit.
        aim: A'y.
        square: y'y, in m^2.
        count: Of coordinates.
    """

    gram: Float[np.ndarray, "columns columns"]
    aim: Float[np.ndarray, " columns"]
    square: float
    count: int

    def __add__(self, other: "Normal") -> "Normal":
        """Put two sets of rows together."""
        return Normal(
            self.gram + other.gram,
            self.aim + other.aim,
            self.square + other.square,
            self.count + other.count,
        )

    def __sub__(self, other: "Normal") -> "Normal":
        """Take rows out again."""
        return Normal(
            self.gram - other.gram,
            self.aim - other.aim,
            self.square - other.square,
            self.count - other.count,
        )

    def only(self, columns: Int[np.ndarray, " some"]) -> "Normal":
        """Return the problem of some columns alone."""
        gram = self.gram[np.ix_(columns, columns)]
        return Normal(gram, self.aim[columns], self.square, self.count)

    def residual_square(self, x: Float[np.ndarray, " columns"]) -> float:
        """Return the sum of squares that a solution leaves, in m^2."""
        return float(self.square - 2.0 * x @ self.aim + x @ self.gram @ x)


def total_of(parts: Sequence[Normal]) -> Normal:
    """Put all sets of rows together."""
    total = parts[0]
    for part in parts[1:]:
        total = total + part
    return total


# --- Elimination of known columns -----------------------------------------------------

SPANS = 1e-10
"""Least share of a direction that is no rounding error; chosen: a million times above
what sums of some 100,000 products leave."""


SURVIVES = 1e-9
"""Share of a direction's raw information that must survive the projection; chosen: a
thousand times above rounding, a hundredth of what could ever be detected."""


def unit_scale(square: Float[np.ndarray, " columns"]) -> Float[np.ndarray, " columns"]:
    """Return factors that give columns of these squares unit length; 0 for nothing."""
    size = np.sqrt(np.maximum(square, 0.0))  # rounding may go below
    return np.where(size > 0.0, 1.0 / np.where(size > 0.0, size, 1.0), 0.0)


def projection_coefficients(
    gram: Float[np.ndarray, "columns columns"], known: Int[np.ndarray, " known"]
) -> Float[np.ndarray, "known columns"]:
    """Return the share of known columns in all columns: gram_KK^+ gram_Kc.

    Known columns may be multiples of each other; only what they span counts.
    """
    if not len(known):
        return np.zeros((0, gram.shape[1]))
    inner = gram[np.ix_(known, known)]
    scale = unit_scale(np.diag(inner))
    value, vector = np.linalg.eigh(inner * scale * scale[:, None])
    keep = value > SPANS * len(known)
    half = (scale[:, None] * vector[:, keep]) / np.sqrt(value[keep])
    return half @ (half.T @ gram[known])


def schur_complement(
    gram: Float[np.ndarray, "columns columns"],
    known: Int[np.ndarray, " known"],
    share: Float[np.ndarray, "known columns"],
    block: Int[np.ndarray, " block"],
) -> Float[np.ndarray, "block block"]:
    """Return the Gram matrix of X_b - X_K share_b, whatever the shares' rounding.

    Written as gram_bb - gram_bK share_b it would err in the first order of it.
    """
    own, side = share[:, block], gram[np.ix_(block, known)]
    inner = gram[np.ix_(known, known)]
    cross, total = side @ own, gram[np.ix_(block, block)]
    total -= cross
    total -= cross.T
    total += own.T @ inner @ own
    return total


def whitening_transform(
    residual_gram: Float[np.ndarray, "columns columns"],
    raw: Float[np.ndarray, " columns"],
) -> Float[np.ndarray, "columns freedom"]:
    """Return what makes columns white, directions without information left out.

    Args:
        residual_gram: Their Gram matrix after everything known was projected out.
        raw: Their information before that.
    """
    live = raw > 0.0
    scale = np.where(live, 1.0 / np.sqrt(np.where(live, raw, 1.0)), 0.0)
    value, vector = np.linalg.eigh(residual_gram * scale * scale[:, None])
    keep = value > SURVIVES * len(raw)
    return scale[:, None] * vector[:, keep] / np.sqrt(value[keep])


def minimum_norm_fit(
    gram: Float[np.ndarray, "columns columns"], score: Float[np.ndarray, " columns"]
) -> Float[np.ndarray, " columns"]:
    """Return the smallest coefficients that fit best; columns may be multiples."""
    joint = np.block([[gram, score[:, None]], [score[None], np.ones((1, 1))]])
    return projection_coefficients(joint, np.arange(len(gram)))[:, -1]


RIDGE = 1e-9
"""Added to the diagonal of scaled normal equations: columns may be multiples."""


def solve(
    gram: Float[np.ndarray, "columns columns"], score: Float[np.ndarray, " columns"]
) -> Float[np.ndarray, " columns"]:
    """Solve normal equations whose columns have very different units."""
    scale, scaled = _ridged(gram)
    return scale * np.linalg.solve(scaled, scale * score)


def _ridged(
    gram: Float[np.ndarray, "columns columns"],
) -> tuple[Float[np.ndarray, " columns"], Float[np.ndarray, "columns columns"]]:
    """Return the scale of each column, and the Gram matrix of the scaled ones."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(gram), 1e-300))
    return scale, gram * scale * scale[:, None] + RIDGE * np.eye(len(gram))


def losses_without(
    gram: Float[np.ndarray, "columns columns"],
    score: Float[np.ndarray, " columns"],
    blocks: Sequence[Int[np.ndarray, " _"]],
) -> tuple[float, ...]:
    """Return the whitened square that is lost without each block, all others adapting.

    ==========  ======================================================================
    Equation    b_B' (G^-1)_BB^-1 b_B, b = G^-1 s
    Source      Wald 1943, the statistic of a linear hypothesis
    Valid       columns of which none is a multiple of others beyond `RIDGE`
    Ignores     nothing else
    ==========  ======================================================================
    """
    scale, scaled = _ridged(gram)
    inverse = np.linalg.inv(scaled)
    fitted = inverse @ (scale * score)
    return tuple(
        float(fitted[own] @ np.linalg.solve(inverse[np.ix_(own, own)], fitted[own]))
        for own in blocks
    )


# --- Block by block, regularised ------------------------------------------------------

ColumnIndices = Int[np.ndarray, " _"]


@dataclass(frozen=True)
class Eliminated:
    """Sums over some rows, with the known columns eliminated.

    Attributes:
        total: Sums over all rows.
        out: Sums over the rows that are left out; None: none are.
        noise: Variance of a coordinate, in m^2.
        precision: P of every column.
        known: Columns, in the order in which they came.
        through: V of every column that is known or may still come.
        aim: y.
    """

    total: Normal
    out: Normal | None
    noise: float
    precision: Float[np.ndarray, " columns"]
    known: ColumnIndices
    through: Float[np.ndarray, "known columns"]
    aim: Float[np.ndarray, " known"]

    @classmethod
    def of(
        cls, total: Normal, out: Normal | None, noise: float, precision: np.ndarray
    ) -> "Eliminated":
        """Begin with no column known."""
        width = len(precision)
        none = np.zeros(0, dtype=int)
        through = np.zeros((0, width))
        return cls(total, out, noise, precision, none, through, np.zeros(0))

    def joined_by(self, own: ColumnIndices) -> "Eliminated":
        """Let a block of columns join the known ones."""
        rest = np.setdiff1d(np.arange(len(self.precision)), self.known)
        inner = self.inner(own, rest)
        upper = cholesky(inner[:, np.searchsorted(rest, own)])
        more = np.zeros((len(own), len(self.precision)))
        more[:, rest] = solve_triangular(upper, inner, trans=1)
        aim = solve_triangular(upper, self._aim(own), trans=1)
        return Eliminated(
            self.total,
            self.out,
            self.noise,
            self.precision,
            np.concatenate([self.known, own]),
            np.concatenate([self.through, more]),
            np.concatenate([self.aim, aim]),
        )

    def with_each(
        self, blocks: Sequence[ColumnIndices]
    ) -> Float[np.ndarray, "columns tried"]:
        """Return the solutions with each block joined by itself; zeros elsewhere."""
        x = np.zeros((len(self.precision), len(blocks)))
        for j, own in enumerate(blocks):
            x[own, j] = np.linalg.solve(self.inner(own, own), self._aim(own))
        aim = self.aim[:, None] - self.through @ x
        x[self.known] = solve_triangular(self.through[:, self.known], aim)
        return x

    def inverse(self) -> Float[np.ndarray, "known known"]:
        """Return H⁻¹ of the known columns."""
        factor = self.through[:, self.known]
        (potri,) = get_lapack_funcs(("potri",), (factor,))
        upper, _ = potri(factor)
        return np.triu(upper) + np.triu(upper, 1).T

    def inner(self, rows: ColumnIndices, columns: ColumnIndices) -> np.ndarray:
        """Return what the known columns leave of H, P's part included."""
        cross = self.total.gram[np.ix_(rows, columns)]
        if self.out is not None:
            cross -= self.out.gram[np.ix_(rows, columns)]
        cross /= self.noise
        cross += self.precision[rows, None] * (rows[:, None] == columns)
        cross -= self.through[:, rows].T @ self.through[:, columns]
        return cross

    def _aim(self, own: ColumnIndices) -> Float[np.ndarray, " own"]:
        """Return what the known columns leave of b."""
        aim = self.total.aim[own]
        if self.out is not None:
            aim = aim - self.out.aim[own]
        return aim / self.noise - self.through[:, own].T @ self.aim


# --- Nonlinear least squares within bounds --------------------------------------------

DAMPED = 1e-3
"""λ of the first step; chosen, as usual for well-scaled problems."""
EASED, STIFFENED = 0.2, 5.0
"""Factors of λ after a step that gains what was said, and after one that does not; the
second doubles with each such step that follows: Nielsen 1999, "Damping parameter in
Marquardt's method"."""
AS_SAID, TOO_LITTLE = 0.5, 0.25
"""Gain over the one that was said, for these factors."""
LEAST_DAMPED, MOST_DAMPED = 1e-9, 1e6
"""λ below which rounding decides, and above which there is no step."""
SMALLEST = 1e-12
"""Range that a step has at least: scipy wants one."""
REACHED, REACHED_SHARE = 0.5, 1e-4
"""Square that one more step must gain, and share of the present one; chosen: an end of
an interval costs four, or as much more as poses differ beyond their errors."""


@dataclass(frozen=True, eq=False)
class Linearised:
    """A least-squares problem about some parameters.

    Attributes:
        square: Sum of squared residuals, priors' part included.
        descent: Half of the direction in which it falls most, J'r - P x.
        gram: J'J + P.
    """

    square: float
    descent: Float[np.ndarray, " parameters"]
    gram: Float[np.ndarray, "parameters parameters"]

    @classmethod
    def of_some(
        cls,
        gram: Float[np.ndarray, "columns columns"],
        score: Float[np.ndarray, " columns"],
        kept: Int[np.ndarray, " parameters"],
    ) -> "Linearised":
        """Return the problem of some columns, where all others are fitted anew.

        Args:
            gram: Of all columns.
            score: Of the residuals there; their own square counts as none.
            kept: The parameters' columns.
        """
        joint = np.block([[gram, score[:, None]], [score[None], np.ones((1, 1))]])
        others = np.setdiff1d(np.arange(len(gram)), kept)
        share = projection_coefficients(joint, others)
        fitted = share[:, -1]
        return cls(
            -float(score[others] @ fitted),
            score[kept] - gram[np.ix_(kept, others)] @ fitted,
            schur_complement(joint, others, share, kept),
        )

    def with_prior(
        self,
        precision: Float[np.ndarray, " some"],
        away: Float[np.ndarray, " some"],
        square: float,
    ) -> "Linearised":
        """Return the same with a prior on the last parameters.

        Args:
            precision: Inverse prior variances.
            away: How far these parameters are from where they are most likely.
            square: What the sum of squares is beside the prior.
        """
        first = len(self.descent) - len(away)
        gram, descent = self.gram.copy(), self.descent.copy()
        at = np.arange(first, len(descent))
        gram[at, at] += precision
        descent[at] -= precision * away
        return Linearised(square + float(np.sum(precision * away**2)), descent, gram)


@dataclass(frozen=True, eq=False)
class Minimum:
    """Where no step gains any more, or no more steps were allowed.

    Attributes:
        parameters: There.
        square: Sum of squared residuals there.
    """

    parameters: Float[np.ndarray, " parameters"]
    square: float


@dataclass(frozen=True, eq=False)
class Bounds:
    """Where parameters may be.

    Attributes:
        low, high: Ends.
        longest: Change in one step at most.
    """

    low: Float[np.ndarray, " parameters"]
    high: Float[np.ndarray, " parameters"]
    longest: Float[np.ndarray, " parameters"]


def minimise(
    linearise: Callable[[np.ndarray], Linearised],
    start: Float[np.ndarray, " parameters"],
    bounds: Bounds,
    evaluations: int,
) -> Minimum:
    """Return a minimum of a sum of squares, by steps that all gain.

    Args:
        linearise: The problem about some parameters; an infinite square: they are
            impossible.
        start: Within bounds.
        bounds: Of the parameters.
        evaluations: Of the problem at most, that of the start not counted.
    """
    here, now, damping, stiffer = start, linearise(start), DAMPED, STIFFENED
    for _ in range(evaluations):
        step = _step(now, here, bounds, damping)
        said = float(2.0 * now.descent @ step - step @ now.gram @ step)
        least = max(REACHED, REACHED_SHARE * now.square)
        if said < least:
            break
        there = np.clip(here + step, bounds.low, bounds.high)
        tried = linearise(there)
        gained = now.square - tried.square
        if gained > AS_SAID * said:
            damping, stiffer = max(EASED * damping, LEAST_DAMPED), STIFFENED
        elif gained < TOO_LITTLE * said:
            damping, stiffer = stiffer * damping, 2.0 * stiffer
        if gained > 0.0:
            here, now = there, tried
        at_end = 0.0 <= gained < least and TOO_LITTLE * said < least
        if at_end or damping > MOST_DAMPED:
            break
    return Minimum(here, now.square)


def _step(
    now: Linearised,
    here: Float[np.ndarray, " parameters"],
    bounds: Bounds,
    damping: float,
) -> Float[np.ndarray, " parameters"]:
    """Return the damped step within bounds."""
    scale = unit_scale(np.diag(now.gram))
    value, vector = np.linalg.eigh(now.gram * scale * scale[:, None])
    root = np.sqrt(np.maximum(value, 0.0) + damping)
    aim = (vector.T @ (scale * now.descent)) / root
    step = scale * (vector @ (aim / root))
    low = np.maximum(bounds.low - here, -bounds.longest)
    high = np.minimum(bounds.high - here, bounds.longest)
    if np.all((step >= low) & (step <= high)):
        return step
    high = np.maximum(high, low + SMALLEST)
    known = np.where(scale > 0.0, scale, 1.0)
    ends = low / known, high / known
    return scale * lsq_linear(root[:, None] * vector.T, aim, ends, method="bvls").x
