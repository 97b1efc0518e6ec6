"""Strata of the blind trials and their limits, written down before any trial.

The bars are shares of trials, fixed by the project's plan. The last is added to them:
it tests the smallest effect that the diagnosis says would have shown.
"""

from dataclasses import dataclass, replace
from typing import Literal

# --- Pools ----------------------------------------------------------------------------

MEMORY = ("lost_motion", "hysteresis", "creep")
"""Effects that only a reversal or a dwell of the load discriminates."""
SINGLE = (
    "joint_compliance", "hardening", "asymmetric_stiffness", "lost_motion",
    "hysteresis", "creep", "angle_dependent_stiffness", "wrist_coupling",
    "bearing_tilt", "link_bending", "base_compliance", "gravity_load",
    "gravity_compensator", "transmission_error", "encoder_offset", "geometry_error",
    "pulley_friction", "wrench_bias", "wrench_gain", "wrench_misalignment",
    "tracker_scale", "tracker_misalignment", "drift", "marker_slip",
)  # fmt: skip
"""Effects that a recording at rest can show."""
ALONE = ("joint_compliance", "pulley_friction")
"""Effects that need a model or a sensor of their own: never combined or removed."""
TOGETHER = tuple(name for name in SINGLE if name not in ALONE)
"""Effects that can be combined with others, and whose names can be taken out."""
OF_LOADS = (
    "hardening", "asymmetric_stiffness", "lost_motion", "hysteresis", "creep",
    "angle_dependent_stiffness", "bearing_tilt", "base_compliance",
)  # fmt: skip
"""Effects that one mark can show, load by load."""
OUTSIDE = (
    "softening", "thrust_turn", "loose_bearing", "foot_lift_off", "axis_crosstalk",
    "warming_gear",
)  # fmt: skip
"""Mechanisms without a name in the vocabulary."""
OTHER_FORMS = ("hardening", "lost_motion", "hysteresis")
"""Effects that a mechanism with another law exists of."""
WHOLE_ARM = tuple(name for name in TOGETHER if name != "tracker_misalignment")
"""Effects of whole arms; the one that is left out needs a frame that is stated."""
EVERY_AXIS = (
    "hardening", "hysteresis", "creep", "angle_dependent_stiffness", "bearing_tilt",
)  # fmt: skip
"""Effects that every rotary axis has where an arm has all; its links bend and its foot
gives way besides. These are those of the study's arm."""
LIBRARY = (*SINGLE, "channel_delay")
"""Names whose hypotheses say what of a mechanism is outside the vocabulary.

Pools and library are fixed, and so is their order: kind, place, form and size of every
trial follow from them. An effect that is registered later changes no trial of these
strata; new strata with a pool of their own conceal it.
"""

# --- Strata ---------------------------------------------------------------------------


@dataclass(frozen=True)
class Stratum:
    """One kind of trial: its effects, markers and load path.

    Attributes:
        name: Short name, as in tables and flags.
        what: Description in a phrase.
        least: Least projected χ² of each effect; empty where there is none.
        targets: Which bodies carry markers.
        path: Load on the hook, as `bench.shared.plan.parse_path` reads it; empty:
            the default path, with a dwell and a reversal.
        known: Whether the vocabulary has its effects.
        pool: Names of the effects that its trials conceal, in turn.
        mechanisms: Which mechanisms have these names: those of the vocabulary, other
            laws under the same names, or mechanisms outside the vocabulary.
        effects: How many effects a whole arm has, `ALL` for every one that arms have
            everywhere, `STUDY` for those of the study's arm; 0: the trial is none of a
            whole arm.
        arm_of: Stratum whose trials have the same arms: without the one mechanism
            outside the vocabulary that is here added to each, with another noise
            stated, without outliers, or with visits in order; empty: none is.
        most: Largest projected χ², drawn log-uniformly from the least; 0: the least.
        has_twin: Whether the answer is asked for the twin of its effect: the same at
            another place, `arms.draw_twins`.
        marks: Marks that the recording keeps, the first of those it has; 0: all. One or
            two do not measure the tracker's noise.
        stated: Noise of the tracker that is stated, over the true one; 0: none is.
    """

    name: str
    what: str
    least: tuple[float, ...] = ()
    targets: str = "all"
    path: str = ""
    known: bool = True
    pool: tuple[str, ...] = SINGLE
    mechanisms: Literal["vocabulary", "other_laws", "outside"] = "vocabulary"
    effects: int = 0
    arm_of: str = ""
    most: float = 0.0
    has_twin: bool = False
    marks: int = 0
    stated: float = 1.0

    @property
    def said(self) -> str:
        """Description with the least χ²."""
        least = " and ".join(f"{size:.0f}" for size in self.least)
        return f"{self.what}, χ² {least} or more" if least else self.what


