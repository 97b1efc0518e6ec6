"""What imitates a name is tried in its place, and a load that was lost comes back."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from small_bench import MECHANICS, arm, nameless, prepared, recording, select_model

from stiffness.diagnosis import exchanges, selection
from stiffness.diagnosis.diagnose import diagnose
from stiffness.diagnosis.exchanges import (
    _exchange_step,
    _imitators,
    _without_needless_terms,
    laws_of_gear_beside,
    load_of_axis,
)
from stiffness.diagnosis.joint_fit import Layout, unexplained
from stiffness.diagnosis.model_fit import ModelTerm, fit_model
from stiffness.diagnosis.nominal_fit import prepare
from stiffness.diagnosis.relinearisation import build_problem, total_softening
from stiffness.diagnosis.search import Search, with_plain_law
from stiffness.diagnosis.selection import (
    _judged,
    _selected_under,
    _with_loads_put_back,
)
from stiffness.effects.angle_dependent_stiffness import AngleDependentStiffness
from stiffness.effects.asymmetric_stiffness import AsymmetricStiffness
from stiffness.effects.bearing_tilt import BearingTilt
from stiffness.effects.geometry_error import GeometryError
from stiffness.effects.gravity_compensator import GravityCompensator
from stiffness.effects.gravity_load import GravityLoad
from stiffness.effects.hardening import Hardening
from stiffness.effects.hardening_tilt import HardeningTilt
from stiffness.effects.lost_motion import LostMotion
from stiffness.effects.stretched_spring import StretchedSpring
from stiffness.effects.transmission_error import TransmissionError
from stiffness.regression.group_selection import select_groups
from stiffness.regression.group_sets import FactorisedSet

NONE = np.zeros(0)


def test_a_load_is_tried_in_the_place_of_a_name_that_does_alone_what_it_does():
    """A wave of the gear turns its axis as a compensator, which also winds others."""
    seen = recording("gravity_compensator@a1,torque_nm=40,phase_rad=0.5", poses=20)
    some = (TransmissionError(), GravityCompensator())
    prepared = prepare(seen, arm().for_recording(seen))
    model = select_model(build_problem(prepared, some[:1]), Layout(prepared, some[:1]))
    assert [m.name for m in model.fit.members] == [("transmission_error", "a1")]
    both = build_problem(prepared, some)
    [(_, load)] = _imitators(replace(model, case=both, share=0.0)).values()
    assert load.name == ("gravity_compensator", "a1")


def test_a_load_is_tried_where_it_does_less_than_a_term_by_what_stays_unexplained():
    """A wave of another order than a load's is no load, unless more stays open."""
    seen = recording(
        "transmission_error@a1,amplitude_rad=5e-4,order=3,phase_rad=1", poses=20
    )
    some = (TransmissionError(), GravityCompensator())
    prepared = prepare(seen, arm().for_recording(seen))
    model = select_model(build_problem(prepared, some[:1]), Layout(prepared, some[:1]))
    model = replace(model, case=build_problem(prepared, some))
    assert not _imitators(replace(model, share=0.999))
    [(less, load)] = _imitators(replace(model, share=0.0)).values()
    assert load.name == ("gravity_compensator", "a1")
    assert 0.0 < less < 0.5 * model.statistics.whole


def test_a_load_is_tried_in_the_place_of_a_term_without_a_name():
    """A generic wave of the angle turns its axis as a compensator does."""
    ready = prepared("gravity_compensator@a1,torque_nm=40,phase_rad=0.5")
    some = (GravityCompensator(),)
    case = build_problem(ready, some)
    term = nameless(case, "angle", "a1")
    model = _selected_under(Layout(ready, ()), *started(build_problem(ready, ()), term))
    assert [m.name for m in model.fit.members] == [term.name]
    [(_, load)] = _imitators(replace(model, case=case, share=0.0)).values()
    assert load.name == ("gravity_compensator", "a1")


def test_a_load_is_tried_in_the_place_of_another_load():
    """Masses of two links imitate a compensator behind a gear that hardens."""
    some = (Hardening(), GravityLoad(), GravityCompensator())
    ready = prepared(
        "gravity_compensator@a2,torque_nm=40,phase_rad=0.5",
        "hardening@a2,stiffness_ratio=2,torque_nm=20",
    )
    few, both = some[:2], build_problem(ready, some)
    model = select_model(build_problem(ready, few), Layout(ready, few))
    masses = {m.name for m in model.fit.members if m.name[0] == "gravity_load"}
    tried = _imitators(replace(model, case=both, share=0.0))
    assert {(name, ("gravity_compensator", "a2")) for name in masses} & set(tried)


