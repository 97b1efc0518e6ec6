"""Gate on observations left out: names that predict nothing go, the weakest first.

Each fold of units is predicted by a fit to the others, with and without a name. Fits
are shrunken: a part of the units goes astray along nearly collinear directions, and
would condemn true names. The prior is held while names go.

==========  ==========================================================================
Equation    beta_f = (A - A_f + L)^-1 (s - s_f), L = k / |b|^2 on the k columns of a
            term, b its coefficients by all units, in columns made white beside the
            nominal ones; gain_p = s_p'beta - beta'A_p beta / 2; l the units' gains
            that are lost without a name; kept where fewer than 2.3 % of random signs of
            the units make as large a sum of l; z = sum l / |l| orders the names
Source      ridge regression with a term's own mean square as its prior variance: MacKay
            1992, "Bayesian interpolation", one step; leave-groups-out validation;
            sign flips: Fisher 1935, "The Design of Experiments", section 21
Valid       units that err independently, ten of them or more
Ignores     that the set was chosen with the same units
==========  ==========================================================================
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np
from jaxtyping import Float, Int
from scipy.stats import norm

from bench.shared.settings import Interval
from stiffness.regression.normal_equations import (
    projection_coefficients,
    schur_complement,
    whitening_transform,
)
from stiffness.regression.testing import MARGIN

COMPARED = 2000
"""Signs that a loss is compared with, its own among them; chosen: 45 are the margin."""


Name = tuple[str, str]


@dataclass(frozen=True)
class Decision:
    """One gate's verdict on one candidate.

    Attributes:
        candidate: Name of the law.
        gate: Which test it met.
        accepted: Whether it passed.
        statistic: What was compared.
        threshold: With what.
        reason: In words.
        parameters: What the candidate had there, where they were worked out.
    """

    candidate: Name
    gate: str
    accepted: bool
    statistic: float
    threshold: float
    reason: str
    parameters: Mapping[str, Interval] = field(default_factory=dict, compare=False)


def last_of_each(decisions: Sequence[Decision]) -> tuple[Decision, ...]:
    """Return the last decision of each gate on each candidate."""
    return tuple({(d.candidate, d.gate): d for d in decisions}.values())


@dataclass(frozen=True)
class UnitStatistics:
    """What each unit says of a few columns.

    Attributes:
        gram: Of each unit.
        score: Of each unit.
        fold: Of each unit; negative where it is neither fitted nor predicted.
    """

    gram: Float[np.ndarray, "units columns columns"]
    score: Float[np.ndarray, "units columns"]
    fold: Int[np.ndarray, " units"]


@dataclass(frozen=True)
class GatedNames:
    """What the gate let through.

    Attributes:
        names: In the order in which they were given.
        terms: Numbers of their terms.
        gain: Of each unit, by fits that did not see it, with these names.
        nominal_gain: The same of the nominal columns alone.
        lost: What each unit loses without each name, the others adapting.
        z: Of each name.
        decisions: On every name.
    """

    names: tuple[Name, ...]
    terms: tuple[int, ...]
    gain: Float[np.ndarray, " units"]
    nominal_gain: Float[np.ndarray, " units"]
    lost: tuple[Float[np.ndarray, " units"], ...]
    z: tuple[float, ...]
    decisions: tuple[Decision, ...]


def gate_names(
    units: UnitStatistics,
    nominal: Int[np.ndarray, " nominal"],
    terms: Sequence[tuple[Name, Int[np.ndarray, " _"]]],
) -> GatedNames:
    """Let names through that predict units left out, the weakest of the others going.

    Args:
        units: What each unit says of the columns.
        nominal: Columns that explain for free.
        terms: Name and columns of each term; several may share a name.
    """
    blocks = [columns for _, columns in terms]
    white = _WhiteUnits.of(units, nominal, blocks)
    names = list(dict.fromkeys(name for name, _ in terms))
    terms_of = {n: [t for t, (name, _) in enumerate(terms) if name == n] for n in names}
    decided: dict[Name, Decision] = {}
    precision = white.precision_of(range(len(blocks)))
    none = white.predict([], [], precision)[0]
    while True:
        gain, without = white.predict(
            [t for n in names for t in terms_of[n]],
            [terms_of[n] for n in names],
            precision,
        )
        lost = [gain - other for other in without]
        z = {n: _z(one) for n, one in zip(names, lost, strict=True)}
        found = {
            n: _decision(n, sign_flip_p_value(one))
            for n, one in zip(names, lost, strict=True)
        }
        weak = [n for n in names if not found[n].accepted]
        if not weak:
            break
        weakest = min(weak, key=z.__getitem__)
        decided[weakest] = found[weakest]
        names.remove(weakest)
    decided |= found
    return GatedNames(
        tuple(names),
        tuple(sorted(t for n in names for t in terms_of[n])),
        gain,
        none,
        tuple(lost),
        tuple(z[n] for n in names),
        tuple(decided[n] for n in terms_of),
    )


def decisions_beside(
    units: UnitStatistics,
    nominal: Int[np.ndarray, " nominal"],
    terms: Sequence[tuple[Name, Int[np.ndarray, " _"]]],
    more: Sequence[Int[np.ndarray, " _"]],
    asked: Sequence[tuple[Name, Sequence[int]]],
) -> list[Decision]:
    """Return the gate's verdict on names beside all others and more columns.

    Args:
        units: What each unit says of the columns.
        nominal: Columns that explain for free.
        terms: As in `gate_names`.
        more: Columns of terms without a name.
        asked: Whose verdict, and which of these terms are fitted too.
    """
    some = sorted({k for _, beside in asked for k in beside})
    blocks = [*(own for _, own in terms), *(more[k] for k in some)]
    white, decisions = _WhiteUnits.of(units, nominal, blocks), []
    for name, beside in asked:
        used = [*range(len(terms)), *(len(terms) + some.index(k) for k in beside)]
        own = [t for t, (other, _) in enumerate(terms) if other == name]
        gain, (without,) = white.predict(used, [own], white.precision_of(used))
        decisions.append(_decision(name, sign_flip_p_value(gain - without)))
    return decisions


def left_out_gain(
    units: UnitStatistics,
    nominal: Int[np.ndarray, " nominal"],
    blocks: Sequence[Int[np.ndarray, " _"]],
) -> Float[np.ndarray, " units"]:
    """Return how much better each unit is predicted by shrunken fits to the others.

    Args:
        units: What each unit says of the columns.
        nominal: Columns that explain for free.
        blocks: Columns of each term; a prior each.
    """
    white, every = _WhiteUnits.of(units, nominal, blocks), range(len(blocks))
    return white.predict(every, [], white.precision_of(every))[0]


@dataclass(frozen=True, eq=False)
class _WhiteUnits:
    """The same statistics in columns that are white beside the nominal ones.

    Attributes:
        gram: Of each unit, fold by fold; nominal directions come first.
        score: Of each unit.
        fold: Of each unit.
        nominal: How many directions are nominal.
        owned: Columns of each term.
    """

    gram: Mapping[int, Float[np.ndarray, "_ columns columns"]]
    score: Float[np.ndarray, "units columns"]
    fold: Int[np.ndarray, " units"]
    nominal: int
    owned: tuple[Int[np.ndarray, " _"], ...]

    @classmethod
    def of(
        cls,
        units: UnitStatistics,
        nominal: Int[np.ndarray, " nominal"],
        blocks: Sequence[Int[np.ndarray, " _"]],
    ) -> "_WhiteUnits":
        """Make columns white."""
        gram, score = units.gram[units.fold >= 0], units.score[units.fold >= 0]
        total = gram.sum(axis=0)
        raw = np.maximum(np.diag(total), 0.0)
        known = whitening_transform(total[np.ix_(nominal, nominal)], raw[nominal])
        share = projection_coefficients(total, nominal)
        width = known.shape[1]
        none = np.zeros((len(nominal), known.shape[1]))
        parts, owned = [(nominal, known, none)], []
        for block in blocks:
            beside = schur_complement(total, nominal, share, block)
            turn = whitening_transform(beside, raw[block])
            owned.append(np.arange(width, width + turn.shape[1]))
            width += turn.shape[1]
            parts.append((block, turn, share[:, block] @ turn))
        mix = np.zeros((len(total), width))
        at = 0
        for block, turn, explained in parts:
            end = at + turn.shape[1]
            mix[block, at:end] = turn
            mix[nominal, at:end] -= explained
            at = end
        fold = units.fold[units.fold >= 0]
        white = {int(f): mix.T @ gram[fold == f] @ mix for f in np.unique(fold)}
        return cls(white, score @ mix, fold, known.shape[1], tuple(owned))

    @cached_property
    def totals(self) -> Mapping[int, Float[np.ndarray, "columns columns"]]:
        """Gram matrix of each fold."""
        return {f: own.sum(axis=0) for f, own in self.gram.items()}

    def precision_of(self, terms: Sequence[int]) -> Float[np.ndarray, " columns"]:
        """Return the prior precision of each column, by a fit of some terms to all.

        0 for the nominal columns and those of other terms.
        """
        used = self._used(terms)
        gram = sum(own[np.ix_(used, used)] for own in self.totals.values())
        fitted = np.zeros(self.score.shape[1])
        score = self.score.sum(axis=0)[used]
        fitted[used] = np.linalg.lstsq(gram, score, rcond=1e-10)[0]
        precision = np.zeros(len(fitted))
        for own in (self.owned[t] for t in terms):
            square = float(np.sum(fitted[own] ** 2))
            precision[own] = len(own) / max(square, 1e-12)
        return precision

    def _used(self, terms: Sequence[int]) -> Int[np.ndarray, " columns"]:
        """Return the nominal columns and those of some terms."""
        blocks = [np.arange(self.nominal), *(self.owned[t] for t in terms)]
        return np.concatenate(blocks).astype(int)

    def predict(
        self,
        terms: Sequence[int],
        left_out: Sequence[Sequence[int]],
        precision: Float[np.ndarray, " columns"],
    ) -> tuple[Float[np.ndarray, " units"], list[Float[np.ndarray, " units"]]]:
        """Return how much better each unit is predicted by fits that have not seen it.

        Args:
            terms: What is fitted beside the nominal columns.
            left_out: Terms without which this is asked too, one list after another.
            precision: Of the prior of each column.
        """
        used = self._used(terms)
        at = {int(column): k for k, column in enumerate(used)}
        gone = [
            np.array([at[int(c)] for t in some for c in self.owned[t]], dtype=int)
            for some in left_out
        ]
        score = self.score[:, used]
        grams = {f: own[np.ix_(used, used)] for f, own in self.totals.items()}
        whole, asked = sum(grams.values()), score.sum(axis=0)
        gain = np.zeros((1 + len(gone), len(score)))
        coefficients = np.zeros((self.score.shape[1], len(gain)))
        for f, own_gram in grams.items():
            inside = self.fold == f
            inner = whole - own_gram + np.diag(precision[used])
            inverse = np.linalg.pinv(inner, rcond=1e-12, hermitian=True)
            beta = inverse @ (asked - score[inside].sum(axis=0))
            every = np.repeat(beta[:, None], 1 + len(gone), axis=1)
            for k, own in enumerate(gone, start=1):
                if len(own):
                    step = np.linalg.solve(inverse[np.ix_(own, own)], beta[own])
                    every[:, k] -= inverse[:, own] @ step
                    every[own, k] = 0.0
            coefficients[used] = every
            curve = np.sum((self.gram[f] @ coefficients) * coefficients, axis=1)
            gain[:, inside] = (score[inside] @ every - 0.5 * curve).T
        return gain[0], list(gain[1:])


def _z(lost: Float[np.ndarray, " units"]) -> float:
    return float(np.sum(lost) / max(float(np.linalg.norm(lost)), 1e-300))


def sign_flip_p_value(lost: Float[np.ndarray, " units"]) -> float:
    """Return the share of random signs of the units that make as large a sum."""
    some = lost[lost != 0.0]
    sums = _random_signs(len(some)) @ some
    slack = 1e-9 * float(np.sum(np.abs(some)))
    return float(np.mean(sums >= sums[0] - slack))


@lru_cache(maxsize=8)
def _random_signs(count: int) -> Float[np.ndarray, "compared units"]:
    """Return random signs; the first all as they were: one that could have been."""
    signs = np.random.default_rng(count).choice([-1.0, 1.0], (COMPARED, count))
    signs[0] = 1.0
    return signs


def _decision(name: Name, p_value: float) -> Decision:
    least = float(norm.sf(MARGIN))
    accepted = p_value < least
    reason = (
        "predicts poses left out" if accepted else "does not predict poses left out"
    )
    return Decision(name, "left_out", accepted, p_value, least, reason)
