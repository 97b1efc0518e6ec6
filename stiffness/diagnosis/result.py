"""Result of a diagnosis: verdict, named effects with intervals, sites, warnings."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from stiffness.regression.group_selection import Decision
from stiffness.regression.intervals import Parameter

__all__ = [
    "Decision",
    "Detection",
    "Diagnosis",
    "Located",
    "Name",
    "NamedEffect",
    "Nominal",
    "Parameter",
    "Rival",
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


@dataclass(frozen=True)
class Detection:
    """Whether there is a mismatch, and what would have been seen.

    Attributes:
        p_value: Of nothing being there; poses' signs flipped.
        residual_rms: After the nominal fit, 3-D per reading, in m.
        noise_rms: What the tracker's noise alone would leave, in m.
        smallest_effect: Displacement rms per reading that an effect must have, beyond
            what is fitted silently, to be seen nine times in ten, in m.
        held_out_within_rms: What the fitted nominal arm leaves on the poses held out of
            differences within visits, in m; NaN where none is held out.
        held_out_rms: The same with what means of visits leave.
    """

    p_value: float
    residual_rms: float
    noise_rms: float
    smallest_effect: float
    held_out_within_rms: float = float("nan")
    held_out_rms: float = float("nan")


@dataclass(frozen=True)
class Located:
    """A place where the arm differs.

    Attributes:
        where: The place.
        p_value: Of nothing being there, for all places looked at.
        share: Of the whitened variance that the mismatch explains.
        depends_on: On what the difference depends.
        zone: Where in torque, direction or time it is largest, in words.
    """

    where: str
    p_value: float
    share: float
    depends_on: tuple[str, ...]
    zone: str


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
    """

    name: Name
    probability: float
    equivalents: tuple[Name, ...]
    parameters: Mapping[str, Parameter]
    shape: tuple[float, ...] = ()
    coefficients: tuple[float, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Rival:
    """Another set of names and its posterior."""

    probability: float
    effects: tuple[Name, ...]


@dataclass(frozen=True)
class Unexplained:
    """What is left or could not be named.

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


@dataclass(frozen=True)
class Warned:
    """A mistake of the set-up, or something that the reader should know."""

    code: str
    where: str
    text: str


@dataclass(frozen=True)
class Nominal:
    """What was fitted silently.

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


@dataclass(frozen=True)
class Diagnosis:
    """The whole answer but the proof.

    Attributes:
        recording: Its name.
        verdict: In one word.
        detection: Whether there is a mismatch.
        located: Where, strongest first.
        named: What, most certain first.
        rivals: Other sets of names.
        unexplained: What is left; None where nothing is.
        confounded: Pairs that these data cannot tell apart.
        warnings: Mistakes of the set-up and remarks.
        nominal: What was fitted silently; None where a mistake stopped the fit.
        held_out: Ids of the poses that naming has not seen.
        downweighted: Readings that counted less: row, marker's name, size in sigma.
        seconds: How long it took.
        shares: Of each name, where many were selected together: what the others would
            not explain without it, as a share of the mismatch on poses left out.
        unexplained_places: Where the residual of a set of many names is significant,
            strongest first.
        decisions: Of each gate on each candidate of a set of many names.
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
    seconds: float = 0.0
    shares: Mapping[Name, float] = field(default_factory=dict)
    unexplained_places: tuple[UnexplainedPlace, ...] = ()
    decisions: tuple[Decision, ...] = ()
