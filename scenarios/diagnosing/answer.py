"""A diagnosis and its proof are put into the fixed form of diagnosis.json."""

import math
from collections.abc import Iterator, Sequence

import msgspec
import numpy as np

from bench.proof import Proof
from bench.proving.channels import Channel
from scenarios.diagnosing.schema import (
    Answer,
    At,
    Called,
    Detected,
    Interval,
    Left,
    Next,
    Number,
    Other,
    Placed,
    Proved,
    Remark,
)
from scenarios.diagnosing.verdict import DISAGREES, Findings, verdict_of
from stiffness.diagnosis.diagnosis import Diagnosis, Name, NamedEffect, Warned

MM, URAD, MICRO = 1e3, 1e6, 1e6
USUAL_M, HEAVIEST_KG = 0.1, 100.0
"""How far from its body's origin an added mass sits usually, and how heavy it is at
most; chosen: wider than any arm's."""


def answer_of(
    diagnosis: Diagnosis,
    simulated: Proof | None,
    unproved: str,
    experiments: Sequence[Next],
    seconds: float,
    proof_requested: bool = True,
) -> Answer:
    """Put a diagnosis and its proof into the fixed form.

    Args:
        diagnosis: What the readings say.
        simulated: Nominal and patched arm in the simulator; None where it could not.
        unproved: Why nothing was proved; empty where something was.
        experiments: What to measure next.
        seconds: That it took.
        proof_requested: Whether a proof was asked for.
    """
    d, open_ = diagnosis, diagnosis.unexplained
    found = d.detection
    proof = None if unproved else simulated
    entry, share = proved(proof), explained_share_of(proof)
    remarks = (*d.warnings, *disagreements(d, simulated))
    return Answer(
        schema=1,
        recording=d.recording,
        verdict=verdict_of(
            Findings(
                differs=d.verdict != "no_mismatch",
                named=bool(d.named),
                residual_passes=d.verdict == "explained",
                proof_requested=proof_requested,
                proof=entry,
                explained_share=share,
            )
        ),
        detection=Detected(
            float(found.p_value),
            number(found.residual_rms, MM),
            number(found.noise_rms, MM),
            number(found.smallest_effect, MM),
        ),
        located=tuple(
            Placed(x.where, x.p_value, x.share, tuple(x.depends_on), x.zone)
            for x in d.located
        ),
        explained_share=share,
        named=tuple(map(_called, d.named)),
        rivals=tuple(
            Other(float(r.probability), tuple(map(_at, r.effects))) for r in d.rivals
        ),
        unexplained=None
        if open_ is None
        else Left(
            open_.where,
            open_.signature,
            {k: tuple(map(float, v)) for k, v in open_.law.items()},
            number(_rest(proof, found.residual_rms), MM),
        ),
        confounded=tuple((_at(a), _at(b)) for a, b in d.confounded),
        warnings=tuple(Remark(w.code, w.where, w.text) for w in remarks),
        proof_requested=proof_requested,
        proof=entry,
        next_experiments=tuple(experiments),
        seconds=round(float(seconds), 3),
    )


def disagreements(diagnosis: Diagnosis, simulated: Proof | None) -> Iterator[Warned]:
    """Say where the simulator's nominal arm is not the one that was fitted."""
    if simulated is None or simulated.markers is None:
        return
    found = diagnosis.detection
    fitted = found.held_out_rms if simulated.absolute else found.held_out_within_rms
    before = simulated.markers.before
    if before > DISAGREES * fitted:
        yield Warned(
            "simulator_disagrees",
            "arm",
            f"on the poses kept back the simulator's nominal arm misses by "
            f"{MICRO * before:.1f} µm, the arm that was fitted to the readings by "
            f"{MICRO * fitted:.1f} µm. They are not the same arm: look at frames, tool "
            "and springs of the model, and do not rely on the proof or on model.xml.",
        )


def explained_share_of(proof: Proof | None) -> Interval | None:
    """Return the share that the proof's first channel explains, as it is written."""
    channel = None if proof is None else proof.markers or proof.angles
    share = None if channel is None else channel.explained
    return None if share is None else Interval(share.estimate, share.low, share.high)


def text_of(answer: Answer) -> str:
    """Return diagnosis.json."""
    return msgspec.json.format(msgspec.json.encode(answer), indent=2).decode() + "\n"


def proved(proof: Proof | None) -> Proved | None:
    """Return the proof's entry; None where nothing was proved."""
    if proof is None or (proof.markers is None and proof.angles is None):
        return None
    entry: dict[str, object] = {}
    channels = ((proof.markers, MM, "mm"), (proof.angles, URAD, "urad"))
    for channel, unit, name in channels:
        if channel is not None:
            entry |= _of_channel(channel, unit, name)
    return msgspec.convert(
        {"simulator": "mujoco", "held_out_poses": len(proof.held_out), **entry}, Proved
    )


def number(value: float, unit: float = 1.0) -> Number:
    """Return a finite number in a unit, or None."""
    return float(value) * unit if math.isfinite(value) else None


def _rest(proof: Proof | None, nominal: float) -> float:
    """Return what the best arm that there is leaves of the readings, in m."""
    return nominal if proof is None or proof.markers is None else proof.markers.after


def _of_channel(c: Channel, unit: float, name: str) -> dict[str, object]:
    gain = {"estimate": c.gain * unit, "low": c.low * unit, "high": c.high * unit}
    return {
        f"before_rms_{name}": c.before * unit,
        f"after_rms_{name}": c.after * unit,
        f"noise_rms_{name}": c.noise * unit,
        f"gain_{name}": gain,
    }


def _called(named: NamedEffect) -> Called:
    parameters = {
        name: Interval(number(p.estimate), number(p.low), number(p.high))
        for name, p in named.parameters.items()
    }
    if "with" in parameters:  # a number of an axis, but a name in the vocabulary
        partner = f"a{round(named.parameters['with'].estimate)}"
        parameters["with"] = Interval(partner, partner, partner)
    words = {k: v for k, v in named.settings.items() if isinstance(v, str)}
    parameters |= {k: Interval(v, v, v) for k, v in words.items()}
    if named.name.effect == "gravity_load":
        parameters = _with_mass(parameters)
    return Called(
        named.name.effect,
        named.name.where,
        float(np.clip(named.probability, 0.0, 1.0)),
        tuple(map(_at, named.equivalents)),
        parameters,
    )


def _with_mass(parameters: dict[str, Interval]) -> dict[str, Interval]:
    """Add mass and centre to first moments that show no mass: one of many pairs.

    A turn about a level axis feels mass x distance alone. The pair given has its centre
    at a usual distance, or as far as the heaviest mass asks for; neither has ends, for
    the data do not hold them, and the moments, which are known, stay beside them.
    """
    moment = {
        name: p.estimate
        for name, p in parameters.items()
        if name.startswith("moment_") and isinstance(p.estimate, float)
    }
    size = math.hypot(*moment.values())
    if "mass_kg" in parameters or not size:
        return parameters
    mass = min(size / USUAL_M, HEAVIEST_KG)
    found = {"mass_kg": Interval(mass, None, None)}
    for name, value in moment.items():
        centre = name.replace("moment", "com").replace("_kg_m", "_m")
        found[centre] = Interval(value / mass, None, None)
    return parameters | found


def _at(name: Name) -> At:
    return At(name.effect, name.where)
