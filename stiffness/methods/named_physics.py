"""Named physics: springs, the laws that a diagnosis names, and a prior over the others.

The recording is diagnosed, and what was named is fitted to all poses beside springs,
with the shapes that the diagnosis found. All laws of gears and structure without a name
stay beside as random effects, whose variances are learnt: what is too weak to be named,
and where, is shrunken and not left away. They go where poses that were left out are not
better predicted with them. Where that leaves no law at all, where nothing differs from
springs, or where the set-up is mistaken, the springs predict alone.

==========  ==========================================================================
Equation    d = p(q_loaded) - p(q_unloaded) + sum_k X_k b_k, X_k a law's columns loaded
            less unloaded; springs free, b_k ~ N(0, v_k), sqrt(v_k) uniform: v_k =
            |b_k|^2 / (1 + n_k - tr C_k / v_k), C_k covariance of the n_k
            coefficients b_k given all readings
Source      columns: `stiffness.effects`; variances: MacKay 1992, "Bayesian
            interpolation", Neural Computation 4, 415; their prior: Gelman 2006, "Prior
            distributions for variance parameters", Bayesian Analysis 1, 515
Needs       what the virtual joint model needs
Assumes     a load that is put on for the first time, in the recording's steps and after
            its waits; noise as measured
Ignores     errors of instruments and of geometry, and masses: within a visit these
            stay, or are of second order
==========  ==========================================================================
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float, Int
from typing_extensions import override

from bench.shared.effect_catalogue import CATALOGUE, si_unit
from bench.shared.recording import LOADED, LOADING, UNLOADED, Recording, WrenchSpec
from stiffness.diagnosis.diagnose import diagnose
from stiffness.diagnosis.model_fit import ModelTerm
from stiffness.diagnosis.nominal_fit import Prepared, prepare
from stiffness.diagnosis.result import Diagnosis, NamedEffect
from stiffness.diagnosis.sufficient_statistics import normal_equations_of
from stiffness.effects import HYPOTHESES
from stiffness.effects.jacobian import BodyTwist, EffectJacobian, JointRotation
from stiffness.effects.statics import springs_of
from stiffness.experiment.deflections import LoadCases, end_effector_markers
from stiffness.experiment.sensor_noise import average_encoders
from stiffness.experiment.static_state import StaticState, static_state_of
from stiffness.methods.method import Fitted, Method, Parameter
from stiffness.methods.vjm import Vjm, VjmFit
from stiffness.regression.empirical_bayes import Solved, VarianceComponents, solved
from stiffness.regression.normal_equations import Normal
from stiffness.regression.splits import split_of
from stiffness.robot.arm import Arm

# --- Method ---------------------------------------------------------------------------

MECHANISMS = tuple(
    law
    for law in HYPOTHESES
    if CATALOGUE[law.effect].family in ("gear", "structure")
    and "within_visit" in CATALOGUE[law.effect].visible_in
)
"""Laws by which an arm gives way under a load."""
NAMES = frozenset(law.effect for law in MECHANISMS)


@dataclass(frozen=True)
class NamedPhysics(Method):
    """Springs and the physics that a diagnosis names, with a prior over the others.

    Attributes:
        held: Axes whose compliance the springs take from the model, as in `Vjm`.
        targets: `flange`: the readings of the end-effector's markers, as the other
            methods use them; `all`: of every marker.
    """

    arm: Arm
    held: tuple[str, ...] = ()
    targets: Literal["flange", "all"] = "flange"

    @override
    def fit(self, recording: Recording) -> "NamedPhysicsFit":
        """Diagnose, then fit all poses again with what was named; see the base class.

        Raises:
            Unusable: Where the recording cannot be used, with all faults.
            NotIdentifiable: Where an axis cannot be identified, by name.
        """
        arm = self.arm.for_recording(recording)
        springs = Vjm(self.arm, self.held).fit(recording)
        recording = recording.take(np.argsort(recording.visit, kind="stable"))
        if self.targets == "flange":
            recording = recording.watching(end_effector_markers(arm, recording))
        diagnosis = diagnose(recording, self.arm)
        if diagnosis.verdict == "no_mismatch" or diagnosis.nominal is None:
            return NamedPhysicsFit(springs, diagnosis, None)
        prepared = prepare(average_encoders(recording), arm)
        return NamedPhysicsFit(springs, diagnosis, _mechanics_of(prepared, diagnosis))


@dataclass(frozen=True, eq=False)
class NamedPhysicsFit(Fitted):
    """Fitted springs and laws.

    Attributes:
        springs: The virtual joint model of the same readings; it predicts where there
            is no law.
        diagnosis: What was named in them.
        mechanics: All laws with their coefficients; None where springs predict alone.
    """

    springs: VjmFit
    diagnosis: Diagnosis
    mechanics: "Mechanics | None"

    def names_alone(self) -> "Mechanics | None":
        """Return the names by the sizes that the diagnosis gave them, as its patch has.

        None where nothing was named that gives way under a load.
        """
        nominal, known = self.diagnosis.nominal, self.mechanics
        named = [e for e in self.diagnosis.named if e.name.effect in NAMES]
        if nominal is None or known is None or not named:
            return None
        own = list(known.springs)
        return replace(
            known,
            softer=nominal.compliance[own] - known.situation.compliance[own],
            terms=tuple(_term(e, known.situation) for e in named),
            coefficients=tuple(np.array(e.coefficients, float) for e in named),
        )

    @override
    def predict(self, cases: LoadCases) -> Float[np.ndarray, "cases 3"]:
        """Predict the motion of each case's first loading; see the base class."""
        if self.mechanics is None:
            return self.springs.predict(cases)
        return self.mechanics.displacement(cases)

    @property
    @override
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters of what was named; the springs' where nothing was."""
        if self.mechanics is None:
            return self.springs.parameters
        found = []
        for effect in self.diagnosis.named:
            for name, p in effect.parameters.items():
                sigma = p.sigma
                called = f"{effect.name.effect}@{effect.name.where} {name}"
                unit = si_unit(name)
                ends = (float(p.low), float(p.high))
                found.append(
                    Parameter(called, float(p.estimate), float(sigma), unit, *ends)
                )
        return tuple(found)