ALL, STUDY = 1000, 2000
"""Number of effects of an arm that has all of them, and of the study's own."""


def _whole_arms() -> tuple[Stratum, ...]:
    """Return strata of whole arms, each with and without a mechanism outside."""
    found = []
    for targets in ("all", "flange"):
        start = "flange_arm" if targets == "flange" else "arm"
        for effects in (6, 12, ALL):
            many = "all" if effects == ALL else str(effects)
            what = f"a whole arm, {many} effects"
            what += ", a flange target alone" if targets == "flange" else ""
            name = f"{start}_{many}"
            inside = Stratum(
                name, what, targets=targets, pool=WHOLE_ARM, effects=effects
            )
            outside = replace(
                inside,
                name=f"{name}_outside",
                what=f"{what}, and a mechanism without a name",
                known=False,
                arm_of=name,
            )
            found += [inside, outside]
    return tuple(found)


def _other_laws() -> tuple[Stratum, ...]:
    """Return strata of the same whole arms with laws of other forms."""
    return tuple(
        replace(
            arm,
            name=f"{arm.name}_other_laws",
            what=f"{arm.what}, laws of other forms",
            mechanisms="other_laws",
            arm_of=arm.name,
        )
        for arm in _whole_arms()
        if arm.known
    )


def _with_twin(name: str, what: str, effect: str) -> Stratum:
    return Stratum(name, what, (400.0,), pool=(effect,), most=40_000.0, has_twin=True)


def _noise_statements() -> tuple[Stratum, ...]:
    """Return strata of one mark, whose noise is stated rightly, wrongly or not."""
    found = []
    for start, what, least in (
        ("one_mark", "one effect, one mark", (1600.0,)),
        ("null_mark", "nothing there, one mark", ()),
    ):
        own = Stratum(start, what, least, "flange", pool=OF_LOADS, marks=1)
        found.append(own)
        for end, said, stated in (
            ("unstated", "noise not stated", 0.0),
            ("small", "noise stated three times too small", 1.0 / 3.0),
            ("large", "noise stated three times too large", 3.0),
        ):
            name, text = f"{start}_{end}", f"{what}, {said}"
            found.append(
                replace(own, name=name, what=text, arm_of=start, stated=stated)
            )
    return tuple(found)