def test_a_load_takes_the_place_of_a_term_where_all_then_are_worth_as_much():
    """A compensator behind a gear that hardens: its torque moves along the law."""
    some = (TransmissionError(), GravityCompensator(), Hardening())
    ready = prepared(
        "gravity_compensator@a1,torque_nm=40,phase_rad=0.5",
        "hardening@a1,stiffness_ratio=2,torque_nm=20",
    )
    layout, both = Layout(ready, some), build_problem(ready, some)
    few = some[::2]
    model = select_model(build_problem(ready, few), Layout(ready, few))
    names = {m.name for m in model.fit.members}
    assert ("transmission_error", "a1") in names
    model = replace(model, case=both, fit=fit_model(both, model.fit.members))
    point = _exchange_step(layout, model).point
    assert point is not None
    assert ("gravity_compensator", "a1") in {m.name for m in point.fit.members}
    assert point.square < unexplained(both, model.fit)
    alone = replace(model, fit=fit_model(both, point.fit.members))
    assert _exchange_step(layout, alone).point is None


def test_a_load_is_told_from_a_wave_by_what_a_gear_that_hardens_feels_of_it():
    """In columns that are laid out once the wave does what the load does."""
    names = (Hardening(), GravityCompensator())
    ready = prepared(
        "gravity_compensator@a3,torque_nm=27,phase_rad=0.855",
        "hardening@a3,stiffness_ratio=1.52,torque_nm=19.6",
    )
    case = build_problem(ready, (*names, TransmissionError()))
    law = ModelTerm(names[0], "a3", np.array([20.0, 0.0]))
    load = ModelTerm(names[1], "a3", NONE)
    wave = ModelTerm(TransmissionError(), "a3", np.array([1.0]))
    layout = Layout(ready, (*names, TransmissionError()))
    point = layout.fitted_jointly(case, fit_model(case, [law, load]))
    own = point.fit.members
    problem = Search.of(layout.at(point), [*own, wave]).problem
    one, other = (FactorisedSet.of(problem, some).worth for some in ([0, 1], [0, 2]))
    swapped = layout.fitted_jointly(case, fit_model(case, [own[0], wave]))
    assert abs(one - other) < 20.0
    assert point.worth(case.poses) - swapped.worth(case.poses) > 100.0


def test_a_compensator_and_a_gear_that_hardens_are_named_at_one_axis():
    """A wave and a spring of two sides do much of what both do, but not under load."""
    seen = recording(
        "gravity_compensator@a3,torque_nm=27,phase_rad=0.855",
        "hardening@a3,stiffness_ratio=1.52,torque_nm=19.6",
        poses=60,
    )
    laws = (*MECHANICS, GravityCompensator(), GravityLoad(), TransmissionError())
    found = diagnose(seen, arm(), laws)
    names = {(n.name.effect, n.name.where) for n in found.named}
    assert names == {("gravity_compensator", "a3"), ("hardening", "a3")}


def test_what_a_compensator_s_pull_does_to_its_bearing_is_no_error_of_a_link():
    """It turns with the axis, as what a wrong link moves does."""
    seen = recording(
        "gravity_compensator@a2,torque_nm=150,phase_rad=0.8",
        "bearing_tilt@a2,u_rad_per_nm=4e-7,v_rad_per_nm=4e-7,centre_m=0.04",
        poses=60,
    )
    laws = (*MECHANICS, GravityCompensator(), TransmissionError(), GeometryError())
    found = diagnose(seen, arm(), laws)
    names = {(n.name.effect, n.name.where) for n in found.named}
    assert names == {("gravity_compensator", "a2"), ("bearing_tilt", "a2")}


def test_a_load_comes_back_where_a_wave_took_what_it_displaces_under_its_torque():
    """While the play still feels it; in columns of its own the wave does less."""
    some = (LostMotion(), GravityCompensator(), TransmissionError())
    ready = prepared(
        "gravity_compensator@a3,torque_nm=14,phase_rad=1.89",
        "lost_motion@a3,width_rad=2.4e-4",
    )
    layout, case = Layout(ready, some), build_problem(ready, some)
    play, load, wave = (
        ModelTerm(law, "a3", np.array(shape))
        for law, shape in zip(some, ([0.3], [], [1.0]), strict=True)
    )
    both = layout.fitted_jointly(case, fit_model(case, [play, load]))
    under = layout.at(both)
    fit = fit_model(under, [play, wave])
    misled = layout.fitted_jointly(under, fit)
    assert unexplained(under, fit) < both.square + 10.0
    assert misled.square > both.square + 1000.0
    back = _with_loads_put_back(layout, under, misled, [load])
    assert {m.name for m in back.fit.members} == {play.name, load.name}
    assert abs(back.over(both, case.poses)) < 1.0


def test_a_load_comes_with_the_law_that_feels_it_where_a_gear_has_no_name(monkeypatch):
    """Alone neither does much: the law has the wrong sign without the load's torque."""
    some = (LostMotion(), Hardening(), GravityCompensator(), TransmissionError())
    ready = prepared(
        "gravity_compensator@a3,torque_nm=20,phase_rad=-0.2",
        "hardening@a3,stiffness_ratio=1.6,torque_nm=15",
    )
    layout, case = Layout(ready, some), build_problem(ready, some)
    wave = ModelTerm(some[3], "a3", np.array([1.0]))
    model = _judged(case, (wave, nameless(case, "torque", "a3")), (), ())
    monkeypatch.setattr(exchanges, "_imitators", lambda model: {})
    point = _exchange_step(layout, replace(model, share=0.5)).point
    assert point is not None
    laws = {("gravity_compensator", "a3"), ("hardening", "a3")}
    assert laws <= point.fit.names <= {*laws, wave.name}
    assert point.worth(case.poses) > -0.5 * unexplained(case, model.fit)
    assert _exchange_step(layout, replace(model, share=1.0)).point is None


