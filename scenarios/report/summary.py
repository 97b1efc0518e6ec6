"""A diagnosis in sentences, for the terminal, the report and the playback.

`sentences` is all of it; `headlines` is what to read first of many names, which
`grouped` tells by effect; `narrative` is five lines, of any engine's answer.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from statistics import median

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from bench.proof.proof import Proof
from scenarios.pipelines.diagnosis import Result
from scenarios.pipelines.patching import fitted_springs
from scenarios.pipelines.schema import (
    Answer,
    At,
    Called,
    Interval,
    Left,
    Open,
    Placed,
    Proved,
    chance,
    parameters_text,
    rounded,
    said_of_turns,
    sizes_far_off,
    unit_of,
)
from scenarios.report.error_budget import (
    MANY,
    along_the_arm,
    open_places,
    percent,
    shares_of_names,
)
from stiffness.diagnosis.result import SCATTER, Nominal
from stiffness.diagnosis.unknown_noise import FEW

# --- Fitted springs -------------------------------------------------------------------

ANOTHER = 0.1
"""Relative difference from which a stiffness is not the model's; chosen: catalogues are
no better."""
SIGMAS = 3.0
"""Standard errors that it must differ by as well; chosen."""


def springs_of(finding: Result) -> Nominal | None:
    """Return springs as the patch has them, of the patched arm where it was proved."""
    proved = finding.answer.verdict != "unproved"
    return fitted_springs(finding.diagnosis, finding.proof if proved else None)


def rows(nominal: Nominal, slides: tuple[bool, ...]) -> Iterator[list[str]]:
    """Yield axis, stiffness, its standard error, the model's, and their ratio.

    Stiffness is in kN m/rad; of an axis that slides in N/m, with the unit in the cell.
    """
    every = zip(nominal.compliance, nominal.sigma, nominal.modelled, strict=True)
    for k, (c, s, m) in enumerate(every):
        unit, word = (1.0, " N/m") if slides and slides[k] else (1e-3, "")
        stiffness, model = (
            f"{unit / x:.4g}{word}" if x > 0.0 else "rigid" for x in (c, m)
        )
        known = f"{100.0 * s / c:.2g}%" if c > 0.0 and s > 0.0 else ""
        if f"a{k + 1}" in nominal.blind:
            known = "not seen"
        ratio = f"{m / c:.2f}" if c > 0.0 and m > 0.0 and known != "not seen" else ""
        yield [f"a{k + 1}", stiffness, known, model, ratio]


def sentence(nominal: Nominal) -> str:
    """Return which springs clearly differ from the model's; empty: none does."""
    told, ratios = [], []
    every = zip(nominal.compliance, nominal.sigma, nominal.modelled, strict=True)
    for k, (c, s, m) in enumerate(every):
        if min(c, s, m) <= 0.0 or f"a{k + 1}" in nominal.blind:
            continue
        ratios.append(m / c)
        if abs(c - m) > max(ANOTHER * c, SIGMAS * s):
            told.append(f"a{k + 1} {m / c:.3g} ± {s * m / c**2:.1g}")
    if not told:
        return ""
    one, all_alike = median(ratios), ""
    if len(ratios) > 1 and max(ratios) - min(ratios) < ANOTHER * one:
        all_alike = f" One factor does for all within {ANOTHER:.0%}: {one:.2g}."
    return (
        "Springs were fitted as nuisance parameters. Over the model's stiffness, "
        f"± one sigma of noise: {', '.join(told)}.{all_alike}"
    )


# --- The narrative --------------------------------------------------------------------


DECIDED = 0.999
"""Probability of a name from which it is told from what is alike; chosen."""


def undecided(answer: Answer) -> Iterator[tuple[At, At]]:
    """Yield the pairs that are alike of which readings do not prefer the named one."""
    sure = {At(n.effect, n.where) for n in answer.named if n.probability > DECIDED}
    equivalents = {other for name in answer.named for other in name.equivalents}
    for pair in answer.confounded:
        if sure.isdisjoint(pair) or not equivalents.isdisjoint(pair):
            yield pair


