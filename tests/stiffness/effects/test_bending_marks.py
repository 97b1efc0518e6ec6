"""A mark on a beam goes with the part of the bend that lies before it."""

from dataclasses import replace

import hypothesis_truth as truth
import numpy as np
import pytest
from numpy.testing import assert_allclose
from small_bench import FEW, MODEL, arm, moved_by, prepared, select_model

from bench.effects.parse import parse_all
from bench.experiment import record
from bench.instruments import Instruments
from bench.proof.proof import prove
from bench.rig import Rig
from bench.shared.recording import Recording
from bench.standard_plans import table_one_plan
from scenarios.pipelines.patching import patch_of_diagnosis
from stiffness.diagnosis.diagnose import diagnose
from stiffness.diagnosis.joint_fit import Layout
from stiffness.diagnosis.model_fit import ModelTerm
from stiffness.diagnosis.nominal_fit import prepare
from stiffness.diagnosis.relinearisation import build_problem
from stiffness.diagnosis.selection import exchange_search
from stiffness.effects.base import axes_of
from stiffness.effects.jacobian import (
    BodyTwist,
    EffectJacobian,
    MarkerDisplacement,
    hstack,
)
from stiffness.effects.joint_compliance import JointCompliance
from stiffness.effects.link_bending import LinkBending, hinges
from stiffness.experiment.static_state import StaticState

LINK, PLACE = "link_2", 3
BEYOND, WITHIN = np.array([0.0]), np.array([1.0])
BENDING, TORSION = 4e5, 3e5
"""EI and GJ, in N m^2."""


def marked(along: float, beside: np.ndarray) -> tuple[StaticState, np.ndarray]:
    """Put a mark on the link, a share along it and a little beside it.

    Returns:
        The situation with this mark, and where it is in each row, in m.
    """
    situation = prepared().situation
    start, end = situation.origin[0, PLACE - 1], situation.origin[0, PLACE]
    inside = axes_of(situation, LINK)[0].T @ (end - start)
    markers = situation.recording.markers
    spot = along * inside + beside
    mark = replace(markers[0], name="mark", body=LINK, position=spot)
    points = situation.recording.points
    assert points is not None
    made = replace(
        situation.recording,
        markers=(*markers, mark),
        points=np.concatenate([points, points[:, :1]], axis=1),
    )
    point = situation.origin[:, PLACE - 1] + axes_of(situation, LINK) @ spot
    return replace(situation, recording=made, frames=None), point


def of_mark(situation: StaticState) -> np.ndarray:
    """Return how the last marker moves per unit of 1/EI and 1/GJ, (rows, 3, 2)."""
    law = LinkBending().jacobian(situation, LINK, WITHIN)
    return truth.moved(situation, law)[:, -1]


def test_a_mark_at_the_end_of_the_beam_moves_as_what_it_carries():
    situation, point = marked(1.0, np.array([0.0, 0.02, -0.03]))
    (carried,) = LinkBending().jacobian(situation, LINK, BEYOND).parts
    assert isinstance(carried, BodyTwist)
    turned = np.cross(carried.twist[:, 3:], point[:, :, None], axis=1)
    moved = carried.twist[:, :3] + turned
    assert_allclose(of_mark(situation), moved, atol=1e-3 * np.abs(moved).max())


def test_a_mark_at_the_clamp_stays():
    situation, _ = marked(0.0, np.zeros(3))
    assert_allclose(of_mark(situation), 0.0, atol=1e-12)


def test_deflection_bends_as_the_moment_says():
    """EI u'' = M(x): second difference of the deflection along the beam."""
    step = 0.05
    u = [
        of_mark(marked(s, np.zeros(3))[0])[:, :, 0]
        for s in (0.5 - step, 0.5, 0.5 + step)
    ]
    situation, _ = marked(0.5, np.zeros(3))
    beam = situation.origin[:, PLACE] - situation.origin[:, PLACE - 1]
    length = np.linalg.norm(beam, axis=1, keepdims=True)
    w = beam / length
    lever = np.cross(0.5 * beam, situation.force[:, PLACE])
    expected = np.cross(lever + situation.moment[:, PLACE], w)
    bend = (u[0] - 2 * u[1] + u[2]) / (step * length) ** 2
    assert_allclose(bend, expected, atol=1e-6 * np.abs(expected).max())


