"""Calibration against closed forms and brute force."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from testbed.experiment.calibration import calibration_error, calibration_interval, reliability


def rng() -> np.random.Generator:
    return np.random.default_rng(7)


@pytest.mark.parametrize(
    ("stated", "truth", "expected"),
    [
        ([0.5] * 4, [True, False] * 2, 0.0),
        ([1.0] * 3, [False] * 3, 1.0),
        ([0.0] * 2 + [1.0] * 2, [False, False, True, True], 0.0),
        ([0.9] * 10, [True] * 7 + [False] * 3, 0.2),
        # Two bins, three rows at .2 of which one is true, one at .8 that is false: (3 * |.2 - 1/3| + .8) / 4
        ([0.2, 0.2, 0.2, 0.8], [True, False, False, False], (3 * (1 / 3 - 0.2) + 0.8) / 4),
    ],
)
def test_the_error_of_simple_cases(stated: list[float], truth: list[bool], expected: float) -> None:
    assert calibration_error(stated, truth) == pytest.approx(expected)


def test_errors_of_opposite_sign_within_a_bin_cancel_and_between_bins_do_not() -> None:
    assert calibration_error([0.41, 0.49], [True, False], bins=10) == pytest.approx(0.05)
    assert calibration_error([0.39, 0.41], [True, False], bins=10) == pytest.approx((0.61 + 0.41) / 2)


def test_the_edges_of_bins_belong_to_the_next_bin_and_one_to_the_last() -> None:
    edges = [place / 10 for place in range(11)]
    found = reliability(edges, [True] * 11)
    assert [each.low for each in found] == pytest.approx(np.arange(10) / 10)
    assert [each.n for each in found] == [1] * 9 + [2]


@given(st.lists(st.tuples(st.floats(0, 1), st.booleans()), min_size=1, max_size=60), st.integers(1, 20))
def test_bins_hold_every_row_once_and_where_it_belongs(rows: list[tuple[float, bool]], bins: int) -> None:
    stated, truth = [each for each, _ in rows], [each for _, each in rows]
    found = reliability(stated, truth, bins)
    assert sum(each.n for each in found) == len(rows)
    assert sum(each.positives for each in found) == sum(truth)
    assert sum(each.n * each.stated for each in found) == pytest.approx(sum(stated))
    assert all(each.low - 1e-12 <= each.stated <= each.high + 1e-12 for each in found)
    error = calibration_error(stated, truth, bins)
    assert error is not None
    assert abs(np.mean(stated) - np.mean(truth)) - 1e-9 <= error <= 1


def test_without_rows_nothing_can_be_told() -> None:
    assert calibration_error([], []) is None
    assert calibration_interval([], [], [], rng()) is None
    assert calibration_interval([0.1, 0.2], [True, False], [4, 4], rng()) is None


@pytest.mark.parametrize(
    ("stated", "truth"), [([1.1], [True]), ([-0.1], [True]), ([0.5], []), ([np.nan], [True])]
)
def test_nonsense_is_refused(stated: list[float], truth: list[bool]) -> None:
    with pytest.raises(ValueError, match=r"probability|same number|finite"):
        calibration_error(stated, truth)


def test_the_interval_resamples_whole_trials() -> None:
    stated = rng().uniform(0, 1, 80)
    truth, trials = rng().random(80) < 0.5, np.repeat(np.arange(40), 2)
    got = calibration_interval(stated, truth, trials, rng())
    errors: list[float] = []
    generator = np.random.default_rng(99)
    for _ in range(1500):  # brute force
        drawn = generator.integers(40, size=40)
        chosen = np.concatenate([np.flatnonzero(trials == trial) for trial in drawn])
        errors.append(calibration_error(stated[chosen], truth[chosen]) or 0.0)
    assert got == pytest.approx(np.quantile(errors, [0.025, 0.975]), abs=0.015)


def test_copies_of_a_trial_add_no_certainty() -> None:
    stated = rng().uniform(0, 1, 30)
    truth = rng().random(30) < 0.5
    once = calibration_interval(stated, truth, np.arange(30), rng())
    copies = calibration_interval(np.tile(stated, 5), np.tile(truth, 5), np.tile(np.arange(30), 5), rng())
    assert once is not None
    assert copies == pytest.approx(once)
