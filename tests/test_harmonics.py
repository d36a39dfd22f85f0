"""The rhythm of a motion: known waves in, the same waves out."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from testbed.bodies.morphology import Vector
from testbed.student.moving.harmonics import design, fit_harmonics, unwrapped
from testbed.student.parameters import HarmonicsParameters

TIMES = np.arange(60) / 15


def waves(times: Vector, period: float) -> Vector:
    turn = 2 * math.pi * times / period
    return np.stack(
        [
            0.2 + 0.1 * np.sin(turn + 1.0),
            0.9 + 0.5 * np.sin(turn),
            -0.4 + 0.4 * np.cos(turn) + 0.15 * np.sin(2 * turn + 0.5),
        ],
        axis=1,
    )


@settings(max_examples=15, deadline=None)
@given(period=st.floats(1.3, 3.0), noise=st.floats(0.5, 3.0), seed=st.integers(0, 1000))
def test_finds_the_period_and_the_motion_between_the_frames_and_beyond_them(
    period: float, noise: float, seed: int
) -> None:
    seen = waves(TIMES, period) + np.random.default_rng(seed).normal(0, math.radians(noise), (60, 3))
    rhythm = fit_harmonics(TIMES, seen)
    assert rhythm.period == pytest.approx(period, rel=0.03)
    between = np.linspace(0, 4, 500)
    assert np.sqrt(np.mean((rhythm.at(between) - waves(between, period)) ** 2)) < math.radians(noise)
    later = np.linspace(4, 8, 500)
    assert np.sqrt(np.mean((rhythm.at(later) - waves(later, period)) ** 2)) < math.radians(3 * noise)


def test_a_few_frames_far_off_do_not_matter() -> None:
    rng = np.random.default_rng(5)
    seen = waves(TIMES, 1.9) + rng.normal(0, math.radians(1), (60, 3))
    seen[[7, 30, 31, 50]] += rng.normal(0, 0.7, (4, 3))
    rhythm = fit_harmonics(TIMES, seen)
    assert rhythm.period == pytest.approx(1.9, rel=0.02)
    assert np.sqrt(np.mean((rhythm.at(TIMES) - waves(TIMES, 1.9)) ** 2)) < math.radians(1)


def test_times_need_not_be_regular() -> None:
    times = np.sort(np.random.default_rng(2).uniform(0, 5, 60))
    assert fit_harmonics(times, waves(times, 2.2)).period == pytest.approx(2.2, rel=0.01)


def test_a_plain_sine_is_not_taken_for_half_of_a_longer_period() -> None:
    rhythm = fit_harmonics(np.arange(90) / 15, np.sin(2 * math.pi / 1.4 * np.arange(90) / 15)[:, None])
    assert rhythm.period == pytest.approx(1.4, rel=0.01)
    assert rhythm.order == 1


def test_a_triangle_gets_more_harmonics_than_a_sine() -> None:
    phase = 2 * math.pi * TIMES / 1.7
    rng = np.random.default_rng(3)
    triangle = (np.arcsin(np.sin(phase)) + rng.normal(0, math.radians(1), 60))[:, None]
    rhythm = fit_harmonics(TIMES, triangle)
    assert rhythm.order >= 3
    fine = np.linspace(0, 4, 300)
    assert np.abs(rhythm.at(fine)[:, 0] - np.arcsin(np.sin(2 * math.pi * fine / 1.7))).max() < 0.2


def test_what_does_not_repeat_itself_is_smoothed_and_held_at_its_ends() -> None:
    rng = np.random.default_rng(1)
    rolling = np.stack([3.0 * TIMES, -0.5 * TIMES], axis=1)
    rhythm = fit_harmonics(TIMES, rolling + rng.normal(0, 0.02, rolling.shape))
    assert rhythm.period is None
    assert rhythm.order == 0
    assert np.abs(rhythm.at(TIMES) - rolling).max() < 0.05
    assert np.allclose(rhythm.at(np.array([-1.0, 99.0])), rhythm.at(TIMES[[0, -1]]))


def test_noise_alone_has_no_rhythm() -> None:
    assert fit_harmonics(TIMES, np.random.default_rng(4).normal(0, 0.02, (60, 3))).period is None


@pytest.mark.parametrize("frames", [1, 2, 7])
def test_too_short_a_look_is_returned_as_it_is(frames: int) -> None:
    seen = waves(TIMES[:frames], 2.0)
    rhythm = fit_harmonics(TIMES[:frames], seen)
    assert rhythm.period is None
    assert rhythm.at(TIMES[:frames]).shape == seen.shape


def test_unwrapped_removes_jumps_by_half_and_whole_turns_and_never_passes_between_them() -> None:
    motion = waves(TIMES, 2.0)
    jumpy = motion.copy()
    jumpy[20:, 1] += math.pi
    jumpy[40:, 2] -= 2 * math.pi
    assert np.allclose(unwrapped(jumpy), motion)
    rhythm = fit_harmonics(TIMES, unwrapped(jumpy))
    fine = rhythm.at(np.linspace(0, 4, 1000))
    assert fine.max() < motion.max() + 0.1
    assert fine.min() > motion.min() - 0.1


@pytest.mark.parametrize("period", [2.0, None])
def test_a_mirrored_and_shifted_reading_is_the_mirrored_and_shifted_motion(period: float | None) -> None:
    seen = waves(TIMES, period) if period else np.cumsum(np.ones((60, 3)), axis=0) * 0.01
    rhythm = fit_harmonics(TIMES, seen)
    before = rhythm.at(TIMES).copy()
    read = rhythm.read(-1.0, np.array([math.pi, 0.0, 1.0]))
    assert np.allclose(read.at(TIMES), [math.pi, 0.0, 1.0] - before)
    assert np.allclose(rhythm.at(TIMES), before)


def test_the_design_is_orthogonal_over_whole_periods() -> None:
    waves_of = design(np.arange(60) / 60 * 2.0, 2.0, 3)
    products = waves_of.T @ waves_of
    assert np.allclose(products, np.diag([60] + [30] * 6), atol=1e-9)


def test_parameters_refuse_nonsense() -> None:
    with pytest.raises(ValueError, match="longest_share"):
        HarmonicsParameters(longest_share=1.5)
