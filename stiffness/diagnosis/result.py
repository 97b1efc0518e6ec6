"""Result of a diagnosis: verdict, named effects with intervals, sites, warnings.

A `Diagnosis` states itself in five lines, gives a name's parameters as
`found["hysteresis", "a2"]`, and says by `found.why_not("creep", "a3")` which gate
withheld a name.
"""

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from bench.shared.effect_catalogue import CATALOGUE
from bench.shared.errors import UnknownName, Warned
from bench.shared.settings import MICRO, SETTINGS, Interval
from stiffness.experiment.outliers import Outlier
from stiffness.regression.predictive_gate import Decision

__all__ = [
    "Decision",
    "Detection",
    "Diagnosis",
    "Interval",
    "Located",
    "Name",
    "NamedEffect",
    "Nominal",
    "Outlier",
    "Rival",
    "SplitNames",
    "Unexplained",
    "UnexplainedPlace",
    "Warned",
]

Verdict = Literal["no_mismatch", "explained", "partly_explained", "unexplained"]


@dataclass(frozen=True)
class Name:
    """An effect of the vocabulary at a place."""

    effect: str
    where: str

    def __str__(self):
        """Return it as people say it."""
        return f"{self.effect} at {self.where}"


@dataclass(frozen=True)
class Detection:
    """Whether there is a mismatch, and what would have been seen.

    Attributes:
        p_value: Of nothing being there; poses' signs flipped.
        residual_rms: After the nominal fit, 3-D per reading, in m.
        noise_rms: What the tracker's noise alone would leave, in m.
        smallest_effect: Displacement rms per reading that an effect must have, beyond
            the nuisance parameters, to be seen nine times in ten, in m.
        held_out_within_rms: What the fitted nominal arm leaves on the poses held out of
            differences within visits, in m; NaN where none is held out.
        held_out_rms: The same with what means of visits leave.
        within_rms: `residual_rms` of differences within visits, in m.
        noise_within_rms: `noise_rms` of these, in m.
    """

    p_value: float
    residual_rms: float
    noise_rms: float
    smallest_effect: float
    held_out_within_rms: float = float("nan")
    held_out_rms: float = float("nan")
    within_rms: float = float("nan")
    noise_within_rms: float = float("nan")

    def fitted_rms(self, absolute: bool, held_out: bool) -> float:
        """Return what the fitted nominal arm leaves, in m.

        Args:
            absolute: With what means of visits leave.
            held_out: On the poses held out; otherwise on all.
        """
        if held_out:
            return self.held_out_rms if absolute else self.held_out_within_rms
        return self.residual_rms if absolute else self.within_rms

    def rms_and_noise(self, within: bool) -> tuple[float, float]:
        """Return rms and noise, of differences within visits where these are known."""
        if within and np.isfinite(self.within_rms):
            return self.within_rms, self.noise_within_rms
        return self.residual_rms, self.noise_rms


@dataclass(frozen=True)
class Located:
    """A place where the arm differs.

    Attributes:
        where: The place.
        p_value: Of nothing being there, for all places looked at.
        share: Of the whitened variance that the mismatch explains.
        depends_on: On what the difference depends.
        zone: Where in torque, direction or time it is largest, in words.
        split_share: Share of the splits of few poses that place a name there; None
            where there is one split, or no name there.
    """

    where: str
    p_value: float
    share: float
    depends_on: tuple[str, ...]
    zone: str
    split_share: float | None = None


@dataclass(frozen=True)
class SplitNames:
    """What is named where some poses are held out.

    Attributes:
        held_out: Ids of the poses that this naming has not seen.
        names: Names of the answer that it gives too, or that would do as well there.
    """

    held_out: tuple[int, ...]
    names: frozenset[Name]


