"""Error budget of an answer with many names, and its names grouped in plain words.

The budget is of the mismatch: the square, beyond noise, by which the fitted nominal arm
misses the poses kept back. The share of a name is what all others would not explain
without it. What several names explain only together belongs to none of them; the rest
is open.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from bench.shared.effect_catalogue import CATALOGUE
from scenarios.pipelines.schema import Answer, Called, Interval, rounded, unit_of

MANY = 4
"""Number of names from which an answer is told in groups; chosen: up to three lines
need no grouping."""


# --- The budget -----------------------------------------------------------------------


@dataclass(frozen=True)
class ErrorBudget:
    """Shares of the mismatch, 0 to 1.

    Attributes:
        of: Share of each place, by family of effects; places along the arm, then the
            instruments.
        jointly: What the names explain only together.
        unexplained: What no name explains; None where no proof tells.
        places: Of what is unexplained, each place where it is significant.
    """

    of: Mapping[str, Mapping[str, float]]
    jointly: float
    unexplained: float | None
    places: Mapping[str, float]

    @property
    def of_places(self) -> dict[str, float]:
        """The share of each place."""
        return {where: sum(kinds.values()) for where, kinds in self.of.items()}

    @property
    def of_families(self) -> dict[str, float]:
        """The share of each family of effects, largest first."""
        found: dict[str, float] = {}
        for kinds in self.of.values():
            for family, share in kinds.items():
                found[family] = found.get(family, 0.0) + share
        return dict(sorted(found.items(), key=lambda x: -x[1]))


def error_budget(answer: Answer) -> ErrorBudget:
    """Return how much of the mismatch each place and family of effects makes."""
    found: dict[str, dict[str, float]] = {}
    for one in sorted(answer.named, key=lambda n: along_the_arm(n.where)):
        kinds = found.setdefault(one.where, {})
        family = family_of(one.effect)
        kinds[family] = kinds.get(family, 0.0) + share_of(one)
    total = sum(share_of(one) for one in answer.named)
    explained = None
    if answer.explained_share is not None:
        estimate = answer.explained_share.estimate
        explained = estimate if isinstance(estimate, float) else None
    known = explained is not None
    return ErrorBudget(
        of=found,
        jointly=max(explained - total, 0.0) if known else 0.0,
        unexplained=min(max(1.0 - explained, 0.0), 1.0) if known else None,
        places={p.where: p.share for p in answer.unexplained_places},
    )


def family_of(effect: str) -> str:
    """Return the kind of part that an effect belongs to; `other` where unknown."""
    return CATALOGUE[effect].family if effect in CATALOGUE else "other"


def share_of(called: Called) -> float:
    """Return a name's share of the mismatch; 0 where none was found."""
    return max(called.share, 0.0) if isinstance(called.share, float) else 0.0


def along_the_arm(where: str) -> tuple[float, str]:
    """Return a key that sorts places from the base to the tool, instruments last."""
    ends = {"base": -1.0, "flange": 900.0, "tool": 901.0}
    if where in ends:
        return ends[where], where
    for start, after in (("a", 0.0), ("link_", 0.5)):
        number = where.removeprefix(start).partition(":")[0]
        if where.startswith(start) and number.isdigit():
            return float(number) + after, where
    return 1000.0, where


def percent(share: float) -> str:
    """Return a share in percent with a digit that can be read: 27 %, 1.3 %, < 0.1 %."""
    if share < 1e-3:
        return "0 %" if share <= 0.0 else "< 0.1 %"
    return f"{100 * share:.0f} %" if share >= 0.0995 else f"{100 * share:.1f} %"


# --- Names in groups ------------------------------------------------------------------

COUNTS = (
    *("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine"),
    *("ten", "eleven", "twelve"),
)

PLAIN: Mapping[str, tuple[str, str, str, str, str]] = {
    "joint_compliance": ("axis", "gives way", "give way", "compliance_rad_per_nm", ""),
    "hardening": ("gear", "hardens", "harden", "stiffness_ratio", "times as stiff"),
    "asymmetric_stiffness": (
        *("gear", "is stiffer one way", "are stiffer one way"),
        *("ratio", "times"),
    ),
    "lost_motion": ("gear", "has play", "have play", "width_rad", "wide"),
    "hysteresis": (
        *("gear", "holds back wind-up", "hold back wind-up"),
        *("width_rad", "wide"),
    ),
    "creep": ("gear", "creeps under load", "creep under load", "ratio", "of wind-up"),
    "angle_dependent_stiffness": (
        *("gear", "is stiffer at some angles", "are stiffer at some angles"),
        *("ratio", "of the stiffness, peak to peak"),
    ),
    "wrist_coupling": (
        *("axis", "is turned by another's torque", "are turned by others' torque"),
        *("compliance_rad_per_nm", ""),
    ),
    "bearing_tilt": ("bearing", "tilts", "tilt", "u_rad_per_nm v_rad_per_nm", ""),
    "link_bending": ("link", "bends", "bend", "bending_nm2", "stiff"),
    "base_compliance": (
        *("", "gives way", "give way"),
        *("rx_rad_per_nm ry_rad_per_nm", ""),
    ),
    "gravity_load": (
        *("link", "weighs other than modelled", "weigh other than modelled"),
        *("mass_kg", ""),
    ),
    "gravity_compensator": (
        *("axis", "is helped by a spring", "are helped by springs"),
        *("torque_nm", ""),
    ),
    "transmission_error": (
        *("gear", "errs with the angle", "err with the angle"),
        *("amplitude_rad", "peak to peak"),
    ),
    "encoder_offset": (
        *("encoder", "is off by a constant", "are off by constants"),
        *("offset_rad", ""),
    ),
    "geometry_error": ("link", "is not as drawn", "are not as drawn", "", ""),
    "pulley_friction": ("", "has a pulley that rubs", "", "ratio", "of the pull"),
    "wrench_bias": ("", "reads an offset", "", "", ""),
    "wrench_gain": ("", "reads a wrong scale", "", "", ""),
    "wrench_misalignment": ("", "is turned or beside its place", "", "", ""),
    "tracker_scale": ("", "reads a wrong scale", "", "", ""),
    "tracker_misalignment": ("", "is not where it is stated", "", "", ""),
    "drift": ("", "wanders with time", "wander with time", "", ""),
    "marker_slip": ("", "moved on its body", "moved on their bodies", "", ""),
    "channel_delay": ("", "lags", "lag", "delay_s", ""),
}
"""Of each effect: the part, what one and several do, the sizes to tell, and a word
after them."""
PLACES = {
    "base": "foot",
    "rig": "rope",
    "wrench_sensor": "force sensor",
}
"""Words for places that are no axis or link."""


