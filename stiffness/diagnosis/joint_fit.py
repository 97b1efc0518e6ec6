"""Joint fit of springs, coefficients and shapes with the columns that they lay out.

What a set does depends on the springs and loads under which its columns are laid out,
and these are the set's own. All of them are fitted together.

==========  ==========================================================================
Equation    min |y - f(x)|^2 + priors; f: the columns as laid out under x, times x's
            coefficients; df/dx: these columns, slopes of shapes, and what a little more
            of x changes of other columns, by differences: of its own gear's laws, or of
            all where it is a load; of springs also how far the arm has turned
Source      Levenberg-Marquardt: `regression.normal_equations`; terms without a name
            are eliminated, Golub and Pereyra 1973
Valid       from a set that was fitted to columns of another layout
Ignores     what springs change of the others' columns beyond their gear, and x of terms
            without a name, which are laid out again once; sets of other names
==========  ==========================================================================
"""

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from bench.shared.errors import BenchError
from stiffness.diagnosis.model_fit import (
    STEP,
    FeltByOthers,
    FreeShape,
    ModelFit,
    SelectionProblem,
    bounds_of,
    fit_model,
    free_shapes,
    prior_of,
    training,
    with_priors,
    with_shapes,
)
from stiffness.diagnosis.nominal_fit import Prepared
from stiffness.diagnosis.relinearisation import (
    TINY,
    build_problem,
    laid_out_softer,
    moved_under,
    nominal_problem,
    slopes_beyond_linear,
    softened,
    softening_of,
    state_under,
)
from stiffness.diagnosis.sufficient_statistics import (
    normal_equations_of,
)
from stiffness.effects.base import Hypothesis
from stiffness.effects.jacobian import (
    EffectJacobian,
    JacobianBlock,
    JointRotation,
    added,
    difference,
    hstack,
    mixture,
    turn,
    values,
)
from stiffness.effects.statics import springs_of
from stiffness.experiment.static_state import StaticState
from stiffness.regression.normal_equations import Bounds, Linearised, minimise
from stiffness.regression.splits import Split

EVALUATIONS = 20
"""How often a set is laid out and fitted at most; chosen: most need three to five."""
SMALL = 1e-3
"""Part of a compliance or a coefficient by which it is changed for a slope; chosen."""


# --- Operating point ------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class OperatingPoint:
    """What columns are laid out under, and the fit of a set to them.

    Attributes:
        softer: By how much compliances are other than prepared, in rad/(N m).
        named: What acts on the columns.
        felt: What more of that changes of itself.
        fit: The set.
        square: Whitened square of the training poses that it does not explain.
    """

    softer: Float[np.ndarray, " springs"]
    named: ModelFit
    felt: FeltByOthers
    fit: ModelFit
    square: float

    def worth(self, poses: int) -> float:
        """Return the set's log Bayes factor against another, but for what both have."""
        return worth_of(self.fit, self.square, poses)

    def over(self, other: "OperatingPoint", poses: int) -> float:
        """Return the log Bayes factor against another set."""
        return self.worth(poses) - other.worth(poses)


def worth_of(fit: ModelFit, square: float, poses: int) -> float:
    """Return what a set is worth that leaves a whitened square, by BIC."""
    return -0.5 * (square + fit.degrees_of_freedom * float(np.log(poses)))


@dataclass(frozen=True, eq=False)
class Layout:
    """How columns are laid out under a set.

    Attributes:
        prepared: The recording against its nominal model.
        hypotheses: What may be named.
    """

    prepared: Prepared
    hypotheses: Sequence[Hypothesis]

    def at(self, point: OperatingPoint) -> SelectionProblem:
        """Lay all columns out at an operating point."""
        given = (point.softer, point.named)
        case = build_problem(self.prepared, self.hypotheses, *given)
        return replace(case, felt=point.felt)

    def fitted_jointly(self, case: SelectionProblem, fit: ModelFit) -> OperatingPoint:
        """Fit springs, coefficients and shapes with the columns that they lay out.

        What acts on the columns and is not in the set acts no more.

        Args:
            case: As laid out.
            fit: The set.
        """
        shapes = free_shapes(case.situation, fit.members)
        nameless = nameless_columns(fit, case.situation)
        joint = _JointFit(self.prepared, case.split, fit, shapes, nameless)
        start = laid_out_softer(case, self.prepared) + fit.springs
        best = minimise(joint.linearise, joint.start(start), joint.bounds, EVALUATIONS)
        if nameless:  # columns of functions of the loads that were found
            joint = joint.laid_out_at(best.parameters)
            again = joint.bounds, EVALUATIONS
            best = minimise(joint.linearise, best.parameters, *again)
        softer, named = joint.at(best.parameters)
        softer = softer + joint.more(named)
        case = nominal_problem(self.prepared, softer, named)
        felt, fit = joint.felt(best.parameters), fit_model(case, named.members)
        return OperatingPoint(softer, named, felt, fit, unexplained(case, fit))


