"""The form of diagnosis.json, schema 1, and the rule of its verdict.

`Answer` is the file. Lengths are in mm and angles in µrad or degrees where a name says
so, all parameters in SI; a number that does not exist, or is not finite, is null.

`verdict_of` follows the order of the format: no mismatch; no name; a proof that was
asked for and failed, or whose gain is not surely positive; all explained; a part
explained.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Literal

import msgspec
import numpy as np

from bench.shared.effect_catalogue import CATALOGUE
from bench.shared.errors import UnknownName
from bench.shared.format import json_text
from bench.shared.settings import SETTINGS
from stiffness.diagnosis.result import Decision, Name, in_words, withheld

if TYPE_CHECKING:
    from bench.proof.explained_share import Channel
    from bench.shared.settings import Interval as Estimated

# --- The form -------------------------------------------------------------------------

Number = float | None
Verdict = Literal[
    "no_mismatch", "unexplained", "unproved", "explained", "partly_explained"
]


class At(msgspec.Struct, frozen=True):
    """An effect and its site."""

    effect: str
    where: str

    def __str__(self):
        return f"{self.effect} at {self.where}"


class Interval(msgspec.Struct, frozen=True):
    """A number with its 95 % interval; text where the parameter is a name."""

    estimate: Number | str
    low: Number | str
    high: Number | str


def wave_of(
    size: float, half: float, order: Interval, phase: float
) -> dict[str, Interval]:
    """Return the parameters of a gear's wave of a size with half an interval.

    Of one that may be nothing any phase does, in rad.
    """
    turn = half / size if size > half else None
    return {
        "amplitude_rad": Interval(size, max(size - half, 0.0), size + half),
        "order": order,
        "phase_rad": Interval(phase, None, None)
        if turn is None
        else Interval(phase, phase - turn, phase + turn),
    }


class Detected(msgspec.Struct, frozen=True):
    """Whether recording and nominal simulation differ, and by how much."""

    p_value: float
    residual_rms_mm: Number
    noise_rms_mm: Number
    smallest_effect_that_would_show_mm: Number


class Placed(msgspec.Struct, frozen=True, omit_defaults=True):
    """A site of the mismatch, with its share and what it depends on.

    `split_share`: of the splits of few poses that give a name there.
    """

    where: str
    p_value: float
    share: float
    depends_on: tuple[str, ...]
    zone: str
    split_share: float | msgspec.UnsetType = msgspec.UNSET


class Called(At, frozen=True, omit_defaults=True):
    """A named effect with its probability, equivalents, parameters and share.

    `share`: what the others would not explain without it. `budget_share`: its part of
    what all explain together; these add up. `split_share`: of the splits of few poses
    that give it, or one that does as well.
    """

    probability: float
    equivalents: tuple[At, ...]
    parameters: dict[str, Interval]
    share: float | msgspec.UnsetType = msgspec.UNSET
    split_share: float | msgspec.UnsetType = msgspec.UNSET
    budget_share: float | msgspec.UnsetType = msgspec.UNSET


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


class OutlierEntry(msgspec.Struct, frozen=True):
    """An outlier, left out, and how far off it is; `*` stands for all marks."""

    pose: int
    marker: str
    size_mm: float


class Refused(At, frozen=True):
    """An effect whose name was refused, with the size that it would have, and why."""

    parameters: dict[str, Interval]
    reason: str


class Proved(msgspec.Struct, frozen=True, omit_defaults=True):
    """The proof in the simulator: errors on held-out poses before and after.

    In mm of marks, in µrad of encoders, in mrad of the turn of 6D targets and of bodies
    with three marks or more. `folds`: of few poses, how many fits judged, each the
    poses that it had not seen.
    """

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
    folds: int | msgspec.UnsetType = msgspec.UNSET
    before_rms_mrad: Number | msgspec.UnsetType = msgspec.UNSET
    after_rms_mrad: Number | msgspec.UnsetType = msgspec.UNSET
    noise_rms_mrad: Number | msgspec.UnsetType = msgspec.UNSET
    gain_mrad: Interval | msgspec.UnsetType = msgspec.UNSET


class Next(msgspec.Struct, frozen=True):
    """A proposed measurement, and the two models that it tells apart.

    Axes that slide are in mm.
    """

    why: str
    pose_deg: tuple[float, ...]
    load_path_kg: tuple[float, ...]
    expected_log_bayes_factor: float

    def pose_text(self, slides: tuple[bool, ...]) -> str:
        """Return the pose; empty `slides`: all axes turn."""
        units = [" mm" if s else "°" for s in slides or (False,) * len(self.pose_deg)]
        pairs = zip(self.pose_deg, units, strict=True)
        return ", ".join(f"{x:.0f}{unit}" for x, unit in pairs)


class Answer(msgspec.Struct, frozen=True, kw_only=True):
    """The content of diagnosis.json."""

    schema: Literal[1] = 1
    recording: str
    verdict: Verdict
    detection: Detected
    located: tuple[Placed, ...] = ()
    explained_share: Interval | None = None
    named: tuple[Called, ...] = ()
    rivals: tuple[Other, ...] = ()
    unexplained: Left | None = None
    confounded: tuple[tuple[At, At], ...] = ()
    warnings: tuple[Remark, ...] = ()
    proof_requested: bool = True
    proof: Proved | None = None
    next_experiments: tuple[Next, ...] = ()
    seconds: float
    unexplained_places: tuple[Open, ...] = ()
    settings: dict[str, float] = msgspec.field(default_factory=lambda: asdict(SETTINGS))
    outliers: tuple[OutlierEntry, ...] = ()
    refused: tuple[Refused, ...] = ()
    scatter_rms_mm: Number = None


def interval_of(known: Estimated, factor: float = 1.0) -> Interval:
    """Return an estimate with both ends as it is written, in a unit of that factor."""
    ends = (known.estimate, known.low, known.high)
    return Interval(*(factor * end for end in ends))


def proved_in(channel: Channel | None, factor: float, unit: str) -> dict[str, Any]:
    """Return the numbers of a channel of a proof, in a unit; none without one."""
    if channel is None:
        return {}
    sizes = (channel.gain, channel.low, channel.high)
    return {
        f"before_rms_{unit}": channel.before * factor,
        f"after_rms_{unit}": channel.after * factor,
        f"noise_rms_{unit}": channel.noise * factor,
        f"gain_{unit}": Interval(*(size * factor for size in sizes)),
    }


def where_known(share: float | None) -> float | msgspec.UnsetType:
    """Return a share as it is written: left out where it is not known."""
    return msgspec.UNSET if share is None else float(share)


# --- The verdict ----------------------------------------------------------------------

VERDICTS: dict[Verdict, str] = {
    "no_mismatch": "Simulation and recording agree",
    "unproved": "A cause is named, but not proved",
    "explained": "The difference is explained",
    "partly_explained": "The difference is explained in part",
    "unexplained": "The difference has no name",
}
"""Each verdict in words, as titles of reports have them."""


@dataclass(frozen=True)
class Findings:
    """The results from which the verdict follows.

    Attributes:
        residual_passes: Whether the residual after the named effects is insignificant.
        proof: Result of the simulator; None where it was not asked or could not.
        explained_share: On the held-out poses; None where there is none.
        improves: Whether the proof surely gains; None: as its interval says.
    """

    mismatch: bool
    named: bool
    residual_passes: bool
    proof_requested: bool
    proof: Proved | None
    explained_share: Interval | None
    improves: bool | None = None


def verdict_of(findings: Findings) -> Verdict:
    """Return the verdict of schema 1 that follows from the findings."""
    if not findings.mismatch:
        return "no_mismatch"
    if not findings.named:
        return "unexplained"
    improves = findings.improves
    if improves is None:
        improves = gain_is_positive(findings.proof)
    if findings.proof_requested and not improves:
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


def said_of_turns(proof: Proved) -> str:
    """Say the error of orientation before and after; empty where none was judged."""
    gain = proof.gain_mrad
    if not isinstance(gain, Interval):
        return ""
    before, after, noise, low, high = (
        "?" if not isinstance(x, float | int) else _digits(x)
        for x in (
            *(proof.before_rms_mrad, proof.after_rms_mrad, proof.noise_rms_mrad),
            *(gain.low, gain.high),
        )
    )
    return (
        f"Orientation: {before} mrad rms before, {after} mrad after (gain {low} to "
        f"{high} mrad); noise leaves {noise} mrad."
    )


def _explains_enough(share: Interval | None) -> bool:
    if share is None:
        return False
    estimate, low = share.estimate, share.low
    if not isinstance(estimate, float | int) or not isinstance(low, float | int):
        return False
    enough, enough_low = SETTINGS.explained_share, SETTINGS.explained_share_low
    return estimate >= enough and low >= enough_low


# --- The entry in schema 1 ------------------------------------------------------------


def text_of(answer: Answer) -> str:
    """Return an answer as the text of diagnosis.json."""
    return json_text(answer)


def number(value: float, unit: float = 1.0) -> Number:
    """Return a finite number times a unit's factor; None where it is not finite."""
    return float(value) * unit if math.isfinite(value) else None


