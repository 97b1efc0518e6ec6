"""One search names one effect or many, and every gate leaves its decisions."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose
from small_bench import FEW, arm, prepared, recording, select_model

from scenarios.pipelines.diagnosis import answer_of
from scenarios.report.data_files import DECISIONS, read_table, write_decisions
from stiffness.diagnosis import verdict
from stiffness.diagnosis.detection import ResidualEquations, imitated_share
from stiffness.diagnosis.diagnose import diagnose
from stiffness.diagnosis.exchanges import _exchange_step
from stiffness.diagnosis.gate import (
    budget_parts,
    cancelled_names,
    gate_terms,
    pose_statistics,
    second_order_name,
)
from stiffness.diagnosis.joint_fit import Layout
from stiffness.diagnosis.localisation import displaced_by_places
from stiffness.diagnosis.model_fit import (
    ModelTerm,
    SelectionProblem,
    fit_model,
    fit_shapes,
)
from stiffness.diagnosis.nominal_fit import Prepared, blocks
from stiffness.diagnosis.relinearisation import build_problem
from stiffness.diagnosis.result import Decision, Diagnosis, Name
from stiffness.diagnosis.selection import (
    SelectedModel,
    _judged,
    _needed_least,
)
from stiffness.diagnosis.sufficient_statistics import (
    SufficientStatistics,
    normal_equations_of,
)
from stiffness.diagnosis.verdict import exchange_posteriors, judge
from stiffness.effects import HYPOTHESES
from stiffness.effects.asymmetric_stiffness import AsymmetricStiffness
from stiffness.effects.bearing_tilt import BearingTilt
from stiffness.effects.drift import Drift
from stiffness.effects.encoder_offset import EncoderOffset
from stiffness.effects.geometry_error import GeometryError
from stiffness.effects.gravity_compensator import GravityCompensator
from stiffness.effects.gravity_load import GravityLoad
from stiffness.effects.hardening import Hardening
from stiffness.effects.hysteresis import Hysteresis
from stiffness.effects.lost_motion import LostMotion
from stiffness.effects.residual_map import GenericTerm
from stiffness.effects.transmission_error import TransmissionError
from stiffness.regression.intervals import jackknife_covariance
from stiffness.regression.normal_equations import losses_without, minimum_norm_fit

EIGHT = (
    "hysteresis@a1",
    "hysteresis@a2",
    "hysteresis@a3",
    "hardening@a2",
    "hardening@a3",
    "bearing_tilt@a3",
    "bearing_tilt@a4",
    "base_compliance@base",
)
NONE = np.zeros(0)
TWO = ("hysteresis@a2,width_rad=1.2e-4", "bearing_tilt@a3")


OTHERS = ("lost_motion", "transmission_error", "encoder_offset", "link_bending")
LIBRARY = tuple(
    law
    for law in HYPOTHESES
    if law.effect in OTHERS or any(law.effect in one for one in EIGHT)
)
"""Part of all laws, for time; with those that imitate what coarse shapes leave."""


@cache
def problem(*effects: str) -> SelectionProblem:
    return build_problem(prepared(*effects), LIBRARY)


@cache
def selected(*effects: str) -> SelectedModel:
    return select_model(problem(*effects), Layout(prepared(*effects), LIBRARY))


@cache
def answer() -> Diagnosis:
    return diagnose(recording(*EIGHT), arm(), LIBRARY)


def named(found: Diagnosis) -> set[str]:
    return {f"{one.name.effect}@{one.name.where}" for one in found.named}


def test_arm_of_eight_effects_gets_all_names_but_one_and_none_that_is_false():
    """Forty poses, of which some are kept back, do not show the weakest for sure."""
    assert named(answer()) <= set(EIGHT)
    assert len(named(answer())) >= len(EIGHT) - 1
    assert answer().verdict in {"explained", "partly_explained"}


def test_a_search_that_starts_from_a_set_finds_what_one_from_nothing_does():
    """A false name of the start goes, and one that it lacks comes in."""
    ready, case, model = prepared(*TWO), problem(*TWO), selected(*TWO)
    false = ModelTerm(GeometryError(), "link_2", NONE)
    start = (false, *model.fit.members[1:])
    found = select_model(case, Layout(ready, LIBRARY), start)
    assert found.fit.names == model.fit.names
    assert_allclose(found.share, model.share, atol=1e-3)


@pytest.mark.parametrize("where", ["a1", "a3"])
def test_term_takes_the_place_of_a_load_that_the_others_do_worse_with(where):
    """A compensator turns an axis as its wave does, but winds up its spring, too."""
    laws = (TransmissionError(), GravityCompensator(), AsymmetricStiffness())
    wave = f"transmission_error@{where},amplitude_rad=3e-4,order=1"
    ready = prepared(wave, f"asymmetric_stiffness@{where}")
    case, layout = build_problem(ready, laws), Layout(ready, laws)
    load = ModelTerm(laws[1], where, NONE)
    terms = load, ModelTerm(laws[2], where, np.ones(1))
    point = layout.fitted_jointly(case, fit_model(case, terms))
    step = _exchange_step(layout, _judged(layout.at(point), point.fit.members, (), ()))
    assert step.point is not None
    assert ("transmission_error", where) in step.point.fit.names
    assert load.name not in step.point.fit.names
    assert step.losses[load.name, ("transmission_error", where)] < -3.0


def test_what_does_as_well_when_all_is_fitted_anew_is_an_equivalent():
    model, other = selected(*TWO), ("bearing_tilt", "a5")
    own = model.fit.members[0].name

    def alike(less: float) -> tuple[Name, ...]:
        losses = {(own, other): less}
        return exchange_posteriors(replace(model, exchange_losses=losses))[
            0
        ].equivalents

    assert Name(*other) in alike(0.0)
    assert Name(*other) in alike(30.0)  # which is likelier before any reading
    assert Name(*other) not in alike(60.0)


def test_every_name_of_a_whole_arm_is_sure_and_has_a_share():
    found = answer()
    assert all(0.0 < (one.share or 0.0) < 1.0 for one in found.named)
    assert all(one.probability >= 0.95 for one in found.named)
    places = [place.share for place in found.located]
    assert {"a1", "a2", "a3", "a4", "base"} <= {place.where for place in found.located}
    assert_allclose(sum(places), 1.0, atol=0.05)


def test_budget_gives_each_name_its_part_of_what_all_explain():
    found = answer()
    parts = {one.name: one.budget_share or 0.0 for one in found.named}
    assert 0.9 < sum(parts.values()) < 1.01
    assert min(parts.values()) > -0.01
    assert max(parts, key=parts.__getitem__).where in {
        place.where for place in found.located[:3]
    }


def test_part_of_the_budget_is_what_a_name_displaces_along_all_names_together():
    model = selected(*EIGHT)
    units, owned = model.statistics.units, dict[tuple[str, str], np.ndarray]()
    for term, columns in zip(
        model.statistics.terms, model.statistics.owned, strict=True
    ):
        owned[term.name] = columns
    value, vector = np.linalg.eigh(units.gram[units.fold >= 0].sum(axis=0))
    design = np.sqrt(np.maximum(value, 0.0))[:, None] * vector.T  # X'X is the gram
    springs = design[:, model.statistics.nominal]
    moved = [
        design[:, owned[member.name]] @ size
        for member, size in zip(model.fit.members, model.fit.coefficients, strict=True)
    ]
    alone = [f - springs @ np.linalg.lstsq(springs, f, rcond=None)[0] for f in moved]
    f = np.sum(alone, axis=0)
    expected = [(own @ f) / (f @ f) for own in alone]
    assert_allclose(
        budget_parts(model.statistics, model.fit), expected, rtol=1e-3, atol=1e-5
    )
    assert_allclose(sum(budget_parts(model.statistics, model.fit)), 1.0)


@pytest.mark.parametrize(
    ("parts", "withheld"),
    [
        ((0.6, 0.5, -0.1, 0.0), set()),  # a name may go against the others a little
        ((0.9, -0.3, -0.3, 0.7), set()),
        ((3.8, -3.5, 0.7, 0.0), {0, 1, 2}),
        ((3.8, -3.0, 0.2, 0.0), {0, 1}),
        ((0.6, 0.0, 0.0, -0.8), set()),  # what has no name is no name's fault
        ((-0.8, 0.2, 0.1, 1.5), {0}),
    ],
)
def test_names_that_mostly_undo_each_other_are_withheld(parts, withheld):
    """Zeros of 5 mrad and lengths of 3 mm did what a hook on the rope had done."""
    laws = (EncoderOffset(), GeometryError(), Hysteresis())
    members = [ModelTerm(law, "a3", np.zeros(0)) for law in laws]
    nameless = GenericTerm("generic_load", "load", "load")
    members.append(ModelTerm(nameless, "a3", np.zeros(0)))
    found = {d.candidate for d in cancelled_names(members, parts)}
    assert found == {members[k].name for k in withheld}


def test_a_rival_exchanges_one_of_the_names_given_or_adds_one_that_is_not_sure():
    found = answer()
    given = {n.name for n in found.named}
    assert found.rivals
    for rival in found.rivals:
        assert len(set(rival.effects) - given) == 1
        assert len(given - set(rival.effects)) <= 1


def test_place_of_a_name_that_is_withheld_is_left_open():
    judged = judge(selected(*EIGHT))
    member = judged.model.fit.members[0]
    alone = replace(judged, withheld=(True, *judged.withheld[1:]))
    told = verdict.answer_of(alone, prepared(*EIGHT), judged.residual)
    assert Name(*member.name) not in {one.name for one in told["named"]}
    (place,) = (p for p in told["unexplained_places"] if p.where == member.where)
    assert set(member.depends_on) <= set(place.depends_on)
    assert 0.0 < place.share <= 1.0


def test_every_gate_of_a_whole_arm_leaves_its_decisions():
    decided = answer().decisions
    gates = {decision.gate for decision in decided}
    assert {"log_evidence", "left_out", "posterior"} <= gates
    assert all(decision.reason for decision in decided)
    for one in answer().named:
        own = [d for d in decided if d.candidate == (one.name.effect, one.name.where)]
        assert own
        assert all(d.accepted for d in own)


def test_the_place_with_the_largest_share_is_listed_first():
    """Several names of one place count together."""
    shares = [place.share for place in answer().located]
    assert len(shares) > 2 and shares == sorted(shares, reverse=True)


def test_intervals_of_a_whole_arm_are_finite_and_hold_the_tilt():
    (tilt,) = (
        one.parameters
        for one in answer().named
        if (one.name.effect, one.name.where) == ("bearing_tilt", "a4")
    )
    for name in ("u_rad_per_nm", "v_rad_per_nm"):
        assert np.isfinite([tilt[name].low, tilt[name].high]).all()
        assert tilt[name].low > 0.0


def test_two_effects_are_two_names_by_the_same_search():
    found = selected(*TWO)
    names = {f"{effect}@{where}" for effect, where in map(name_of, found.fit.members)}
    assert names == {effect.partition(",")[0] for effect in TWO}
    assert found.share > 0.9


def name_of(term: ModelTerm) -> tuple[str, str]:
    return term.name


def test_every_candidate_that_was_not_selected_has_a_reason():
    decided = selected(*TWO).decisions
    of_names = {d.candidate for d in decided if d.gate == "log_evidence"}
    assert of_names == {c.name for c in problem(*TWO).library.candidates}
    creep: list[Decision] = [d for d in decided if d.candidate == ("hardening", "a5")]
    assert creep and all(d.reason for d in creep)


def test_members_explain_beside_each_other_what_fits_without_them_lose():
    found, case = selected(*TWO), selected(*TWO).case
    members = found.fit.members
    for k, gain in enumerate(found.drop_one_gains):
        rest = [m for i, m in enumerate(members) if i != k]
        less = fit_model(case, rest)
        assert_allclose(gain, found.fit.gain - less.gain, rtol=1e-3)


def by_instruments_alone(case: SelectionProblem, at: Prepared) -> SufficientStatistics:
    exactly = np.zeros(len(at.pose_repeatability))
    return blocks(case.situation, case.data.visits, at.readings, exactly)[0]


def test_place_displaces_what_a_nominal_fit_of_its_effects_leaves():
    gear = ("hysteresis@a2", "hardening@a2", "bearing_tilt@a3")
    found, at = selected(*gear), prepared(*gear)
    case, fit = found.case, found.fit
    data = by_instruments_alone(case, at)
    displaced = displaced_by_places(case, data, fit)
    assert len(displaced) < len(fit.members)
    for where, square in displaced.items():
        pairs = zip(fit.members, fit.coefficients, strict=True)
        terms = [(m, size) for m, size in pairs if m.where == where]
        own = [term.jacobian(case.situation) for term, _ in terms]
        beta = np.concatenate([size for _, size in terms])
        fold = np.zeros(len(case.split.fold), dtype=int)
        gram = normal_equations_of(data, [*own, *case.nominal], fold).gram[0]
        alone = len(beta)
        signal, cross = beta @ gram[:alone, :alone] @ beta, beta @ gram[:alone, alone:]
        taken = cross @ minimum_norm_fit(gram[alone:, alone:], cross)
        assert_allclose(square, signal - taken, rtol=1e-3)


def test_neighbouring_links_displace_each_what_either_could_take_of_the_other():
    """Their errors are nearly one motion: without either, little would be lost."""
    found, at = selected("hysteresis@a2"), prepared("hysteresis@a2")
    case = found.case
    shift = np.array([1e-3, 0.0, 0.0, 0.0, 0.0, 0.0])
    links = ("link_3", "link_4")
    both = replace(
        found.fit,
        members=tuple(ModelTerm(GeometryError(), link, np.zeros(0)) for link in links),
        coefficients=(shift, shift),
    )
    data = by_instruments_alone(case, at)
    displaced = displaced_by_places(case, data, both)
    laws = [*case.nominal, *(m.jacobian(case.situation) for m in both.members)]
    every = np.zeros(len(case.split.fold), dtype=int)
    gram = normal_equations_of(data, laws, every).gram[0]
    n, sizes = case.library.nominal, np.zeros(len(gram))
    sizes[n:] = [*shift, *shift]
    own = [np.arange(n, n + 6), np.arange(n + 6, n + 12)]
    lost = losses_without(gram, gram @ sizes, own)
    for link, alone in zip(links, lost, strict=True):
        assert displaced[link] > 1e3 * alone


def test_wave_between_visits_displaces_far_more_than_axes_that_return_ill_let_show():
    both = ("transmission_error@a3", "hysteresis@a1")
    found, at = selected(*both), prepared(*both)
    data = by_instruments_alone(found.case, at)
    displaced = displaced_by_places(found.case, data, found.fit)
    members, gains = found.fit.members, found.drop_one_gains
    shows = {m.where: gain for m, gain in zip(members, gains, strict=True)}
    assert displaced["a3"] > 8.0 * shows["a3"]
    assert displaced["a1"] < 2.0 * shows["a1"]  # a loop shows within visits


@pytest.mark.parametrize(
    ("size", "least"),
    [
        ((-1e-4, 1e-4), "hysteresis"),  # the true law has the wrong sign
        ((1e-4, -1e-4), "hysteresis"),
        ((1e-4, 1e-4), "bearing_tilt"),  # no law of one size is impossible
    ],
)
def test_of_two_laws_at_a_place_the_one_goes_that_costs_least(size, least):
    case = problem("lost_motion@a2")
    terms = (
        ModelTerm(LostMotion(), "a2", np.array([2.0])),
        ModelTerm(Hysteresis(), "a2", np.array([40.0, 0.0])),
        ModelTerm(BearingTilt(), "a2", np.zeros(1)),
    )
    sizes = (*(np.array([s]) for s in size), np.array([-1e-6, -1e-6]))
    fit = replace(fit_model(case, terms), coefficients=sizes)
    wrong = next((k for k in (0, 1) if size[k] < 0.0), 2)
    asked = Decision(terms[wrong].name, "physical", False, 1.0, 0.1, "too small")
    assert _needed_least(case, fit, asked).candidate == (least, "a2")


@pytest.mark.parametrize("offset", [9e-4, 3e-3])
def test_offset_far_above_noise_is_named_though_six_columns_do_as_well(offset):
    """The more it explains the less its form is certain; its one number stays one."""
    laws = (*FEW, GeometryError(), TransmissionError(), GravityCompensator())
    made = recording(f"encoder_offset@a4,offset_rad={offset}", poses=60)
    found = diagnose(made, arm(), laws)
    (only,) = found.named
    assert only.name == Name("encoder_offset", "a4")
    assert "geometry_error" not in {one.effect for one in only.equivalents}


def test_columns_of_a_name_s_own_place_may_do_more_of_it_than_those_of_another():
    model = selected(*TWO)
    beyond = ResidualEquations.of(model.case, model.fit)
    every = enumerate(model.fit.members)
    loop = next(k for k, m in every if m.name == ("hysteresis", "a2"))
    near, far = (
        imitated_share(beyond, model.fit, loop, where) for where in ("a2", "a6")
    )
    assert 0.5 < near <= 1.0
    assert 0.0 <= far < 0.3


@pytest.mark.parametrize("load", [True, False])
def test_name_that_a_load_found_near_it_may_be_wrong_by_is_none(load):
    """Without a load the same set keeps its slight name: its columns are exact."""
    case = build_problem(prepared(), HYPOTHESES)
    wanted = [("base_compliance", "base"), ("geometry_error", "link_1")]
    wanted += [("gravity_load", "link_2")] if load else []
    of_name = {c.name: c for c in case.library.candidates}
    found = [of_name[name] for name in wanted]
    terms = [ModelTerm(c.hypothesis, c.where, c.shapes[0]) for c in found]
    first = gate_terms(pose_statistics(case, terms))[0]
    lost = tuple(np.full_like(first.gain, size) for size in (1e3, 1.0, 1e2))
    names = tuple(wanted)
    gated = replace(first, names=names, lost=lost[: len(names)])
    slight = second_order_name(case, terms, gated)
    assert (slight is not None) == load
    if slight is not None:
        assert slight.candidate == names[1]
        assert slight.statistic == pytest.approx(1e-3)


def test_of_parts_of_a_sum_that_are_alike_one_stays():
    """Both are next to linear: readings hold the sum of their speeds, and neither."""
    ready = prepared("drift@base,x_m_per_h=2e-4,rz_rad_per_h=5e-5")
    case = build_problem(ready, (Drift(),))
    span = float(np.ptp(case.situation.recording.time))
    twice = ModelTerm(Drift(), "base", np.array([100.0, 90.0]) * span)
    model = _judged(case, (twice,), (), ())
    assert model.fit.names == {("drift", "base")}
    assert len(model.fit.members[0].shape) == 1
    speed = model.parameters[0]["x_m_per_h"]
    assert speed.low < 2e-4 < speed.high < 3e-4


def test_a_second_load_is_held_against_none_that_its_columns_were_laid_out_under():
    some, ready = (GravityLoad(), BearingTilt()), prepared("gravity_load@link_2")
    terms = [ModelTerm(some[0], where, NONE) for where in ("link_2", "link_3")]
    here = build_problem(ready, some)
    names = tuple(t.name for t in terms)
    first = gate_terms(pose_statistics(here, terms))[0]
    lost = tuple(np.full_like(first.gain, size) for size in (1e3, 1.0))
    gated = replace(first, names=names, lost=lost)
    slight = second_order_name(here, terms, gated)
    assert slight is not None
    assert slight.candidate == names[1]
    under = build_problem(ready, some, named=fit_model(here, terms[:1]))
    assert second_order_name(under, terms, gated) is None
    tilt = ModelTerm(some[1], "a3", np.zeros(1))  # gives way under what it is not
    under = build_problem(ready, some, named=fit_model(here, [tilt]))
    gated = replace(gated, names=(tilt.name, terms[1].name))
    assert second_order_name(under, [tilt, terms[1]], gated) is not None


def test_prior_of_a_load_is_the_mass_of_its_body_at_half_a_metre():
    here = prepared().situation
    sigma = GravityLoad().prior_sigma(here, "link_3")
    assert sigma.shape == (GravityLoad().jacobian(here, "link_3", NONE).columns,)
    assert_allclose(sigma, here.arm.chain.mass[2] * np.array([1.0, 0.5, 0.5]))


def test_mismatch_of_nothing_is_noise_of_either_sign():
    excess = problem().data.mismatch_of_poses
    free = problem().data.within.degrees_of_freedom.sum()
    assert abs(excess.sum()) < 0.1 * free
    assert problem(*EIGHT).data.mismatch_of_poses.sum() > 10.0 * abs(excess.sum())


def test_shapes_fitted_together_explain_more_and_stay_on_the_grid():
    case, law = problem(*EIGHT), Hardening()
    terms = []
    for where in ("a2", "a3"):
        grid = law.shapes(case.situation, where)
        terms.append(ModelTerm(law, where, grid[len(grid) // 2]))

    def gain(some: tuple[ModelTerm, ...]) -> float:
        return fit_model(case, some).gain

    after = fit_shapes(case, terms)
    assert gain(after) > gain(tuple(terms)) + 10.0
    for term in after:
        grid = law.shapes(case.situation, term.where)
        assert np.all(term.shape >= grid.min(axis=0) - 1e-12)
        assert np.all(term.shape <= grid.max(axis=0) + 1e-12)


def test_jackknife_is_the_spread_of_fits_that_leave_a_pose_out():
    rng = np.random.default_rng(0)
    x, y = rng.standard_normal((12, 5, 3)), rng.standard_normal((12, 5))
    own, asked = x.swapaxes(1, 2) @ x, np.einsum("pri,pr->pi", x, y)
    whole = np.linalg.solve(own.sum(axis=0), asked.sum(axis=0))
    score = asked - own @ whole
    moved = []
    for p in range(12):
        rest = np.arange(12) != p
        some = np.linalg.solve(own[rest].sum(axis=0), asked[rest].sum(axis=0))
        moved.append(some - whole)
    want = 11 / 12 * np.array(moved).T @ np.array(moved)
    assert_allclose(jackknife_covariance(own, score), want, rtol=1e-6)


def test_answer_of_a_whole_arm_carries_shares_open_places_and_decisions(tmp_path):
    found = answer()
    told = answer_of(found, None, "", (), 1.0, False)
    shares = [n.share for n in told.named if isinstance(n.share, float)]
    assert len(shares) == len(told.named)
    assert all(0.0 < share < 1.0 for share in shares)
    assert len(told.unexplained_places) == len(found.unexplained_places)
    write_decisions(tmp_path / DECISIONS, found.decisions)
    rows = read_table(tmp_path / DECISIONS)
    assert len(rows) == len(found.decisions)
    assert all(row["reason"] for row in rows)
    assert {f"{r['effect']}@{r['where']}" for r in rows} >= named(found)
