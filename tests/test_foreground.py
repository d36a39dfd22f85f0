"""One candidate among others in the same view."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from testbed.vision.camera import StereoRig
from testbed.vision.foreground import find_candidates, is_ahead, without_others

RIG = StereoRig()
DARK = 180


def bearing_of(column: float) -> float:
    return math.atan((column - RIG.width / 2) / RIG.focal)


def view(*outlines: tuple[int, int]) -> NDArray[np.uint8]:
    image = np.full((RIG.height, RIG.width), 250, np.uint8)
    for first, last in outlines:
        image[30:50, first:last] = 90
    return image


def film(*outlines: tuple[int, int]) -> NDArray[np.uint8]:
    return np.array([[view(*outlines)] * 2])


def test_who_is_alone_in_view_is_left_alone() -> None:
    frames = film((40, 60))
    behind = [math.radians(120), math.radians(-60)]
    assert without_others(frames, RIG, behind, dark_below=DARK).frames is frames
    assert without_others(frames, RIG, [], dark_below=DARK).frames is frames


@settings(max_examples=40, deadline=None)
@given(st.integers(2, 25), st.integers(1, 15), st.integers(42, 49), st.integers(51, 58), st.integers(3, 10))
def test_others_are_painted_over_and_the_candidate_is_not(
    start: int, width: int, first: int, last: int, apart: int
) -> None:
    end = min(start + width, first - apart)
    if end <= start:
        end = start + 1
    mirrored = (RIG.width - end, RIG.width - start)
    frames = film((start, end), (first, last), mirrored)
    others = [bearing_of((start + end) / 2), bearing_of(sum(mirrored) / 2)]
    alone = without_others(frames, RIG, others, dark_below=DARK)
    assert np.array_equal(alone.frames, film((first, last)))
    assert not alone.touched.any()


def test_two_that_cannot_be_parted_are_told() -> None:
    alone = without_others(film((20, 60)), RIG, [bearing_of(30)], dark_below=DARK)
    assert alone.touched.all()
    assert np.array_equal(alone.frames, film((20, 60)))


@pytest.mark.parametrize("shift", [-4, 0, 4])
def test_a_candidate_off_the_middle_is_still_the_nearest(shift: int) -> None:
    """The rig rests a little off, and the eyes see it to either side of the middle."""
    own, other = (44 + shift, 48 + shift), (80, 95)
    alone = without_others(film(own, other), RIG, [bearing_of(87)], dark_below=DARK)
    assert np.array_equal(alone.frames, film(own))


def test_whoever_is_out_of_sight_now_is_no_reason_to_touch_the_candidate() -> None:
    alone = without_others(film((40, 60)), RIG, [bearing_of(90)], dark_below=DARK)
    assert np.array_equal(alone.frames, film((40, 60)))


def test_who_stands_behind_is_found_once() -> None:
    """The sweep ends where it began: both ends show the same robot."""
    column = RIG.focal * math.tan(math.radians(20))
    left, right = (int(50 - column), int(50 - column) + 6), (int(50 + column) - 6, int(50 + column))
    views = [
        (math.radians(-160), view(left)),
        (0.0, view((45, 55))),
        (math.radians(160), view(right)),
    ]
    found = find_candidates(views, RIG, dark_below=DARK, gap=math.radians(5), narrowest=math.radians(3))
    assert len(found) == 2
    assert found[0] == pytest.approx(0, abs=0.02) or found[1] == pytest.approx(0, abs=0.02)
    behind = max(found, key=abs)
    assert abs(abs(behind) - math.pi) < 0.05


@pytest.mark.parametrize(
    ("outlines", "ahead"),
    [
        ([(45, 60)], True),  # 1 degree
        ([(60, 74)], True),  # 9 degrees
        ([(66, 80)], False),  # 12 degrees
        ([(30, 100)], False),  # partly out of view: nobody knows
        ([(0, 100)], True),  # too large for the view
        ([(0, 20), (40, 62)], True),
        ([(10, 35), (65, 90)], False),  # nobody in the middle
        ([], False),
    ],
)
def test_who_stands_straight_ahead(outlines: list[tuple[int, int]], ahead: bool) -> None:
    assert is_ahead(view(*outlines), RIG, math.radians(10), dark_below=DARK) == ahead
