"""The verdict of an answer: what the readings say, unless the proof speaks against it.

The order is that of the format: nothing differs; no name; a proof that was asked for
and failed or gains nothing for sure; all explained; a part explained.
"""

from dataclasses import dataclass

from scenarios.diagnosing.schema import Interval, Proved, Verdict

ENOUGH, ENOUGH_LOW = 0.98, 0.95
"""Explained share, and the low end of its interval, from which all is explained though
something is left that readings still show; the rule of the format."""
DISAGREES = 1.5
"""Rms of the simulator's nominal arm over that of the fitted one, on the same poses,
above which the two are not the same arm; the rule of the format."""


@dataclass(frozen=True)
class Findings:
    """What a verdict rests on.

    Attributes:
        differs: Whether the test found a mismatch.
        named: Whether a name was given.
        residual_passes: Whether nothing significant is left after the names.
        proof_requested: Whether a proof was asked for.
        proof: What the simulator said; None where it was not asked or could not.
        explained_share: On the poses kept back; None where there is none.
    """

    differs: bool
    named: bool
    residual_passes: bool
    proof_requested: bool
    proof: Proved | None
    explained_share: Interval | None


def verdict_of(findings: Findings) -> Verdict:
    """Return the verdict."""
    if not findings.differs:
        return "no_mismatch"
    if not findings.named:
        return "unexplained"
    if findings.proof_requested and not gains(findings.proof):
        return "unproved"
    if findings.residual_passes or _explains_enough(findings.explained_share):
        return "explained"
    return "partly_explained"


def gains(proof: Proved | None) -> bool:
    """Return whether a proof's gain is above zero for sure.

    Where markers and encoders were both compared, markers decide.
    """
    if proof is None:
        return False
    gain = proof.gain_mm if isinstance(proof.gain_mm, Interval) else proof.gain_urad
    if not isinstance(gain, Interval):
        return False
    return isinstance(gain.low, float | int) and gain.low > 0.0


def _explains_enough(share: Interval | None) -> bool:
    if share is None:
        return False
    estimate, low = share.estimate, share.low
    if not isinstance(estimate, float | int) or not isinstance(low, float | int):
        return False
    return estimate >= ENOUGH and low >= ENOUGH_LOW