# --- Why a name was withheld ----------------------------------------------------------


def why_not(
    answer: Answer, decisions: Sequence[Decision], effect: str, where: str
) -> str:
    """Say why an effect was not named at a place.

    Raises:
        UnknownName: Where there is no such effect.
    """
    if effect not in CATALOGUE:
        raise UnknownName("effect", effect, CATALOGUE)
    for one in answer.named:
        if (one.effect, one.where) == (effect, where):
            return f"It is named, with probability {one.probability:.3g}."
        if At(effect, where) in one.equivalents:
            return (
                f"By these data it would do as well as {one}, which is named in its "
                "place."
            )
    refused = withheld(decisions, Name(effect, where))
    if refused:
        return " ".join(map(in_words, refused))
    return f"No gate has decided on {effect} at {where}: it was not a candidate there."


# --- Parameters for people ------------------------------------------------------------

WORDS = {
    "rad": ("µrad", 1e6),
    "rad_per_nm": ("µrad/(N m)", 1e6),
    "m": ("mm", 1e3),
    "m_per_n": ("µm/N", 1e6),
    "m_per_h": ("µm/h", 1e6),
    "rad_per_h": ("µrad/h", 1e6),
    "nm": ("N m", 1.0),
    "nm2": ("kN m²", 1e-3),
    "kg": ("kg", 1.0),
    "n": ("N", 1.0),
    "s": ("s", 1.0),
    "kg_m": ("kg m", 1.0),
}
"""Display unit and its number per SI unit, by the ending of a parameter's name."""
DEGREES = ("°", 180.0 / np.pi)
"""Display unit of a phase."""
MILLISECONDS = ("ms", 1e3)
"""Display unit of a channel's delay."""
COUNTS = ("order",)
"""Parameters that are whole numbers in gears, such as the order of a harmonic."""


