"""Statistics against closed forms, SciPy, brute force and published values."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from testbed.experiment.statistics import (
    auc,
    auc_interval,
    bootstrap_mean,
    bootstrap_median,
    mean_sem,
    paired_test,
    share_interval,
    wilson,
)


def rng() -> np.random.Generator:
    return np.random.default_rng(7)


@pytest.mark.parametrize(
    ("successes", "n", "low", "high"),
    [
        (81, 263, 0.2553, 0.3662),  # Newcombe 1998, Statistics in Medicine 17, table I
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0000, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ],
)
def test_wilson_gives_the_published_values(successes: int, n: int, low: float, high: float) -> None:
    assert wilson(successes, n) == pytest.approx((low, high), abs=5e-5)


@given(st.integers(1, 500).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))), st.floats(0.5, 0.999))
def test_wilson_agrees_with_scipy(case: tuple[int, int], confidence: float) -> None:
    successes, n = case
    theirs = stats.binomtest(successes, n).proportion_ci(confidence, method="wilson")
    assert wilson(successes, n, confidence) == pytest.approx((theirs.low, theirs.high), abs=1e-9)


@pytest.mark.parametrize(("successes", "n"), [(0, 0), (-1, 3), (4, 3)])
def test_wilson_refuses_what_is_no_proportion(successes: int, n: int) -> None:
    with pytest.raises(ValueError, match="no proportion"):
        wilson(successes, n)


scored = st.lists(st.tuples(st.integers(-5, 5), st.booleans()), min_size=1, max_size=30)


@given(scored)
def test_auc_counts_pairs(rows: list[tuple[int, bool]]) -> None:
    positives = [score for score, truth in rows if truth]
    negatives = [score for score, truth in rows if not truth]
    pairs = [(p > n) + 0.5 * (p == n) for p in positives for n in negatives]
    expected = sum(pairs) / len(pairs) if pairs else None
    got = auc([score for score, _ in rows], [truth for _, truth in rows])
    assert got == (expected if expected is None else pytest.approx(expected))


def test_auc_is_the_mann_whitney_statistic() -> None:
    positives, negatives = rng().normal(1, 1, 40), rng().normal(0, 1, 25)
    u = stats.mannwhitneyu(positives, negatives).statistic
    area = auc(np.concatenate([positives, negatives]), [True] * 40 + [False] * 25)
    assert area == pytest.approx(u / (40 * 25))


def test_a_higher_score_means_appropriate() -> None:
    assert auc([0.9, 0.1], [True, False]) == 1.0
    assert auc([0.1, 0.9], [True, False]) == 0.0


def test_a_score_that_is_no_number_is_refused() -> None:
    with pytest.raises(ValueError, match="finite"):
        auc([0.1, math.nan], [True, False])


def test_auc_interval_resamples_whole_trials() -> None:
    scores, truths, trials = _trials(40)
    got = auc_interval(scores, truths, trials, rng(), resamples=3000)
    areas = []
    generator = np.random.default_rng(99)
    for _ in range(1500):  # brute force: draw trials, repeat their rows, take the plain AUC
        drawn = generator.integers(40, size=40)
        chosen = np.concatenate([np.flatnonzero(trials == trial) for trial in drawn])
        areas.append(auc(scores[chosen], truths[chosen]))
    assert got is not None
    assert got == pytest.approx(np.quantile(areas, [0.025, 0.975]), abs=0.015)


def test_copies_of_a_trial_add_no_certainty() -> None:
    scores, truths, trials = _trials(25)
    four_times = (np.tile(scores, 4), np.tile(truths, 4))
    once = auc_interval(scores, truths, trials, rng())
    copies = auc_interval(*four_times, np.tile(trials, 4), rng())
    mistaken = auc_interval(*four_times, np.arange(200) // 2, rng())  # as if they were independent
    assert once is not None
    assert mistaken is not None
    assert copies == pytest.approx(once)
    ratio = (once.high - once.low) / (mistaken.high - mistaken.low)
    assert ratio == pytest.approx(2, rel=0.1)  # the root of four


def test_auc_interval_covers_the_truth_about_as_often_as_it_says() -> None:
    true = stats.norm.cdf(1 / math.sqrt(2))
    hits = 0
    for seed in range(200):
        scores, truths, trials = _trials(30, seed=seed, gap=1.0)
        interval = auc_interval(scores, truths, trials, rng(), resamples=300)
        assert interval is not None
        hits += interval.low <= true <= interval.high
    assert 0.88 <= hits / 200 <= 0.99


def test_a_perfect_separation_of_few_trials_is_not_certain() -> None:
    interval = auc_interval([1, 0, 1, 0, 1, 0], [True, False] * 3, [0, 0, 1, 1, 2, 2], rng())
    assert interval == pytest.approx(wilson(3, 3))


def test_a_share_of_single_verdicts_has_the_binomials_interval() -> None:
    right = np.arange(200) < 130
    interval = share_interval(right, np.arange(200), rng(), resamples=20_000)
    assert interval == pytest.approx(stats.binom(200, 0.65).ppf([0.025, 0.975]) / 200, abs=0.006)


def test_verdicts_that_agree_within_a_trial_count_once() -> None:
    right, trials = rng().random(60) < 0.6, np.arange(60)
    once = share_interval(right, trials, rng())
    copies = share_interval(np.tile(right, 4), np.tile(trials, 4), rng())
    assert copies == pytest.approx(once)
    mistaken = wilson(4 * int(right.sum()), 240)  # as if they were independent
    assert (copies.high - copies.low) / (mistaken.high - mistaken.low) == pytest.approx(2, rel=0.1)


def test_trials_of_unequal_size_are_weighed_by_their_verdicts() -> None:
    sizes = rng().integers(1, 6, 40)
    trials = np.repeat(np.arange(40), sizes)
    right = rng().random(len(trials)) < 0.7
    generator, shares = np.random.default_rng(3), []
    for _ in range(2000):  # brute force: draw trials, take all of their verdicts
        drawn = np.concatenate([right[trials == trial] for trial in generator.integers(40, size=40)])
        shares.append(drawn.mean())
    assert share_interval(right, trials, rng()) == pytest.approx(
        np.quantile(shares, [0.025, 0.975]), abs=0.015
    )


@pytest.mark.parametrize(
    ("right", "trials"),
    [
        ([True, False, True], [4, 4, 4]),
        ([True] * 6, [0, 0, 1, 1, 2, 2]),
        ([True, False] * 3, [0, 0, 1, 1, 2, 2]),
    ],
)
def test_without_any_width_a_share_has_wilsons_interval(right: list[bool], trials: list[int]) -> None:
    assert share_interval(right, trials, rng()) == wilson(sum(right), len(right))


def test_the_interval_of_a_share_repeats_and_refuses_nonsense() -> None:
    right, trials = rng().random(30) < 0.5, np.arange(30) // 2
    assert share_interval(right, trials, rng()) == share_interval(right, trials, rng())
    for wrong in (([], []), ([True], [0, 1])):
        with pytest.raises(ValueError, match=r"no proportion|same number"):
            share_interval(*wrong, rng())


@pytest.mark.parametrize("truths", [[True, False], [True, True], []])
def test_auc_interval_of_one_trial_or_one_class_cannot_be_told(truths: list[bool]) -> None:
    assert auc_interval(list(range(len(truths))), truths, [0] * len(truths), rng()) is None


def test_resampling_repeats_with_the_seed() -> None:
    scores, truths, trials = _trials(12)
    one, two = (auc_interval(scores, truths, trials, np.random.default_rng(3)) for _ in range(2))
    assert one == two
    assert one != auc_interval(scores, truths, trials, np.random.default_rng(4), resamples=50)


def test_paired_test_agrees_with_scipy_and_the_closed_forms() -> None:
    start, end = rng().uniform(1, 2, 30), rng().uniform(0.8, 1.9, 30)
    test = paired_test(start, end, rng())
    assert test.p_value == pytest.approx(stats.wilcoxon(end, start).pvalue)
    assert test.difference == pytest.approx(np.mean(end) - np.mean(start))
    assert test.start_sem == pytest.approx(stats.sem(start))
    assert test.end_sem == pytest.approx(stats.sem(end))
    theirs = stats.bootstrap((end - start,), np.mean, method="percentile", random_state=1).confidence_interval
    assert test.difference_low == pytest.approx(theirs.low, abs=0.01)
    assert test.difference_high == pytest.approx(theirs.high, abs=0.01)


def test_an_error_fell_only_if_significantly_and_downward() -> None:
    start = np.linspace(1, 2, 20)
    assert paired_test(start, start - 0.5, rng()).fell
    assert not paired_test(start, start + 0.5, rng()).fell
    assert not paired_test(start, start, rng()).fell
    assert paired_test(start, start, rng()).p_value == 1.0


def test_a_single_pair_tells_nothing() -> None:
    test = paired_test([2.0], [1.0], rng())
    assert test.n == 1
    assert test.difference == -1.0
    assert math.isnan(test.difference_low)
    assert not test.fell


@pytest.mark.parametrize(("start", "end"), [([], []), ([1], [1, 2]), ([1, math.nan], [1, 2])])
def test_paired_test_refuses_what_is_not_paired(start: list[float], end: list[float]) -> None:
    with pytest.raises(ValueError, match=r"same number|finite"):
        paired_test(start, end, rng())


@settings(max_examples=30)
@given(st.lists(st.floats(-100, 100), min_size=2, max_size=12))
def test_the_bootstrap_of_a_mean_stays_within_the_data(values: list[float]) -> None:
    low, high = bootstrap_mean(values, rng(), resamples=200)
    assert min(values) - 1e-9 <= low <= high <= max(values) + 1e-9


def test_mean_and_sem_along_an_axis() -> None:
    curves = rng().normal(size=(30, 51))
    mean, sem = mean_sem(curves)
    assert mean == pytest.approx(curves.mean(0))
    assert sem == pytest.approx(stats.sem(curves, axis=0))
    assert np.all(np.isnan(mean_sem(curves[:1]).sem))


def _trials(count: int, seed: int = 0, gap: float = 0.8) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    generator = np.random.default_rng(seed)
    truths = np.tile([True, False], count)
    return generator.normal(truths * gap), truths, np.repeat(np.arange(count), 2)


def test_the_bootstrap_of_a_median_agrees_with_scipy() -> None:
    values = rng().normal(size=41)
    theirs = stats.bootstrap((values,), np.median, method="percentile", random_state=1).confidence_interval
    assert bootstrap_median(values, rng()) == pytest.approx((theirs.low, theirs.high), abs=0.08)
    assert math.isnan(bootstrap_median([1.0], rng()).low)
