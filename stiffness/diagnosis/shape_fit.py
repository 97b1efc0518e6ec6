"""Fit of all shape parameters of a model together, by Gauss-Newton.

==========  ==========================================================================
Equation    min |y - X(theta) b|^2 + |(theta - theta_0) / s|^2 over b and theta; columns
            of theta: what a little more of it does, times b; s half of the spacing of
            the coarse grid; steps that lose are halved; b solved anew at each shape
Source      variable projection: Golub and Pereyra 1973; Kaufman 1975
Valid       from a coarse grid's best, whose neighbours have alike columns
Ignores     shapes beyond the grid's ends, and those that count something
==========  ==========================================================================
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from stiffness.diagnosis.model_fit import (
    WHOLE,
    ModelFit,
    ModelTerm,
    SelectionProblem,
    fit_of,
    training,
)
from stiffness.diagnosis.sufficient_statistics import normal_equations_of
from stiffness.effects.jacobian import EffectJacobian, values, with_values
from stiffness.regression.elimination import minimum_norm_fit

ROUNDS = 3
"""Steps; chosen: the third moves a hundredth of the first."""
HALVINGS = 2
SETTLED = 1.0
"""Whitened square that one more step must gain; chosen: a pose weighs more."""
SPACING = 0.5
"""Prior standard deviation in spacings of the coarse grid."""
STEP = 1e-2
"""Part of a spacing, or of the shape, by which it is moved for its slope."""


@dataclass(frozen=True)
class _Shape:
    """One shape parameter that may move.

    Attributes:
        term: Number of its term.
        number: Which of the term's.
        factor: Whether it moves as a logarithm.
        low, high: Ends of the coarse grid, as it moves.
        spacing: Of the grid about its start.
        start: Where it was at first.
    """

    term: int
    number: int
    factor: bool
    low: float
    high: float
    spacing: float
    start: float

    def of(self, term: ModelTerm) -> float:
        """Return where it is in its term, as it moves."""
        value = float(term.shape[self.number])
        return float(np.log(value)) if self.factor else value

    def with_value(self, term: ModelTerm, value: float) -> ModelTerm:
        """Return its term with another value of it."""
        shape = term.shape.copy()
        shape[self.number] = np.exp(value) if self.factor else value
        return replace(term, shape=shape)


def fit_shapes(
    case: SelectionProblem, terms: Sequence[ModelTerm], rounds: int = ROUNDS
) -> tuple[ModelTerm, ...]:
    """Move all shapes of a set to where the set explains most.

    Args:
        case: What may be looked at.
        terms: The set, at shapes of the coarse grid or near.
        rounds: Steps at most.
    """
    terms = list(terms)
    shapes = _free_shapes(case, terms)
    if not shapes:
        return tuple(terms)
    fit, step = _linearised(case, terms, shapes)
    for left in reversed(range(rounds)):
        for _ in range(HALVINGS + 1):
            tried = list(terms)
            for shape, change in zip(shapes, step, strict=True):
                own = tried[shape.term]
                value = np.clip(shape.of(own) + change, shape.low, shape.high)
                tried[shape.term] = shape.with_value(own, float(value))
            after, following = _linearised(case, tried, shapes)
            rise = _objective(after, tried, shapes) - _objective(fit, terms, shapes)
            if rise > 0.0:
                break
            step = 0.5 * step
        else:
            break
        terms, fit, step = tried, after, following
        if rise < SETTLED or not left:
            break
    return tuple(terms)


def _objective(
    fit: ModelFit, terms: Sequence[ModelTerm], shapes: Sequence[_Shape]
) -> float:
    away = [(s.of(terms[s.term]) - s.start) / (SPACING * s.spacing) for s in shapes]
    return fit.gain - float(np.sum(np.square(away)))


def _linearised(
    case: SelectionProblem, terms: Sequence[ModelTerm], shapes: Sequence[_Shape]
) -> tuple[ModelFit, Float[np.ndarray, " shapes"]]:
    """Fit a set, and return where its shapes should go by their slopes.

    The slopes are those of the fit's own coefficients, which one pass over the readings
    does not know yet: all columns' slopes are laid out and then added up.
    """
    laws = [term.jacobian(case.situation) for term in terms]
    slopes = [_slope(case, terms[s.term], s) for s in shapes]
    found = normal_equations_of(
        case.data, [*case.nominal, *laws, *slopes], training(case.split)
    )
    gram, score = found.gram[1], found.score[~case.split.held_out].sum(axis=0)
    width = sum(law.columns for law in (*case.nominal, *laws))
    fit = fit_of(terms, laws, gram[:width, :width], score[:width])
    mix = np.zeros((len(gram), width + len(shapes)))
    mix[:width, :width] = np.eye(width)
    at = width
    for column, (shape, slope) in enumerate(zip(shapes, slopes, strict=True), width):
        mix[at : at + slope.columns, column] = fit.coefficients[shape.term]
        at += slope.columns
    gram, score = mix.T @ gram @ mix, mix.T @ score
    for column, shape in enumerate(shapes, width):
        precision = (SPACING * shape.spacing) ** -2
        gram[column, column] += precision
        score[column] -= precision * (shape.of(terms[shape.term]) - shape.start)
    step = minimum_norm_fit(gram, score)[width:]
    most = np.array([s.spacing for s in shapes])
    return fit, np.clip(step, -most, most)


def _slope(case: SelectionProblem, term: ModelTerm, shape: _Shape) -> EffectJacobian:
    """Return what a little more of a shape parameter does per unit of coefficient."""
    here = shape.of(term)
    step = STEP * shape.spacing
    if not shape.factor and here != 0.0:
        step = min(step, STEP * abs(here))
    sides = []
    for value in (here + step, here - step):
        sides.append(shape.with_value(term, value).jacobian(case.situation))
    parts = []
    for one, other in zip(sides[0].parts, sides[1].parts, strict=True):
        slope = (values(one) - values(other)) / (2.0 * step)
        parts.append(with_values(one, slope))
    return EffectJacobian(sides[0].columns, tuple(parts))


def _free_shapes(case: SelectionProblem, terms: Sequence[ModelTerm]) -> list[_Shape]:
    """Return the shape parameters that may move."""
    found = []
    for t, term in enumerate(terms):
        law = term.hypothesis
        grid = law.shapes(case.situation, term.where)
        for j, name in enumerate(law.shape_names[: term.degrees_of_freedom]):
            factor = name in law.logarithmic
            own = np.unique(grid[:, j])
            at = np.log(own) if factor and own[0] > 0.0 else own
            if name in WHOLE or len(at) < 2 or (factor and own[0] <= 0.0):
                continue
            value = float(term.shape[j])
            here = float(np.log(value)) if factor else value
            nearest = int(np.argmin(np.abs(at - here)))
            beside = np.abs(np.delete(at, nearest) - at[nearest])
            spacing = float(beside.min())
            low, high = float(at[0]), float(at[-1])
            found.append(_Shape(t, j, factor, low, high, spacing, here))
    return found
