"""Which few effects together explain best is found by trying all of them.

==========  ==========================================================================
Equation    gain(S) = b_S' G_SS^-1 b_S after the nominal columns are projected out;
            log evidence = gain / 2 - k ln(poses) / 2 + log prior(size)
Source      unit-information prior (Kass & Wasserman 1995) with the pose as the unit of
            information; k counts coefficients and shape parameters
Valid       columns that are not multiples of each other
Ignores     the shape parameters' own priors beyond their count
==========  ==========================================================================
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Float, Int
from scipy.special import gammaln

from stiffness.diagnosis.evidence import Evidence, left_of, white_turn, without
from stiffness.diagnosis.library import Library

PRIOR_OF_SIZE = (0.4, 0.35, 0.2, 0.05)
"""Prior of none, one, two or three effects; chosen: few causes, each as likely."""
ONE_MORE = 0.25
"""Prior of each further effect; chosen: as three are to two."""
SHORT_LIST = 30
"""Candidates whose triples are all tried; pairs are tried of all. Chosen: 4060 sets."""
RIDGE = 1e-8


@dataclass(frozen=True)
class Ranked:
    """Sets of candidates with what they explain.

    Attributes:
        sets: Numbers of candidates; the empty set comes first.
        shape: Which of each member's shapes is meant.
        gain: Whitened square that each set explains beyond what is nominal.
        log_evidence: With the prior of its size.
    """

    sets: tuple[tuple[int, ...], ...]
    shape: tuple[tuple[int, ...], ...]
    gain: Float[np.ndarray, " sets"]
    log_evidence: Float[np.ndarray, " sets"]


@dataclass(frozen=True)
class White:
    """Candidates' columns at their best shapes, each candidate's own made white."""

    product: Float[np.ndarray, "m m"]
    score: Float[np.ndarray, " m"]
    owned: tuple[Int[np.ndarray, " _"], ...]
    shape: tuple[int, ...]
    alone: Float[np.ndarray, " candidates"]


def log_prior(size: int, candidates: int) -> float:
    """Return the prior of one set of a size: the size's prior over the sets' number."""
    if size > candidates:
        return -np.inf
    ways = gammaln(candidates + 1) - gammaln(size + 1) - gammaln(candidates - size + 1)
    small = min(size, len(PRIOR_OF_SIZE) - 1)
    of_size = np.log(PRIOR_OF_SIZE[small]) + (size - small) * np.log(ONE_MORE)
    return float(of_size - ways)


def white_candidates(library: Library, evidence: Evidence) -> White:
    """Choose every candidate's best shape and make its columns white.

    Args:
        library: Nominal columns, candidates and map.
        evidence: Over the poses that may be looked at.
    """
    gram, score = evidence.gram.sum(axis=0), evidence.score.sum(axis=0)
    nominal = np.arange(library.nominal)
    share = without(gram, nominal)
    score = score - score[nominal] @ share
    turns, owned, shape, alone, start = [], [], [], [], 0
    used: list[np.ndarray] = []
    for candidate in library.candidates:
        best: tuple[float, int, np.ndarray] = (-1.0, 0, np.zeros((0, 0)))
        for s, block in enumerate(candidate.columns):
            left = left_of(gram, nominal, share, block)
            turn = white_turn(left, evidence.raw[block])
            gain = float(np.sum((turn.T @ score[block]) ** 2))
            if gain > best[0]:
                best = (gain, s, turn)
        gain, s, turn = best
        alone.append(gain)
        shape.append(s)
        used.append(candidate.columns[s])
        turns.append(turn)
        owned.append(np.arange(start, start + turn.shape[1]))
        start += turn.shape[1]
    columns = np.concatenate(used) if used else np.zeros(0, dtype=int)
    mix = np.zeros((len(columns), start))
    row = 0
    for turn, own in zip(turns, owned, strict=True):
        mix[row : row + len(turn), own] = turn
        row += len(turn)
    left = left_of(gram, nominal, share, columns)
    return White(
        mix.T @ left @ mix,
        mix.T @ score[columns],
        tuple(owned),
        tuple(shape),
        np.array(alone),
    )


def gains(white: White, sets: Sequence[tuple[int, ...]]) -> Float[np.ndarray, " sets"]:
    """Return what sets of candidates explain together, all sets of one size at once."""
    if not sets or not sets[0]:
        return np.zeros(len(sets))
    widest = max(len(own) for own in white.owned)
    pad = np.full((len(white.owned), widest), -1)
    for k, own in enumerate(white.owned):
        pad[k, : len(own)] = own
    total = np.empty(len(sets))
    members = np.array(sets)
    for at in range(0, len(sets), 4096):
        index = pad[members[at : at + 4096]].reshape(len(members[at : at + 4096]), -1)
        real = index >= 0
        inner = white.product[index[:, :, None], index[:, None, :]]
        inner = np.where(real[:, :, None] & real[:, None, :], inner, 0.0)
        inner[:, range(inner.shape[1]), range(inner.shape[1])] = np.where(
            real, 1.0 + RIDGE, 1.0
        )
        ask = np.where(real, white.score[index], 0.0)
        solved = np.linalg.solve(inner, ask[:, :, None])[:, :, 0]
        total[at : at + 4096] = np.sum(ask * solved, axis=1)
    return total


def ranked(library: Library, white: White, poses: int, largest: int = 3) -> Ranked:
    """Try all sets up to a size and rank them by evidence, the empty set first.

    Args:
        library: The candidates.
        white: Their white columns.
        poses: How many units of information there are.
        largest: Most members of a set.
    """
    count = len(library.candidates)
    every: list[tuple[int, ...]] = [()]
    total = [np.zeros(1)]
    some = np.flatnonzero([len(own) > 0 for own in white.owned])
    singles = [(int(k),) for k in some]
    total.append(gains(white, singles))
    every += singles
    if largest > 1:
        pairs = list(combinations((int(k) for k in some), 2))
        pairs = [p for p in pairs if _distinct(library, p)]
        total.append(gains(white, pairs))
        every += pairs
    if largest > 2 and len(some) > 2:
        listed = _short_list(library, every, np.concatenate(total), poses)
        triples = [t for t in combinations(listed, 3) if _distinct(library, t)]
        total.append(gains(white, triples))
        every += triples
    gain = np.concatenate(total)
    freedom = np.array([sum(library.candidates[k].freedom for k in s) for s in every])
    rarer = [c.hypothesis.log_prior for c in library.candidates]
    prior = np.array(
        [log_prior(len(s), count) + sum(rarer[k] for k in s) for s in every]
    )
    log_evidence = 0.5 * gain - 0.5 * freedom * np.log(poses) + prior
    shape = tuple(tuple(white.shape[k] for k in s) for s in every)
    return Ranked(tuple(every), shape, gain, log_evidence)


def _distinct(library: Library, members: Sequence[int]) -> bool:
    """Return whether no name comes twice."""
    names = {library.candidates[k].name for k in members}
    return len(names) == len(members)


def _short_list(
    library: Library, sets: list[tuple[int, ...]], gain: np.ndarray, poses: int
) -> list[int]:
    """Return the candidates that come up in the best sets so far."""
    freedom = np.array([sum(library.candidates[k].freedom for k in s) for s in sets])
    order = np.argsort(-(gain - freedom * np.log(poses)))
    listed: list[int] = []
    for at in order:
        listed.extend(k for k in sets[at] if k not in listed)
        if len(listed) >= SHORT_LIST:
            break
    return sorted(listed[:SHORT_LIST])
