"""Two students on the same teachers: exact small cases, independent oracles, and intervals that mean what they say."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from testbed.experiment.paired import holm, paired_accuracy, paired_auc
from testbed.experiment.roc import Scored, auc_difference
from testbed.experiment.statistics import auc


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def outcomes(both: int, first: int, second: int, neither: int) -> tuple[list[bool], list[bool]]:
    pairs = (
        [(True, True)] * both
        + [(True, False)] * first
        + [(False, True)] * second
        + [(False, False)] * neither
    )
    ours, theirs = zip(*pairs, strict=True)
    return list(ours), list(theirs)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 9), st.integers(0, 9), st.integers(0, 9), st.integers(1, 9))
def test_with_one_teacher_a_trial_it_is_mcnemars_exact_test(
    both: int, first: int, second: int, neither: int
) -> None:
    ours, theirs = outcomes(both, first, second, neither)
    found = paired_accuracy(ours, theirs, range(len(ours)), rng(), resamples=50)
    expected = stats.binomtest(first, first + second).pvalue if first + second else 1.0
    assert found.p_value == pytest.approx(expected)
    assert found.difference == pytest.approx(np.mean(theirs) - np.mean(ours))


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.booleans(), st.booleans(), st.integers(0, 3)), min_size=1, max_size=12))
def test_trials_are_exchanged_whole(rows: list[tuple[bool, bool, int]]) -> None:
    ours, theirs, trials = zip(*rows, strict=True)
    gains = [sum(t - o for o, t, trial in rows if trial == each) for each in sorted(set(trials))]
    flipped = [abs(sum(s * g for s, g in zip(signs, gains, strict=True))) for signs in
               itertools.product((1, -1), repeat=len(gains))]  # fmt: skip
    expected = np.mean([value >= abs(sum(gains)) for value in flipped])
    assert paired_accuracy(ours, theirs, trials, rng(), resamples=50).p_value == pytest.approx(expected)


def test_copies_of_a_teacher_within_a_trial_are_no_more_evidence() -> None:
    ours, theirs = outcomes(10, 1, 9, 5)
    once = paired_accuracy(ours, theirs, range(25), rng())
    thrice = paired_accuracy(ours * 3, theirs * 3, list(range(25)) * 3, rng())
    assert thrice.p_value == pytest.approx(once.p_value)
    assert thrice.interval == pytest.approx(once.interval)
    assert (once.n, once.trials, thrice.n, thrice.trials) == (25, 25, 75, 25)


def test_two_who_are_never_wrong_are_the_same_only_as_far_as_trials_tell() -> None:
    widths = []
    for count in (5, 50, 500):
        found = paired_accuracy([True] * count, [True] * count, range(count), rng())
        assert (found.difference, found.p_value) == (0, 1)
        assert found.interval is not None
        assert found.interval.low < 0 < found.interval.high
        widths.append(found.interval.high - found.interval.low)
    assert widths[0] > widths[1] > widths[2] > 0


def test_intervals_of_accuracy_cover_the_true_difference() -> None:
    draws, covered = rng(1), 0
    for _ in range(300):
        difficulty = draws.random(60)
        ours, theirs = (draws.random(60) < np.clip(difficulty + shift, 0, 1) for shift in (0.2, 0.35))
        found = paired_accuracy(ours, theirs, np.arange(60), draws, resamples=300)
        truth = float(np.mean(np.clip(difficulty + 0.35, 0, 1) - np.clip(difficulty + 0.2, 0, 1)))
        assert found.interval is not None
        covered += found.interval.low <= truth <= found.interval.high
    assert covered / 300 > 0.9


def world(seed: int, trials: int, skills: tuple[float, float], shared: float = 1.0) -> tuple[np.ndarray, ...]:
    """Two teachers a trial, one of each kind; two students whose errors have a part in common."""
    draws = rng(seed)
    positive = np.tile([True, False], trials)
    hard = draws.normal(size=2 * trials) * shared
    first, second = (skill * (positive - 0.5) + hard + draws.normal(size=2 * trials) for skill in skills)
    return first, second, positive, np.repeat(np.arange(trials), 2)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.integers(2, 12))
def test_areas_are_those_of_the_statistics(seed: int, trials: int) -> None:
    first, second, positive, trial = world(seed, trials, (1, 2))
    first, second = np.round(first), np.round(second)  # with ties
    found = paired_auc(first, second, positive, trial, rng(), resamples=20)
    assert found is not None
    assert found.first == pytest.approx(auc(first, positive))
    assert found.second == pytest.approx(auc(second, positive))
    assert found.difference == pytest.approx(found.second - found.first)


def test_the_interval_is_that_of_the_matched_bootstrap() -> None:
    first, second, positive, trial = world(3, 80, (0.8, 1.6))
    found = paired_auc(first, second, positive, trial, rng(1))
    other = auc_difference(Scored.of(second, positive, trial), Scored.of(first, positive, trial), rng(2))
    assert found is not None
    assert other is not None
    assert found.interval is not None
    assert found.interval == pytest.approx(other.interval, abs=0.01)


def test_a_scale_of_its_own_changes_nothing() -> None:
    first, second, positive, trial = world(5, 30, (0.8, 1.6))
    plain = paired_auc(first, second, positive, trial, rng())
    assert paired_auc(np.exp(first), 1000 * second - 7, positive, trial, rng()) == plain


def test_chance_alone_is_seldom_called_a_difference() -> None:
    values = []
    for seed in range(200):
        found = paired_auc(*world(seed, 25, (1.2, 1.2)), rng(seed), resamples=199)
        assert found is not None
        values.append(found.p_value)
    assert np.mean(np.array(values) <= 0.05) < 0.1
    assert stats.kstest(values, "uniform").pvalue > 1e-3


def test_a_better_student_is_found_and_so_is_a_worse_one() -> None:
    first, second, positive, trial = world(8, 120, (0.4, 2.5))
    found, mirrored = (
        paired_auc(*pair, positive, trial, rng()) for pair in ((first, second), (second, first))
    )
    assert found is not None
    assert mirrored is not None
    assert found.p_value < 0.001 < 0.1 < found.difference
    assert found.interval is not None
    assert found.interval.low > 0
    assert mirrored.difference == pytest.approx(-found.difference)
    assert mirrored.p_value == pytest.approx(found.p_value, abs=0.001)


def test_a_perfect_student_is_not_certain_after_few_trials() -> None:
    positive, trial = np.tile([True, False], 6), np.repeat(np.arange(6), 2)
    found = paired_auc(positive + 0.0, positive + 0.0, positive, trial, rng())
    assert found is not None
    assert found.interval is not None
    assert found.interval.low < -0.1 < 0.1 < found.interval.high
    assert found.p_value == 1


def test_what_cannot_be_compared_is_said() -> None:
    assert paired_auc([1.0, 2.0], [2.0, 1.0], [True, True], [0, 1], rng()) is None
    single = paired_auc([1.0, 2.0], [2.0, 1.0], [True, False], [0, 0], rng(), resamples=20)
    assert single is not None
    assert single.interval is None
    for wrong in (([True], [True, False], [0]), ([], [], [])):
        with pytest.raises(ValueError, match="same number"):
            paired_accuracy(*wrong, rng())
    with pytest.raises(ValueError, match="finite"):
        paired_auc([np.nan, 1.0], [1.0, 2.0], [True, False], [0, 1], rng())


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(0, 1), min_size=1, max_size=8))
def test_holms_values_reject_as_his_procedure_does(values: list[float]) -> None:
    level, rejected = 0.05, set()
    for step, place in enumerate(sorted(range(len(values)), key=values.__getitem__)):
        if values[place] > level / (len(values) - step):
            break
        rejected.add(place)
    adjusted = holm(values)
    assert {place for place, value in enumerate(adjusted) if value <= level} == rejected
    assert all(0 <= value <= 1 and value >= plain for value, plain in zip(adjusted, values, strict=True))