@dataclass(frozen=True)
class NamedEffect:
    """A name that was given.

    Attributes:
        name: Effect and place.
        probability: Posterior of it or one of its equivalents.
        equivalents: Names that would do as well, most probable first.
        parameters: In SI, with 95 % intervals.
        shape: Its hypothesis' shape parameters.
        coefficients: Its hypothesis' amplitudes.
        settings: Parameters that are no numbers with an interval (a partner's name).
        split_share: Share of the splits of few poses that give it; None with one split.
        share: What the others would not explain without it, as a share of the mismatch
            on poses left out; None where it was not selected among others.
        budget_share: Its part of the same share that all members of the set explain;
            the parts of all members add up.
    """

    name: Name
    probability: float
    equivalents: tuple[Name, ...]
    parameters: Mapping[str, Interval]
    shape: tuple[float, ...] = ()
    coefficients: tuple[float, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)
    split_share: float | None = None
    share: float | None = None
    budget_share: float | None = None


@dataclass(frozen=True)
class Rival:
    """The names given with one of them exchanged, or with one more that is not sure.

    Attributes:
        probability: Posterior of the name that was put in, the other names held.
        effects: The whole set.
    """

    probability: float
    effects: tuple[Name, ...]


@dataclass(frozen=True)
class Unexplained:
    """The residual, or what could not be named.

    Attributes:
        where: The place where it is strongest.
        signature: On what it depends and how it looks, in words.
        law: Extra turn of the axis against torque, learnt from the data: torque in N m,
            turn in rad while loading and while unloading; empty where none holds at
            poses left out.
    """

    where: str
    signature: str
    law: Mapping[str, tuple[float, ...]]


@dataclass(frozen=True)
class UnexplainedPlace:
    """A place where the residual is significant beside everything that was named.

    Attributes:
        where: The place.
        p_value: Of nothing being there, for all places that were tested.
        share: Of the mismatch.
        depends_on: On what the residual depends.
        law: How it looks, in words; empty where nothing holds at poses left out.
    """

    where: str
    p_value: float
    share: float
    depends_on: tuple[str, ...]
    law: str = ""


def _beyond_limits(decisions: Sequence[Decision]) -> tuple[Warned, ...]:
    """Say which effects would do what has no name, with sizes that are not possible."""
    why = {d.candidate: d.reason for d in decisions if d.gate == "physical"}
    return tuple(
        Warned(
            "beyond_limits",
            where,
            f"{effect} at {where} was tried and refused: {reason}. If that may be, the "
            "set-up or the model is mistaken there.",
        )
        for (effect, where), reason in why.items()
    )


def _tared_under_load(
    decisions: Sequence[Decision], open_at: Collection[str]
) -> tuple[Warned, ...]:
    """Say that one force along each visit's load is missing in all of its rows."""
    tare = (d for d in decisions if d.candidate[0] == "generic_tare")
    asked = (d for d in tare if d.candidate[1] in open_at)
    text = (
        "part of the mismatch is what one force would do that pulls in each row as the "
        "visit's load does, also where none is read. Was the sensor zeroed while a "
        "hook, a pan or a rope's tension pulled, or is their weight not counted?"
    )
    return tuple(
        Warned("tared_under_load", d.candidate[1], text)
        for d in asked
        if d.gate == "left_out" and d.accepted
    )


def remarks_on(
    decisions: Sequence[Decision], places: Sequence[UnexplainedPlace]
) -> tuple[Warned, ...]:
    """Say what decisions tell of the set-up, where the mismatch is not explained.

    Args:
        decisions: Of all gates.
        places: What has no name.
    """
    open_at = {place.where for place in places}
    return (*_beyond_limits(decisions), *_tared_under_load(decisions, open_at))


SCATTER = "scatter"
"""Code of the remark that poses differ more than anything stated allows."""


def scattered(dispersion: float) -> Warned:
    """Say that poses differ at random, by more than errors explain.

    A law that changes its sign from pose to pose (a stiffness that another axis' angle
    governs) averages out of every column, and random signs leave it as it is.

    Args:
        dispersion: Variance of the map's scores over that of the stated errors.
    """
    text = (
        f"poses differ {np.sqrt(dispersion):.1f} times as much as the stated errors "
        "make them, after no law that was tried. Either errors are larger than stated, "
        "or something is left out that depends on what is not looked at."
    )
    return Warned(SCATTER, "rig", text)


