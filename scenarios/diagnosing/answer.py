"""A diagnosis and its proof are put into the fixed form of diagnosis.json."""

import math
from collections.abc import Sequence

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
from stiffness.diagnosis.diagnosis import Diagnosis, Name, NamedEffect

MM, URAD = 1e3, 1e6
USUAL_M, HEAVIEST_KG = 0.1, 100.0
"""How far from its body's origin an added mass sits usually, and how heavy it is at
most; chosen: wider than any arm's."""


def answer_of(
    diagnosis: Diagnosis,
    proof: Proof | None,
    experiments: Sequence[Next],
    seconds: float,
) -> Answer:
    """Put a diagnosis and its proof into the fixed form."""
    d, open_ = diagnosis, diagnosis.unexplained
    found = d.detection
    return Answer(
        schema=1,
        recording=d.recording,
        verdict=d.verdict,
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
        warnings=tuple(Remark(w.code, w.where, w.text) for w in d.warnings),
        proof=proved(proof),
        next_experiments=tuple(experiments),
        seconds=round(float(seconds), 3),
    )


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
