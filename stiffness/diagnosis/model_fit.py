"""Fit of a model: coefficients, nonlinear shape parameters, and held-out gain.

A case is what naming looks at: data, hypotheses, and what may not be seen. A named
effect is a hypothesis at a place with a shape, and what was fitted to it.

==========  ==========================================================================
Equation    min |y - X(theta) b|^2 + |(theta - theta_0) / s|^2 over b and theta; columns
            of theta: what a little more of it does, times b; s half of the spacing of
            the coarse grid; b solved anew at each shape
Source      variable projection: Golub and Pereyra 1973; steps: Levenberg-Marquardt
Valid       from a coarse grid's best, whose neighbours have alike columns
Ignores     shapes beyond the grid's ends, and those that count something
==========  ==========================================================================
"""

from collections.abc import Collection, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from bench.shared.effect_catalogue import CATALOGUE
from stiffness.diagnosis.sufficient_statistics import (
    Augmented,
    HeldColumns,
    SufficientStatistics,
    normal_equations_of,
)
from stiffness.effects.base import Hypothesis
from stiffness.effects.candidates import Library
from stiffness.effects.jacobian import (
    EffectJacobian,
    difference,
    hstack,
    mixture,
    orthogonal_to,
)
from stiffness.effects.residual_map import GenericTerm
from stiffness.effects.statics import springs_of
from stiffness.experiment.static_state import StaticState
from stiffness.regression.normal_equations import (
    Bounds,
    Linearised,
    NormalEquations,
    minimise,
    solve,
)
from stiffness.regression.splits import Split

# --- Selection problem ----------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class FeltByOthers:
    """What more of a set's parameters changes of what its other members displace.

    Attributes:
        springs: One column for each fitted compliance.
        laws: By name, a column for each coefficient.
        shapes: By name and number of a shape parameter, per unit of it and of each
            coefficient, which add up at the set's own.
        coefficients: By name, those about which these were taken.
    """

    springs: tuple[EffectJacobian, ...]
    laws: Mapping[tuple[str, str], EffectJacobian]
    shapes: Mapping[tuple[tuple[str, str], int], EffectJacobian]
    coefficients: Mapping[tuple[str, str], Float[np.ndarray, " columns"]]

    def total(self, names: Collection[tuple[str, str]]) -> EffectJacobian:
        """Return one column: of some laws' coefficients as they are."""
        some = [name for name in self.laws if name in names]
        found = [np.zeros(0), *(self.coefficients[name] for name in some)]
        laws = hstack([self.laws[name] for name in some])
        return mixture(laws, np.concatenate(found)[:, None])


@dataclass(frozen=True)
class SelectionProblem:
    """Everything that naming looks at.

    Attributes:
        data: Readings without what the nominal fit explains.
        situation: Where the arm stood.
        springs: Axes whose compliance is nominal.
        library: All columns.
        split: Which poses may be looked at.
        seed: Of random signs.
        dispersion_limit: Dispersion of poses up to which errors may be misstated.
        named: The set that acts on all columns; None: nothing does.
        felt: What more of it changes of itself; None: that was not looked at.
    """

    data: SufficientStatistics
    situation: StaticState
    springs: tuple[int, ...]
    library: Library
    split: Split
    seed: int
    dispersion_limit: float
    named: "ModelFit | None" = None
    felt: FeltByOthers | None = None

    @property
    def nominal(self) -> tuple[EffectJacobian, ...]:
        """The nominal columns."""
        return springs_of(self.situation, self.springs)

    @property
    def poses(self) -> int:
        """How many poses may be looked at."""
        return int(np.sum(~self.split.held_out))

    @cached_property
    def normal_equations(self) -> NormalEquations:
        """What the readings say about the library's columns, but for the map's."""
        fold = training(self.split)
        return normal_equations_of(self.data, self.library.columns, fold)

    @cached_property
    def map_equations(self) -> NormalEquations:
        """What they say about nominal columns and the residual map's."""
        fold = training(self.split)
        return normal_equations_of(self.data, self.library.map.columns, fold)

    @cached_property
    def augmented(self) -> Augmented:
        """Normal equations of the library with terms before it."""
        return Augmented(self.data, self.library.columns, self.normal_equations)


