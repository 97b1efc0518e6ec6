"""What was named between encoders goes into a patch, but for delays."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from bench.one_chain import moving
from bench.patch import FILE, MODEL_FILE, Patch, rig_of, text_of, with_arm
from bench.patch_effects import Named
from bench.patch_model import mjcf_of
from bench.proving.laid_out import in_model, mounted_on
from bench.recording import Recording
from scenarios.two_encoders.axis import Axis
from stiffness.two_encoders.found import Between
from stiffness.two_encoders.terms import WOUND


def waves_of(name: str, found: Between) -> tuple[Named, ...]:
    """Return the waves of an axis' gear."""
    effects, i = [], 0
    for term in found.terms:
        own = found.x[i : i + len(term.parameters)]
        i += len(own)
        if term.order:
            known: dict[str, float | str | None] = {
                "amplitude_rad": float(np.hypot(*own)),
                "order": term.order,
                "phase_rad": float(np.arctan2(own[0], own[1])),
            }
            effects.append(Named("transmission_error", name, known))
    return tuple(effects)


def patch_of(axes: Sequence[Axis]) -> Patch:
    """Return the gears' mechanisms: springs, contacts, play and waves."""
    springs: dict[str, float | None] = {}
    effects: list[Named] = []
    for a in axes:
        effects += waves_of(a.name, a.found)
        give = a.found.value(WOUND, "compliance_rad_per_nm")
        if give > 0.0:
            springs[a.name] = 1.0 / give
        elif a.model_give and a.give is not None and not a.is_nominal_spring:
            springs[a.name] = None
        for effect in ("hysteresis", "lost_motion"):
            width = a.found.value(effect, "width_rad")
            if width > 0.0:
                effects.append(Named(effect, a.name, {"width_rad": width}))
    return Patch(stiffness_nm_per_rad=springs, effects=tuple(effects))


def patched(axes: Sequence[Axis], recording: Recording, model: Path) -> Patch:
    """Return the patch of a recording's arm, with the arm in it."""
    patch = replace(patch_of(axes), axes=moving(recording, model))
    bare = rig_of(Patch(axes=patch.axes), model)
    patch = in_model(recording, patch, bare.anatomy)
    patch = replace(patch, mounted=mounted_on(recording, bare))
    return with_arm(patch, bare)


def write_patch(folder: Path, patch: Patch) -> None:
    """Write patch.json and model.xml, where a gear has a mechanism at all."""
    if patch.effects or patch.stiffness_nm_per_rad:
        (folder / FILE).write_text(text_of(patch), encoding="utf-8")
        text = mjcf_of(rig_of(patch))
        (folder / MODEL_FILE).write_text(text, encoding="utf-8")
