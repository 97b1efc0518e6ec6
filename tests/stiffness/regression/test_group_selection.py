"""Groups of columns are found among many, whatever their order and units."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stiffness.regression import group_selection
from stiffness.regression.group_selection import (
    MOST_SHAPES,
    GroupSelection,
    exchange_worths,
    select_groups,
)
from stiffness.regression.group_sets import (
    COMMON,
    ColumnGroup,
    FactorisedSet,
    GroupProblem,
)
from stiffness.regression.predictive_gate import UnitStatistics, gate_names

UNITS, ROWS, NOMINAL, LAWS, SHAPES = 80, 30, 3, 25, 3
TRUE = tuple(("law", str(k)) for k in (1, 4, 7, 8, 12, 13, 17, 18, 21, 24))


@cache
def columns() -> np.ndarray:
    """Laws of two columns in three shapes, which are alike; neighbours are too."""
    rng = np.random.default_rng(3)
    count = NOMINAL + 2 * LAWS * SHAPES
    x = rng.standard_normal((UNITS * ROWS, count))
    for law in range(LAWS):
        first = NOMINAL + 2 * SHAPES * law
        for shape in range(1, SHAPES):
            own = slice(first + 2 * shape, first + 2 * shape + 2)
            x[:, own] = 0.3 * x[:, own] + x[:, first : first + 2]
        if law % 2:
            x[:, first] += 1.5 * x[:, first - 2 * SHAPES]
        x[:, first] += x[:, 0]
    return x


@cache
def readings(seed: int = 0, *names: tuple[str, str]) -> np.ndarray:
    rng = np.random.default_rng(seed)
    y = rng.standard_normal(UNITS * ROWS) + columns()[:, :NOMINAL] @ [9.0, -5.0, 3.0]
    for _, law in names:
        first = NOMINAL + 2 * SHAPES * int(law) + 2 * (int(law) % SHAPES)
        y += columns()[:, first : first + 2] @ [0.5, -0.4]
    return y


def groups(order: np.ndarray | None = None) -> list[ColumnGroup]:
    every = [
        ColumnGroup(("law", str(law)), NOMINAL + 2 * (SHAPES * law + s) + np.arange(2))
        for law in range(LAWS)
        for s in range(SHAPES)
    ]
    every = [replace(group, shape_parameters=1) for group in every]
    return every if order is None else [every[k] for k in order]


def problem(y: np.ndarray, scale: np.ndarray | float = 1.0, order=None) -> GroupProblem:
    x = columns() * scale
    gram = x.T @ x
    raw, known = np.diag(gram), np.arange(NOMINAL)
    return GroupProblem.of(gram, x.T @ y, raw, known, groups(order), UNITS)


def names(case: GroupProblem, found: GroupSelection) -> list[tuple[str, str]]:
    return sorted(case.groups[k].name for k in found.groups)


def test_ten_laws_of_twenty_five_are_found_with_their_shapes():
    case = problem(readings(1, *TRUE))
    found = select_groups(case)
    assert names(case, found) == sorted(TRUE)
    for k in found.groups:
        assert k % SHAPES == int(case.groups[k].name[1]) % SHAPES


@pytest.mark.parametrize("seed", range(4))
def test_nothing_there_gives_nothing(seed):
    found = select_groups(problem(readings(seed)))
    assert found.groups == ()
    assert found.log_evidence == 0.0
    assert not any(decision.accepted for decision in found.decisions)


def test_order_of_groups_does_not_matter():
    y, order = readings(1, *TRUE), np.random.default_rng(5).permutation(LAWS * SHAPES)
    here, there = problem(y), problem(y, order=order)
    one, other = select_groups(here), select_groups(there)
    assert names(here, one) == names(there, other)
    assert_allclose(one.log_evidence, other.log_evidence, rtol=1e-9)


def test_units_of_columns_do_not_matter():
    """Radians per newton metre beside metres: twelve powers of ten."""
    y = readings(1, *TRUE)
    scale = 10.0 ** np.random.default_rng(6).uniform(-6, 6, columns().shape[1])
    here, there = problem(y), problem(y, scale)
    one, other = select_groups(here), select_groups(there)
    assert one.groups == other.groups
    assert_allclose(one.log_evidence, other.log_evidence, rtol=1e-6)


def test_start_elsewhere_ends_at_the_same_set():
    case = problem(readings(1, *TRUE))
    wrong = tuple(range(0, 60, 7))
    assert set(select_groups(case, wrong).groups) == set(select_groups(case).groups)


def test_column_that_others_make_up_adds_no_rank():
    """An offset beside six shifts and turns of the same body, say."""
    x = columns()[:, :7].copy()
    x[:, 5] = x[:, 3] - 2.0 * x[:, 4]
    own = [ColumnGroup((n, ""), np.array([k, k + 1])) for n, k in (("a", 3), ("b", 5))]
    gram = x.T @ x
    y = x @ np.array([1.0, 1.0, 1.0, 0.5, -0.5, 0.4, 0.6])
    y = y + np.random.default_rng(0).standard_normal(len(y))
    case = GroupProblem.of(gram, x.T @ y, np.diag(gram), np.arange(3), own, UNITS)
    both = FactorisedSet.of(case, (0, 1))
    assert len(both.aim) == 3
    assert select_groups(case).groups in {(0, 1), (1, 0)}
    known = x[:, :5] @ np.linalg.lstsq(x[:, :5], y)[0]
    whole = x @ np.linalg.lstsq(x, y)[0]
    first = FactorisedSet.of(case, (0,))
    assert_allclose(both.gain - first.gain, whole @ whole - known @ known, rtol=1e-6)
    for alone, rest in ((0, 1), (1, 0)):  # of either order, whatever its rank
        own = both.gain - FactorisedSet.of(case, (rest,)).gain
        assert_allclose(both.own_gain([alone]), own, rtol=1e-6)
        assert both.reduced([alone]).directions.shape == (3, 1)


@pytest.mark.parametrize("seen", [0.0, 1e-9, 1e-5, 1e-2])
def test_rank_and_own_parts_depend_on_no_order_where_only_priors_tell_columns_apart(
    seen,
):
    """Shifts of two links along parallel axes, say: units tell them apart or do not."""
    rng = np.random.default_rng(0)
    x = rng.standard_normal((UNITS * ROWS, 8))
    x[:, 5] = x[:, 2] + seen * x[:, 5]
    y = x @ np.array([0.2, 0.3, 0.4, 0.1, 0.2, 0.5, 0.3, 0.2])
    y = y + rng.standard_normal(len(y))
    gram, none = x.T @ x, np.zeros(0, dtype=int)
    own = [
        ColumnGroup(("length", "1"), np.arange(3)),
        ColumnGroup(("length", "2"), np.arange(3, 6)),
        ColumnGroup(("law", ""), np.arange(6, 8)),
    ]
    prior = np.array([1e-3, 1e-2, 1e-6, 1e-2, 1e-3, 1e-6, 0.0, 0.0]) * gram[0, 0]
    case = GroupProblem.of(gram, x.T @ y, np.diag(gram), none, own, UNITS, prior)
    rank = 8 if seen > 1e-3 else 7
    for order in ((0, 1, 2), (2, 1, 0), (1, 2, 0)):
        every = FactorisedSet.of(case, order)
        assert every.rank == rank
        for place, group in enumerate(order):
            rest = FactorisedSet.of(case, [k for k in order if k != group])
            lost = every.gain - rest.gain
            assert_allclose(every.own_gain([place]), lost, rtol=1e-6, atol=1e-6)
            assert_allclose(every.reduced([place]).worth, rest.worth, rtol=1e-9)


def test_effects_of_one_kind_share_their_rate():
    """Beside an error of one link, zeros of axes are as likely as other links' are."""
    own = [
        ColumnGroup(("link", "1"), np.array([0])),
        ColumnGroup(("link", "2"), np.array([1])),
        ColumnGroup(("zero", "1"), np.array([2]), kind="link"),
        ColumnGroup(("tilt", "1"), np.array([3])),
        ColumnGroup(("tilt", "2"), np.array([4])),
    ]
    gram, none = np.eye(5), np.zeros(0, dtype=int)
    case = GroupProblem.of(gram, np.zeros(5), np.ones(5), none, own, UNITS)
    price = case.prices([0])
    assert price[1] == price[2] < price[3] == price[4]
    assert case.price([0, 1], 2) == case.price([0, 2], 2) < case.price([0, 3], 2)