def sentences(finding: Result) -> Iterator[str]:
    """Yield the sentences that state a result; one without proof begins with that."""
    a = finding.answer
    if a.verdict == "unproved":
        yield _unproved(finding)
    for warning in a.warnings:
        yield f"Note ({warning.where}): {warning.text}"
    yield _detected(a)
    springs = springs_of(finding)
    if springs is not None and (told := sentence(springs)):
        yield told
    if a.verdict == "no_mismatch" or finding.diagnosis.nominal is None:
        return
    if a.located:
        yield _where(a.located)
    yield from _names(a, finding.recording.posture.shape[1])
    if not a.named:
        yield "What: no name of the list explains it; none is given."
    yield from _still_open(a)
    if alike := [*undecided(a)]:
        pairs = [f"{x} with {y}" for x, y in alike[:3]]
        yield f"These data hardly tell apart: {_list(pairs)}."
    if finding.proof is not None:
        yield _proved(finding.answer)
    elif finding.unproved and a.verdict != "unproved":
        yield f"Nothing was proved: {finding.unproved}"
    for step in a.next_experiments[:1]:
        path = " ".join(f"{x:g}" for x in step.load_path_kg)
        pose = step.pose_text(finding.recording.slides)
        yield f"Next: pose [{pose}], load {path} kg; it {step.why}."


def headlines(finding: Result) -> Iterator[str]:
    """Yield what to read first of many names: mismatch, proof, names, what is open."""
    answer = finding.answer
    if answer.verdict == "unproved":
        yield _unproved(finding)
    yield _detected(answer)
    if finding.proof is not None:
        yield _proved(finding.answer)
    yield from _names(answer, finding.recording.posture.shape[1])
    yield from _still_open(answer)


def _where(located: Sequence[Placed]) -> str:
    first = located[0]
    on = f", and depends on {_list(first.depends_on)}" if first.depends_on else ""
    zone = f", strongest at {first.zone}" if first.zone else ""
    if first.zone == "everywhere":
        zone = ", everywhere alike"
    rest = [x.where for x in located[1:]]
    also = f" Also: {_list(rest)}." if rest else ""
    drawn = _of_splits(first.split_share)
    place = f"{first.where} ({first.share:.0%} of what differs{drawn})"
    return f"Where: {place}{on}{zone}.{also}"


def _of_splits(share: object) -> str:
    """Return in how many splits of few poses a name or place was given; empty: one."""
    if not isinstance(share, float):
        return ""
    return ", in every split" if share == 1.0 else f", in {share:.0%} of the splits"


def _detected(answer: Answer) -> str:
    found = answer.detection
    p = f"p = {found.p_value:.2g}"
    if found.residual_rms_mm is None or found.noise_rms_mm is None:
        if answer.proof is None:
            return "The set-up does not fit the model; nothing further was tried."
        agree = "agree" if answer.verdict == "no_mismatch" else "differ"
        return f"Simulation and recording {agree} ({p})."
    missed, noise = 1e3 * found.residual_rms_mm, 1e3 * found.noise_rms_mm
    alone = f"noise alone leaves {noise:.1f} µm"
    sizes = f"readings miss the fitted nominal arm by {missed:.1f} µm, {alone}"
    if answer.verdict == "no_mismatch":
        said = {warning.code for warning in answer.warnings}
        none = "No difference was found that so few poses show" * (FEW in said)
        none = "No law was found in what differs" if SCATTER in said else none
        told = f"{none or 'Simulation and recording agree'} ({p}): {sizes}."
        least = found.smallest_effect_that_would_show_mm
        if none or least is None:
            return told
        left = f"of which the nominal fit leaves {1e3 * least:.2g} µm rms"
        return f"{told} A named effect {left} would have shown."
    return f"Simulation and recording differ ({p}): {sizes}."


def _named(called: Called, proved: bool) -> str:
    shown = f": {parameters_text(called.parameters, ', ')}" if called.parameters else ""
    share = called.split_share
    of_some = isinstance(share, float) and share < 1.0  # that share is said instead
    probable = f", probability {chance(called.probability)}"
    if of_some or not proved:
        probable = "" if of_some else ", by the readings alone"
    what = "What" if proved else "Suggested, not proved"
    text = f"{what}: {called}{probable}{_of_splits(share)}{shown}."
    if called.equivalents:
        others = map(str, called.equivalents[:3])
        text += f" As well by these data: {_list(others)}."
    return text