# --- Terms of a model -----------------------------------------------------------------


@dataclass(frozen=True)
class ModelTerm:
    """One hypothesis at one place with one shape.

    Attributes:
        hypothesis: Which.
        where: The place.
        shape: Of its law.
        beyond: Terms to whose columns, and their slopes by shapes, its own are made
            orthogonal.
    """

    hypothesis: Hypothesis
    where: str
    shape: Float[np.ndarray, " parameters"]
    beyond: tuple["ModelTerm", ...] = ()

    @property
    def name(self) -> tuple[str, str]:
        """Effect and place."""
        return self.hypothesis.effect, self.where

    @property
    def key(self) -> Hashable:
        """What its columns depend on, beside the situation."""
        beyond = tuple(term.key for term in self.beyond)
        return self.hypothesis, self.where, self.shape.tobytes(), beyond

    def jacobian(self, situation: StaticState) -> EffectJacobian:
        """Return its columns."""
        own = self.hypothesis.jacobian(situation, self.where, self.shape)
        if not self.beyond:
            return own
        known = [t.jacobian(situation) for t in self.beyond]
        moved = free_shapes(situation, self.beyond)
        known += [shape.slope(situation, self.beyond[shape.term]) for shape in moved]
        return orthogonal_to(own, hstack(known))

    @property
    def is_generic(self) -> bool:
        """Whether it is a block of the residual map, which has no name."""
        return isinstance(self.hypothesis, GenericTerm)

    @property
    def depends_on(self) -> tuple[str, ...]:
        """On what its displacement depends."""
        law = self.hypothesis
        if isinstance(law, GenericTerm):
            return (law.depends_on,)
        return CATALOGUE[law.effect].depends_on

    @property
    def degrees_of_freedom(self) -> int:
        """How many shape parameters there are."""
        return len(self.shape)

    @property
    def shape_names(self) -> tuple[str, ...]:
        """Names of its shape parameters; a law that is a sum repeats them."""
        names = self.hypothesis.shape_names
        return tuple(names[j % len(names)] for j in range(len(self.shape)))

    @property
    def is_first_form(self) -> bool:
        """Whether its law has no other form, or this is its first."""
        forms = zip(self.shape_names, self.shape, strict=True)
        return all(round(value) == 0 for name, value in forms if name == "law")

    def grid(self, situation: StaticState, j: int) -> Float[np.ndarray, " values"]:
        """Return the coarse values of a shape parameter, in order."""
        shapes = self.hypothesis.shapes(situation, self.where)
        return np.unique(shapes[:, j % max(shapes.shape[1], 1)])

    def with_parameter(self, j: int, value: float) -> "ModelTerm":
        """Return it with another value of one of its shape parameters."""
        shape = self.shape.copy()
        shape[j] = value
        return replace(self, shape=shape)

    def has_form_of(self, situation: StaticState, other: "ModelTerm") -> bool:
        """Return whether the law of another place has the same form at this one."""
        forms = enumerate(zip(other.shape_names, other.shape, strict=True))
        return all(
            value in self.grid(situation, j)
            for j, (name, value) in forms
            if name in WHOLE
        )


@dataclass(frozen=True)
class ModelFit:
    """A set of members fitted together with the nominal springs.

    Attributes:
        members: Which.
        gain: Whitened square explained beyond the nominal columns, training poses.
        springs: Change of each fitted compliance.
        coefficients: Of each member.
        degrees_of_freedom: Coefficients and shapes.
        nominal_gain: Whitened square that the nominal columns explain alone.
    """

    members: tuple[ModelTerm, ...]
    gain: float
    springs: Float[np.ndarray, " springs"]
    coefficients: tuple[Float[np.ndarray, " _"], ...]
    degrees_of_freedom: int
    nominal_gain: float = 0.0

    @property
    def names(self) -> frozenset[tuple[str, str]]:
        """Effect and place of each member, of those without a name too."""
        return frozenset(member.name for member in self.members)