# --- Mechanics ------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class LoadPath:
    """How a visit puts its load on, up to the first reading under all of it.

    Attributes:
        share: Of the load in each step; 0 first, 1 last.
        changed: When the load changed, in s.
        read: When it was read, in s.
    """

    share: Float[np.ndarray, " steps"]
    changed: Float[np.ndarray, " steps"]
    read: Float[np.ndarray, " steps"]


@dataclass(frozen=True, eq=False)
class Mechanics:
    """Springs and laws with their coefficients.

    Attributes:
        situation: Where the arm stood when it was fitted.
        springs: Axes whose compliance is fitted, from 0.
        softer: By how much each of these is softer than in `situation`.
        terms: Laws at places.
        coefficients: Of each term.
        path: How a load is put on.
    """

    situation: StaticState
    springs: tuple[int, ...]
    softer: Float[np.ndarray, " springs"]
    terms: tuple[ModelTerm, ...]
    coefficients: tuple[Float[np.ndarray, " _"], ...]
    path: LoadPath

    def displacement(self, cases: LoadCases) -> Float[np.ndarray, "cases 3"]:
        """Return the motion of each case's point under its load, in m."""
        state, steps = self._state_of(cases), len(self.path.share)
        point = state.arm.point_in_base(
            state.rest, "flange", np.repeat(cases.point_in_flange, steps, axis=0)
        )
        place = point.copy()
        nominal = springs_of(state, self.springs)
        for law, size in zip(nominal, self.softer, strict=True):
            place += _displacement_of(law, np.array([size]), state, point)
        for term, sizes in zip(self.terms, self.coefficients, strict=True):
            place += _displacement_of(term.jacobian(state), sizes, state, point)
        place = place.reshape(len(cases), steps, 3)
        return place[:, -1] - place[:, 0]

    def _state_of(self, cases: LoadCases) -> StaticState:
        """Return the static state of visits that put each case's load on."""
        known, path = self.situation.recording, self.path
        count, steps = len(cases), len(path.share)
        stage = np.array([UNLOADED, *[LOADING] * (steps - 2), LOADED])
        load = cases.wrench_in_base[:, None] * path.share[:, None]
        visits = Recording(
            name=known.name,
            time=np.tile(path.read, count),
            posture_id=np.repeat(np.arange(count), steps),
            visit=np.repeat(np.arange(count), steps),
            posture=np.repeat(cases.posture, steps, axis=0),
            load_time=np.tile(path.changed, count),
            stage=np.tile(stage, count),
            axes=known.axes,
            bodies=known.bodies,
            slides=known.slides,
            wrench=load.reshape(count * steps, 6),
            markers=known.markers,
            points=np.full((count * steps, len(known.markers), 3), np.nan),
            wrench_sensor=WrenchSpec(
                0.0, 0.0, position=cases.origin_in_flange, frame="base"
            ),
            tool=cases.payload,
            displacement=known.displacement,
        )
        here = self.situation
        state = static_state_of(here.arm, visits, here.compliance, here.bodies)
        return replace(state, frames=here.frames)