def test_a_name_has_few_shapes_at_most():
    """More of them would follow what is no law of one shape."""
    x = np.random.default_rng(3).standard_normal((400, 6))
    y = x @ np.full(6, 3.0)
    own = [ColumnGroup(("law", ""), np.array([k]), 1) for k in range(6)]
    gram, none = x.T @ x, np.zeros(0, dtype=int)
    case = GroupProblem.of(gram, x.T @ y, np.diag(gram), none, own, UNITS)
    assert len(select_groups(case).groups) == MOST_SHAPES


def test_gain_is_that_of_least_squares():
    y = readings(1, *TRUE)
    case = problem(y)
    found = select_groups(case)
    x = columns()
    owned = [groups()[k].columns for k in found.groups]
    used = np.concatenate([np.arange(NOMINAL), *owned])
    fit = x[:, used] @ np.linalg.lstsq(x[:, used], y)[0]
    bare = x[:, :NOMINAL] @ np.linalg.lstsq(x[:, :NOMINAL], y)[0]
    assert_allclose(found.gain, fit @ fit - bare @ bare, rtol=1e-9)


def test_every_name_leaves_a_decision_with_its_reason():
    found = select_groups(problem(readings(1, *TRUE)))
    every = [("law", str(k)) for k in range(LAWS)]
    assert [d.candidate for d in found.decisions] == every
    accepted = {d.candidate for d in found.decisions if d.accepted}
    assert accepted == set(TRUE)
    for decision in found.decisions:
        assert decision.accepted == (decision.statistic > decision.threshold)
        assert decision.reason


