"""How answers to blind trials are marked, and what rates follow."""

from dataclasses import replace

import pytest

from bench.effects.hysteresis_many import ManyContacts
from scenarios.studies.blind_trials.rates import (
    BINS,
    MARKS,
    PairedRate,
    bars,
    calibration,
    confusion,
    failures,
    paired_rates,
)
from scenarios.studies.blind_trials.score import covered_by, score_answer
from scenarios.studies.blind_trials.strata import BARS, STRATA, USUAL

NO_MISMATCH = {"verdict": "no_mismatch", "seconds": 1.0}

# --- Marking -------------------------------------------------------------------------


def truth_of(*names, stratum="one_400", mechanism="X", **parameters):
    effects = [
        {
            "effect": name.partition("@")[0],
            "where": name.partition("@")[2],
            "parameters": parameters,
            "mechanism": mechanism,
        }
        for name in names
    ]
    return {"stratum": stratum, "effects": effects, "chi2": [450.0] * len(names)}


def named(name, *equivalents, probability=0.99, **parameters: tuple[float, float]):
    def at(text):
        effect, _, where = text.partition("@")
        return {"effect": effect, "where": where}

    stated = {
        k: {"estimate": (low + high) / 2, "low": low, "high": high}
        for k, (low, high) in parameters.items()
    }
    return at(name) | {
        "probability": probability,
        "equivalents": [at(e) for e in equivalents],
        "parameters": stated,
    }


def answer_of(*entries, verdict="explained", located="a2"):
    return {
        "verdict": verdict,
        "located": [{"where": located}],
        "named": list(entries),
        "rivals": [],
        "seconds": 2.0,
    }


def marks(answer, truth):
    found = score_answer("one_400 0", "x", answer, truth)
    names = ("detected", "place_first", "right", "exact", "whole_set", "wrong_name")
    return {n for n in (*names, "abstains", "told_apart") if getattr(found, n)}


TRUE, OTHER = "hysteresis@a2", "lost_motion@a2"


def test_outliers_and_mistakes_of_the_set_up_are_listed_or_not():
    far = [{"pose": 3, "marker": "flange_a", "size_mm": 4.0}] * 3
    truth = truth_of(TRUE, stratum="outliers") | {"outliers": far[:2]}
    right = answer_of(named(TRUE))
    for count, listed in ((0, False), (1, False), (2, True), (3, False)):
        answer = right | {"outliers": far[:count]}
        assert score_answer("", "", answer, truth).listed is listed
    truth = truth_of(TRUE, stratum="mistaken_relative")
    truth |= {"mistake": {"axis_zero": "a3"}}
    said = {"warnings": [{"code": "axis_zero", "where": "a3"}]}
    assert score_answer("", "", answer_of() | said, truth).listed
    assert not score_answer("", "", right | said, truth).listed
    assert not score_answer("", "", answer_of(), truth).listed
    beyond = "'a3_deg': 190° is beyond the limits of 'a3', -120 to 156°"
    refused = f"{beyond}; all rows are inside counted from another zero (-90°)."
    assert score_answer("", "", {"failed": refused}, truth).listed
    assert not score_answer("", "", {"failed": f"{beyond}."}, truth).listed


ALL_RIGHT = {"detected", "place_first", "right", "exact", "whole_set", "told_apart"}


@pytest.mark.parametrize(
    ("answer", "expected"),
    [
        (answer_of(named(TRUE)), ALL_RIGHT),
        (answer_of(named(TRUE, OTHER)), ALL_RIGHT - {"told_apart"}),
        (
            answer_of(named(OTHER, "creep@a2", TRUE)),
            {"detected", "place_first", "right", "whole_set"},
        ),
        (
            answer_of(named(OTHER, "x@a1", "y@a1", "z@a1", TRUE)),
            "fourth does not count",
        ),
        (answer_of(named("hysteresis@a3"), located="a3"), {"detected", "wrong_name"}),
        (
            answer_of(named(TRUE), named("creep@a4")),
            {"detected", "place_first", "right", "wrong_name", "told_apart"},
        ),
        (answer_of(verdict="unexplained"), {"detected", "place_first", "abstains"}),
        (NO_MISMATCH, set()),
        ({"failed": "Unusable"}, set()),
    ],
)
def test_answer_is_marked_by_the_rules(answer, expected):
    if expected == "fourth does not count":
        expected = {"detected", "place_first", "wrong_name"}
    assert marks(answer, truth_of(TRUE)) == expected


