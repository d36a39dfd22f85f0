"""Performing what was rehearsed: how it begins, how long it lasts, how far it goes."""

from __future__ import annotations

import math
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest
from motion_builder import CRAWLER, PERIOD, STEP, TIMES, crawling, mirrored, rehearsed

from testbed.bodies.morphology import Vector
from testbed.student.body.imagination import Imagination
from testbed.student.body.settling import Settler
from testbed.student.moving.performing import (
    duration,
    playback,
    practise,
    prepare,
    ramp_steps,
    size_seen,
    travel_seen,
)
from testbed.student.moving.rehearsal import RehearsalRecord, rehearse
from testbed.student.parameters import ImaginationParameters, PerformingParameters, RehearsalParameters
from testbed.vision.primitives import X


def test_playback_begins_flat_keeps_to_the_travel_and_repeats_itself() -> None:
    record, parameters = replace(rehearsed(), lag=0.03), PerformingParameters(cycles=3, seconds=60)
    commands = playback(record, STEP, parameters)
    begun = ramp_steps(parameters, STEP) - 1
    period = record.rhythm.period
    assert period is not None
    assert len(commands) == begun + round(3 * period / STEP)
    assert np.abs(commands[0]).max() < math.radians(1)
    fastest = np.abs(np.diff(commands, axis=0)).max() / STEP
    assert fastest < math.radians(300)
    assert np.all(commands >= record.limits[:, 0])
    assert np.all(commands <= record.limits[:, 1])
    cycle = round(period / STEP)
    assert np.abs(commands[begun : begun + cycle] - commands[begun + cycle : begun + 2 * cycle]).max() < 0.05


def test_a_motion_without_a_rhythm_is_performed_once() -> None:
    record = rehearsed("rigid")
    assert record.rhythm.period is None
    assert duration(record, PerformingParameters()) == pytest.approx(TIMES[-1])


def test_distance_and_size_are_read_off_the_motion_from_either_side() -> None:
    truth = crawling(0.0).parts[:, 0, X]
    cycle = truth[30] - truth[0]
    for motion in (crawling(2.0, 1.6), mirrored(crawling(2.0, 1.6))):
        record = rehearse(CRAWLER, motion, None, RehearsalParameters(), np.random.default_rng(1))
        assert size_seen(motion, record, CRAWLER) == pytest.approx(1.6)
        assert travel_seen(motion, record, CRAWLER) == pytest.approx(cycle, rel=0.1)
    assert math.isnan(travel_seen(motion, rehearsed("rigid"), CRAWLER))


def test_the_student_comes_as_far_as_its_teacher_once_it_has_practised() -> None:
    record, parameters = rehearsed(), PerformingParameters(practice=15)
    truth = crawling(0.0).parts[:, 0, X]
    wanted = float(truth[30] - truth[0])
    assert wanted > 0.02
    with Imagination(ImaginationParameters(), STEP) as mind:
        better = prepare(record, crawling(), CRAWLER, mind, STEP, parameters, np.random.default_rng(2))
        with mind.imagine(CRAWLER) as rehearsal:
            bases, _ = rehearsal.move(better.performance(STEP, parameters))
    assert 0.01 < better.lag < 0.08
    begun = ramp_steps(parameters, STEP) - 1
    per_cycle = (bases[-1, 0] - bases[begun, 0]) / ((len(bases) - begun) * STEP / PERIOD)
    assert 0.7 < per_cycle / wanted < 1.3
    assert np.array_equal(better.weights, record.weights)
    assert not np.array_equal(better.performed, record.performed)


def test_what_rolls_too_far_off_is_not_imagined_and_that_changes_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    record, parameters = replace(rehearsed(), lag=0.03), PerformingParameters(practice=10, practice_cycles=1)
    travel = travel_seen(crawling(), record, CRAWLER)
    flat = np.tile([0.0, 0, 0, 0, 0, 0, 1], (1000, 1))
    with Imagination(ImaginationParameters(), STEP) as mind, mind.imagine(CRAWLER) as rehearsal:
        moves = Mock(wraps=rehearsal.move)
        monkeypatch.setattr(rehearsal, "move", moves)

        def practised() -> Vector:
            moves.reset_mock()
            rng = np.random.default_rng(0)
            return practise(record, CRAWLER, rehearsal, travel, STEP, parameters, rng).performed

        foreseen = practised()
        assert 1 < moves.call_count <= parameters.practice
        # Whoever always foresees the same is doubted as much as it was wrong.
        monkeypatch.setattr(Settler, "follow", lambda _, targets, servos: (flat[: len(targets)], 0 * targets))
        assert np.array_equal(practised(), foreseen)
        assert moves.call_count == parameters.practice + 1
    assert not np.array_equal(foreseen, record.performed)


def test_nothing_is_practised_without_a_rhythm() -> None:
    record = rehearsed("rigid")
    with Imagination(ImaginationParameters(), STEP) as mind, mind.imagine(CRAWLER) as rehearsal:
        same = practise(
            record, CRAWLER, rehearsal, math.nan, STEP, PerformingParameters(), np.random.default_rng(0)
        )
    assert same is record


def test_asking_for_more_makes_up_for_the_servos_lag() -> None:
    record = rehearsed()
    wanted = playback(record, STEP, PerformingParameters())

    def off(led: RehearsalRecord) -> float:
        with Imagination(ImaginationParameters(), STEP) as mind, mind.imagine(CRAWLER) as rehearsal:
            _, joints = rehearsal.move(playback(led, STEP, PerformingParameters()))
        return float(np.sqrt(np.mean((joints - wanted)[60:] ** 2)))

    assert off(replace(record, lag=0.035)) < 0.3 * off(record)
