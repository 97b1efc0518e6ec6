"""The form of diagnosis.json, schema 1, and the rule of its verdict.

The form of diagnosis.json is fixed: schema 1.

Lengths are in mm and angles in µrad or degrees where a name says so, all parameters in
SI. A number that does not exist, or has no end, is null.

The verdict of an answer: what the readings say, unless the proof speaks against it.

The order is that of the format: nothing differs; no name; a proof that was asked for
and failed or gains nothing for sure; all explained; a part explained.
"""

import math
from dataclasses import dataclass
from typing import Literal

import msgspec

# --- The form -------------------------------------------------------------------------

Number = float | None
Verdict = Literal[
    "no_mismatch", "unexplained", "unproved", "explained", "partly_explained"
]


class At(msgspec.Struct, frozen=True):
    """A name and its place."""

    effect: str
    where: str


class Interval(msgspec.Struct, frozen=True):
    """A number with its 95 % interval; a name where a parameter is one."""

    estimate: Number | str
    low: Number | str
    high: Number | str


class Detected(msgspec.Struct, frozen=True):
    """Whether something is there."""

    p_value: float
    residual_rms_mm: Number
    noise_rms_mm: Number
    smallest_effect_that_would_show_mm: Number


class Placed(msgspec.Struct, frozen=True):
    """Where."""

    where: str
    p_value: float
    share: float
    depends_on: tuple[str, ...]
    zone: str


class Called(msgspec.Struct, frozen=True):
    """What."""

    effect: str
    where: str
    probability: float
    equivalents: tuple[At, ...]
    parameters: dict[str, Interval]


class Other(msgspec.Struct, frozen=True):
    """What else it might be."""

    probability: float
    effects: tuple[At, ...]


class Left(msgspec.Struct, frozen=True):
    """What stays open, and the residual of the patched arm, else of the nominal."""

    where: str
    signature: str
    law: dict[str, tuple[float, ...]]
    residual_rms_mm: Number


class Remark(msgspec.Struct, frozen=True):
    """What the reader should mend or know."""

    code: str
    where: str
    text: str


class Proved(msgspec.Struct, frozen=True, omit_defaults=True):
    """What the simulator says on poses held out."""

    simulator: Literal["mujoco"]
    held_out_poses: int
    before_rms_mm: Number | msgspec.UnsetType = msgspec.UNSET
    after_rms_mm: Number | msgspec.UnsetType = msgspec.UNSET
    noise_rms_mm: Number | msgspec.UnsetType = msgspec.UNSET
    gain_mm: Interval | msgspec.UnsetType = msgspec.UNSET
    before_rms_urad: Number | msgspec.UnsetType = msgspec.UNSET
    after_rms_urad: Number | msgspec.UnsetType = msgspec.UNSET
    noise_rms_urad: Number | msgspec.UnsetType = msgspec.UNSET
    gain_urad: Interval | msgspec.UnsetType = msgspec.UNSET


class Next(msgspec.Struct, frozen=True):
    """What to measure next."""

    why: str
    pose_deg: tuple[float, ...]
    load_path_kg: tuple[float, ...]
    expected_log_bayes_factor: float


class Answer(msgspec.Struct, frozen=True):
    """diagnosis.json."""

    schema: Literal[1]
    recording: str
    verdict: Verdict
    detection: Detected
    located: tuple[Placed, ...]
    explained_share: Interval | None
    named: tuple[Called, ...]
    rivals: tuple[Other, ...]
    unexplained: Left | None
    confounded: tuple[tuple[At, At], ...]
    warnings: tuple[Remark, ...]
    proof_requested: bool
    proof: Proved | None
    next_experiments: tuple[Next, ...]
    seconds: float


# --- The verdict ----------------------------------------------------------------------

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
        mismatch: Whether the test found a mismatch.
        named: Whether a name was given.
        residual_passes: Whether nothing significant is left after the names.
        proof_requested: Whether a proof was asked for.
        proof: What the simulator said; None where it was not asked or could not.
        explained_share: On the poses kept back; None where there is none.
    """

    mismatch: bool
    named: bool
    residual_passes: bool
    proof_requested: bool
    proof: Proved | None
    explained_share: Interval | None


def verdict_of(findings: Findings) -> Verdict:
    """Return the verdict."""
    if not findings.mismatch:
        return "no_mismatch"
    if not findings.named:
        return "unexplained"
    if findings.proof_requested and not gain_is_positive(findings.proof):
        return "unproved"
    if findings.residual_passes or _explains_enough(findings.explained_share):
        return "explained"
    return "partly_explained"


def gain_is_positive(proof: Proved | None) -> bool:
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


# --- The entry in schema 1 ------------------------------------------------------------


def text_of(answer: Answer) -> str:
    """Return diagnosis.json."""
    return msgspec.json.format(msgspec.json.encode(answer), indent=2).decode() + "\n"


def number(value: float, unit: float = 1.0) -> Number:
    """Return a finite number in a unit, or None."""
    return float(value) * unit if math.isfinite(value) else None