def _names(answer: Answer, axes: int) -> Iterator[str]:
    """Yield a sentence for each name, or for each effect where there are many names."""
    if len(answer.named) < MANY:
        proved = answer.verdict != "unproved"
        yield from (_named(called, proved) for called in answer.named)
        return
    yield (
        f"What: {len(answer.named)} names. In brackets: the share of the mismatch; the "
        "shares add up to what is explained."
    )
    yield from grouped(answer, axes)
    some = [n for n in answer.named if _of_splits(n.split_share).endswith("the splits")]
    if some:
        told = [f"{n} ({n.split_share:.0%})" for n in some]
        yield f"Not given in every split of the poses: {_list(told)}."
    unsure = [n for n in answer.named if n.equivalents]
    if unsure:
        told = [
            f"{' or '.join(map(str, n.equivalents))} for {n}"
            for n in unsure[:MOST_SHOWN]
        ]
        if more := len(unsure) - len(told):
            told.append(f"{more} more")
        yield f"As well by these data: {_list(told)}."


def _still_open(answer: Answer) -> Iterator[str]:
    """Yield what stays open: several places, or one; no warning is repeated."""
    places, one = open_places(answer), answer.unexplained
    if len(places) > 1 or (places and len(answer.named) >= MANY):
        yield _open_places(places)
    elif one is not None and one.signature not in {w.text for w in answer.warnings}:
        yield _open(one)


def _open_places(places: Sequence[Open]) -> str:
    told = []
    for p in places:
        words = [percent(p.share), *filter(None, (_list(p.depends_on), p.law))]
        told.append(f"{p.where} ({'; '.join(words)})")
    return f"Something without a name is left at {_list(told)}."


def _open(left: Left) -> str:
    if left.residual_rms_mm is None:
        return f"Open: {left.signature}"
    law = "A law was learnt as a table." if left.law else "No law holds elsewhere."
    look = f" ({left.signature})" if left.signature else ""
    return f"Open: something at {left.where or 'no one place'}{look}. {law}"


def _proved(answer: Answer) -> str:
    """Return what a patch is worth on the poses kept back, by any engine."""
    proof = answer.proof
    if proof is None:
        return "Proof: nothing was seen on the poses kept back."
    values = [proof.before_rms_mm, proof.after_rms_mm, proof.noise_rms_mm]
    factor, unit, gain = _judged(proof)
    if unit == "µrad":
        values = [proof.before_rms_urad, proof.after_rms_urad, proof.noise_rms_urad]
    before, after, noise = (f"{_in_unit(v, factor)} {unit}" for v in values)
    said = (
        f"Proof: on {_poses(proof.held_out_poses, proof.folds)}, the patched simulator "
        f"misses by {after}, the nominal one, fitted likewise, by {before}"
        + (f"; noise alone leaves {noise}." if isinstance(values[2], float) else ".")
    )
    low = high = None
    if gain is not None:
        low, high = gain.low, gain.high
        said += f" Gain {_gain(gain, factor, unit)}."
    share = answer.explained_share
    if share is not None and isinstance(low, float) and low > 0.0:
        ends = [f"{v:.1%}" for v in (share.estimate, share.low, share.high)
                if isinstance(v, float)]  # fmt: skip
        said += f" Of what noise does not explain, {ends[0]} are explained"
        said += f" ({ends[1]} to {ends[2]})." if len(ends) == 3 else "."
    if turned := said_of_turns(proof):
        said += f" {turned}"
    if isinstance(high, float) and high < 0.0:
        said += " On the poses kept back the patch makes it worse."
    elif isinstance(low, float) and low <= 0.0:
        said += " The gain's interval holds zero: they do not prove it."
    return said


def _judged(proof: Proved) -> tuple[float, str, Interval | None]:
    """Return factor, unit and gain of what judges: marks, or encoders without marks."""
    if isinstance(proof.gain_mm, Interval):
        return 1e3, "µm", proof.gain_mm
    gain = proof.gain_urad
    return 1.0, "µrad", gain if isinstance(gain, Interval) else None


def _in_unit(value: object, factor: float) -> str:
    return f"{factor * value:.1f}" if isinstance(value, float) else "?"


def _poses(count: int, folds: object) -> str:
    """Return the poses that judge a patch, in words."""
    if isinstance(folds, int) and folds > 1:
        return f"all {count} poses, each kept back once from one of {folds} fits"
    return (
        "one pose that was kept back"
        if count == 1
        else (f"{count} poses that were kept back")
    )