def training(split: Split) -> np.ndarray:
    """Return one fold index per pose: 0 held out, 1 fitted."""
    return (split.fold > 0).astype(int)


def fit_model(case: SelectionProblem, members: Sequence[ModelTerm]) -> ModelFit:
    """Fit members and nominal springs to the training poses.

    Args:
        case: What may be looked at.
        members: The set.
    """
    own = [m.jacobian(case.situation) for m in members]
    found = normal_equations_of(case.data, [*case.nominal, *own], training(case.split))
    score = found.score[~case.split.held_out].sum(axis=0)
    widths = [law.columns for law in own]
    first = len(case.nominal)
    gram = with_priors(found.gram[1], first, members, widths, case.situation)
    return fit_of(members, own, gram, score)


def with_priors(
    gram: Float[np.ndarray, "all all"],
    first: int,
    members: Sequence[ModelTerm],
    widths: Sequence[int],
    situation: StaticState,
) -> Float[np.ndarray, "all all"]:
    """Return normal equations with what is known of coefficients before any reading.

    Args:
        gram: Of columns of which those of the members come one after the other.
        first: Number of the first of these.
        members: The terms.
        widths: How many columns each has.
        situation: Where the arm stood.
    """
    gram = gram.copy()
    diagonal = np.einsum("ii->i", gram)
    at = first
    for member, count in zip(members, widths, strict=True):
        sigma = member.hypothesis.prior_sigma(situation, member.where)
        if sigma is not None:
            diagonal[at : at + count] += sigma**-2.0
        at += count
    return gram


def fit_of(
    members: Sequence[ModelTerm],
    own: Sequence[EffectJacobian],
    gram: Float[np.ndarray, "columns columns"],
    score: Float[np.ndarray, " columns"],
) -> ModelFit:
    """Solve for nominal springs, which come first, and members.

    Args:
        members: The set.
        own: Their signatures.
        gram: Of the training poses.
        score: The same.
    """
    solved = solve(gram, score)
    n = len(gram) - sum(s.columns for s in own)
    before = float(score[:n] @ solve(gram[:n, :n], score[:n])) if n else 0.0
    gain = float(score @ solved) - before
    ends = np.cumsum([n, *(s.columns for s in own)])
    parts = tuple(solved[a:b] for a, b in pairwise(ends))
    freedom = sum(s.columns for s in own) + sum(m.degrees_of_freedom for m in members)
    return ModelFit(tuple(members), gain, solved[:n], parts, freedom, before)


LAW_ACCURACY = 0.0025
"""Share of what a name explains by which the form of its law may be wrong: log Bayes
factors are no more certain, and what explains less beside it may be its own. Chosen: a
twentieth of its amplitude, squared."""


# --- Test of the residual -------------------------------------------------------------


def other_forms(
    case: SelectionProblem, members: Sequence[ModelTerm]
) -> list[EffectJacobian]:
    """Return the other accepted forms of named laws.

    They are not held against a name, nor do they earn one for another effect.
    """
    forms = (m.hypothesis.variants(case.situation, m.where, m.shape) for m in members)
    return [form for form in forms if form.columns]


# --- Refinement of shapes -------------------------------------------------------------

WHOLE = ("with", "memory", "within", "beside", "law")
"""Shape parameters that count something and have nothing in between."""


def shape_columns(
    situation: StaticState, member: ModelTerm, coefficients: np.ndarray
) -> list[EffectJacobian]:
    """Return what a little more of each shape parameter does, per unit of it.

    Args:
        situation: Where the arm stood.
        member: Whose shape.
        coefficients: Of its columns; or several sets of them, one a column.
    """
    sets = coefficients.reshape(len(coefficients), -1)
    slopes = []
    for j, name in enumerate(member.shape_names):
        if name in WHOLE:
            slopes.append(EffectJacobian(sets.shape[1]))
            continue
        span = np.ptp(member.grid(situation, j))
        step = 1e-3 * (span if span > 0 else max(1.0, abs(member.shape[j])))
        if name in member.hypothesis.logarithmic:
            step = min(step, 0.5 * float(member.shape[j]))  # never below zero
        sides = (float(member.shape[j]) + by for by in (step, -step))
        high, low = (member.with_parameter(j, x).jacobian(situation) for x in sides)
        slopes.append(difference(high, low, sets / (2 * step)))
    return slopes