ALUMINIUM = 23e-6
"""Thermal expansion per K of the metal that most arms are made of."""
TRUE_SCALE = 2e-5
"""Error of a tracker's scale from which it is doubted; chosen: makers state less."""


def other_causes(named: Sequence[NamedEffect]) -> tuple[Warned, ...]:
    """Say what looks like a name and may be something else."""
    said = ((one, _other_cause(one.name.effect, one.parameters)) for one in named)
    return tuple(
        Warned("other_cause", one.name.where, f"{one.name} may also be {cause}.")
        for one, cause in said
        if cause
    )


def _other_cause(effect: str, sizes: Mapping[str, Interval]) -> str:
    """Return what else displaces an arm as an effect of some sizes; empty: nothing."""
    nothing = Interval(np.nan, np.nan, np.nan)
    names = ("ratio", "order", "lag_rad", "share_lag_rad")
    ratio, order, *lags = (sizes.get(name, nothing) for name in names)
    if effect == "mass_scale" and ratio.high < 1.0:
        return "a controller that takes out part of the sag, the same in all axes"
    if effect == "tracker_scale" and abs(scale := ratio.estimate) > TRUE_SCALE:
        warm = f"{abs(scale) / ALUMINIUM:.1f} K {'warmer' if scale > 0 else 'colder'}"
        return f"an arm that is {warm} than as drawn, if it is of aluminium"
    if effect == "transmission_error" and -np.inf < order.low <= 0.0:
        return "a spring across the axis, such as hoses, or a wrong gear ratio"
    if any(lag.high < 0.0 for lag in lags):
        return "friction that holds the axis short of its angle"
    return ""


@dataclass(frozen=True)
class Nominal:
    """The nuisance parameters as fitted.

    Attributes:
        compliance: Of each axis, in rad/(N m), together with what was named.
        sigma: Standard deviations, 0 where it was not fitted.
        modelled: Of each axis, as the model says, in rad/(N m); 0 = rigid.
        blind: Axes whose spring these data cannot see.
        base_from_tracker: In m.
        places: Of each marker in its body's frame, in m.
        noise_ratio: Measured noise of a reading over the stated one.
        pose_repeatability: One sigma of the axes' arrival, in rad.
    """

    compliance: Float[np.ndarray, " axes"]
    sigma: Float[np.ndarray, " axes"]
    modelled: Float[np.ndarray, " axes"]
    blind: tuple[str, ...]
    base_from_tracker: Float[np.ndarray, "4 4"]
    places: Float[np.ndarray, "markers 3"]
    noise_ratio: float
    pose_repeatability: Float[np.ndarray, " axes"]


