"""ROC curves and their differences against closed forms and brute force."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from testbed.experiment.roc import Scored, auc_difference, roc_points
from testbed.experiment.statistics import auc, wilson


def rng() -> np.random.Generator:
    return np.random.default_rng(7)


def scored(gap: float, trials: int = 30, seed: int = 0, noise: np.ndarray | None = None) -> Scored:
    """A positive and a negative in each trial."""
    truth = np.tile([True, False], trials)
    drawn = np.random.default_rng(seed).normal(size=2 * trials) if noise is None else noise
    return Scored.of(drawn + gap * truth, truth, np.repeat(np.arange(trials), 2))


@given(st.lists(st.tuples(st.integers(-3, 3), st.booleans()), min_size=2, max_size=40))
def test_the_area_below_the_curve_is_the_auc(rows: list[tuple[int, bool]]) -> None:
    scores, truth = [score for score, _ in rows], [each for _, each in rows]
    assume(0 < sum(truth) < len(truth))
    alarms, hits = roc_points(scores, truth)
    assert (alarms[0], hits[0], alarms[-1], hits[-1]) == (0, 0, 1, 1)
    assert np.all(np.diff(alarms) >= 0)
    assert np.all(np.diff(hits) >= 0)
    assert np.trapezoid(hits, alarms) == pytest.approx(auc(scores, truth))


def test_points_of_the_curve_are_rates_above_thresholds() -> None:
    scores, truth = np.array([3.0, 2, 2, 1, 0]), np.array([True, True, False, False, True])
    alarms, hits = roc_points(scores, truth)
    assert alarms == pytest.approx([0, 0, 0.5, 1, 1])
    assert hits == pytest.approx([0, 1 / 3, 2 / 3, 2 / 3, 1])


@pytest.mark.parametrize("truth", [[True, True], [False, False], []])
def test_a_curve_needs_both_classes(truth: list[bool]) -> None:
    with pytest.raises(ValueError, match="both classes"):
        roc_points(range(len(truth)), truth)


def test_the_interval_of_a_difference_draws_the_same_trials_for_both() -> None:
    noise = rng().normal(size=60)
    one, other = scored(1.0, noise=noise), scored(0.6, noise=noise + 0.3 * rng().normal(size=60))
    found = auc_difference(one, other, rng())
    gaps, generator = [], np.random.default_rng(5)
    for _ in range(1500):  # brute force
        drawn = generator.integers(30, size=30)
        rows = np.concatenate([[2 * trial, 2 * trial + 1] for trial in drawn])
        areas = [auc(side.scores[rows], side.positive[rows]) for side in (one, other)]
        gaps.append(areas[0] - areas[1])  # type: ignore[operator]
    assert found is not None
    assert found.n == 30
    assert found.value == auc(one.scores, one.positive) - auc(other.scores, other.positive)  # type: ignore[operator]
    assert found.interval == pytest.approx(np.quantile(gaps, [0.025, 0.975]), abs=0.015)


def test_matched_trials_tell_more_than_unmatched_ones() -> None:
    noise = rng().normal(size=80)
    one, alike = scored(1.0, 40, noise=noise), scored(0.8, 40, noise=noise)
    other = scored(0.8, 40, noise=rng().permutation(noise))
    widths = []
    for against in (alike, other):
        found = auc_difference(one, against, rng())
        assert found is not None
        assert found.interval is not None
        widths.append(found.interval.high - found.interval.low)
    assert widths[0] < 0.5 * widths[1]


def test_a_difference_changes_its_sign_with_the_sides() -> None:
    one, other = scored(1.0), scored(0.5, seed=1)
    here, there = auc_difference(one, other, rng()), auc_difference(other, one, rng())
    assert here is not None
    assert there is not None
    assert here.value == -there.value
    assert here.interval == pytest.approx([-end for end in reversed(there.interval)])  # type: ignore[arg-type]


def test_two_perfect_separations_of_few_trials_are_not_certainly_alike() -> None:
    found = auc_difference(scored(99.0, 24), scored(99.0, 24, seed=1), rng())
    low, high = wilson(24, 24)
    assert found is not None
    assert found.value == 0
    assert found.interval == pytest.approx((-(high - low), high - low))


def test_one_perfect_separation_keeps_the_doubt_about_itself() -> None:
    other = scored(1.0, 24)
    found = auc_difference(scored(99.0, 24), other, rng())
    assert found is not None
    assert found.interval is not None
    assert found.interval.low < found.value < found.interval.high
    doubt = 1 - wilson(24, 24).low
    assert found.value - found.interval.low >= doubt
    assert found.interval.high <= 1


def test_only_common_trials_are_compared() -> None:
    one, other = scored(1.0, 30), scored(1.0, 12)
    shorter = Scored(one.scores[:24], one.positive[:24], one.trials[:24])
    assert auc_difference(one, other, rng()) == auc_difference(shorter, other, rng())
    apart = Scored(other.scores, other.positive, other.trials + 100)
    assert auc_difference(one, apart, rng()) is None


def test_a_single_common_trial_has_no_interval() -> None:
    found = auc_difference(scored(1.0, 1), scored(0.5, 1), rng())
    assert found is not None
    assert found.interval is None


def test_scores_of_unequal_number_are_refused() -> None:
    with pytest.raises(ValueError, match="same number"):
        Scored.of([1.0], [True, False], [0, 0])
