"""The form of diagnosis.json, schema 1, and the rule of its verdict.

`Answer` is the file. Lengths are in mm and angles in µrad or degrees where a name says
so, all parameters in SI; a number that does not exist, or is not finite, is null.

`verdict_of` follows the order of the format: no mismatch; no name; a proof that was
asked for and failed, or whose gain is not surely positive; all explained; a part
explained.
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
    """An effect and its site."""

    effect: str
    where: str


class Interval(msgspec.Struct, frozen=True):
    """A number with its 95 % interval; text where the parameter is a name."""

    estimate: Number | str
    low: Number | str
    high: Number | str


class Detected(msgspec.Struct, frozen=True):
    """Whether recording and nominal simulation differ, and by how much."""

    p_value: float
    residual_rms_mm: Number
    noise_rms_mm: Number
    smallest_effect_that_would_show_mm: Number


class Placed(msgspec.Struct, frozen=True):
    """A site of the mismatch, with its share and what it depends on."""

    where: str
    p_value: float
    share: float
    depends_on: tuple[str, ...]
    zone: str


class Called(msgspec.Struct, frozen=True, omit_defaults=True):
    """A named effect with its probability, equivalents, parameters and share."""

    effect: str
    where: str
    probability: float
    equivalents: tuple[At, ...]
    parameters: dict[str, Interval]
    share: float | msgspec.UnsetType = msgspec.UNSET


class Open(msgspec.Struct, frozen=True):
    """A place where something is left beside all that was named."""

    where: str
    share: float
    depends_on: tuple[str, ...]
    law: str


class Other(msgspec.Struct, frozen=True):
    """A competing model and its probability."""

    probability: float
    effects: tuple[At, ...]


class Left(msgspec.Struct, frozen=True):
    """The unexplained residual: of the patched arm, else of the nominal one."""

    where: str
    signature: str
    law: dict[str, tuple[float, ...]]
    residual_rms_mm: Number


class Remark(msgspec.Struct, frozen=True):
    """A warning: something that the reader should correct or know."""

    code: str
    where: str
    text: str


class Proved(msgspec.Struct, frozen=True, omit_defaults=True):
    """The proof in the simulator: errors on held-out poses before and after."""

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
    """A proposed measurement, and the two models that it tells apart."""

    why: str
    pose_deg: tuple[float, ...]
    load_path_kg: tuple[float, ...]
    expected_log_bayes_factor: float


class Answer(msgspec.Struct, frozen=True):
    """The content of diagnosis.json."""

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
    unexplained_places: tuple[Open, ...] = ()


# --- The verdict ----------------------------------------------------------------------

ENOUGH, ENOUGH_LOW = 0.98, 0.95
"""Explained share, and the low end of its interval, from which all is explained though
the residual is still significant; the rule of the format."""
DISAGREES = 1.5
"""Rms of the simulator's nominal arm over that of the fitted one, on the same poses,
above which the two are not the same arm; the rule of the format."""


@dataclass(frozen=True)
class Findings:
    """The results from which the verdict follows.

    Attributes:
        mismatch: Whether the test found a mismatch.
        named: Whether an effect was named.
        residual_passes: Whether the residual after the named effects is insignificant.
        proof_requested: Whether a proof was asked for.
        proof: Result of the simulator; None where it was not asked or could not.
        explained_share: On the held-out poses; None where there is none.
    """

    mismatch: bool
    named: bool
    residual_passes: bool
    proof_requested: bool
    proof: Proved | None
    explained_share: Interval | None


def verdict_of(findings: Findings) -> Verdict:
    """Return the verdict of schema 1 that follows from the findings."""
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
    """Return whether the low end of a proof's gain is above zero.

    Where markers and encoders were both compared, the markers' gain decides.
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
    """Return an answer as the text of diagnosis.json."""
    return msgspec.json.format(msgspec.json.encode(answer), indent=2).decode() + "\n"


def number(value: float, unit: float = 1.0) -> Number:
    """Return a finite number times a unit's factor; None where it is not finite."""
    return float(value) * unit if math.isfinite(value) else None
