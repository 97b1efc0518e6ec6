"""Translates what was found into a patch: effects, springs and laws of the simulator.

A hypothesis and a mechanism write the same physics in different forms. Where a name's
shape bends the form, it becomes the mechanism's own setting as a first guess, which the
simulator then refines:

- hysteresis: stops of three even slips up to r = slip_nm, w wide together, rise by 3/2r
  at first and have, as springs that slip beside one of stiffness K, (1 + stiffening) =
  1 / (1 - 3 w K / 4r);
- lost motion: the play closes at the same torque.

What was named between encoders goes into a patch but for delays. A patch keeps where
each axis stood and what it carried in the poses that it was fitted to, so that it can
be judged on another recording.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, get_args

import numpy as np
from jaxtyping import Float

from bench.effects import EFFECTS
from bench.effects.effect import UNBOUNDED
from bench.mechanisms import offsets_of
from bench.patch import (
    FILE,
    MODEL_FILE,
    AxisRange,
    GearMemory,
    Law,
    Patch,
    PatchEffect,
    Value,
    WrittenRig,
    can_build,
    effect_of,
    named,
    rig_of,
    text_of,
    with_arm,
)
from bench.patched_model import patched_model
from bench.proof.refinement import Place
from bench.proof.setup import for_simulator
from bench.rig import RIGID, Memory, Rig
from bench.shared.effect_catalogue import CATALOGUE
from bench.shared.recording import Recording
from bench.user_model import ASSETS
from scenarios.pipelines.recording_check import static_torque
from stiffness.diagnosis.result import (
    Diagnosis,
    Interval,
    NamedEffect,
    Nominal,
    Warned,
)
from stiffness.effects import HYPOTHESES
from stiffness.effects.angle_dependent_stiffness import MOST_UNEVEN
from stiffness.experiment.visits import BEFORE, UNKNOWN
from stiffness.regression.splits import COUNTED
from stiffness.robot.arm import Arm

if TYPE_CHECKING:
    from bench.proof.proof import Proof
    from scenarios.pipelines.encoder_axes import Axis
    from stiffness.calibration.final_fit import Table
    from stiffness.calibration.result import Calibrated

# --- Where a patch was fitted ---------------------------------------------------------

NEAR = np.radians(1.0)
"""An angle further than this from every fitted one is new to a patch, in rad (m on a
slide); chosen: a quarter of the shortest wave that matters."""


def ranges_of(
    posture: Float[np.ndarray, "rows axes"], torque: Float[np.ndarray, "rows axes"]
) -> dict[str, AxisRange]:
    """Return each axis' range: stretches of angles with nothing new between them.

    Of the rows that were fitted, postures are in rad (m on a slide); torques, in N m
    (N), are those of weight and load about each axis.
    """
    found = {}
    for k, (angle, load) in enumerate(zip(posture.T, torque.T, strict=True)):
        known = np.unique(angle)
        parts = np.split(known, np.flatnonzero(np.diff(known) > 2.0 * NEAR) + 1)
        stretches = tuple((float(p[0]), float(p[-1])) for p in parts)
        span = (float(load.min()), float(load.max()))
        found[f"a{k + 1}"] = AxisRange(stretches, span)
    return found


DIGESTS = 24
"""Rows of which a patch keeps a digest; chosen: some may be missing."""


def digests_of(recording: Recording, most: int | None = DIGESTS) -> tuple[str, ...]:
    """Return digests of rows with a target that was seen, so many evenly taken.

    Relative readings begin each visit at zero, in any recording of the same poses: such
    rows tell nothing.
    """
    points = recording.points
    if points is None:
        return ()
    rows = np.flatnonzero(np.nan_to_num(points).any(axis=(1, 2)))
    if most is not None:
        rows = rows[:: max(-(-len(rows) // most), 1)]
    every = zip(recording.posture[rows], points[rows], strict=True)
    return tuple(_digest(posture, seen) for posture, seen in every)


def _digest(posture: np.ndarray, points: np.ndarray) -> str:
    """Return the digest of a row's angles and of its first target that was seen."""
    first = points[np.isfinite(points).all(axis=-1)][:1]
    read = np.concatenate([posture, first.ravel()])
    return sha256(np.rint(read / COUNTED).astype("<i8").tobytes()).hexdigest()[:16]


# --- From a diagnosis -----------------------------------------------------------------

SOFTEST, STIFFEST = 0.05, 10.0
"""Bounds of a stiffening's first guess; chosen."""
LAWS = {law.effect: law for law in HYPOTHESES}