def grouped(answer: Answer, axes: int) -> Iterator[str]:
    """Yield one sentence for each effect at all its places, largest share first.

    Args:
        answer: With names.
        axes: Number of axes of the arm.
    """
    groups: dict[str, list[Called]] = {}
    for one in sorted(answer.named, key=lambda n: along_the_arm(n.where)):
        groups.setdefault(one.effect, []).append(one)
    order = sorted(groups, key=lambda e: -sum(map(share_of, groups[e])))
    for effect in order:
        together = groups[effect]
        sizes = _sizes(effect, together)
        share = percent(sum(map(share_of, together)))
        text = f"{_who_does(effect, together, axes)}{f': {sizes}' if sizes else ''}"
        yield f"{text} ({share})."


def _who_does(effect: str, together: Sequence[Called], axes: int) -> str:
    """Return the parts and what they do, with a capital: `All six gears harden`."""
    places = tuple(dict.fromkeys(n.where for n in together))
    part, one, several, *_ = PLAIN.get(effect, ("", "", "", "", ""))
    several = several or one
    if not one:  # no words for it: its name in the vocabulary
        return f"{effect.replace('_', ' ')} at {_listed(places)}".capitalize()
    of_axes = all(place[1:].isdigit() and place[0] == "a" for place in places)
    links = [place for place in places if place.startswith("link_")]
    everywhere = {"axes": axes, "links": axes - 1}
    kind = "axes" if of_axes else "links" if len(links) == len(places) else ""
    count = len(places)
    if kind and count > 2 and count == everywhere[kind]:
        word = COUNTS[count] if count < len(COUNTS) else str(count)
        return f"All {word} {_plural(part or kind[:-1])} {several}"
    if kind == "links":
        numbers = [place.removeprefix("link_") for place in places]
        word = "Link" if count == 1 else "Links"
        return f"{word} {_listed(numbers)} {one if count == 1 else several}"
    if kind == "axes":
        word = part or "axis"
        if word == "axis":
            told = f"{'Axis' if count == 1 else 'Axes'} {_listed(places)}"
        else:
            told = f"The {word if count == 1 else _plural(word)} of {_listed(places)}"
        return f"{told} {one if count == 1 else several}"
    told = _listed([_placed(place) for place in places])
    return f"{told[:1].upper()}{told[1:]} {one if count == 1 else several}"


def _placed(where: str) -> str:
    if where.startswith("marker:"):
        return f"mark {where.removeprefix('marker:')}"
    if where.startswith("link_"):
        return where.replace("_", " ")
    if where in PLACES or where in ("flange", "tool", "tracker"):
        return f"the {PLACES.get(where, where)}"
    return where


def _plural(word: str) -> str:
    return "axes" if word == "axis" else f"{word}s"


def _listed(words: Sequence[str]) -> str:
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} and {words[-1]}"


# --- Their sizes ----------------------------------------------------------------------

SHARES = ("creep", "angle_dependent_stiffness", "pulley_friction")
"""Effects whose ratio is a share, told in percent."""
PEAK_TO_PEAK = {("angle_dependent_stiffness", "ratio"): 2.0}
"""Factor to a wave's peak-to-peak value, where its name alone does not tell."""


def _sizes(effect: str, together: Sequence[Called]) -> str:
    """Return the sizes of a group as one range, each end rounded to its interval."""
    names, word = (PLAIN.get(effect) or ("", "", "", "", ""))[3:]
    names = names.split()
    known = [
        (name, n.parameters[name], ends)
        for n in together
        for name in names
        if name in n.parameters and (ends := _numbers(n.parameters[name])) is not None
    ]
    if not known:
        return ""
    unit, factor = unit_of(known[0][0])
    factor *= PEAK_TO_PEAK.get((effect, known[0][0]), 1.0)
    if effect in SHARES:
        unit, factor = "%", 100.0 * factor
    known.sort(key=lambda x: x[2][0])
    told = [rounded(p, factor, at[0]) for _, p, at in (known[0], known[-1])]
    if len(known) == 1:
        _, one, (_, low, high) = known[0]
        told = [rounded(one, factor, low), rounded(one, factor, high)]
    text = told[0] if told[0] == told[1] else f"{told[0]} to {told[1]}"
    return " ".join(filter(None, (text, unit, word)))


def _numbers(interval: Interval) -> tuple[float, float, float] | None:
    """Return estimate, low and high; None where the data do not hold all three."""
    value, low, high = interval.estimate, interval.low, interval.high
    if not (isinstance(value, float) and isinstance(low, float)):
        return None
    return (value, low, high) if isinstance(high, float) else None