def _displacement_of(
    law: EffectJacobian,
    sizes: Float[np.ndarray, " columns"],
    state: StaticState,
    point: Float[np.ndarray, "rows 3"],
) -> Float[np.ndarray, "rows 3"]:
    """Return how a law moves points of the flange, in m."""
    twist = np.zeros((state.rows, 6))
    flange = state.arm.attachment("flange").axis
    carriers = state.arm.chain.carriers(flange)
    for part in law.parts:
        if isinstance(part, JointRotation) and part.axis in carriers:
            twist += state.screw[:, part.axis] * (part.law @ sizes)[:, None]
        elif isinstance(part, BodyTwist) and part.site - 1 in (-1, *carriers):
            twist += part.twist @ sizes
    return twist[:, :3] + np.cross(twist[:, 3:], point)


NEARLY_FULL = 0.97
"""Share of a visit's largest force that counts as all of it; chosen: readings of one
weight differ by noise, and steps by more."""


def path_of(recording: Recording) -> LoadPath:
    """Return the usual way in which a recording's visits put their load on.

    Medians over the visits with the usual number of steps. Where a visit's first
    reading is not its unloaded one, the load is put on in one step.
    """
    assert recording.wrench is not None
    starts, steps = [], []
    for visit in np.unique(recording.visit):
        rows = np.flatnonzero(recording.visit == visit)
        force = recording.wrench[rows, :3]
        size = np.linalg.norm(force - force[0], axis=1)
        full = int(np.argmax(size >= NEARLY_FULL * size.max()))
        usual = recording.stage[rows[0]] == UNLOADED and full > 0
        starts.append((rows, size / size[full] if usual else None))
        steps.append(full if usual else 0)
    count = int(np.argmax(np.bincount(steps)))
    if count == 0:
        wait = np.median(recording.time - recording.load_time)
        begun = np.array([0.0, 1.0]) * wait
        return LoadPath(np.array([0.0, 1.0]), begun, begun + wait)
    usual = [s for s, full in zip(starts, steps, strict=True) if full == count]
    some = np.array([rows[: count + 1] for rows, _ in usual])
    share = np.median([own[: count + 1] for _, own in usual], axis=0)
    begun = recording.load_time[some[:, :1]]
    changed = np.median(recording.load_time[some] - begun, axis=0)
    read = np.median(recording.time[some] - begun, axis=0)
    share[0], share[-1] = 0.0, 1.0
    return LoadPath(share, changed, read)


# --- Fit ------------------------------------------------------------------------------

FIRST_VARIANCE = 1e3
"""Of a coefficient before the readings have spoken, in units of what they know of it;
chosen: some thirty standard errors."""
FAINTEST = 1e-6
"""The same of a law that is not there; chosen: a thousandth of a standard error."""
LEAST_FITTED = 1e-3
"""Coefficients fitted with a law, as a number, below which it is not there; chosen."""
ROUNDING = 1e-8
"""Least that readings know of a direction, as a share of what they know of the best;
chosen: above what sums in single precision leave."""
ROUNDS = 100
SETTLED = 0.02
"""Change of a variance's logarithm, times what is fitted with it, that ends the rounds;
chosen."""


def _term(effect: NamedEffect, situation: StaticState) -> ModelTerm:
    """Return a named effect as the law, of several with its name, that was fitted."""
    where, shape = effect.name.where, np.array(effect.shape, dtype=float)
    laws = [law for law in MECHANISMS if law.effect == effect.name.effect]
    terms = [
        ModelTerm(law, where, shape)
        for law in laws
        if len(law.shape_names) == len(shape)
    ]
    sizes = len(effect.coefficients)
    own = (t for t in terms if t.jacobian(situation).columns == sizes)
    return next(own, ModelTerm(laws[0], where, shape))


