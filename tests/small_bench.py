"""A KR10 on the bench in forty poses, with springs stiffer than the model's."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import hypothesis_truth as truth
import numpy as np

from bench.effects.parse import parse_all
from bench.experiment import record
from bench.instruments import Instruments
from bench.instruments.markers import Markers
from bench.instruments.tracker import Tracker
from bench.model_file import load, plain_mjcf
from bench.rig import Rig
from bench.shared.effect_catalogue import CATALOGUE
from bench.shared.recording import Recording
from bench.standard_plans import table_one_plan
from stiffness.diagnosis.diagnose import diagnose
from stiffness.diagnosis.exchanges import with_exchanges
from stiffness.diagnosis.joint_fit import Layout
from stiffness.diagnosis.model_fit import ModelTerm, SelectionProblem
from stiffness.diagnosis.nominal_fit import Prepared, prepare
from stiffness.diagnosis.result import Diagnosis
from stiffness.diagnosis.search import generic_term
from stiffness.diagnosis.selection import SelectedModel, search_model
from stiffness.effects import HYPOTHESES
from stiffness.effects.bearing_tilt import BearingTilt
from stiffness.effects.encoder_offset import EncoderOffset
from stiffness.effects.hardening import Hardening
from stiffness.effects.hysteresis import Hysteresis
from stiffness.effects.jacobian import EffectJacobian
from stiffness.robot.arm import Arm

MODEL = Path(__file__).parents[1] / "mjcf" / "kr10_r1100_2" / "kr10_r1100_2.xml"
SOFTER = 1.6  # true stiffness over the model's: the nuisance fit has to change it
FEW = (Hardening(), Hysteresis(), BearingTilt(), EncoderOffset())
MECHANICS = tuple(
    law for law in HYPOTHESES if CATALOGUE[law.effect].family in ("gear", "structure")
)
"""All laws of gears, bearings, links and the foot, without those of instruments."""


@cache
def arm() -> Arm:
    return Arm.from_mjcf_text(plain_mjcf(load(MODEL)))


@cache
def recording(
    *effects: str,
    poses: int = 40,
    seed: int = 1,
    softness: tuple[float, ...] = (SOFTER,),
) -> Recording:
    stiffness = load(MODEL).jnt_stiffness * np.array(softness)
    rig = Rig(MODEL, stiffness=stiffness)
    rig = replace(rig, effects=parse_all(effects, rig.nominal))
    instruments = Instruments(
        tracker=Tracker(occlusions=0.02), markers=Markers(placement=5e-4)
    )
    return record(rig, table_one_plan(poses=poses), instruments, seed=seed)


def select_model(
    case: SelectionProblem, layout: Layout, start: Sequence[ModelTerm] = ()
) -> SelectedModel:
    """Search the set that explains best, what imitates each other exchanged."""
    return with_exchanges(search_model(case, layout, start), layout)


def nameless(case: SelectionProblem, kind: str, where: str) -> ModelTerm:
    """Return the generic term of a kind at a place."""
    blocks = case.library.map.blocks
    (block,) = (b for b in blocks if (b.kind, b.where) == (kind, where))
    return generic_term(block)


@cache
def prepared(*effects: str) -> Prepared:
    return prepare(recording(*effects), arm())


def moved_by(law: EffectJacobian, size: np.ndarray, *effects: str) -> Recording:
    """Return the recording plus an effect Jacobian times its coefficients."""
    made, ready = recording(*effects), prepared(*effects)
    assert made.points is not None
    moved = truth.moved(ready.situation, law) @ size
    return replace(made, points=made.points + moved @ ready.frames.transform[:3, :3])


def relative(made: Recording) -> Recording:
    """Count each visit's readings from its first row, in the frame that they show."""
    assert made.points is not None
    first = np.searchsorted(made.visit, made.visit)
    seen = np.isfinite(made.points[first]).all(axis=(1, 2))
    moved = replace(
        made,
        points=made.points - made.points[first],
        displacement="relative",
        base_from_tracker=prepare(made, arm()).frames.transform,
    )
    return moved.take(np.flatnonzero(seen))


def names(found: Diagnosis) -> list[tuple[str, str]]:
    return [(one.name.effect, one.name.where) for one in found.named]


@cache
def diagnosis(*effects: str) -> Diagnosis:
    return diagnose(recording(*effects), arm(), FEW)