STRATA = {
    stratum.name: stratum
    for stratum in (
        Stratum("null", "nothing there"),
        Stratum("null_nuisance", "nothing there, but instruments at their worst"),
        Stratum("one_100", "one effect, barely to be seen", (100.0,)),
        Stratum("one_400", "one effect", (400.0,)),
        Stratum("flange_400", "one effect, a flange target alone", (400.0,), "flange"),
        Stratum("two_400", "two effects", (400.0, 400.0), pool=TOGETHER),
        Stratum(
            "outside",
            "a mechanism without a name",
            (100.0,),
            known=False,
            pool=OUTSIDE,
            mechanisms="outside",
        ),
        Stratum(
            "removed",
            "an effect whose name was taken out",
            (100.0,),
            known=False,
            pool=TOGETHER,
        ),
        Stratum(
            "memory",
            "play, hysteresis or creep, dwell and reversal",
            (400.0,),
            pool=MEMORY,
        ),
        Stratum(
            "memory_blind",
            "the same, loaded once without a dwell or a reversal",
            (400.0,),
            path="0,2.5,5,7.5,10",
            pool=MEMORY,
        ),
        Stratum(
            "second_law",
            "a name in the form of another law",
            (400.0,),
            pool=OTHER_FORMS,
            mechanisms="other_laws",
        ),
        Stratum("one_45", "one effect that should just show", (45.0,)),
        *_whole_arms(),
        _with_twin("alike_drift", "drift of the base or of the tracker", "drift"),
        _with_twin("alike_mass", "mass on link 3 or on link 4", "gravity_load"),
        _with_twin("alike_tilt", "a tilt, and that of the next axis", "bearing_tilt"),
        Stratum(
            "reading_lag",
            "an axis that is read before it rests",
            (400.0,),
            pool=("reading_lag",),
            most=40_000.0,
        ),
        *_noise_statements(),
        Stratum(
            "memory_carried",
            "play, hysteresis or creep in gears that remember the visit before",
            (400.0,),
            pool=MEMORY,
            most=40_000.0,
        ),
        Stratum(
            "outliers",
            "one effect, one reading in a thousand far off",
            (400.0,),
            arm_of="one_400",
        ),
        Stratum(
            "mistaken_relative",
            "one effect in differences within visits, an axis read wrongly",
            (400.0,),
            pool=OF_LOADS,
        ),
        Stratum(
            "share_lag",
            "an axis that is read before it rests, by its share of the move",
            (400.0,),
            pool=("reading_lag",),
            most=40_000.0,
        ),
        *_other_laws(),
        Stratum(
            "memory_unknown",
            "the same as memory_carried, visits told in another order",
            (400.0,),
            arm_of="memory_carried",
            pool=MEMORY,
            most=40_000.0,
        ),
        Stratum(
            "mistaken_absolute",
            "one effect, an axis read wrongly",
            (400.0,),
            arm_of="mistaken_relative",
            pool=OF_LOADS,
        ),
        Stratum("study_arm", "the study's arm, sizes within 30 %", effects=STUDY),
        Stratum(
            "compensated",
            "an axis whose sag the controller takes out",
            (400.0,),
            pool=("deflection_compensation",),
            most=4_000_000.0,
        ),
    )
}
"""The order is fixed, since seeds depend on it; new strata are added at the end."""
OUTLIERS = ("outliers",)
"""Strata of which a thousandth of the readings is far off."""
RELATIVE = ("mistaken_relative",)
"""Strata of differences within visits."""
MISTAKEN = (*RELATIVE, "mistaken_absolute")
"""Strata in which an axis is coupled, reversed or of another zero."""
BY_SHARE = ("share_lag",)
"""Strata whose readings lag in proportion to an axis' share of the move."""
REORDERED = ("memory_unknown",)
"""Strata whose recording does not say from which posture the arm came to each visit."""
CARRIED = (
    "memory_carried",
    *REORDERED,
    *(stratum.name for stratum in _other_laws()),
)
"""Strata whose gears remember the visit before, of which the answer is not told."""
USUAL = tuple(
    name
    for name, s in STRATA.items()
    if not (s.effects or s.most or s.marks or name in (*OUTLIERS, *MISTAKEN))
)
"""Strata that are tried unless others are asked for: of one size, not of a whole arm,
and with the noise stated as it is."""


# --- Bars -----------------------------------------------------------------------------


@dataclass(frozen=True)
class Bar:
    """The share of a mark that is required of some strata.

    Attributes:
        mark: Mark of `TrialScore` that is counted.
        at_most: Whether the share is an upper limit.
        of: Mark that a trial needs to be counted at all; empty: all count.
    """

    strata: tuple[str, ...]
    mark: str
    share: float
    at_most: bool = False
    of: str = ""


SIGNED = ("reading_lag", "share_lag")
"""Strata whose effect has a sign that the answer has to give."""
SIGN, SIZE = 0.95, 0.92
"""Required share of their trials in which the effect is named with its sign, and of the
intervals that hold its size."""
BARS = (
    Bar(("null", "null_nuisance"), "detected", 0.01, at_most=True),
    Bar(("one_100",), "detected", 0.95),
    Bar(("one_100",), "place_first", 0.90),
    Bar(("one_100",), "right", 0.90),
    Bar(("one_400",), "detected", 0.99),
    Bar(("one_400",), "place_first", 0.97),
    Bar(("one_400",), "right", 0.97),
    Bar(("one_400",), "exact", 0.80),
    Bar(("flange_400",), "right", 0.80),
    Bar(("two_400",), "whole_set", 0.80),
    Bar(("outside", "removed"), "wrong_name", 0.10, at_most=True),
    Bar(("outside", "removed"), "abstains", 0.80, of="detected"),
    Bar(("memory",), "told_apart", 0.90),
    Bar(("memory_carried",), "right", 0.95),
    Bar(("memory_carried",), "told_apart", 0.90),
    Bar(("memory_unknown",), "right", 0.95),
    Bar(("memory_unknown",), "told_apart", 0.90),
    Bar(("memory_blind",), "declared", 0.90),
    Bar(("second_law",), "right", 0.97),
    Bar(("one_45",), "detected", 0.90),
    Bar(("outliers",), "listed", 0.95),
    Bar(("mistaken_relative",), "listed", 0.95),
    Bar(("mistaken_absolute",), "listed", 0.95),
    Bar(("compensated",), "right", 0.95),
)
"""Limits on shares of trials; those on coverage, gain and time are in `rates`."""