def test_two_names_cannot_both_stand_for_one_effect():
    truth = truth_of(TRUE, "creep@a4", stratum="two_400")
    both = answer_of(named(OTHER, TRUE, "creep@a4"), named("hardening@a2", TRUE))
    assert "whole_set" in marks(both, truth)
    twice = answer_of(named(TRUE, "creep@a4"), named("hardening@a1"))
    assert "right" in marks(twice, truth)
    assert "whole_set" not in marks(twice, truth)


@pytest.mark.parametrize(
    ("rival", "true"),
    [
        ((TRUE, "creep@a4"), True),  # the false name for a true one
        ((TRUE, "creep@a3"), False),  # for another false one
        (("hardening@a1", "creep@a4"), False),  # the true name for another true one
        ((TRUE, "hardening@a1", "creep@a4"), True),  # one true name more
    ],
)
def test_a_rival_is_true_where_what_it_brings_is_and_what_it_replaces_is_not(
    rival, true
):
    truth = truth_of(TRUE, "creep@a4", "play@a6")

    answer = answer_of(named(TRUE), named("hardening@a1"))
    effects = [dict(zip(("effect", "where"), n.split("@"), strict=True)) for n in rival]
    answer["rivals"] = [{"probability": 0.3, "effects": effects}]
    *names, one = score_answer("arm_6 0", "x", answer, truth).stated
    assert [hit for _, hit in names] == [True, False]
    assert one == (0.3, true)


def test_any_name_for_a_nameless_mechanism_is_wrong():
    truth = truth_of("softening@a2", stratum="outside")
    assert "wrong_name" in marks(answer_of(named("hardening@a2")), truth)
    assert "abstains" in marks(answer_of(verdict="unexplained"), truth)


def test_interval_counts_only_for_the_true_name_and_the_same_law():
    entry = named(TRUE, width_rad=(1e-4, 2e-4), order=(2.0, 2.0))
    (effect,) = truth_of(TRUE, width_rad=1.5e-4, order=2)["effects"]
    (found,) = covered_by([entry], effect)
    assert found.parameter == "hysteresis.width_rad"
    assert found.holds
    (outside,) = covered_by([entry], effect | {"parameters": {"width_rad": 3e-4}})
    assert not outside.holds
    assert covered_by([entry], effect | {"where": "a3"}) == []
    assert covered_by([entry], effect | {"mechanism": ManyContacts.__name__}) == []


def test_phase_counts_round_the_circle_and_with_the_sign_of_its_wave():
    (effect,) = truth_of("transmission_error@a2", amplitude_rad=1e-4, phase_rad=3.1)[
        "effects"
    ]
    name = "transmission_error@a2"
    near = named(name, amplitude_rad=(0.9e-4, 1.1e-4), phase_rad=(-3.3, -3.1))
    turned = named(name, amplitude_rad=(-1.1e-4, -0.9e-4), phase_rad=(-0.1, 0.1))
    for stated in (near, turned):
        found = covered_by([stated], effect)
        assert [one.holds for one in found] == [True, True]


# --- Rates ---------------------------------------------------------------------------


def scores():
    """Nine right answers and a wrong one, nulls of which one alarms."""
    right = answer_of(named(TRUE, probability=0.98, width_rad=(1e-4, 2e-4)))
    wrong = answer_of(named("creep@a2", probability=0.96))
    truth = truth_of(TRUE, width_rad=1.5e-4)
    found = [score_answer(f"one_400 {k}", f"n{k}", right, truth) for k in range(9)]
    found.append(score_answer("one_400 9", "n9", wrong, truth))
    nothing = truth_of(stratum="null")
    found += [
        score_answer(f"null {k}", f"m{k}", NO_MISMATCH, nothing) for k in range(4)
    ]
    return [
        *found,
        score_answer("null 4", "m4", answer_of(verdict="unexplained"), nothing),
    ]


def test_rates_have_the_intervals_of_clopper_and_pearson():
    rates = {r.what: r for r in bars(scores())}
    right = rates["right: one_400"]
    assert (right.successes, right.trials, right.met) == (9, 10, False)
    assert right.low == pytest.approx(0.5550, abs=5e-5)  # Clopper and Pearson 1934
    assert right.high == pytest.approx(0.9975, abs=5e-5)
    alarms = rates["detected: null and null_nuisance"]
    assert (alarms.successes, alarms.trials, alarms.met) == (1, 5, False)
    assert rates["detected: one_400"].met
    assert rates["detected: one_100"].value is None
    assert rates["intervals that hold their parameter"].trials == 9


