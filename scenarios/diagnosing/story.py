"""A finding is told in plain sentences: is something there, where, what, proved?"""

from collections.abc import Iterator

from bench.proof import Proof
from scenarios.diagnosing import springs
from scenarios.diagnosing.finding import MICRO, Finding, channel_of
from scenarios.diagnosing.schema import Called
from scenarios.diagnosing.units import chance, label, span
from stiffness.diagnosis.remarks import SCATTER


def sentences(finding: Finding) -> Iterator[str]:
    """Tell a finding, one sentence after the other."""
    d, a = finding.diagnosis, finding.answer
    for warning in a.warnings:
        yield f"Note ({warning.where}): {warning.text}"
    yield _detected(finding)
    if d.nominal is not None and (told := springs.sentence(d.nominal)):
        yield told
    if a.verdict == "no_mismatch":
        return
    if a.located:
        first = a.located[0]
        on = f", and depends on {_list(first.depends_on)}" if first.depends_on else ""
        zone = f", strongest at {first.zone}" if first.zone else ""
        if first.zone == "everywhere":
            zone = ", everywhere alike"
        rest = [x.where for x in a.located[1:]]
        also = f" Also: {_list(rest)}." if rest else ""
        yield (
            f"Where: {first.where} ({first.share:.0%} of what differs){on}{zone}.{also}"
        )
    for called in a.named:
        yield _named(called)
    if not a.named:
        yield "What: no name of the list explains it; none is given."
    if a.unexplained is not None:
        yield _open(finding)
    if a.confounded:
        pairs = [f"{x.effect} at {x.where} with {y.effect} at {y.where}"
                 for x, y in a.confounded[:3]]  # fmt: skip
        yield f"These data hardly tell apart: {_list(pairs)}."
    if finding.proof is not None:
        yield from _proved(finding.proof)
    elif d.verdict != "no_mismatch" and finding.unproved:
        yield f"Nothing was proved: {finding.unproved}"
    for step in a.next_experiments[:1]:
        path = " ".join(f"{x:g}" for x in step.load_path_kg)
        pose = " ".join(f"{x:.0f}" for x in step.pose_deg)
        yield f"Next: pose [{pose}]°, load {path} kg; it {step.why}."


def _detected(finding: Finding) -> str:
    found = finding.answer.detection
    p = f"p = {found.p_value:.2g}"
    if found.residual_rms_mm is None or found.noise_rms_mm is None:
        return "The set-up does not fit the model; nothing further was tried."
    missed, noise = 1e3 * found.residual_rms_mm, 1e3 * found.noise_rms_mm
    sizes = (
        f"readings miss the fitted nominal arm by {missed:.1f} µm, noise alone leaves "
        f"{noise:.1f} µm"
    )
    if finding.answer.verdict == "no_mismatch":
        if any(warning.code == SCATTER for warning in finding.answer.warnings):
            return f"No law was found in what differs ({p}): {sizes}."
        least = found.smallest_effect_that_would_show_mm
        shown = "" if least is None else (
            " A named effect of which the nominal fit leaves "
            f"{1e3 * least:.2g} µm rms would have shown."
        )  # fmt: skip
        return f"Simulation and recording agree ({p}): {sizes}.{shown}"
    return f"Simulation and recording differ ({p}): {sizes}."


def _named(called: Called) -> str:
    sizes = [f"{label(n)} {span(n, p)}" for n, p in called.parameters.items()]
    shown = f": {', '.join(sizes)}" if sizes else ""
    text = (
        f"What: {called.effect} at {called.where}, probability "
        f"{chance(called.probability)}{shown}."
    )
    if called.equivalents:
        others = [f"{e.effect} at {e.where}" for e in called.equivalents[:3]]
        text += f" As well by these data: {_list(others)}."
    return text


def _open(finding: Finding) -> str:
    left = finding.answer.unexplained
    assert left is not None
    if left.residual_rms_mm is None:
        return f"Open: {left.signature}"
    law = "A law was learnt as a table." if left.law else "No law holds elsewhere."
    look = f" ({left.signature})" if left.signature else ""
    return f"Open: something at {left.where or 'no one place'}{look}. {law}"


def _proved(proof: Proof) -> Iterator[str]:
    channel, unit = channel_of(proof)
    if channel is None:
        return
    before, after, noise, gain, low, high = (
        MICRO * x
        for x in (
            channel.before,
            channel.after,
            channel.noise,
            channel.gain,
            channel.low,
            channel.high,
        )
    )
    yield (
        f"Proof: on {len(proof.held_out)} poses that were kept back, the patched "
        f"simulator misses by {after:.1f} {unit} instead of {before:.1f} {unit}; "
        f"stated noise alone leaves {noise:.1f} {unit}. Gain {gain:.1f} {unit} "
        f"({low:.1f} to {high:.1f})."
    )
    if high < 0.0:
        yield "On the poses kept back the patch makes it worse."
    elif low <= 0.0:
        yield "The gain's interval holds zero: the poses kept back do not prove it."


def _list(words) -> str:
    words = list(words)
    if len(words) < 2:
        return "".join(words)
    return ", ".join(words[:-1]) + " and " + words[-1]