def patch_of_diagnosis(diagnosis: Diagnosis, recording: Recording, arm: Arm) -> Patch:
    """Return what a diagnosis puts into the simulator, to be refined there.

    Args:
        diagnosis: What was named, and the nuisance parameters.
        recording: Whose marks were fitted.
        arm: The nominal arm.
    """
    nominal = fitted_springs(diagnosis, None)
    if nominal is None:
        return Patch()
    springs = {
        f"a{k}": _start_of_spring(*map(float, one))
        for k, one in enumerate(
            zip(nominal.compliance, nominal.sigma, nominal.modelled, strict=True), 1
        )
    }
    memory, memories = memory_of(diagnosis.named)
    frame = np.asarray(nominal.base_from_tracker, float)
    fitted = ~np.isin(recording.posture_id, diagnosis.held_out)
    if recording.points is not None:
        fitted &= np.isfinite(recording.points).any(axis=(1, 2))
    seen = recording.take(fitted)
    return Patch(
        stiffness_nm_per_rad=springs,
        effects=tuple(
            entry
            for effect in diagnosis.named
            if can_build(effect.name.effect)
            for entry in (
                patch_entry(effect, springs),
                *(
                    PatchEffect(effect.name.effect, effect.name.where, dict(part))
                    for part in _further(effect)
                ),
            )
        ),
        laws=laws_of(diagnosis),
        base_from_tracker=tuple((r[0], r[1], r[2], r[3]) for r in frame.tolist()),
        markers={
            marker.name: (float(x), float(y), float(z))
            for marker, (x, y, z) in zip(recording.markers, nominal.places, strict=True)
        },
        fitted=ranges_of(seen.posture, static_torque(seen, arm.at(seen.posture))),
        memory=memory,
        memories=memories,
        readings=digests_of(recording),
    )


LEAST = 0.1
"""Compliance over the model's below which an estimate is none; chosen: a decade."""


def _start_of_spring(compliance: float, sigma: float, modelled: float) -> float | None:
    """Return the stiffness that the simulator starts from; None: the axis is rigid.

    The model's own, where what is fitted is no compliance, or next to none and not
    sure: laws beside it may turn the axis alike.
    """
    none = compliance < LEAST * modelled and compliance < 2.0 * sigma
    start = modelled if compliance <= 0.0 or none else compliance
    return 1.0 / start if start > 0.0 else None


KINDS: Mapping[int, GearMemory] = {BEFORE: "carried", UNKNOWN: "unknown"}
"""What a law takes for known at arrival, as a patch has it; all else is forgotten."""


def memory_of(named: Sequence[NamedEffect]) -> tuple[Memory, dict[str, GearMemory]]:
    """Return what most gears keep of the visit before, and those that do otherwise.

    Of each gear as most of what it does says: a faint name does not decide. A name
    alone has no share.
    """
    votes: dict[str, dict[GearMemory, float]] = defaultdict(lambda: defaultdict(float))
    for effect in named:
        if effect.name.effect in ("hysteresis", "creep") and len(effect.shape) > 1:
            share = 1.0 if effect.share is None else max(effect.share, 0.0)
            kind = KINDS.get([*map(round, effect.shape)][1], "forgotten")
            votes[effect.name.where][kind] += share
    of_all = {
        kind: sum(own.get(kind, 0.0) for own in votes.values())
        for kind in get_args(Memory)
    }
    memory: Memory = max(of_all, key=of_all.__getitem__)
    every: dict[str, GearMemory] = {
        axis: max(own, key=own.__getitem__) for axis, own in votes.items()
    }
    return memory, {axis: kind for axis, kind in every.items() if kind != memory}


def springs_of_mechanisms(
    springs: dict[str, float | None], named: Sequence[NamedEffect]
) -> dict[str, float | None]:
    """Return the stiffness from which mechanisms start where laws have another base.

    A law adds to one compliance C of its axis; the mechanism changes one stiffness K:

    - hardening: C is 1/K3, at large torques, and K is K1, at small ones;
    - asymmetric stiffness: C is the mean of both ways, and K is the softer one;
    - angle-dependent stiffness: C is the mean of 1/K(q), and K is the mean of K(q).
    """
    found = dict(springs)
    for effect in named:
        own, where = effect.parameters, effect.name.where
        stiffness = found.get(where)
        if stiffness is None:
            continue
        if effect.name.effect == "hardening":
            stiffness /= float(np.clip(own["stiffness_ratio"].estimate, 1.0, STIFFEST))
        elif effect.name.effect == "asymmetric_stiffness":
            ratio = max(own["ratio"].estimate, 1.0 / STIFFEST)
            stiffness *= (1.0 + min(ratio, 1.0 / ratio)) / 2.0
        elif effect.name.effect == "angle_dependent_stiffness":
            others = [part["ratio"] for part in _further(effect)]
            for size in (own["ratio"].estimate, *others):
                ratio = float(np.clip(size, 0.0, MOST_UNEVEN))
                stiffness /= math.sqrt(1.0 - ratio**2)
        found[where] = stiffness
    return found