# --- Fit of all shapes together -------------------------------------------------------

EVALUATIONS = 6
"""How often a set is fitted at other shapes; chosen: the third step moves a hundredth
of the first, and some steps gain nothing."""
SPACING = 0.5
"""Prior standard deviation in spacings of the coarse grid."""
STEP = 1e-2
"""Part of a spacing, or of the shape, by which it is moved for its slope."""


@dataclass(frozen=True)
class FreeShape:
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

    @property
    def precision(self) -> float:
        """Inverse prior variance."""
        return (SPACING * self.spacing) ** -2

    def of(self, term: ModelTerm) -> float:
        """Return where it is in its term, as it moves."""
        value = float(term.shape[self.number])
        return float(np.log(value)) if self.factor else value

    def with_value(self, term: ModelTerm, value: float) -> ModelTerm:
        """Return its term with another value of it."""
        value = float(np.exp(value)) if self.factor else value
        return term.with_parameter(self.number, value)

    def slope(self, situation: StaticState, term: ModelTerm) -> EffectJacobian:
        """Return what a little more of it does per unit of each coefficient."""
        here = self.of(term)
        step = STEP * self.spacing
        if not self.factor and here != 0.0:
            step = min(step, STEP * abs(here))
        values = (here + step, here - step)
        high, low = (self.with_value(term, v).jacobian(situation) for v in values)
        return difference(high, low, np.eye(high.columns) / (2.0 * step))


def free_shapes(
    situation: StaticState, terms: Sequence[ModelTerm]
) -> tuple[FreeShape, ...]:
    """Return the shape parameters of a set that may move."""
    found = []
    for t, term in enumerate(terms):
        for j, name in enumerate(term.shape_names):
            factor = name in term.hypothesis.logarithmic
            own = term.grid(situation, j)
            at = np.log(own) if factor and own[0] > 0.0 else own
            if name in WHOLE or len(at) < 2 or (factor and own[0] <= 0.0):
                continue
            value = float(term.shape[j])
            here = float(np.log(value)) if factor else value
            nearest = int(np.argmin(np.abs(at - here)))
            beside = np.abs(np.delete(at, nearest) - at[nearest])
            spacing = float(beside.min())
            low, high = float(at[0]), float(at[-1])
            found.append(FreeShape(t, j, factor, low, high, spacing, here))
    return tuple(found)


def with_shapes(
    terms: Sequence[ModelTerm],
    shapes: Sequence[FreeShape],
    moved: Float[np.ndarray, " shapes"],
) -> tuple[ModelTerm, ...]:
    """Return a set whose shapes are elsewhere."""
    terms = list(terms)
    for shape, value in zip(shapes, moved, strict=True):
        terms[shape.term] = shape.with_value(terms[shape.term], float(value))
    return tuple(terms)


def prior_of(
    shapes: Sequence[FreeShape], terms: Sequence[ModelTerm]
) -> tuple[Float[np.ndarray, " shapes"], Float[np.ndarray, " shapes"]]:
    """Return inverse prior variances of shapes, and how far they are from starts."""
    away = [shape.of(terms[shape.term]) - shape.start for shape in shapes]
    return np.array([shape.precision for shape in shapes]), np.array(away)


def bounds_of(shapes: Sequence[FreeShape]) -> Bounds:
    """Return where shapes may be, and how far they go in one step."""
    values = np.array([(s.low, s.high, s.spacing) for s in shapes]).reshape(-1, 3)
    return Bounds(*values.T)


