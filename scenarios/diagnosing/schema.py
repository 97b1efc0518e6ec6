"""The form of diagnosis.json is fixed: schema 1.

Lengths are in mm and angles in µrad or degrees where a name says so, all parameters in
SI. A number that does not exist, or has no end, is null.
"""

from typing import Literal

import msgspec

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
    """What stays open, and what is left by the patched arm, else by the nominal."""

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
