"""Nobody can gain more on held-out poses than whoever knows what is true."""

from pathlib import Path

import numpy as np

from bench.errors import BenchError
from bench.patch import Patch
from bench.patch_effects import can_build, named
from bench.proof import prove
from bench.rig import RIGID, Rig
from scenarios.nominal import arm_of, read_for
from stiffness.diagnosis.prepare import prepare
from stiffness.diagnosis.split import split_of

MM = 1e3


def oracle_gain_mm(folder: Path, model: Path, rig: Rig) -> float | None:
    """Return what the true mechanism gains on the poses that are held out, in mm.

    It is proved as a diagnosis' patch is: frame and places start where the diagnosis
    has them, springs and parameters where they truly are.

    Args:
        folder: Of the recording.
        model: The nominal arm.
        rig: What is true.

    Returns:
        The gain; None where the simulator has no such mechanism or finds no rest.
    """
    if not rig.effects or not all(can_build(e.name) for e in rig.effects):
        return None
    recording, arm, _ = read_for(folder, arm_of(model))
    frames = prepare(recording, arm).frames
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = frames.turn, frames.shift
    held_out = np.unique(recording.pose)[split_of(recording).held_out]
    springs = zip(rig.anatomy.axes, rig.springs, strict=True)
    patch = Patch(
        stiffness_nm_per_rad={a: None if k >= RIGID else float(k) for a, k in springs},
        effects=tuple(named(effect) for effect in rig.effects),
        base_from_tracker=tuple((a, b, c, d) for a, b, c, d in transform.tolist()),
        markers={
            marker.name: (float(x), float(y), float(z))
            for marker, (x, y, z) in zip(recording.markers, frames.place, strict=True)
        },
    )
    try:
        proof = prove(recording, model, patch, held_out.tolist(), thorough=False)
    except (BenchError, ArithmeticError, ValueError):
        return None
    return None if proof.markers is None else MM * proof.markers.gain