def test_stable_names_of_few_poses_are_counted_and_what_is_said():
    truth = truth_of(TRUE)
    answers = [
        answer_of(named(TRUE) | {"split_share": 1.0}),
        answer_of(named("creep@a2") | {"split_share": 0.9}),
        answer_of(named("creep@a2") | {"split_share": 0.8}),
        answer_of(verdict="unexplained"),
    ]
    found = [
        score_answer(f"one_400 {k}", f"n{k}", answer, truth)
        for k, answer in enumerate(answers)
    ]
    rates = {r.what: r for r in bars(found)}
    stable = rates["names of 90% of the splits true"]
    assert (stable.successes, stable.trials, stable.met) == (1, 2, False)
    large = rates["effects with a χ² of 400 or more said"]
    assert (large.successes, large.trials) == (1, 4)
    assert "names of 90% of the splits true" not in {r.what for r in bars(scores())}


def test_noise_statements_are_held_against_the_same_trial_with_true_noise():
    truth = {
        name: truth_of(TRUE, stratum=name) for name in ("one_mark", "one_mark_small")
    }
    right, none = answer_of(named(TRUE)), answer_of(verdict="unexplained")
    answers = [("one_mark", 0, right), ("one_mark", 1, right), ("one_mark", 2, none)]
    answers += [("one_mark_small", 0, right), ("one_mark_small", 1, none)]
    answers += [("one_mark_small", 2, right)]
    found = [score_answer(f"{s} {k}", f"{s}{k}", a, truth[s]) for s, k, a in answers]
    rates = {r.what: r for r in bars(found)}
    kept = rates["right of those right with the true noise: one_mark_small"]
    assert (kept.successes, kept.trials) == (1, 2)


def test_same_trials_of_two_runs_are_compared_by_those_that_differ():
    """Seven lost and none gained are surely fewer, by 2 × 2^-7; one is not."""
    right, wrong = (s for s in scores() if s.label in ("one_400 0", "one_400 9"))

    def found(lost: int, gained: int) -> PairedRate:
        now = [wrong] * lost + [right] * (100 - lost)
        now = [replace(s, label=f"one_400 {k}") for k, s in enumerate(now)]
        missed = range(lost, lost + gained)
        before = [
            {"trial": s.label, **dict.fromkeys(MARKS, "0" if k in missed else "1")}
            for k, s in enumerate(now)
        ]
        rows = paired_rates(now, before[:-1])
        (row,) = [r for r in rows if r.mark == "right"]
        assert (row.trials, row.lost, row.gained) == (99, lost, gained)
        assert (row.before, row.after) == (99 - gained, 99 - lost)
        return row

    assert found(7, 0).p_value == pytest.approx(2.0**-6)
    assert not found(7, 0).met
    assert found(1, 0).met and found(5, 5).met
    assert not found(6, 3).met  # three in a hundred fewer
    assert found(0, 9).met


def test_failures_are_those_that_speak_against_a_bar():
    assert [s.label for s in failures(scores())] == ["one_400 9", "null 4"]
    refused = replace(
        scores()[0], stratum="mistaken_relative", failed="Unusable", listed=True
    )
    assert failures([refused]) == []
    assert failures([replace(refused, listed=False)]) != []


def test_confusion_counts_every_trial_once_and_calibration_every_statement():
    matrix = confusion(scores())
    assert sum(row["trials"] for row in matrix) == 15
    mistaken = [row for row in matrix if row["answer"] == "creep"]
    assert [(row["truth"], row["trials"]) for row in mistaken] == [("hysteresis", 1)]
    (row,) = calibration(scores())
    assert (row["from"], row["to"], row["statements"]) == (0.95, 0.99, 10)
    assert row["true"] == 0.9
    assert BINS[0] == 0.0 and BINS[-1] == 1.0


def test_every_bar_is_of_a_kind_and_a_mark_that_exist():
    found = scores()[0]
    for bar in BARS:
        assert set(bar.strata) <= set(STRATA)
        assert isinstance(getattr(found, bar.mark), bool)
    assert {name for bar in BARS for name in bar.strata} >= set(USUAL)