@dataclass(frozen=True, repr=False)
class Diagnosis:
    """The whole answer but the proof.

    Attributes:
        recording: Its name.
        verdict: In one word.
        detection: Whether there is a mismatch.
        located: Where, strongest first.
        named: What, most certain first.
        rivals: Other sets of names, most probable first.
        unexplained: The residual; None where there is none.
        confounded: Pairs that these data cannot tell apart.
        warnings: Mistakes of the set-up and remarks.
        nominal: The nuisance parameters; None where a mistake stopped the fit.
        held_out: Ids of the poses that naming has not seen.
        downweighted: Readings that counted less: row, marker's name, size in sigma.
        outliers: Outliers, which were left out.
        seconds: How long it took.
        unexplained_places: Where the residual of a set of many names is significant,
            strongest first.
        decisions: Of each gate on each candidate of a set of many names.
        scatter: Rms of a reading that fits no law and was taken for noise, in m; None
            where noise is as stated or measured.
        reading_noise: One sigma of one frame's coordinates that was used where it is
            not the stated one, in m; None elsewhere.
        splits: Of few poses, each of which is held out once: what is named without
            them, the answer's own split first; empty with one split.
    """

    recording: str
    verdict: Verdict
    detection: Detection
    located: tuple[Located, ...] = ()
    named: tuple[NamedEffect, ...] = ()
    rivals: tuple[Rival, ...] = ()
    unexplained: Unexplained | None = None
    confounded: tuple[tuple[Name, Name], ...] = ()
    warnings: tuple[Warned, ...] = ()
    nominal: Nominal | None = None
    held_out: tuple[int, ...] = ()
    downweighted: tuple[tuple[int, str, float], ...] = ()
    outliers: tuple[Outlier, ...] = ()
    seconds: float = 0.0
    unexplained_places: tuple[UnexplainedPlace, ...] = ()
    decisions: tuple[Decision, ...] = ()
    splits: tuple[SplitNames, ...] = ()
    scatter: float | None = None
    reading_noise: float | None = None

    def __getitem__(self, name: tuple[str, str]) -> NamedEffect:
        """Return what was named, by effect and place.

        Raises:
            KeyError: Where it was not named, saying why.
        """
        for one in self.named:
            if (one.name.effect, one.name.where) == name:
                return one
        raise KeyError(self.why_not(*name))

    def __repr__(self):
        """Return the story in five lines."""
        return "\n".join(_narrative(self))

    def why_not(self, effect: str, where: str) -> str:
        """Say why an effect was not named at a place, in a sentence or a few.

        Args:
            effect: In the vocabulary.
            where: The place.

        Raises:
            UnknownName: Where there is no such effect.
        """
        if effect not in CATALOGUE:
            raise UnknownName("effect", effect, CATALOGUE)
        return " ".join(_why_not(self, Name(effect, where)))


# --- The story ------------------------------------------------------------------------

MOST_SHOWN = 3
"""Names of which the story gives the parameters, and places that it lists."""


def _narrative(found: Diagnosis) -> Iterator[str]:
    word = found.verdict.replace("_", " ")
    yield f"Diagnosis of {found.recording!r}: {word}, by the readings alone."
    d = found.detection
    sizes = "the set-up is wrong"
    if np.isfinite(d.residual_rms):
        missed, noise = (MICRO * size for size in d.rms_and_noise(within=False))
        sizes = (
            f"readings miss the fitted nominal arm by {missed:.1f} µm, "
            f"noise alone leaves {noise:.1f} µm"
        )
        if 0.0 < d.within_rms < d.residual_rms:  # the scale of most proofs
            missed, noise = (MICRO * size for size in d.rms_and_noise(within=True))
            sizes += f"; within visits {missed:.1f} µm and {noise:.1f} µm"
    yield f"Mismatch: p = {d.p_value:.2g}; {sizes}."
    shown = [f"{x.where} ({x.share:.0%})" for x in found.located[:MOST_SHOWN]]
    yield f"Where: {', '.join(shown) or 'nowhere in particular'}."
    names = [_stated(n) for n in found.named[:MOST_SHOWN]]
    names += [str(n.name) for n in found.named[MOST_SHOWN:]]
    yield f"What: {'; '.join(names) or 'nothing is named'}."
    left = found.unexplained
    rest = "nothing that is significant" if left is None else (
        f"{left.where or 'no one place'}: {left.signature or 'no law holds'}"
    )  # fmt: skip
    said = "".join(f" Note ({w.where}): {w.text}" for w in found.warnings[:1])
    yield f"Left: {rest}.{said}"


def _stated(named: NamedEffect) -> str:
    sizes = [
        f"{name} {p.estimate:.3g} ({p.low:.3g} to {p.high:.3g})"
        for name, p in named.parameters.items()
    ]
    probable = f"{named.name}, probability {named.probability:.3f}"
    return f"{probable}: {', '.join(sizes)}" if sizes else probable


# --- Why a name was withheld ----------------------------------------------------------

