"""What has no name still has a place, a look, and perhaps a law that holds elsewhere.

==========  ==========================================================================
Equation    extra turn = sum over knots of (loading + unloading) hats of torque, fitted
            with everything known; claimed where poses left out gain by two standard
            errors, and its loop where they gain by that once more
Source      piecewise linear regression; leave-groups-out validation
Valid       about an axis; other places get words alone
Ignores     what the law does beyond the torques seen
==========  ==========================================================================
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from stiffness.diagnosis.case import Case
from stiffness.diagnosis.evidence import evidence_of
from stiffness.diagnosis.member import held_out_gain, solve, training
from stiffness.diagnosis.residual_map import KNOTS, hats
from stiffness.diagnosis.scored import is_clear
from stiffness.diagnosis.signature import Signature, Turn

EVEN = 0.3
"""Share of a law's square from which its even part is mentioned; chosen."""


def law_of(
    case: Case, known: tuple[Signature, ...], where: str
) -> tuple[Mapping[str, tuple[float, ...]], str]:
    """Learn an axis' extra turn against torque, and say how it looks.

    Args:
        case: What may be looked at.
        known: Columns that are fitted beside it.
        where: The axis.

    Returns:
        Torque in N m and turn in rad while loading and unloading, and words; both
        empty where it does not hold at poses left out.
    """
    situation = case.situation
    if where not in situation.axes:
        return {}, ""
    k = situation.axis(where)
    torque = situation.torque[:, k]
    knots = hats(torque, KNOTS)
    if not knots.shape[1]:
        return {}, ""
    path = situation.load_torque[:, k][situation.steps]
    rise = np.diff(path, axis=1, prepend=path[:, :1])
    grows = situation.from_steps((np.sign(path) * np.sign(rise) >= 0).astype(float))
    width = knots.shape[1]
    plain = Signature(width, (Turn(k, knots),))
    both = np.concatenate([knots, knots * (2 * grows - 1)[:, None]], axis=1)
    looped = Signature(2 * width, (Turn(k, both),))
    at = np.unique(np.quantile(torque, np.linspace(0.0, 1.0, KNOTS)))
    without, single, double = (
        held_out_gain(case.data, [*known, *law], case.split)[~case.split.held_out]
        for law in ((), (plain,), (looped,))
    )
    if is_clear(double - single):
        fit = _fitted(case, known, looped)
        mean, half = fit[:width], fit[width:]
    elif is_clear(single - without):
        mean, half = _fitted(case, known, plain), np.zeros(width)
    else:
        return {}, ""
    return {
        "torque_nm": tuple(float(v) for v in at),
        "loading_rad": tuple(float(v) for v in mean + half),
        "unloading_rad": tuple(float(v) for v in mean - half),
    }, _look(at, mean - np.interp(0.0, at, mean), half)


def _fitted(
    case: Case, known: tuple[Signature, ...], law: Signature
) -> Float[np.ndarray, " columns"]:
    """Return a law's coefficients, bounded, for hats add up to what springs do."""
    evidence = evidence_of(case.data, [*known, law], training(case.split))
    n = sum(s.columns for s in known)
    gram = evidence.gram[1].copy()
    ridge = np.zeros(len(gram))
    ridge[n:] = 1e-6 * np.trace(gram[n:, n:]) / law.columns
    score = evidence.score[~case.split.held_out].sum(axis=0)
    return solve(gram + np.diag(ridge), score)[n:]


def _look(at: np.ndarray, mean: np.ndarray, half: np.ndarray) -> str:
    """Say whether a law is odd or even in torque and whether it has a loop."""
    mirrored = np.interp(-at, at, mean)
    odd, even = 0.5 * (mean - mirrored), 0.5 * (mean + mirrored)
    whole = float(np.sum(odd**2) + np.sum(even**2)) + 1e-300
    words = []
    if np.sum(odd**2) > EVEN * whole:
        words.append("odd in torque")
    if np.sum(even**2) > EVEN * whole:
        words.append("even in torque")
    if np.any(half):
        words.append("with a loop between loading and unloading")
    return ", ".join(words)