def fitted_springs(diagnosis: Diagnosis, proof: Proof | None) -> Nominal | None:
    """Return the nuisance parameters, the springs as the patch's mechanisms have them.

    With a proof they are those of the patched arm, with errors beside all of the patch.
    """
    nominal = diagnosis.nominal
    if nominal is None:
        return None
    if proof is not None and proof.spring_errors is not None:
        own = proof.simulation.order  # axes of the recording
        stiffness = proof.patched.rig.springs[own]
        compliance = np.where(stiffness < RIGID, 1.0 / stiffness, 0.0)
        sigma = compliance * proof.spring_errors[own]
        return replace(nominal, compliance=compliance, sigma=sigma)
    axes = [f"a{k + 1}" for k in range(len(nominal.compliance))]
    every = zip(axes, nominal.compliance, strict=True)
    fitted = {a: None if c <= 0.0 else float(1.0 / c) for a, c in every}
    base = springs_of_mechanisms(fitted, diagnosis.named)
    ratio = np.array([(fitted[a] or 1.0) / (base[a] or 1.0) for a in axes])
    return replace(
        nominal, compliance=nominal.compliance * ratio, sigma=nominal.sigma * ratio
    )


def patch_entry(effect: NamedEffect, springs: dict[str, float | None]) -> PatchEffect:
    """Return one named effect for the patch."""
    parameters: dict[str, Value] = {
        name: float(p.estimate) if np.isfinite(p.estimate) else None
        for name, p in effect.parameters.items()
    }
    where, settings = effect.name.where, {}
    parameters |= neutral_sizes(effect)
    if "with" in parameters and isinstance(parameters["with"], float):
        parameters["with"] = f"a{round(parameters['with'])}"
    if effect.name.effect == "hysteresis" and effect.shape:
        settings["stiffening"] = stiffening(
            effect.parameters["width_rad"].estimate, springs.get(where), effect.shape[0]
        )
    if effect.name.effect == "lost_motion" and effect.shape:
        settings["closing_nm"] = max(float(effect.shape[0]), 1e-6)
    if effect.name.effect == "link_bending" and effect.shape:
        settings["marks_bend"] = float(round(effect.shape[0]))
    if effect.name.effect == "base_compliance" and effect.shape:
        settings["centre_m"] = float(effect.shape[0])
    return PatchEffect(effect.name.effect, where, parameters, settings)


def _further(effect: NamedEffect) -> list[dict[str, float]]:
    """Return the parameters of what a law that is a sum has beside what is reported."""
    if len(effect.shape) < 2:
        return []
    found = {name: p.estimate for name, p in effect.parameters.items()}
    parts = np.array(effect.shape), np.array(effect.coefficients)
    every = LAWS[effect.name.effect].further(found, *parts)
    return [{name: float(v) for name, v in one.items()} for one in every]


def left_neutral(diagnosis: Diagnosis) -> Iterator[Warned]:
    """Say which sizes of what was named the readings do not hold, or only together."""
    asked = (d for d in diagnosis.decisions if d.gate == "magnitude" and d.accepted)
    together = {d.candidate: d.reason for d in asked}
    for effect in diagnosis.named:
        called, where = effect.name.effect, effect.name.where
        if reason := together.get((called, where)):
            yield Warned("size_not_held", where, f"{called} on {where}: {reason}.")
        if names := tuple(neutral_sizes(effect)):
            yield Warned(
                "size_not_held",
                where,
                f"{called} on {where}: these data do not hold {' and '.join(names)}; "
                "the patch is without.",
            )