def test_what_marks_do_as_a_body_is_nearly_all_they_do():
    situation = prepared().situation
    law = LinkBending().jacobian(situation, LINK, WITHIN)
    whole = truth.moved(situation, law)
    bodies = [part for part in law.parts if not isinstance(part, MarkerDisplacement)]
    left = whole - truth.moved(situation, EffectJacobian(law.columns, tuple(bodies)))
    on_link = [
        m for m, one in enumerate(situation.recording.markers) if one.body == LINK
    ]
    assert len(on_link) > 2
    assert np.linalg.norm(left[:, on_link]) < 0.2 * np.linalg.norm(whole[:, on_link])


def beam() -> Recording:
    """Link 2 is a beam, and the marks on it go with it."""
    law = LinkBending().jacobian(prepared().situation, LINK, WITHIN)
    return moved_by(law, np.array([1.0 / BENDING, 1.0 / TORSION]))


def lumped() -> Recording:
    """Link 2 gives way at two points of it, and the marks between see the first."""
    situation = prepared().situation
    give_way = hstack(hinges(situation, LINK))
    start, end = situation.origin[0, PLACE - 1], situation.origin[0, PLACE]
    half = float(np.linalg.norm(end - start)) / 2
    one = np.array([half / BENDING, half / TORSION])
    return moved_by(give_way, np.concatenate([0 * one, one, one, 0 * one]))


def unmeasured() -> Recording:
    """Nobody measured where the marks sit; they are fitted."""
    made = beam()
    marks = tuple(replace(mark, position=None) for mark in made.markers)
    return replace(made, markers=marks)


@pytest.mark.parametrize("made", [beam, lumped, unmeasured])
def test_a_beam_with_marks_on_it_is_a_link_that_bends(made):
    found = diagnose(made(), arm(), (*FEW, JointCompliance(), LinkBending()))
    assert found.verdict == "explained"
    assert [(e.name.effect, e.name.where) for e in found.named] == [
        ("link_bending", LINK)
    ]


def test_patch_bends_marks_with_their_link_where_readings_say_so():
    said = f"link_bending@{LINK},bending_nm2=1e5,torsion_nm2=1e5,marks_bend=1"
    rig = Rig(MODEL)
    rig = Rig(MODEL, effects=parse_all((said,), rig.nominal))
    made = record(rig, table_one_plan(poses=30), Instruments(), seed=3)
    nominal = arm().for_recording(made)
    found = diagnose(made, nominal, (*FEW, JointCompliance(), LinkBending()))
    assert [str(e.name) for e in found.named] == [f"link_bending at {LINK}"]
    patch = patch_of_diagnosis(found, made, nominal)
    (entry,) = patch.effects
    assert entry.settings["marks_bend"] == 1
    held = np.unique(made.posture_id)[::4].tolist()
    judged = {}
    for bend in (0, 1):
        one = replace(entry, settings={"marks_bend": float(bend)})
        patch = replace(patch, effects=(one,))
        judged[bend] = prove(made, MODEL, patch, held, thorough=False)
    kept, bent = (judged[bend].markers for bend in (0, 1))
    assert bent.after < 1.02 * bent.noise
    assert kept.explained.estimate < 0.95
    assert bent.explained.estimate > 0.98
    (effect,) = judged[1].patch.effects
    assert effect.parameters["bending_nm2"] == pytest.approx(1e5, rel=0.02)


def test_a_link_without_marks_is_not_asked_how_its_marks_bend():
    """A link that bends with its marks is compared with one that has none."""
    made = beam()
    kept = np.array([not mark.name.startswith("link1") for mark in made.markers])
    marks = tuple(mark for mark, k in zip(made.markers, kept, strict=True) if k)
    assert made.points is not None
    seen = replace(made, markers=marks, points=made.points[:, kept])
    ready, library = prepare(seen, arm()), (*FEW, LinkBending())
    model = select_model(build_problem(ready, library), Layout(ready, library))
    assert {m.name: m.shape[0] for m in model.fit.members} == {
        ("link_bending", LINK): 1.0
    }
    bare = ModelTerm(library[-1], "link_1", np.zeros(1))
    search = exchange_search(replace(model, fine=(*model.fine, bare)))
    shapes = {float(t.shape[0]) for t in search.terms if t.name == bare.name}
    assert shapes == {0.0}