# --- The gate on units left out -------------------------------------------------------


def units(y: np.ndarray) -> UnitStatistics:
    x = columns().reshape(UNITS, ROWS, -1)
    gram = x.swapaxes(1, 2) @ x
    score = np.einsum("urc,ur->uc", x, y.reshape(UNITS, ROWS))
    fold = np.arange(UNITS) % 9 - 1
    return UnitStatistics(gram, score, fold)


def terms(*laws: int) -> list[tuple[tuple[str, str], np.ndarray]]:
    first = (NOMINAL + 2 * (SHAPES * law + law % SHAPES) for law in laws)
    return [
        (("law", str(law)), at + np.arange(2))
        for law, at in zip(laws, first, strict=True)
    ]


def test_names_that_predict_stay_and_those_that_fit_noise_go():
    laws = terms(0, 1, 2, 4, 7, 8, 10, 12)
    found = gate_names(units(readings(1, *TRUE)), np.arange(NOMINAL), laws)
    assert found.names == tuple(name for name, _ in laws if name in TRUE)
    assert [d.accepted for d in found.decisions] == [n in TRUE for n, _ in laws]


def test_one_unit_alone_carries_no_name():
    """A collision in one pose is no law of the arm."""
    y = readings().copy()
    first = terms(4)[0][1]
    y[ROWS : 2 * ROWS] += columns()[ROWS : 2 * ROWS, first] @ [20.0, 20.0]
    found = gate_names(units(y), np.arange(NOMINAL), terms(4))
    assert found.names == ()


def test_gate_does_not_depend_on_units_of_columns():
    one = units(readings(1, *TRUE))
    scale = 10.0 ** np.random.default_rng(6).uniform(-6, 6, one.score.shape[1])
    other = replace(
        one, gram=one.gram * scale * scale[:, None], score=one.score * scale
    )
    laws = terms(0, 1, 2, 4, 7, 8)
    here, there = (gate_names(u, np.arange(NOMINAL), laws) for u in (one, other))
    assert here.names == there.names
    assert_allclose(here.z, there.z, rtol=1e-5)


# --- Prior of names -------------------------------------------------------------------