def neutral_sizes(effect: NamedEffect) -> dict[str, Value]:
    """Return the sizes that do nothing in the patch, for the readings hold others only.

    An effect of which they hold no size at all keeps the sizes that were estimated
    together: it was named, and there is no better guess.
    """
    loose, sizes = _not_held(effect), _magnitudes(effect)
    if sizes <= loose or not can_build(effect.name.effect):
        return {}
    neutral = named(effect_of(PatchEffect(effect.name.effect, effect.name.where)))
    return {n: neutral.parameters[n] for n in sorted(sizes & loose)}


def within_bounds(effect: NamedEffect) -> dict[str, Interval]:
    """Return the parameters with intervals that end where the mechanism's bounds are.

    That takes nothing from their coverage, for the truth lies within. A size that the
    readings do not hold and that no mechanism can have is the one that does nothing.
    """
    bounds = {kind.name: kind.bounds() for kind in EFFECTS}.get(effect.name.effect, {})
    neutral, found = neutral_sizes(effect), dict(effect.parameters)
    for name, p in effect.parameters.items():
        low, high = bounds.get(name, UNBOUNDED)
        if math.isfinite(p.low) and p.low <= high and low <= p.high < math.inf:
            found[name] = replace(p, low=max(p.low, low), high=min(p.high, high))
        elif name in neutral and not low <= p.estimate <= high:
            value = neutral[name]
            none = value if isinstance(value, float) else math.inf
            found[name] = replace(p, estimate=none)
    return found


LEFT_OUT = 0.3
"""What the simulator may find otherwise than the diagnosis, over one sigma of a
parameter; chosen: what columns leave out is less than what the readings leave open.
Where it may be more, sizes take what nothing named explains."""


def sigmas_of(diagnosis: Diagnosis) -> dict[Place, float]:
    """Return by how much the simulator may refine parameters; 0: not at all.

    Not refined is what the readings do not hold, and the whole form of an effect of
    which they hold no size: its sizes alone may follow the springs they belong to.
    """
    found: dict[Place, float] = {}
    for effect in diagnosis.named:
        loose, sizes = _not_held(effect), _magnitudes(effect)
        own = {
            name: 0.0 if name in loose else LEFT_OUT * p.sigma
            for name, p in effect.parameters.items()
        }
        if sizes <= loose:
            own = {name: 0.0 for name in own if name not in sizes}
        where = effect.name.effect, effect.name.where
        found |= {(*where, name): sigma for name, sigma in own.items()}
    return found


def _not_held(effect: NamedEffect) -> set[str]:
    """Return the parameters without an interval."""
    own = effect.parameters.items()
    return {name for name, p in own if not np.isfinite([p.low, p.high]).all()}


def _magnitudes(effect: NamedEffect) -> set[str]:
    info = CATALOGUE[effect.name.effect]
    sizes = {p.name for p in info.parameters if p.role == "magnitude"}
    return sizes & set(effect.parameters)


def stiffening(width_rad: float, stiffness: float | None, slip_nm: float) -> float:
    """Return how much stiffer a gear is before anything slips: 1/(1 - 3 w K/4r) - 1."""
    if stiffness is None:
        return 1.0
    share = 0.75 * width_rad * stiffness / max(slip_nm, 1e-9)
    if share >= 1.0:
        return STIFFEST
    return float(np.clip(1.0 / (1.0 - share) - 1.0, SOFTEST, STIFFEST))


def laws_of(diagnosis: Diagnosis) -> tuple[Law, ...]:
    """Return the table of what has no name, where one was learnt."""
    left = diagnosis.unexplained
    if left is None or not left.law.get("torque_nm"):
        return ()
    return (
        Law(
            left.where,
            tuple(map(float, left.law["torque_nm"])),
            tuple(map(float, left.law["loading_rad"])),
            tuple(map(float, left.law["unloading_rad"])),
        ),
    )


# --- From a calibration ---------------------------------------------------------------

FAINT = 1e-7
"""Amplitude in rad below which a wave is left away; chosen: 0.1 µm at a metre."""
ACROSS = ("lost_motion",)
"""Effects that calibration knows of a slide's guide alone."""
FROM_SIDES = ("hysteresis",)
"""Effects that depend on where an axis came from; `proof` plays them as arrivals."""