def test_a_load_comes_with_the_law_that_feels_it_where_a_wave_imitates_it():
    """In columns without the load's torque another law does more than the true one."""
    some = (Hardening(), AsymmetricStiffness(), GravityCompensator())
    some += (TransmissionError(), AngleDependentStiffness())
    ready = prepared(
        "gravity_compensator@a3,torque_nm=27,phase_rad=0.855",
        "hardening@a3,stiffness_ratio=1.52,torque_nm=19.6",
    )
    layout, case = Layout(ready, some), build_problem(ready, some)
    wave = ModelTerm(some[3], "a3", np.array([1.0]))
    model = replace(_judged(case, (wave,), (), ()), share=0.5)
    load = load_of_axis(case, "a3")
    assert load is not None
    alone = layout.fitted_jointly(case, fit_model(case, [load]))
    ((_, first), *_) = laws_of_gear_beside(case, [wave], "a3")
    assert first.name != ("hardening", "a3")
    ((_, under), *_) = laws_of_gear_beside(layout.at(alone), alone.fit.members, "a3")
    assert under.name == ("hardening", "a3")
    found = _exchange_step(layout, model).point
    assert found is not None
    assert found.fit.names == {load.name, under.name}


def test_what_a_play_leaves_at_a_wrong_shape_goes_where_the_play_does_better_alone():
    some = (LostMotion(),)
    ready = prepared("lost_motion@a3,width_rad=2.4e-4")
    layout, case = Layout(ready, some), build_problem(ready, some)
    play = ModelTerm(some[0], "a3", np.array([3.0]))
    model = _judged(case, (play,), (), ())
    both = replace(model, fit=fit_model(case, [play, nameless(case, "torque", "a3")]))
    alone = _without_needless_terms(layout, both)
    (found,) = alone.fit.members
    assert found.name == play.name
    assert 0.1 < found.shape[0] < 0.5
    assert unexplained(alone.case, alone.fit) < 0.0


def started(case, term: ModelTerm):
    """Return a search that starts with a term, and the set of it alone."""
    search = Search.of(case, [term])
    return search, select_groups(search.problem, [0])


def test_a_load_that_is_withheld_acts_no_more_on_others(monkeypatch):
    """Where the search begins with it, as where one was found on the way."""
    some = (GravityCompensator(),)
    ready = prepared("gravity_compensator@a1,torque_nm=40,phase_rad=0.5")
    layout, judged = Layout(ready, some), selection._judged
    bare = build_problem(ready, some)
    term = select_model(bare, Layout(ready, some)).fit.members
    fit = fit_model(bare, term)
    acting = build_problem(ready, some, total_softening(bare, ready, fit), fit)
    search = Search.of(acting, term)
    start = select_groups(search.problem, range(len(term)))
    monkeypatch.setattr(selection, "_judged", lambda c, t, *o: judged(c, (), *o))
    found = _selected_under(layout, search, start)
    assert not found.fit.members
    assert np.ptp(search.case.situation.torque - bare.situation.torque) > 1.0
    assert_allclose(found.case.situation.torque, bare.situation.torque, atol=0.1)


@pytest.mark.parametrize(
    ("form", "shape", "plain", "kept"),
    [
        (StretchedSpring(), [2.2, 0.6], GravityCompensator(), []),
        (HardeningTilt(), [0.05, 0.4, 20.0], BearingTilt(), [0.05]),
        (GravityCompensator(), [], None, []),
    ],
)
def test_law_stands_in_for_a_form_of_it_that_is_impossible(form, shape, plain, kept):
    case = build_problem(prepared(), (Hardening(),))
    other = ModelTerm(Hardening(), "a2", np.array([20.0, 0.0]))
    term = ModelTerm(form, "a3", np.array(shape))
    found = with_plain_law(case, (other, term), term.name)
    if plain is None:
        assert found == ()
        return
    assert [t.hypothesis for t in found] == [other.hypothesis, plain]
    assert len(found[1].shape) == len(kept)


def test_compensator_is_found_by_its_plain_law_where_a_form_of_it_would_push():
    """Fitted beside other laws, a spring of some free length came out below zero."""
    true = "gravity_compensator@a3,torque_nm=60,phase_rad=1.5"
    seen = recording(true, "hardening@a3,stiffness_ratio=1.8,torque_nm=30")
    case = build_problem(prepare(seen, arm().for_recording(seen)), (Hardening(),))
    pushes = ModelTerm(StretchedSpring(), "a3", np.array([1.5 - np.pi, 0.6]))
    model = _judged(case, (pushes,), (), ())
    [found] = model.fit.members
    assert found.hypothesis == GravityCompensator()
    (torque,) = (p["torque_nm"] for p in model.parameters)
    assert 0.0 < torque.low < 60.0 < torque.high