def test_effect_that_one_site_has_is_likelier_at_the_others():
    """Beta-binomial: worth of the second name over that of the first, by hand."""
    case, sites = problem(readings()), LAWS
    none = case.prices([])
    first = case.prices([0])
    absent = COMMON * sites
    assert_allclose(none, np.log((sites - 1 + absent) / COMMON))
    assert_allclose(first[SHAPES:], np.log((sites - 2 + absent) / (COMMON + 1)))
    one, two = (case.price(set_, 0) for set_ in ([0], [0, SHAPES]))
    numbers = 0.5 * np.log(UNITS)  # of a shape
    assert_allclose(one, none[0] + numbers)
    assert_allclose(two - one, first[SHAPES] + numbers)


def test_rival_gains_nothing_by_what_would_come_beside_the_set_anyway():
    """A name that is missing helps with every other: it is no reason to exchange."""
    case = problem(readings(2, *TRUE))
    found = select_groups(case)
    missing, asked = TRUE[0], TRUE[5]
    short = [k for k in found.groups if case.groups[k].name != missing]
    exchanges = exchange_worths(case, short, asked, live=np.inf)
    rivals = {n: w for n, w in exchanges.worth.items() if n not in (missing, asked)}
    assert max(rivals.values()) < exchanges.worth[asked] - 50.0


def test_numbers_of_a_name_cost_half_a_logarithm_of_the_units_each():
    case = problem(readings(2, *TRUE))
    found = select_groups(case)
    exchanges = exchange_worths(case, found.groups, TRUE[3])
    costs = np.array([*exchanges.size.values()])  # two columns and one shape
    assert_allclose(costs, 1.5 * np.log(UNITS))


@pytest.mark.parametrize("seed", range(6))
def test_of_two_laws_that_do_the_same_the_first_is_found_however_sums_are_rounded(seed):
    """Another kind of processor adds up in another order, by so much."""
    rng = np.random.default_rng(seed)
    turned = columns()[:, 9:11] @ np.linalg.qr(rng.standard_normal((2, 2)))[0]
    x = np.hstack([columns()[:, :NOMINAL], columns()[:, 9:11], turned])
    y = 1e3 * columns()[:, 9:11] @ [0.5, -0.4] + readings(seed)
    x *= 1.0 + 1e-12 * rng.standard_normal(x.shape)
    twins = [
        ColumnGroup(("law", where), NOMINAL + 2 * k + np.arange(2))
        for k, where in enumerate("ab")
    ]
    gram, known = x.T @ x, np.arange(NOMINAL)
    case = GroupProblem.of(gram, x.T @ y, np.diag(gram), known, twins, UNITS)
    for start in ((), (0,)):
        assert select_groups(case, start).groups == (0,)


@pytest.mark.parametrize("seed", range(6))
def test_no_step_of_the_search_makes_a_set_of_near_multiples_worth_less(
    seed, monkeypatch
):
    """A course in time that no law follows is imitated by ever more of alike columns.

    Beside each other these columns have little more information than is counted.
    """
    rng = np.random.default_rng(seed)
    width, count = 4, 14
    base = np.linspace(-1.0, 1.0, UNITS * ROWS)[:, None] ** np.arange(1, 9)
    x = np.concatenate(
        [
            base @ rng.standard_normal((8, width))
            + 10.0 ** rng.uniform(-4.0, -2.5) * rng.standard_normal((len(base), width))
            for _ in range(count)
        ],
        axis=1,
    )
    y = 30.0 * np.sin(7.0 * base[:, 0]) + rng.standard_normal(len(base))
    own = [
        ColumnGroup(("law", str(k)), width * k + np.arange(width)) for k in range(count)
    ]
    none = np.zeros(0, dtype=int)
    case = GroupProblem.of(x.T @ x, x.T @ y, np.sum(x**2, axis=0), none, own, UNITS)
    for step in ("_pruned", "_with_exchanges", "_with_several_for_one"):
        monkeypatch.setattr(group_selection, step, never_worse(step))
    select_groups(case)


def never_worse(step: str):
    """Return a step of the search that fails where a set comes out worth less."""
    done = getattr(group_selection, step)

    def checked(case: GroupProblem, start: tuple[int, ...]) -> tuple[int, ...]:
        found = done(case, start)
        before, after = (FactorisedSet.of(case, g).worth for g in (start, found))
        assert after >= before
        return found

    return checked