NOT_HELD = "(not held by these data)"
PDG = 3.55
"""Leading digits of an error below which two of them are kept (Particle Data Group)."""
WAVE = ("amplitude_rad", "peak to peak", "µrad", 2e6)
"""A wave's amplitude in answers; for people its peak-to-peak value, with its unit and
factor."""


def size(name: str, value: float | str | None) -> str:
    """Return a parameter's value in its display unit, with three digits."""
    if value is None:
        return "no bound"
    if isinstance(value, str):
        return value
    unit, factor = unit_of(name)
    return f"{_digits(value * factor)}{' ' + unit if unit else ''}"


def _digits(value: float) -> str:
    """Return three digits, without a power of ten below a million."""
    small = f"{value:.3g}"
    return f"{value:.0f}" if 1e3 <= abs(float(small)) < 1e6 else small


def large_corrections(named: Sequence[Called]) -> tuple[Remark, ...]:
    """Say which geometry is off by more than that of a model of the same arm.

    The limit is the catalogue's largest physical size of the effect.
    """
    found = []
    for one in named:
        info = CATALOGUE.get(one.effect)
        if info is None or info.family != "geometry" or info.largest is None:
            continue
        sizes = {p.name for p in info.parameters if p.role == "magnitude"}
        beyond = {
            name: one.parameters[name]
            for name in sorted(sizes & set(one.parameters))
            if _is_beyond(one.parameters[name], info.largest)
        }
        if beyond:
            text = (
                f"{one} is {parameters_text(beyond)}: more than manufacture and "
                "assembly make. Is this the model of this arm, of this variant?"
            )
            found.append(Remark("large_correction", one.where, text))
    return tuple(found)


def _is_beyond(size: Interval, largest: float) -> bool:
    """Return whether a size is over a limit, and its interval holds no zero."""
    low, high = size.low, size.high
    if not isinstance(low, float) or not isinstance(high, float):
        return False
    return low * high > 0.0 and abs(low + high) > 2.0 * largest


def parameters_text(parameters: Mapping[str, Interval], apart: str = "; ") -> str:
    """Return all parameters by name, each with its value and its interval."""
    return apart.join(f"{label(n)} {span(n, p)}" for n, p in parameters.items())


