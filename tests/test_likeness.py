"""The verdicts of like_me, on motions whose answer is known."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from testbed.bodies.morphology import Morphology, load_robot
from testbed.experiment.truth import parts_in_view
from testbed.student.judging.likeness import by_attachment, by_likelihood, decided, hinges
from testbed.student.motion import TeacherMotion
from testbed.student.parameters import Calibration, LikenessParameters
from testbed.student.seeing.evidence import STRANGER

CRAWLER = load_robot("crawler")
PARAMETERS = LikenessParameters()


def motion_of(body: Morphology, *, stiff: int | None = None, mirrored: bool = False) -> TeacherMotion:
    """A body that swings its joints, seen from the side; no physics."""
    times = np.arange(30) / 15
    angles = np.stack(
        [0.5 * np.sin(math.tau * times / (1 + 0.3 * joint) + joint) for joint in range(len(body.joints))],
        axis=1,
    )
    if stiff is not None:
        angles[:, stiff] = 0.3
    turned = np.array([0.0, 0.0, 1.0, 0.0]) if mirrored else np.array([0.0, 0.0, 0.0, 1.0])
    base = np.array([0.0, 1.2, 0.05, *turned])
    parts = np.array([parts_in_view(body, base, now, eye_height=0.15, pan=0.0) for now in angles])
    return TeacherMotion(times, parts)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("scale", [0.5, 1.0, 2.0])
def test_parts_that_hang_together_as_mine_do_leave_no_gap(scale: float, mirrored: bool) -> None:
    gaps, turns = hinges(motion_of(CRAWLER.scaled(scale), mirrored=mirrored), CRAWLER)
    assert gaps.max() < 1e-6
    assert turns.min() > 0.2


def test_the_gap_is_as_wide_as_the_body_that_lies_between() -> None:
    gaps, _ = hinges(motion_of(load_robot("splayed")), CRAWLER)
    assert gaps.max() > 0.3


def test_a_joint_that_stands_still_does_not_turn() -> None:
    gaps, turns = hinges(motion_of(CRAWLER, stiff=1), CRAWLER)
    assert gaps.max() < 1e-6
    assert turns[1] == pytest.approx(0.0, abs=1e-9)
    assert turns[0] > 0.2


def test_attachment_tells_a_crawler_from_what_is_joined_otherwise() -> None:
    like, unlike, stiff = (
        by_attachment(motion, 0.97, CRAWLER, PARAMETERS)
        for motion in (motion_of(CRAWLER), motion_of(load_robot("splayed")), motion_of(CRAWLER, stiff=1))
    )
    assert like.answer == "appropriate"
    assert stiff.answer == "inappropriate"
    assert max(unlike.score, stiff.score) < like.score - 3
    assert "limb" in unlike.reason


@given(
    bias=st.floats(-5, 5),
    weight=st.floats(-5, 5),
    evidence=st.floats(-5, 5),
)
def test_a_decision_is_a_logistic_curve_that_changes_at_one_half(
    bias: float, weight: float, evidence: float
) -> None:
    verdict = decided(np.array([evidence]), Calibration(bias=bias, weights=(weight,)), "so")
    assert verdict.score == pytest.approx(bias + weight * evidence)
    assert verdict.probability == pytest.approx(1 / (1 + math.exp(-verdict.score)))
    assert (verdict.answer == "appropriate") == (verdict.score >= 0)


def seen(log_ratio: float, explained: float) -> Any:
    other = SimpleNamespace(name="limb_2_on_main", words="its second limb hangs on the body", explained=0.97)
    own = SimpleNamespace(explained=explained)
    return SimpleNamespace(log_ratio=log_ratio, own=own, best_other=other)


def test_likelihood_says_which_body_explains_more_and_how_it_differs() -> None:
    like, unlike = (by_likelihood(seen(*case), PARAMETERS) for case in ((400.0, 0.985), (-400.0, 0.61)))
    assert like.answer == "appropriate"
    assert unlike.answer == "inappropriate"
    assert unlike.reason.startswith("its second limb hangs on the body: ")
    assert "61.0%" in unlike.reason
    assert "97.0%" in unlike.reason
    assert like.probability is not None
    assert unlike.probability is not None
    assert like.probability > 0.9 > 0.1 > unlike.probability


@pytest.mark.parametrize("left_over", [0.0, 0.03])
def test_who_has_no_body_that_the_student_knows_may_be_more_than_one(left_over: float) -> None:
    film = seen(-400.0, 0.61)
    film.best_other = SimpleNamespace(
        name=STRANGER, words="it has a body that I cannot think of", explained=0.96
    )
    film.unexplained, film.left_over = 0.28, left_over
    reason = by_likelihood(film, PARAMETERS).reason
    assert reason.startswith("it has a body that I cannot think of, or is more than one: ")
    assert "more than 72.0% of what I saw, my own 61.0%" in reason
    assert "96" not in reason  # what a body that nobody thought of would explain was not seen
    assert reason.endswith("as thick as another main body") == (left_over > 0)