SIGNS = "random signs of the poses do as well in {0:.2g}, less than {1:.2g} is needed"
STATISTICS = {
    "log_evidence": "log evidence gained is {0:.3g}, more than {1:.3g} is needed",
    "regions_left_out": "gain there is {0:.2g} standard errors, {1:.2g} are needed",
    "left_out": SIGNS,
    "other_forms": SIGNS,
    "second_order": "it is {0:.2g} of what that explains, {1:.2g} is needed",
    "residual": "the residual is {0:.2g} of what it explains, {1:.2g} may be",
    "homogeneity": "they differ by {0:.2g} of what it explains, {1:.2g} may be",
    "posterior": "probability is {0:.2g}, {1:.2g} is needed",
    "splits": "{0:.0%} of the splits give it, more than {1:.0%} is needed",
}
"""What a gate compares, in words; of other gates the numbers are given as they are."""


def in_words(decision: Decision) -> str:
    """Return a gate's verdict with its reason and, where it has any, its numbers."""
    d, reason = decision, decision.reason
    first = reason[:1].upper() + reason[1:]
    if not np.isfinite([d.statistic, d.threshold]).all() or d.statistic == d.threshold:
        return f"{first}."
    usual = f"{d.gate.replace('_', ' ')}: {{0:.3g}} against {{1:.3g}}"
    numbers = STATISTICS.get(d.gate, usual).format(d.statistic, d.threshold)
    return f"{first}: {numbers}."


def withheld(decisions: Sequence[Decision], name: Name) -> list[Decision]:
    """Return the gates that a candidate did not pass, the last first."""
    own = [d for d in decisions if tuple(d.candidate) == (name.effect, name.where)]
    return [d for d in reversed(own) if not d.accepted]


def refused_with_size(found: Diagnosis) -> list[Decision]:
    """Return the last gate at which each name was stopped that had a size by then."""
    given = {name for n in found.named for name in (n.name, *n.equivalents)}
    last = {
        Name(*d.candidate): d
        for d in found.decisions
        if d.parameters and not d.accepted
    }
    return [d for name, d in last.items() if name not in given]


MOST_WITHHELD = 5
"""Names that are said to have come furthest without being given; chosen."""


def strongest_withheld(found: Diagnosis) -> list[Decision]:
    """Return the gates at which the names that came furthest were stopped.

    Furthest: past most gates, then nearest to the threshold. Names that were given,
    and their equivalents, are not among them.
    """
    given = {name for n in found.named for name in (n.name, *n.equivalents)}
    last: dict[Name, Decision] = {}
    passed: Counter[Name] = Counter()
    for d in found.decisions:
        name = Name(*d.candidate)
        if d.accepted:
            passed[name] += 1
        else:
            last[name] = d
    short = {
        name: abs(d.threshold - d.statistic) if np.isfinite(d.statistic) else np.inf
        for name, d in last.items()
        if name not in given
    }
    order = sorted(short, key=lambda name: (-passed[name], short[name]))
    return [last[name] for name in order[:MOST_WITHHELD]]


def _why_not(found: Diagnosis, name: Name) -> Iterator[str]:
    for one in found.named:
        if one.name == name:
            yield f"It is named: {_stated(one)}."
            return
        if name in one.equivalents:
            yield (
                f"By these data it would do as well as {one.name}, which is the more "
                "probable of the two and is named in its place."
            )
            return
    if found.nominal is None and found.warnings:
        yield f"No name was looked for while this stands: {found.warnings[0].text}"
        return
    if found.verdict == "no_mismatch":
        yield (
            "No name was looked for: recording and fitted model do not differ "
            f"significantly (p = {found.detection.p_value:.2g}, below "
            f"{SETTINGS.significance:g} is needed)."
        )
        return
    refused = [in_words(d) for d in withheld(found.decisions, name)]
    yield from refused
    best = max((r.probability for r in found.rivals if name in r.effects), default=None)
    if best is not None:
        yield (
            f"Another set of names, that has it, has a probability of {best:.2g}; "
            f"{SETTINGS.name_probability:g} is needed."
        )
    elif not refused:
        sites = ", ".join(CATALOGUE[name.effect].sites)
        yield (
            f"No gate has decided on {name}: it was not among the candidates that came "
            "close to a name, these readings cannot show it, or it cannot be at that "
            f"place ({name.effect} belongs to: {sites})."
        )