def unexplained(case: SelectionProblem, fit: ModelFit) -> float:
    """Return the whitened square of the training poses that a set does not explain."""
    mismatch = case.data.mismatch_of_poses[~case.split.held_out]
    return float(mismatch.sum()) - fit.nominal_gain - fit.gain


# --- Readings as a function of all parameters -----------------------------------------


@dataclass(frozen=True, eq=False)
class _JointFit:
    """Readings as a function of springs, coefficients and shapes of a set.

    Parameters are changes of compliances, coefficients of names, and shapes. Columns
    are laid out under these, so that slopes hold what a law of a gear changes of the
    others. Terms without a name are fitted anew each time, each with columns that stay
    as they are: any function that is much alike does what they are there for.

    Attributes:
        prepared: The recording against its nominal model.
        split: Which poses may be looked at.
        first: The set as it was fitted before.
        shapes: That may move.
        nameless: Columns of the terms without a name.
    """

    prepared: Prepared
    split: Split
    first: ModelFit
    shapes: tuple[FreeShape, ...]
    nameless: tuple[EffectJacobian, ...]

    def laid_out_at(self, parameters: Float[np.ndarray, " parameters"]) -> "_JointFit":
        """Return the same with terms without a name under what parameters say."""
        named = self.at(parameters)[1]
        state = state_under(self._stands(parameters), named)
        return replace(self, nameless=nameless_columns(named, state))

    def _stands(self, parameters: Float[np.ndarray, " parameters"]) -> StaticState:
        """Return where the arm rests, before what laws make felt."""
        softer, named = self.at(parameters)
        return moved_under(self.prepared, softer + self.more(named), named)[1]

    @property
    def owners(self) -> list[int]:
        """Number of the member of each coefficient of a name."""
        every = zip(self.first.members, self.first.coefficients, strict=True)
        return [k for k, (m, c) in enumerate(every) if not m.is_generic for _ in c]

    @property
    def bounds(self) -> Bounds:
        """Springs are not below rigid, shapes on the grid; all else is free."""
        before = self.prepared.situation.compliance[list(self.prepared.springs)]
        free = np.full(len(before) + len(self.owners), np.inf)
        own = bounds_of(self.shapes)
        least = np.concatenate([-before, -free[len(before) :], own.low])
        most, longest = (np.concatenate([free, x]) for x in (own.high, own.longest))
        return Bounds(least, most, longest)

    def start(self, softer: Float[np.ndarray, " springs"]) -> np.ndarray:
        """Return the parameters of the set as it was fitted before."""
        every = zip(self.first.members, self.first.coefficients, strict=True)
        named = [size for member, size in every if not member.is_generic]
        start = [shape.start for shape in self.shapes]
        whole, bounds = np.concatenate([softer, *named, start]), self.bounds
        return np.clip(whole, bounds.low, bounds.high)

    def at(
        self, parameters: Float[np.ndarray, " parameters"]
    ) -> tuple[Float[np.ndarray, " springs"], ModelFit]:
        """Return changes of compliances, and the set with its coefficients."""
        count, owners = len(self.prepared.springs), np.array(self.owners, dtype=int)
        sizes = parameters[count : count + len(owners)]
        coefficients = tuple(
            old if member.is_generic else sizes[owners == k]
            for k, (member, old) in enumerate(
                zip(self.first.members, self.first.coefficients, strict=True)
            )
        )
        moved = parameters[count + len(owners) :]
        members = with_shapes(self.first.members, self.shapes, moved)
        fit = replace(self.first, members=members, coefficients=coefficients)
        return parameters[:count], fit

    def more(self, named: ModelFit) -> Float[np.ndarray, " springs"]:
        """Return by how much a set softens springs on average over rows."""
        own = self.prepared.springs
        return softening_of(self.prepared.situation, own, named)

    def linearise(self, parameters: Float[np.ndarray, " parameters"]) -> Linearised:
        """Return the least-squares problem about some parameters."""
        count = len(parameters)
        softer, named = self.at(parameters)
        try:
            data, stands = moved_under(self.prepared, softer + self.more(named), named)
        except BenchError:  # springs too soft for the load
            nothing = np.zeros((count, count))
            return Linearised(np.inf, np.zeros(count), nothing)
        state, springs = state_under(stands, named), list(self.prepared.springs)
        every = list(zip(named.members, named.coefficients, strict=True))
        names = [m for m, _ in every if not m.is_generic]
        laws = [m.jacobian(state) for m in names]
        slopes = [
            mixture(s.slope(state, every[s.term][0]), every[s.term][1][:, None])
            for s in self.shapes
        ]
        felt = self._of_others(parameters, stands, state)
        known = [*springs_of(state, springs), *laws, *slopes, *self.nameless]
        found = normal_equations_of(
            data, [*known, *felt.values()], training(self.split)
        )
        gram, score = found.gram[1], found.score[~self.split.held_out].sum(axis=0)
        widths = [law.columns for law in laws]
        gram = with_priors(gram, len(springs), names, widths, state)

        # about what the columns of springs and laws make of the readings there
        before = self.prepared.situation.compliance
        size = np.zeros(len(gram))
        size[:count] = parameters
        size[: len(springs)] -= (stands.compliance - before)[springs]
        size[count - len(self.shapes) : count] = 0.0
        mix = np.eye(len(gram), len(gram) - len(felt))
        mix[len(gram) - len(felt) + np.arange(len(felt)), list(felt)] = 1.0
        square = float(data.mismatch_of_poses[~self.split.held_out].sum())
        square += float(size @ (gram @ size - 2.0 * score))
        left = mix.T @ (score - gram @ size)
        problem = Linearised.of_some(mix.T @ gram @ mix, left, np.arange(count))
        prior = prior_of(self.shapes, named.members)
        return problem.with_prior(*prior, square + problem.square)

    def felt(self, parameters: Float[np.ndarray, " parameters"]) -> FeltByOthers:
        """Return what more of parameters changes of what others displace, by name."""
        named, stands = self.at(parameters)[1], self._stands(parameters)
        found = self._of_others(parameters, stands, state_under(stands, named))
        members, sizes = named.members, named.coefficients
        own, owners = self.prepared.springs, np.array(self.owners, dtype=int)
        nothing, laws, shapes = EffectJacobian(1), {}, {}
        for k in sorted(set(self.owners)):
            each = len(own) + np.flatnonzero(owners == k)
            laws[members[k].name] = hstack([found.get(int(j), nothing) for j in each])
        for j, shape in enumerate(self.shapes, len(own) + len(owners)):
            member, size = members[shape.term], sizes[shape.term]
            unit = 1.0 / member.shape[shape.number] if shape.factor else 1.0
            each = unit * size[None] / max(float(size @ size), TINY**4)
            if j in found:
                shapes[member.name, shape.number] = mixture(found[j], each)
        springs = tuple(found.get(j, nothing) for j in range(len(own)))
        whole = {m.name: c for m, c in zip(members, sizes, strict=True)}
        return FeltByOthers(springs, laws, shapes, whole)

    def _of_others(
        self,
        parameters: Float[np.ndarray, " parameters"],
        stands: StaticState,
        state: StaticState,
    ) -> dict[int, EffectJacobian]:
        """Return what more of a parameter changes of other laws' columns.

        Laws of one gear make each other feel their torque: one parameter of each axis
        is changed at a time. Loads are felt everywhere: each is changed by itself.

        Args:
            parameters: All of them.
            stands: Where the arm rests under them, before what laws make felt.
            state: With that.
        """
        softer, named = self.at(parameters)
        steps, found = self._steps(parameters, stands), dict[int, EffectJacobian]()
        turning = self._turning(stands)
        of_axes, of_all = (_moved_by(named, state, some) for some in (turning, None))
        for changed in self._changed_together(stands, turning):
            moved = parameters.copy()
            moved[list(changed)] += steps[list(changed)]
            everywhere = None in changed.values()
            before, some = (of_all, None) if everywhere else (of_axes, turning)
            after = _moved_by(named, self._acting(moved, stands), some)
            for j, axis in changed.items():
                one = difference(after, before, np.array([[1.0 / steps[j]]]))
                on = (p for p in one.parts if axis is None or _rotates(p, axis))
                parts = tuple(p for p in on if np.any(values(p) != 0.0))
                if parts:
                    found[j] = EffectJacobian(1, parts)
        # lever arms and loads of where the arm rests, which generic terms do not hold
        for j, more in enumerate(slopes_beyond_linear(self.prepared, stands)):
            found[j] = added(found[j], more) if j in found else more
        # a spring's own column has a load's torque, and so have what loads displace,
        # where columns are laid out under all of the spring's change
        own = list(self.prepared.springs)
        whole = self.prepared.situation.compliance[own] + softer + self.more(named)
        laid_out = np.isclose(stands.compliance[own], whole)
        acting = state.torque - stands.torque
        for j, axis in enumerate(own):
            if laid_out[j] and np.any(acting[:, axis] != 0.0):
                twice = turn(axis, -acting[:, axis])
                found[j] = added(found[j], twice) if j in found else twice
        return found

    def _acting(
        self, parameters: Float[np.ndarray, " parameters"], stands: StaticState
    ) -> StaticState:
        """Return the state with what laws make each other feel, the arm resting."""
        softer, named = self.at(parameters)
        compliance = softened(self.prepared, softer + self.more(named))
        return state_under(stands.with_compliance(compliance), named)

    def _turning(self, situation: StaticState) -> frozenset[int]:
        """Return the numbers of the names that turn axes."""
        return frozenset(
            k
            for k, m in enumerate(self.first.members)
            if not m.is_generic
            and any(isinstance(p, JointRotation) for p in m.jacobian(situation).parts)
        )

    def _changed_together(
        self, situation: StaticState, turning: Collection[int]
    ) -> list[dict[int, int | None]]:
        """Return parameters with the axis that they turn; None: they act everywhere."""
        index = {where: k for k, where in enumerate(situation.axes)}
        members = self.first.members
        owners = [*self.owners, *(shape.term for shape in self.shapes)]
        together, alone = list[dict[int, int | None]](), list[dict[int, int | None]]()
        on = Counter[int]()
        of_springs = enumerate(self.prepared.springs)
        of_members = (
            (j, index.get(members[k].where))
            for j, k in enumerate(owners, len(self.prepared.springs))
            if k in turning
        )
        for j, axis in (*of_springs, *of_members):
            if axis is None:
                alone.append({j: None})
                continue
            if on[axis] == len(together):
                together.append({})
            together[on[axis]][j] = axis
            on[axis] += 1
        return [*together, *alone]

    def _steps(
        self, parameters: Float[np.ndarray, " parameters"], situation: StaticState
    ) -> Float[np.ndarray, " parameters"]:
        """Return small changes of parameters, by which slopes are taken."""
        springs, owners = list(self.prepared.springs), np.array(self.owners, dtype=int)
        sizes = parameters[len(springs) : len(springs) + len(owners)]
        whole = [np.linalg.norm(sizes[owners == k]) for k in owners]
        steps = [*situation.compliance[springs], *whole]
        of_shapes = [STEP * shape.spacing for shape in self.shapes]
        return np.array([*(SMALL * max(step, TINY**2) for step in steps), *of_shapes])


def nameless_columns(
    fit: ModelFit, situation: StaticState
) -> tuple[EffectJacobian, ...]:
    """Return the columns of the terms of a set that have no name."""
    return tuple(m.jacobian(situation) for m in fit.members if m.is_generic)


def _moved_by(
    fit: ModelFit, state: StaticState, some: Collection[int] | None
) -> EffectJacobian:
    """Return what names, all or some, displace in a state, as one column."""
    every = enumerate(zip(fit.members, fit.coefficients, strict=True))
    return added(
        EffectJacobian(1),
        *(
            mixture(m.jacobian(state), c[:, None])
            for k, (m, c) in every
            if not m.is_generic and (some is None or k in some)
        ),
    )


def _rotates(part: JacobianBlock, axis: int) -> bool:
    return isinstance(part, JointRotation) and part.axis == axis
