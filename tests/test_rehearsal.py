"""Imitation ``rehearsed``: motions of bodies that are known, and what the student makes of them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from motion_builder import (
    CRAWL,
    CRAWLER,
    PERIOD,
    STEP,
    TIMES,
    crawling,
    gait,
    quasi_static,
    rehearsed,
)
from scipy.special import expit

from testbed.bodies.morphology import Joint, Morphology, Vector
from testbed.student.body.imagination import Imagination
from testbed.student.body.settling import Settler
from testbed.student.moving.harmonics import fit_harmonics
from testbed.student.moving.readings import correspondences, misplacement, on_branch, proportioned, readings
from testbed.student.moving.rehearsal import _Trial, rehearse
from testbed.student.moving.rehearsal_search import (
    climb,
    damped_least_squares,
    differences,
    joint_angles,
    logistic_start,
)
from testbed.student.moving.rolls import headings, roll_of, view_of
from testbed.student.parameters import ImaginationParameters, RehearsalParameters
from testbed.vision.primitives import OMEGA


def test_the_student_moves_like_one_of_its_kind() -> None:
    record = rehearsed()
    assert record.score > 0.8
    assert record.r2 > 0.9
    assert record.joint_r2.min() > 0.9
    assert record.rms < math.radians(3)
    assert record.rhythm.period == pytest.approx(PERIOD, rel=0.02)
    assert not record.mirrored
    assert record.order.tolist() == [0, 1, 2]


@pytest.mark.parametrize(("kind", "most"), [("splayed", 0.3), ("locked", 0.3), ("rigid", 0.3)])
def test_other_bodies_share_less_of_the_motion(kind: str, most: float) -> None:
    assert rehearsed(kind).score < most


def test_a_locked_joint_shows_at_that_joint_alone() -> None:
    first, second = rehearsed("locked").joint_r2
    assert first > 0.9
    assert second < 0.3


def test_a_teacher_seen_from_its_other_side_is_a_mirror_image() -> None:
    ours, theirs = rehearsed(), rehearsed("mirrored")
    assert theirs.mirrored
    assert theirs.order.tolist() == [0, 1, 2]
    assert theirs.score == pytest.approx(ours.score, abs=0.02)
    assert np.allclose(theirs.teacher_rolls, ours.teacher_rolls, atol=1e-4)


def test_the_order_of_objects_does_not_matter() -> None:
    ours, theirs = rehearsed(), rehearsed("swapped")
    assert theirs.order.tolist() == [0, 2, 1]
    assert np.allclose(theirs.teacher_rolls[:, [0, 2, 1]], ours.teacher_rolls)
    assert theirs.score == pytest.approx(ours.score, abs=0.02)


def test_the_record_tells_the_search_from_a_random_start_to_the_end() -> None:
    record = rehearsed()
    iterations = len(record.errors)
    assert record.weights.shape == (iterations, 2, 3)
    assert len(record.responses) == iterations
    assert record.responses[-1].shape == record.teacher_rolls.shape
    assert np.all(np.diff(record.errors) <= 0)
    assert record.errors[-1] < record.errors[0]
    assert np.abs(record.weights[0]).max() <= 1
    off = record.responses[-1] - record.teacher_rolls[:, record.order]
    assert record.errors[-1] == pytest.approx(float(np.sqrt(np.sum(off**2))))
    assert record.commands.shape == (RehearsalParameters().samples, 2)
    assert np.allclose(record.rhythm.at(record.times), record.teacher_rolls)


def test_the_same_seed_gives_the_same_controller() -> None:
    again = rehearse(CRAWLER, crawling(), None, RehearsalParameters(), np.random.default_rng(1))
    assert np.array_equal(again.weights, rehearsed().weights)


def test_the_final_controller_is_tried_in_the_physical_imagination() -> None:
    assert math.isnan(rehearsed().imagined_error)
    with Imagination(ImaginationParameters(), STEP) as mind:
        record = rehearse(CRAWLER, crawling(), mind, RehearsalParameters(), np.random.default_rng(1))
    assert 0 < record.imagined_error < math.radians(8)


def test_bodies_with_other_numbers_of_parts() -> None:
    data = CRAWLER.model_dump()
    data["parts"]["limb_c"] = data["parts"]["limb_b"]
    data["joints"]["joint_c"] = Joint(parent="body", child="limb_c", angle_deg=180).model_dump()
    four = Morphology.model_validate(data)
    motion = quasi_static(four, (*CRAWL, (15.0, 25.0, 200.0)))
    record = rehearse(four, motion, None, RehearsalParameters(), np.random.default_rng(1))
    assert record.weights.shape[1:] == (3, 4)
    assert record.score > 0.8
    with pytest.raises(ValueError, match="3 parts cannot imitate 4"):
        rehearse(CRAWLER, motion, None, RehearsalParameters(), np.random.default_rng(1))


def test_the_joint_angles_of_a_body_are_read_off_its_rolls() -> None:
    splayed = CRAWLER.varied(joints={"joint_b": {"parent": "body", "angle_deg": 180}})
    for body in (CRAWLER, splayed):
        wanted = gait(TIMES, CRAWL)
        bases, joints = Settler(body).follow(wanted)
        rolls = roll_of(headings(body, bases, joints), view_of(body)[0])
        assert np.allclose(joint_angles(body, rolls), wanted, atol=1e-6)


def test_rolls_are_shifted_by_whole_turns_to_where_the_body_has_them() -> None:
    rolls = crawling().parts[:, :, OMEGA] + np.array([2, -4, 6]) * math.pi
    shifted = on_branch(CRAWLER, rolls, np.arange(3))
    assert abs(shifted[:, 0].mean()) < math.pi
    assert np.abs(np.diff(shifted, axis=1)).max() < math.pi
    assert np.allclose(np.sin(shifted), np.sin(rolls))


def test_parts_stand_where_the_own_ones_would_whatever_the_size_and_place() -> None:
    motion = crawling(0.0, 1.7)
    rolls, places = motion.parts[:, :, OMEGA], motion.parts[:, :, 1:3]
    assert misplacement(CRAWLER, rolls, places + np.array([5.0, -3.0])) < 0.01
    apart = places.copy()
    apart[:, 2] += [0.3, 0.0]
    assert misplacement(CRAWLER, rolls, apart) > 0.2


def test_many_limbs_are_matched_by_positions_alone() -> None:
    assert len(correspondences(CRAWLER, np.zeros((4, 3, 2)))) == 2
    limbs = {f"limb_{i}": CRAWLER.parts["limb_a"] for i in range(6)}
    joints = {f"joint_{i}": Joint(parent="body", child=f"limb_{i}", angle_deg=60.0 * i) for i in range(6)}
    star = Morphology(name="star", parts={"body": CRAWLER.parts["body"], **limbs}, joints=joints)
    flat = view_of(star)[1]
    shuffled = np.array([0, 3, 1, 2, 6, 5, 4])
    (order,) = correspondences(star, np.stack([flat[shuffled]] * 4))
    assert order[0] == 0
    assert sorted(order) == list(range(7))
    assert np.allclose(flat[shuffled][order], flat, atol=1e-9)


def test_the_closed_form_finds_a_controller_that_exists() -> None:
    rolls = crawling(0.0).parts[:, :, OMEGA]
    true = np.array([[-1.0, 1.2, 0.1], [0.3, -0.9, 1.0]])
    limits = np.array([[-1.0, 1.5], [-1.5, 0.5]])
    low, high = limits.T
    found = logistic_start(rolls, low + (high - low) * expit(rolls @ true.T), limits)
    assert np.allclose(found, true, atol=0.05)


def test_damped_least_squares_solves_rosenbrock_and_the_hill_climber_only_descends() -> None:
    def rosenbrock(x: Vector) -> Vector:
        return np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]])

    found, left = damped_least_squares(rosenbrock, differences(rosenbrock, 1e-6), np.array([-1.2, 1.0]), 100)
    assert np.allclose(found, 1, atol=1e-2)
    assert left @ left < 1e-3
    told: list[float] = []
    start = np.array([-1.2, 1.0])
    _, left = climb(
        rosenbrock, start, 300, 0.1, np.random.default_rng(0), lambda _, r: told.append(float(r @ r))
    )
    assert len(told) == 300
    assert left @ left == min(told) < rosenbrock(start) @ rosenbrock(start)


def test_what_the_teacher_model_leaves_unexplained_counts_against_the_motion() -> None:
    record = rehearse(
        CRAWLER, crawling(), None, RehearsalParameters(), np.random.default_rng(1), explained=0.8
    )
    assert record.score == pytest.approx(rehearsed().score - 0.2)


def test_longer_limbs_are_no_other_body() -> None:
    stretched = CRAWLER.varied(parts={"limb_a": {"length": 0.15}, "limb_b": {"length": 0.28}})
    motion = quasi_static(stretched, ((10.0, 30.0, 0.0), (40.0, 25.0, 60.0)))
    likened = proportioned(CRAWLER, motion.parts, (0.5, 2.0))
    lengths = [part.length_along_x for part in likened.parts.values()]
    assert lengths == pytest.approx([0.14, 0.15, 0.28])
    ours, own = (
        rehearse(CRAWLER, motion, None, RehearsalParameters(proportions=bounds), np.random.default_rng(1))
        for bounds in ((0.5, 2.0), (1.0, 1.0))
    )
    assert ours.score > own.score + 0.02
    assert ours.misplaced < 0.02 < own.misplaced
    with pytest.raises(ValueError, match="around 1"):
        RehearsalParameters(proportions=(1.2, 2.0))


def test_the_derivatives_follow_the_joints() -> None:
    rhythm = fit_harmonics(TIMES, crawling(0.0).parts[:, :, OMEGA])
    reading = readings(CRAWLER, crawling(0.0), rhythm, 4, (1.0, 1.0))[0]
    trial = _Trial(reading, TIMES)
    weights = trial.start()
    now = trial.residual(weights)
    slow = differences(trial.residual, 1e-3)(weights, now)
    quick = trial.jacobian(weights, now)
    assert np.median(np.abs(quick - slow)) < 0.02 * np.median(np.abs(slow)) + 1e-3
    assert float(np.corrcoef(quick.ravel(), slow.ravel())[0, 1]) > 0.95