def _unproved(finding: Result) -> str:
    """Return a sentence that says that the names are not proved, and why."""
    proof = finding.answer.proof
    factor, unit, gain = (1.0, "", None) if proof is None else _judged(proof)
    if proof is None or gain is None:
        why = finding.unproved or "nothing was seen on the poses kept back."
        return f"Not proved: what is named below was not confirmed, for {why}"
    lost = isinstance(gain.high, float) and gain.high < 0.0
    worse = "makes it worse" if lost else "does not surely help"
    return (
        f"Not proved: on {_poses(proof.held_out_poses, proof.folds)}, what is "
        f"named below {worse}: gain {_gain(gain, factor, unit)}."
    )


def _gain(gain: Interval, factor: float, unit: str) -> str:
    value, low, high = (
        _in_unit(v, factor) for v in (gain.estimate, gain.low, gain.high)
    )
    return f"{value} {unit} ({low} to {high})"


def _list(words) -> str:
    words = list(words)
    if len(words) < 2:
        return "".join(words)
    return ", ".join(words[:-1]) + " and " + words[-1]


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
    "base_compliance": ("", "gives way", "give way", "rx_rad_per_nm ry_rad_per_nm", ""),
    "gravity_load": (
        *("link", "weighs other than modelled", "weigh other than modelled"),
        *("mass_kg", ""),
    ),
    "mass_scale": ("arm", "weighs other than modelled", "", "ratio", ""),
    "gravity_compensator": (
        *("axis", "is helped by a spring", "are helped by springs"),
        *("torque_nm", ""),
    ),
    "deflection_compensation": (
        *("axis", "is held against its sag", "are held against their sag"),
        *("ratio", "of the modelled sag"),
    ),
    "transmission_error": (
        *("gear", "errs with the angle", "err with the angle"),
        *("amplitude_rad", "peak to peak"),
    ),
    "encoder_offset": (
        *("encoder", "is off by a constant", "are off by constants"),
        *("offset_rad", ""),
    ),
    "reading_lag": (
        *("axis", "is read before it rests", "are read before they rest"),
        *("lag_rad share_lag_rad", "along the last move"),
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
PLACES = {"base": "foot", "rig": "rope", "wrench_sensor": "force sensor"}
"""Words for places that are no axis or link."""


def grouped(answer: Answer, axes: int) -> Iterator[str]:
    """Yield one sentence for each effect at all its places, largest share first."""
    groups: dict[str, list[Called]] = {}
    for one in sorted(answer.named, key=lambda n: along_the_arm(n.where)):
        groups.setdefault(one.effect, []).append(one)
    shares = shares_of_names(answer)
    share_of = {
        effect: sum(shares[At(effect, one.where)] for one in together)
        for effect, together in groups.items()
    }
    order = sorted(groups, key=lambda e: -share_of[e])
    for effect in order:
        together = groups[effect]
        sizes = _magnitudes(effect, together)
        share = percent(share_of[effect])
        text = f"{_who_does(effect, together, axes)}{f': {sizes}' if sizes else ''}"
        yield f"{text} ({share})."


def _who_does(effect: str, together: Sequence[Called], axes: int) -> str:
    """Return the parts and what they do, with a capital: `All six gears harden`."""
    places = tuple(dict.fromkeys(n.where for n in together))
    part, one, several, *_ = PLAIN.get(effect, ("", "", "", "", ""))
    several = several or one
    if not one:  # no words for it: its name in the vocabulary
        return f"{effect.replace('_', ' ')} at {_list(places)}".capitalize()
    of_axes = all(place[1:].isdigit() and place[0] == "a" for place in places)
    links = [place for place in places if place.startswith("link_")]
    kind = "axes" if of_axes else "links" if len(links) == len(places) else ""
    count = len(places)
    if kind == "axes" and 2 < count == axes:
        word = COUNTS[count] if count < len(COUNTS) else str(count)
        return f"All {word} {_plural(part or 'axis')} {several}"
    if kind == "links":
        numbers = [place.removeprefix("link_") for place in places]
        word = "Link" if count == 1 else "Links"
        return f"{word} {_list(numbers)} {one if count == 1 else several}"
    if kind == "axes":
        word = part or "axis"
        if word == "axis":
            told = f"{'Axis' if count == 1 else 'Axes'} {_list(places)}"
        else:
            told = f"The {word if count == 1 else _plural(word)} of {_list(places)}"
        return f"{told} {one if count == 1 else several}"
    told = _list([_placed(place) for place in places])
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


# --- Their sizes ----------------------------------------------------------------------

SHARES = ("creep", "angle_dependent_stiffness", "pulley_friction")
"""Effects whose ratio is a share, told in percent."""
PEAK_TO_PEAK = {("angle_dependent_stiffness", "ratio"): 2.0}
"""Factor to a wave's peak-to-peak value, where its name alone does not tell."""


def _magnitudes(effect: str, together: Sequence[Called]) -> str:
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
    # of several names their estimates; of one all its intervals, from end to end
    some = [[(at[k], p) for _, p, at in known] for k in (0, 1, 2)]
    low, high = some[1:] if len(together) == 1 else (some[0], some[0])
    ends = min(low, key=lambda x: x[0]), max(high, key=lambda x: x[0])
    told = [rounded(p, factor, value) for value, p in ends]
    told = [x.removesuffix(".0") for x in told]
    text = told[0] if told[0] == told[1] else f"{told[0]} to {told[1]}"
    return " ".join(filter(None, (text, unit, word)))


def _numbers(interval: Interval) -> tuple[float, float, float] | None:
    """Return estimate, low and high; None where the data do not hold all three."""
    value, low, high = interval.estimate, interval.low, interval.high
    if not (isinstance(value, float) and isinstance(low, float)):
        return None
    return (value, low, high) if isinstance(high, float) else None


# --- The narrative in five lines ------------------------------------------------------

MOST_SHOWN = 3
"""Names of which alternatives are told."""


def narrative(answer: Answer) -> Iterator[str]:
    """Yield verdict, mismatch, places, names with proof, and what stays open.

    Many names are told by effect, as `sentences` does.
    """
    verdict = answer.verdict.replace("_", " ")
    yield f"Diagnosis of {answer.recording!r}: {verdict}."
    yield _detected(answer)
    if answer.located:
        yield _where(answer.located)
    yield from _names(answer, 0)
    if answer.proof is not None:
        yield _proved(answer)
    told = list(_still_open(answer))
    yield from told
    if not told and answer.warnings and not answer.named:
        yield f"Note ({answer.warnings[0].where}): {answer.warnings[0].text}"


# --- The terminal ---------------------------------------------------------------------

SIZES = (
    "sizes in patch.json and model.xml were fitted once more in the simulator, beside "
    "each other, and may differ a little from these estimates and intervals."
)
"""What the patch of a proved diagnosis holds."""


def sizes_text(finding: Result, proof: Proof) -> str:
    """Return what a proved patch holds, and which of its sizes moved far."""
    own = list(proof.simulation.order) == list(range(len(proof.simulation.order)))
    first = proof.patch.effects[::-1] if own else ()  # else of axes of other names
    sizes = {(e.effect, e.where): e.parameters for e in first}
    told = sizes_far_off(finding.answer.named, sizes)
    if not told:
        return SIZES
    more = [f"{len(told) - MOST_SHOWN} more"] * (len(told) > MOST_SHOWN)
    far = _list([*told[:MOST_SHOWN], *more])
    return f"{SIZES} Far from what is said beside all that has no name: {far}."


def tell(console: Console, finding: Result, notes: tuple[str, ...], out: Path) -> None:
    """Print the sentences, the table of named effects, and the report's path."""
    for sentence in sentences(finding):
        console.print(sentence, markup=False, highlight=False)
    told = finding.answer
    if told.named:
        table = Table(title="Named", title_justify="left")
        columns = ["effect", "where", "probability", "parameters"]
        if any(n.equivalents for n in told.named):
            columns.append("would do as well")
        for column in columns:
            table.add_column(column)
        for n in told.named:
            others = ", ".join(f"{e.effect}@{e.where}" for e in n.equivalents[:3])
            known = chance(n.probability), parameters_text(n.parameters, "\n"), others
            cells = (n.effect, n.where, *known)
            table.add_row(*map(escape, cells[: len(columns)]))
        console.print(table)
    if finding.proof is not None:
        notes = (*notes, sizes_text(finding, finding.proof))
    for note in notes:
        console.print(f"Note: {note}", markup=False, highlight=False)
    console.print(f"{out / 'report.html'}", markup=False, highlight=False)