def _mechanics_of(prepared: Prepared, diagnosis: Diagnosis) -> Mechanics | None:
    """Fit springs and laws to all poses, within visits alone; None without a law."""
    here = prepared.situation
    bands = [[_term(e, here)] for e in diagnosis.named if e.name.effect in NAMES]
    named = len(bands)
    bands += [
        [ModelTerm(law, where, shape) for shape in law.shapes(here, where)]
        for law in MECHANISMS
        for where in law.places(here)
    ]
    terms = [term for band in bands for term in band]
    laws = [term.jacobian(here) for term in terms]
    nominal = springs_of(here, prepared.springs)
    data = replace(prepared.data, between=None)
    fold = split_of(here.recording).fold
    found = normal_equations_of(data, [*nominal, *laws], fold)
    score = np.stack(
        [found.score[fold == f].sum(axis=0) for f in range(fold.max() + 1)]
    )
    of_term = np.repeat(np.arange(len(bands)), [len(band) for band in bands])
    of_column = np.repeat(of_term, [law.columns for law in laws])
    band = np.concatenate([np.full(len(nominal), -1), of_column]).astype(int)
    square = float(np.sum(data.within.square))
    if not _is_better(found.gram, score, band, named, square):
        terms = terms[:named]
    if not terms:
        return None
    width = len(nominal) + sum(law.columns for law in laws[: len(terms)])
    gram, asked = found.gram.sum(axis=0)[:width, :width], score.sum(axis=0)[:width]
    sizes = shrunken_fit(gram, asked, band[:width], square)
    ends = np.cumsum([len(nominal), *(law.columns for law in laws[: len(terms)])])
    softer, *coefficients = np.split(sizes, ends[:-1])
    path = path_of(here.recording)
    return Mechanics(
        here, prepared.springs, softer, tuple(terms), tuple(coefficients), path
    )


def _is_better(
    gram: Float[np.ndarray, "folds columns columns"],
    score: Float[np.ndarray, "folds columns"],
    band: Int[np.ndarray, " columns"],
    named: int,
    square: float,
) -> bool:
    """Return whether poses left out are better predicted with the bands of no name.

    A fold of neighbouring poses is left out at a time; the variances are learnt without
    it too.
    """
    whole, asked, few = gram.sum(axis=0), score.sum(axis=0), band < named
    gain = []
    for own, ask in zip(gram, score, strict=True):
        if not ask.any():
            continue
        predicted = []
        for some in (few, np.ones_like(few)):
            at = np.ix_(some, some)
            sizes = shrunken_fit(
                (whole - own)[at], (asked - ask)[some], band[some], square
            )
            predicted.append(ask[some] @ sizes - 0.5 * sizes @ own[at] @ sizes)
        gain.append(predicted[1] - predicted[0])
    return float(np.sum(gain)) > 0.0


def shrunken_fit(
    gram: Float[np.ndarray, "columns columns"],
    score: Float[np.ndarray, " columns"],
    band: Int[np.ndarray, " columns"],
    square: float,
) -> Float[np.ndarray, " columns"]:
    """Solve normal equations whose bands of columns have a variance each, learnt.

    The Gram matrix is X' S^-1 X, the score X' S^-1 y, the square y' S^-1 y, beyond
    which no band explains; a negative band is free. A band's coefficients share one
    unit, that of what the readings know of them on average: a column that they hardly
    see stays at its prior.
    """
    free, count = band < 0, int(band.max(initial=-1)) + 1
    known = np.maximum(np.diag(gram), 0.0)
    unit = known.copy()
    for b in range(count):
        unit[band == b] = known[band == b].mean()
    scale = np.where(unit > 0.0, 1.0 / np.sqrt(np.where(unit > 0.0, unit, 1.0)), 0.0)
    value, vector = np.linalg.eigh(gram * scale * scale[:, None])
    value = np.maximum(value, ROUNDING * value.max(initial=1.0))
    white = (vector * value) @ vector.T
    normal = Normal(white, score * scale, square, 0)
    variance, alive = np.full(count, FIRST_VARIANCE), np.ones(count, dtype=bool)
    found = _solved(normal, band, variance)
    for _ in range(ROUNDS):
        used = 1.0 - found.precision * found.spread()
        fitted = np.bincount(band[~free], used[~free], count)
        size = np.bincount(band[~free], (found.x**2)[~free], count)
        alive &= fitted > LEAST_FITTED
        new = np.clip(size / (fitted + 1.0), FAINTEST, square)
        new[~alive] = FAINTEST
        change = np.abs(np.log(new / variance)) * np.minimum(fitted, 1.0)
        variance = new
        found = _solved(normal, band, variance)
        if change.max(initial=0.0) < SETTLED:
            break
    return found.x * scale


def _solved(
    normal: Normal,
    band: Int[np.ndarray, " columns"],
    variance: Sequence[float] | Float[np.ndarray, " bands"],
) -> Solved:
    """Solve with variances as they are; readings are white, so their noise is one."""
    return solved(normal, band, VarianceComponents(1.0, np.asarray(variance)))
