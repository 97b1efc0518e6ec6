"""The verdict follows the proof, case by case of the format."""

from dataclasses import replace
from typing import Any

import msgspec
import numpy as np
import pytest

from bench.proof.explained_share import explained_share
from scenarios.pipelines.schema import (
    Answer,
    Called,
    Detected,
    Findings,
    Interval,
    Placed,
    Proved,
    gain_is_positive,
    verdict_of,
)
from scenarios.report.summary import narrative

GOOD = Interval(0.02, 0.01, 0.03)
ZERO = Interval(0.01, 0.0, 0.02)
WORSE = Interval(-0.02, -0.03, -0.01)


def proof(gain: Interval | None = None, angle: Interval | None = None) -> Proved:
    given: Any = {"gain_mm": gain, "gain_urad": angle}
    return Proved("mujoco", 30, **{k: v for k, v in given.items() if v is not None})


ALL_WELL = Findings(
    mismatch=True,
    named=True,
    residual_passes=True,
    proof_requested=True,
    proof=proof(GOOD),
    explained_share=Interval(0.99, 0.97, 1.0),
)
PART = replace(ALL_WELL, residual_passes=False)


@pytest.mark.parametrize(
    ("findings", "verdict"),
    [
        (replace(ALL_WELL, mismatch=False), "no_mismatch"),
        (replace(ALL_WELL, mismatch=False, named=False, proof=None), "no_mismatch"),
        (replace(ALL_WELL, named=False), "unexplained"),
        (replace(ALL_WELL, named=False, proof=None), "unexplained"),
        (replace(ALL_WELL, named=False, proof=proof(WORSE)), "unexplained"),
        (replace(ALL_WELL, proof=None), "unproved"),
        (replace(ALL_WELL, proof=proof(ZERO)), "unproved"),
        (replace(ALL_WELL, proof=proof(WORSE)), "unproved"),
        (replace(ALL_WELL, proof=proof()), "unproved"),
        (replace(ALL_WELL, proof=proof(angle=ZERO)), "unproved"),
        (replace(ALL_WELL, proof=proof(ZERO, angle=GOOD)), "unproved"),
        (replace(PART, proof=proof(WORSE)), "unproved"),
        (ALL_WELL, "explained"),
        (replace(ALL_WELL, proof=proof(angle=GOOD)), "explained"),
        (replace(ALL_WELL, explained_share=None), "explained"),
        (PART, "explained"),
        (replace(PART, explained_share=Interval(0.98, 0.95, 1.0)), "explained"),
        (replace(PART, explained_share=Interval(0.97, 0.96, 1)), "partly_explained"),
        (replace(PART, explained_share=Interval(0.99, 0.94, 1)), "partly_explained"),
        (replace(PART, explained_share=None), "partly_explained"),
        (replace(ALL_WELL, proof_requested=False, proof=None), "explained"),
        (
            replace(PART, proof_requested=False, proof=None, explained_share=None),
            "partly_explained",
        ),
    ],
)
def test_verdict_is_the_first_that_holds(findings, verdict):
    assert verdict_of(findings) == verdict


def test_nothing_is_explained_where_the_gain_may_be_zero():
    for gain in (ZERO, WORSE, Interval(0.0, None, None), Interval(0.01, "x", "y")):
        assert not gain_is_positive(proof(gain))
        assert verdict_of(replace(ALL_WELL, proof=proof(gain))) == "unproved"


def test_explained_share_is_what_noise_does_not_explain():
    """(before² - after²) / (before² - noise²) over groups of any size."""
    random = np.random.default_rng(0)
    count = random.integers(5, 30, 40).astype(float)
    noise = count * random.uniform(0.9, 1.1, 40)
    before, after = noise + 9.0 * count, noise + 1.8 * count
    share = explained_share(before, after, noise, count)
    assert share is not None
    assert share.estimate == pytest.approx(0.8)
    assert share.low <= share.estimate <= share.high


def test_no_share_is_given_of_a_mismatch_that_noise_could_have_made():
    random = np.random.default_rng(0)
    count = np.full(30, 10.0)
    noise, before = count, count * random.uniform(0.5, 1.6, 30)
    assert explained_share(before, before, noise, count) is None
    assert explained_share(before[:1], before[:1], noise[:1], count[:1]) is None


def test_share_covers_the_truth_at_its_level():
    """95 % of 200 draws of 30 poses; 0.90 to 0.99 is what 200 allow."""
    random, hits = np.random.default_rng(1), 0
    for _ in range(200):
        count = np.full(30, 36.0)
        size = random.gamma(2.0, 2.0, 30)  # mismatch of each pose over noise
        noise = count.copy()
        before = random.chisquare(36, 30) + count * size
        after = random.chisquare(36, 30) + count * 0.1 * size
        share = explained_share(before, after, noise, count)
        assert share is not None
        hits += share.low <= 0.9 <= share.high
    assert 0.90 <= hits / 200 <= 0.99


# --- Sentences beside their numbers ---------------------------------------------------

SURE = ("explained", "above 0.999", "What:")
"""Words that claim more than a gain that may be zero allows."""


def said(gain: Interval | None, split_share: float | None = None) -> str:
    """Return the narrative of one name at 0.9999, with its proof."""
    share = {} if split_share is None else {"split_share": split_share}
    proved = None if gain is None else replace_folds(proof(gain), split_share)
    explained = Interval(0.99, 0.97, 1.0)
    verdict = verdict_of(replace(ALL_WELL, proof=proved, explained_share=explained))
    return "\n".join(
        narrative(
            Answer(
                schema=1,
                recording="by hand",
                verdict=verdict,
                detection=Detected(0.0002, 0.03, 0.01, 0.005),
                located=(Placed("a2", 0.0002, 1.0, (), "", **share),),
                explained_share=explained,
                named=(Called("hysteresis", "a2", 0.9999, (), {}, 0.9, **share),),
                rivals=(),
                unexplained=None,
                confounded=(),
                warnings=(),
                proof_requested=True,
                proof=proved,
                next_experiments=(),
                seconds=1.0,
            )
        )
    )


def replace_folds(proved: Proved, split_share: float | None) -> Proved:
    return proved if split_share is None else msgspec.structs.replace(proved, folds=5)


@pytest.mark.parametrize("split_share", [None, 0.6, 1.0])
@pytest.mark.parametrize(
    "gain", [None, ZERO, WORSE, Interval(0.0176, -0.0176, 0.056), GOOD]
)
def test_no_sentence_contradicts_its_number(gain, split_share):
    text = said(gain, split_share)
    if gain is not GOOD:
        assert "unproved" in text and "not proved" in text.lower()
        assert not any(word in text for word in SURE)
    elif split_share == 0.6:
        assert "in 60% of the splits" in text and "above 0.999" not in text
    else:
        assert "explained" in text and "above 0.999" in text
    if split_share == 1.0:
        assert "in every split" in text
    if split_share is not None and gain is not None:
        assert "each kept back once from one of 5 fits" in text