FAR = 0.5
"""How far beyond an interval, over its width, a size of a patch is said; chosen."""


def sizes_far_off(
    named: Sequence[Called], sizes: Mapping[tuple[str, str], Mapping[str, object]]
) -> list[str]:
    """Return which sizes, by effect and place, are far from their intervals."""
    found = []
    for n in named:
        own = sizes.get((n.effect, n.where), {})
        for one in CATALOGUE[n.effect].parameters:
            p, now = n.parameters.get(one.name), own.get(one.name)
            if one.role != "magnitude" or p is None or not isinstance(now, float):
                continue
            if isinstance(p.low, float) and isinstance(p.high, float):
                beyond = max(p.low - now, now - p.high)
                if beyond > FAR * (p.high - p.low) > 0.0:
                    moved = msgspec.structs.replace(p, estimate=now)
                    found.append(f"{n} {parameters_text({one.name: moved})}")
    return found


def span(name: str, interval: Interval) -> str:
    """Return a parameter's value and its interval in its display unit."""
    text = size(name, interval.estimate)
    low, high = interval.low, interval.high
    held = low is not None or high is not None
    if isinstance(low, float) and isinstance(high, float):
        held = not 0.0 < ENDLESS * low < high
    if not held:
        return f"{text} {NOT_HELD}"
    if whole := _whole(name, interval):
        return whole
    if isinstance(interval.estimate, str) or interval.low == interval.high:
        return text
    factor = unit_of(name)[1]
    told = [
        rounded(interval, factor, x) if isinstance(x, float) else "?"
        for x in (interval.estimate, interval.low, interval.high)
    ]
    if all(x.endswith(".0") or x == "?" for x in told):
        told = [x.removesuffix(".0") for x in told]
    return f"{told[0]}{text[len(text.split(' ')[0]) :]} ({told[1]} to {told[2]})"


DECADES, ENDLESS = 100.0, 1e6
"""Upper over lower end of an interval from which only its order of magnitude counts,
and from which data do not hold the parameter at all; chosen."""


def rounded(interval: Interval, factor: float, value: float) -> str:
    """Return a number with the digits that its interval allows.

    Half the interval's width keeps one digit, two where they are below 36, as the
    Particle Data Group rounds; without both ends the number has three digits, and two
    where its ends are decades apart. The interval is in SI, `factor` leads to the unit
    that is shown; `value` is what is shown, such as the estimate or an end.
    """
    low, high, shown = interval.low, interval.high, factor * value
    if not isinstance(low, float) or not isinstance(high, float) or high <= low:
        return _digits(shown)
    if low > 0.0 and high > DECADES * low:
        two = float(f"{shown:.2g}")
        return f"{two:.0f}" if abs(two) >= 10.0 else f"{two:g}"
    half = abs(factor) * (high - low) / 2.0
    digits = -math.floor(math.log10(half))
    digits += half * 10.0**digits < PDG
    return f"{round(shown, digits) + 0.0:.{max(digits, 0)}f}"


def _whole(name: str, interval: Interval) -> str:
    """Return the only whole number in a count's interval; empty: none, or several."""
    ends = interval.low, interval.estimate, interval.high
    low, here, high = (x if isinstance(x, float) else np.nan for x in ends)
    if name not in COUNTS or not low <= round(here) <= high or high - low >= 1.0:
        return ""
    return str(round(here))


def chance(probability: float) -> str:
    """Return a probability with three digits, bounded at 0.001 and 0.999."""
    if probability < 1e-3:
        return "below 0.001"
    return f"{probability:.3f}" if probability <= 0.999 else "above 0.999"


def unit_of(name: str) -> tuple[str, float]:
    """Return a parameter's display unit and the factor from SI to it, by its name."""
    if name.startswith("phase"):
        return DEGREES
    if name == WAVE[0]:
        return WAVE[2:]
    if name.startswith("delay"):
        return MILLISECONDS
    for ending in sorted(WORDS, key=len, reverse=True):
        if name.endswith(f"_{ending}"):
            return WORDS[ending]
    return ("", 1.0)


def label(name: str) -> str:
    """Return a parameter's name without its unit."""
    if name == WAVE[0]:
        return WAVE[1]
    for ending in sorted(WORDS, key=len, reverse=True):
        if name.endswith(f"_{ending}"):
            return name.removesuffix(f"_{ending}").replace("_", " ")
    return name.replace("_", " ")
