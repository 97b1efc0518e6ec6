"""Where an arm differs: what is named has a place, and the map finds the others.

==========  ==========================================================================
Equation    place by place: the place of the map that captures most is taken, its
            columns count as known, the rest is tested again, until nothing speaks
Source      forward selection with a max-T test by sign flips at each step (Holm-like:
            the family shrinks by what was found)
Valid       markers on every body; with a flange target alone a place is an inference
Ignores     places without columns in the map (force sensor, markers): these are named
==========  ==========================================================================
"""

from collections.abc import Mapping

import numpy as np

from stiffness.diagnosis.detect import ALARM
from stiffness.diagnosis.diagnosis import Located
from stiffness.diagnosis.evidence import Evidence
from stiffness.diagnosis.flips import sign_flips, white_scores
from stiffness.diagnosis.library import Library
from stiffness.diagnosis.member import Member, SetFit
from stiffness.diagnosis.situation import Situation

FAINT = 1e-3
"""Share of the largest torque on any axis below which there is none; chosen."""
MOST = 4
"""Places that are looked for at most; chosen: more is no finding but a bad model."""

DEPENDS: Mapping[str, tuple[str, ...]] = {
    "joint_compliance": ("torque",),
    "hardening": ("torque",),
    "asymmetric_stiffness": ("torque", "direction"),
    "lost_motion": ("torque",),
    "hysteresis": ("torque", "history"),
    "creep": ("torque", "time"),
    "angle_dependent_stiffness": ("torque", "angle"),
    "transmission_error": ("angle",),
    "bearing_tilt": ("load",),
    "wrist_coupling": ("torque",),
    "encoder_offset": (),
    "link_bending": ("load",),
    "gravity_load": ("load", "angle"),
    "gravity_compensator": ("angle",),
    "geometry_error": ("angle",),
    "base_compliance": ("load",),
    "wrench_bias": ("load",),
    "wrench_gain": ("load",),
    "wrench_misalignment": ("load", "direction"),
    "pulley_friction": ("load", "direction"),
    "drift": ("time",),
    "marker_slip": ("time",),
    "channel_delay": ("time",),
}
"""On what each effect depends, by its equation."""
WORDS = {"geometry": "angle"}


def places_of_map(
    library: Library,
    evidence: Evidence,
    score: np.ndarray,
    known: np.ndarray,
    seed: int,
) -> list[tuple[str, float, float, tuple[str, ...]]]:
    """Return places that speak, strongest first: where, p, captured, depends on."""
    gram = evidence.gram.sum(axis=0)
    names = tuple(dict.fromkeys(m.where for m in library.map))
    columns = {
        n: np.concatenate([m.columns for m in library.map if m.where == n])
        for n in names
    }
    found: list[tuple[str, float, float, tuple[str, ...]]] = []
    left = list(names)
    for _ in range(MOST):
        white = white_scores(
            gram, score, known, [columns[n] for n in left], evidence.raw
        )
        tested = sign_flips(white, seed)
        best = int(np.argmax(tested.z))
        if tested.together[best] >= ALARM:
            break
        where = left.pop(best)
        parts = [m for m in library.map if m.where == where]
        of_parts = sign_flips(
            white_scores(gram, score, known, [m.columns for m in parts], evidence.raw),
            seed,
        )
        strong = of_parts.captured > 0.5 * of_parts.captured.max()
        words = [WORDS.get(m.depends_on, m.depends_on) for m in parts]
        words = tuple(dict.fromkeys(w for w, s in zip(words, strong, strict=True) if s))
        p, captured = float(tested.together[best]), float(tested.captured[best])
        found.append((where, p, captured, words))
        known = np.concatenate([known, columns[where]])
    return found


def places_of_names(
    fit: SetFit, alone: list[float], p_value: float, situation: Situation
) -> tuple[Located, ...]:
    """Return where the named effects sit, strongest first.

    Args:
        fit: The set.
        alone: What each member explains that the others do not.
        p_value: Of the mismatch.
        situation: For the zone in words.
    """
    total = max(sum(alone), 1e-12)
    order = np.argsort(alone)[::-1]
    joined: dict[str, Located] = {}
    for k in order:
        member = fit.members[k]
        if member.where in joined:
            old = joined[member.where]
            joined[member.where] = Located(
                old.where,
                old.p_value,
                old.share + alone[k] / total,
                tuple(
                    dict.fromkeys((*old.depends_on, *DEPENDS.get(member.name[0], ())))
                ),
                old.zone,
            )
            continue
        joined[member.where] = Located(
            member.where,
            p_value,
            alone[k] / total,
            DEPENDS.get(member.name[0], ()),
            zone_of(situation, member),
        )
    return tuple(joined.values())


def zone_of(situation: Situation, member: Member) -> str:
    """Say in words where an axis' effect is largest."""
    if member.where not in situation.axes:
        return ""
    parts = member.signature(situation).parts
    if not parts or not hasattr(parts[0], "law"):
        return ""
    k = situation.axis(member.where)
    law = np.abs(parts[0].law).sum(axis=1)  # type: ignore[union-attr]
    if np.ptp(law) < 1e-9 * max(law.max(), 1e-300):
        return "everywhere"
    strong = law >= 0.7 * law.max()
    torque = situation.torque[strong, k]
    stages, count = np.unique(situation.recording.stage[strong], return_counts=True)
    words = []
    stage = situation.recording.stage
    if count.max() > 0.6 * count.sum() and np.any(stage != stage[0]):
        words.append(str(stages[np.argmax(count)]))
    low, high = np.quantile(torque, [0.05, 0.95])
    least = FAINT * max(float(np.abs(situation.torque).max()), 1e-9)
    if max(abs(low), abs(high)) > least:
        words.append(f"torque {low:.3g} to {high:.3g} N m")
    return ", ".join(words)