def patch_of_calibration(found: Calibrated) -> Patch:
    """Return everything that was found; waves below a tenth of a µrad left away."""
    from stiffness.calibration.model import CalibrationState, entries_of

    effects: list[PatchEffect] = []
    drawing: dict[tuple[str, str], dict[str, float | str | None]] = {}
    values = found.corrected_geometry.values
    for entry, value in zip(entries_of(found.readings.arm.chain), values, strict=True):
        if value != 0.0:
            own = drawing.setdefault((entry.effect, entry.where), {})
            own[entry.parameter] = float(value)
    effects += [
        PatchEffect(effect, where, own) for (effect, where), own in drawing.items()
    ]
    for (effect, where), numbers in found.estimates.items():
        if (effect, where) not in drawing:
            known = {name: e.estimate for name, e in numbers.items()}
            settings: dict[str, Value] = {"across": 1} if effect in ACROSS else {}
            effects.append(PatchEffect(effect, where, dict(known), settings))
    for axis, table in found.error_tables.items():
        effects += _harmonics(axis, table)
    names, places = found.readings.names, found.corrected_geometry.places
    fitted = found.readings.take(~found.held)
    torque = CalibrationState.of(fitted, found.corrected_geometry).torque
    return Patch(
        stiffness_nm_per_rad={a: k.estimate for a, k in found.springs[1].items()},
        effects=tuple(effects),
        base_from_tracker=_rows(found.corrected_geometry.base_from_tracker),
        markers={n: _triple(p) for n, p in zip(names, places, strict=True)},
        fitted=ranges_of(fitted.posture, torque),
    )


def _harmonics(axis: str, table: Table) -> list[PatchEffect]:
    found = []
    for order, c, s in zip(table.order, table.cos, table.sin, strict=True):
        size = math.hypot(c, s)
        if size >= FAINT:
            wave = {"amplitude_rad": size, "order": float(order)}
            phase = {"phase_rad": math.atan2(c, s)}
            found.append(PatchEffect("transmission_error", axis, {**wave, **phase}))
    return found


def _rows(frame: np.ndarray) -> tuple:
    return tuple(tuple(float(x) for x in row) for row in frame)


def _triple(place: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in place)
    return x, y, z


# --- Harmonics of a gear --------------------------------------------------------------


def patch_of_axes(axes: Sequence[Axis]) -> Patch:
    """Return the gears' mechanisms: springs, contacts, play and waves."""
    from scenarios.pipelines.encoder_axes import waves_of
    from stiffness.dual_encoder.terms import WIDTHS, WOUND

    springs: dict[str, float | None] = {}
    effects: list[PatchEffect] = []
    for a in axes:
        effects += waves_of(a.name, a.found)
        compliance = a.found.value(WOUND, "compliance_rad_per_nm")
        if compliance > 0.0:
            springs[a.name] = 1.0 / compliance
        elif (
            a.model_compliance and a.compliance is not None and not a.is_nominal_spring
        ):
            springs[a.name] = None
        for effect, size in WIDTHS.items():
            width = a.found.value(effect, size)
            if width > 0.0:
                effects.append(PatchEffect(effect, a.name, {size: width}))
    return Patch(stiffness_nm_per_rad=springs, effects=tuple(effects))


def patch_of_encoders(axes: Sequence[Axis], recording: Recording, model: Path) -> Patch:
    """Return the patch of a recording's arm, with the arm in it."""
    patch = for_simulator(recording, patch_of_axes(axes), model)
    return with_arm(patch, rig_of(Patch(axes=patch.axes), model))


# --- The files ------------------------------------------------------------------------


def write_patch(folder: Path, patch: Patch, rig: Rig) -> None:
    """Write patch.json, model.xml with its meshes, and controller.csv.

    The rig is the patch's, built from the user's file or from the arm in the patch.

    Raises:
        BenchError: Where no model can be made of it.
    """
    from bench import controller_table

    file = None if isinstance(rig, WrittenRig) else Path(rig.arm_file)
    model = patched_model(rig, file, marks=bool(patch.markers))
    patch = replace(patch, not_in_model=model.not_held)
    (folder / FILE).write_text(text_of(patch), encoding="utf-8")
    (folder / MODEL_FILE).write_text(model.text, encoding="utf-8")
    table = controller_table.controller_table(rig, offsets_of(rig, rig.anatomy))
    (folder / controller_table.FILE).write_text(table, encoding="utf-8")
    for name, data in model.assets.items():
        (folder / ASSETS).mkdir(exist_ok=True)
        (folder / ASSETS / name).write_bytes(data)


def write_patch_of_axes(folder: Path, patch: Patch, model: Path | None) -> None:
    """Write the same files, where a gear has a mechanism at all."""
    if patch.effects or patch.stiffness_nm_per_rad:
        write_patch(folder, patch, rig_of(patch, model))