@dataclass(frozen=True, eq=False)
class HeldTerms:
    """Terms of a set that stay as they are, for others that are fitted beside them.

    Attributes:
        case: What may be looked at.
        terms: That stay.
        laws: Their columns.
        known: Nominal columns and theirs, and what the readings say of them; None:
            nothing stays, and all is laid out at once.
    """

    case: SelectionProblem
    terms: tuple[ModelTerm, ...] = ()
    laws: tuple[EffectJacobian, ...] = ()
    known: HeldColumns | None = None

    @classmethod
    def of(cls, case: SelectionProblem, terms: Sequence[ModelTerm]) -> "HeldTerms":
        """Lay the columns of terms out once."""
        laws = tuple(term.jacobian(case.situation) for term in terms)
        fold = training(case.split)
        known = HeldColumns.of(case.data, [*case.nominal, *laws], fold)
        return cls(case, tuple(terms), laws, known)

    def with_more(
        self, more: Sequence[EffectJacobian]
    ) -> tuple[Float[np.ndarray, "all all"], Float[np.ndarray, " all"]]:
        """Return normal equations of nominal columns, those that stay, and more."""
        if self.known is not None:
            return self.known.with_more(more)
        columns, fold = [*self.case.nominal, *more], training(self.case.split)
        found = normal_equations_of(self.case.data, columns, fold)
        return found.gram[1], found.score[fold == 1].sum(axis=0)

    def fitted_with(self, term: ModelTerm) -> ModelFit:
        """Return the fit with one more term, the last, at the shape that does most."""
        terms = (*self.terms, _with_best_shapes(self, [term])[-1])
        law = terms[-1].jacobian(self.case.situation)
        laws, (gram, score) = (*self.laws, law), self.with_more([law])
        widths, first = [own.columns for own in laws], len(self.case.nominal)
        gram = with_priors(gram, first, terms, widths, self.case.situation)
        return fit_of(terms, laws, gram, score)


def fit_shapes(
    case: SelectionProblem, terms: Sequence[ModelTerm]
) -> tuple[ModelTerm, ...]:
    """Move shapes of a set to where the set explains most.

    Args:
        case: What may be looked at.
        terms: The set, at shapes of the coarse grid or near.
    """
    return _with_best_shapes(HeldTerms(case), terms)


def _with_best_shapes(
    held: HeldTerms, terms: Sequence[ModelTerm]
) -> tuple[ModelTerm, ...]:
    """Return terms at the shapes at which all that stay and they explain most."""
    shapes = free_shapes(held.case.situation, terms)
    if not shapes:
        return tuple(terms)

    def linearise(moved: np.ndarray) -> Linearised:
        return _linearised(held, with_shapes(terms, shapes, moved), shapes)

    bounds, start = bounds_of(shapes), np.array([shape.start for shape in shapes])
    inside = np.clip(start, bounds.low, bounds.high)
    best = minimise(linearise, inside, bounds, EVALUATIONS)
    return with_shapes(terms, shapes, best.parameters)


def _linearised(
    held: HeldTerms, moving: Sequence[ModelTerm], shapes: Sequence[FreeShape]
) -> Linearised:
    """Fit a set, and return what its shapes' slopes say beside its coefficients.

    The slopes are those of the fit's own coefficients, which one pass over the readings
    does not know yet: all columns' slopes are laid out and then added up.
    """
    case, terms = held.case, (*held.terms, *moving)
    own = [term.jacobian(case.situation) for term in moving]
    slopes = [s.slope(case.situation, moving[s.term]) for s in shapes]
    laws, (gram, score) = (*held.laws, *own), held.with_more([*own, *slopes])
    widths = [law.columns for law in laws]
    gram = with_priors(gram, len(case.nominal), terms, widths, case.situation)
    width = len(case.nominal) + sum(widths)
    fit = fit_of(terms, laws, gram[:width, :width], score[:width])
    sizes = fit.coefficients[len(held.terms) :]
    mix = np.zeros((len(gram), width + len(shapes)))
    mix[:width, :width] = np.eye(width)
    at = width
    for column, (shape, slope) in enumerate(zip(shapes, slopes, strict=True), width):
        mix[at : at + slope.columns, column] = sizes[shape.term]
        at += slope.columns
    gram, score = mix.T @ gram @ mix, mix.T @ score
    problem = Linearised.of_some(gram, score, np.arange(width, len(gram)))
    precision, away = prior_of(shapes, moving)
    return problem.with_prior(precision, away, -fit.gain - fit.nominal_gain)
