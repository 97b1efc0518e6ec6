"""A calibration is put into the fixed form of diagnosis.json.

==========  ==========================================================================
Equation    probability of a name = Phi(z), z = its loss when taken out over the loss'
            standard error over regions left out; share = its loss over all losses
Source      paired differences over clusters, taken as normal
Valid       ten regions or more
Ignores     that losses of confounded names overlap
==========  ==========================================================================
"""

import numpy as np
from scipy.stats import norm

from scenarios.calibrating.proof import Proof, rms
from scenarios.calibrating.remains import ALPHA, Remains
from scenarios.diagnosing.schema import (
    Answer,
    At,
    Called,
    Detected,
    Interval,
    Left,
    Placed,
    Proved,
)
from scenarios.diagnosing.verdict import Findings, verdict_of
from stiffness.calibration.blocks import Key
from stiffness.calibration.calibrated import Calibrated

MM = 1e3
DEPENDS = {
    "joint_compliance": ("torque",),
    "bearing_tilt": ("torque",),
    "transmission_error": ("angle",),
    "hysteresis": ("direction", "history"),
    "drift": ("time",),
}
LIKE = {"hysteresis": "lost_motion"}
"""What looks the same in an arm that only stands: the side it came from."""


def answer_of(
    name: str,
    found: Calibrated,
    proof: Proof,
    remains: Remains,
    seconds: float,
    rejected: float = 1.0,
) -> Answer:
    """Put everything together.

    Args:
        name: Of the recording.
        found: The calibration.
        proof: What the simulator says of it.
        remains: What is left.
        seconds: That it took.
        rejected: p-value of the nominal arm, where another test has looked at it.
    """
    first, last = found.at_first, found.at_last
    p_value = min(1.0, rejected, 2.0 * min(first.p_value, proof.p_value))
    something = p_value < ALPHA or proof.gain[1] > 0.0
    names = found.named if proof.gain[1] > 0.0 else ()
    low, high = MM * proof.gain[1], MM * proof.gain[2]
    entry = Proved(
        simulator="mujoco",
        held_out_poses=proof.poses,
        before_rms_mm=MM * rms(proof.before),
        after_rms_mm=MM * rms(proof.after),
        noise_rms_mm=MM * last.noise,
        gain_mm=Interval(MM * proof.gain[0], low, high),
    )
    share = proof.explained
    explained = share and Interval(share.estimate, share.low, share.high)
    passes = remains.p_value >= ALPHA
    verdict = verdict_of(
        Findings(something, bool(names), passes, True, entry, explained)
    )
    left = None
    if verdict in ("partly_explained", "unexplained"):
        left = Left(remains.where, remains.signature, {}, MM * rms(proof.after))
    return Answer(
        schema=1,
        recording=name,
        verdict=verdict,
        detection=Detected(
            p_value, MM * first.rms, MM * last.noise, MM * last.smallest
        ),
        located=_located(found, names),
        explained_share=explained,
        named=tuple(_called(found, key) for key in names),
        rivals=(),
        unexplained=left,
        confounded=tuple(
            (At(e.effect, e.where), other)
            for e in map(_called, [found] * len(names), names)
            for other in e.equivalents
        ),
        warnings=(),
        proof_requested=True,
        proof=entry,
        next_experiments=(),
        seconds=round(seconds, 1),
    )


def _located(found: Calibrated, names: tuple[Key, ...]) -> tuple[Placed, ...]:
    budget = found.selected.budget
    total = sum(max(loss, 0.0) for loss, _ in budget.values())
    places: dict[str, list[Key]] = {}
    for key in names:
        places.setdefault(key[1], []).append(key)
    placed = []
    for where, own in places.items():
        share = sum(budget[k][0] for k in own) / max(total, 1e-30)
        p = min(float(norm.sf(budget[k][0] / budget[k][1])) for k in own)
        depends = dict.fromkeys(d for k in own for d in DEPENDS.get(k[0], ()))
        placed.append(Placed(where, p, float(share), tuple(depends), _zone(found, own)))
    return tuple(sorted(placed, key=lambda p: -p.share))


def _zone(found: Calibrated, own: list[Key]) -> str:
    where = own[0][1]
    if not (where[:1] == "a" and where[1:].isdigit()):
        return "everywhere"
    k = int(where[1:]) - 1
    angle = np.degrees(found.readings.posture[:, k])
    low, high = np.quantile(angle, [0.01, 0.99])
    if where in found.tables:
        grid = np.radians(np.linspace(low, high, 721))
        worst = np.degrees(grid[np.argmax(np.abs(found.tables[where].at(grid)))])
        return f"from {low:.0f}° to {high:.0f}°, most at {worst:.0f}°"
    return f"from {low:.0f}° to {high:.0f}°"


def _called(found: Calibrated, key: Key) -> Called:
    loss, error = found.selected.budget[key]
    effect, where = key
    parameters = {
        name: Interval(e.value, e.low, e.high)
        for name, e in found.estimates.get(key, {}).items()
    }
    if effect == "transmission_error":
        wave = found.waves[where]
        size, half = wave.size, wave.half
        turn = half / size if size > half else None  # else any phase does
        n, q = float(wave.order), wave.phase
        parameters["amplitude_rad"] = Interval(size, max(size - half, 0.0), size + half)
        parameters["order"] = Interval(n, n, n)
        parameters["phase_rad"] = (
            Interval(q, None, None) if turn is None else Interval(q, q - turn, q + turn)
        )
    equivalents = [At(*other) for other in found.selected.alike.get(key, ())]
    if effect in LIKE:
        equivalents.append(At(LIKE[effect], where))
    elif effect == "drift":
        equivalents.append(At("drift", "tracker"))
    elif effect == "encoder_offset":
        carrier = found.readings.arm.chain.parent[int(where[1:]) - 1]
        if carrier >= 0:
            equivalents.append(At("geometry_error", f"link_{carrier + 1}"))
    sure = float(np.clip(norm.cdf(loss / error), 0.0, 0.9999))
    return Called(effect, where, sure, tuple(dict.fromkeys(equivalents)), parameters)
