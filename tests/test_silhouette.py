"""Silhouettes: exact coverage against the ray kernel and against closed forms; darkness against what it was made of."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from matplotlib.path import Path
from matplotlib.transforms import Bbox
from numpy.typing import NDArray

from testbed.student.parameters import SilhouetteParameters
from testbed.student.seeing._plan import row_ends
from testbed.vision._spans import add_outline, clear
from testbed.vision.camera import StereoRig
from testbed.vision.kernel import render
from testbed.vision.silhouette import coverage, darkness

RIG = StereoRig()
FINE = 16


def supersampled(parts: NDArray[np.float64]) -> NDArray[np.float64]:
    """Coverage by the ray kernel on a rig with FINE x FINE as many pixels."""
    fine = StereoRig(RIG.width * FINE, RIG.height * FINE, RIG.field_of_view, RIG.baseline)
    seen = render(parts, fine) < 255
    share: NDArray[np.float64] = seen.reshape(2, RIG.height, FINE, RIG.width, FINE).mean((2, 4))
    return share


part = st.tuples(
    st.sampled_from([0, 1, 2]),
    st.floats(-0.35, 0.35),
    st.floats(-0.25, 0.25),
    st.floats(0.8, 1.6),
    st.floats(-4.0, 4.0),
    st.floats(0.03, 0.15),
    st.floats(0.03, 0.15),
    st.floats(0.02, 0.10),
)


def row(
    shape: int, x: float, y: float, z: float, omega: float, a: float, b: float, c: float
) -> NDArray[np.float64]:
    sizes = {0: (a, b, c), 1: (a / 2, 0.0, 0.0), 2: (c / 4, a, 0.0)}[shape]
    return np.array([[shape, x, y, z, omega, *sizes]])


@settings(max_examples=40, deadline=None)
@given(part)
@example((0, 0.0, 0.15, 1.474609375, 0.0, 0.140625, 0.078125, 0.0231))
@example((2, 0.25, 0.25, 0.875, -1.0, 0.125, 0.125, 0.09375))
def test_one_part_covers_what_rays_meet(numbers: tuple[float, ...]) -> None:
    model = row(int(numbers[0]), *numbers[1:])
    ours, theirs = coverage(model, RIG), supersampled(model)
    # Edges that lie along rows of rays are off by up to one row of sixteen; polygons cut round caps a little.
    assert np.abs(ours - theirs).max() < 0.2
    assert ours.sum() == pytest.approx(theirs.sum(), rel=0.04, abs=2.0)


def shared_area(corners: NDArray[np.float64], u: int, v: int) -> float:
    """How much of pixel (u, v) a polygon (n, 2) covers, cut by another library."""
    outline = Path(np.concatenate([corners, corners[:1]]))
    x, y = np.asarray(outline.clip_to_bbox(Bbox.from_extents(u, v, u + 1, v + 1)).vertices).T
    return float(0.5 * abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))))


corner = st.one_of(st.floats(-9, 15), st.integers(-9, 15).map(float))


@settings(max_examples=200, deadline=None)
@given(st.lists(st.tuples(corner, corner), min_size=3, max_size=3))
@example([(0.0, 1.0), (0.0, 1e-313), (1.0, 0.0)])
def test_an_image_shows_exactly_its_share_of_an_outline(triangle: list[tuple[float, float]]) -> None:
    height, width = 5, 6
    corners = np.array(triangle)
    area, cover = np.zeros((height, width + 2)), np.zeros((height, width))
    rows = row_ends(height, width)
    blank = np.zeros((height, width), np.float32)
    px, py = corners.T.copy()
    change = add_outline(px, py, 3, blank, area, cover, rows, True)
    expected = [[shared_area(corners, u, v) for u in range(width)] for v in range(height)]
    np.testing.assert_allclose(cover, expected, rtol=0, atol=1e-9)
    assert change == pytest.approx(np.sum(cover**2))
    clear(cover, rows)
    assert not cover.any()
    assert not area.any()


def test_overlapping_parts_cover_no_more_than_once() -> None:
    model = np.array([[0, 0.0, 0.1, 1.0, 0.0, 0.14, 0.11, 0.05], [2, 0.1, 0.1, 1.0, 0.4, 0.01, 0.2, 0.0]])
    once, twice = coverage(model, RIG), coverage(np.concatenate([model, model]), RIG)
    np.testing.assert_array_equal(once, twice)
    assert twice.max() <= 1.0
    assert np.abs(once - supersampled(model)).mean() < 2e-3


def test_a_plate_covers_its_exact_area_wherever_it_lies() -> None:
    pixel = 1.0 / RIG.focal
    for shift in (0.0, 0.13, 0.5, 0.77):
        plate = np.array([[0, shift * pixel, 0.3 * pixel, 1.0, 0.31, 10 * pixel, 1e-9, 3 * pixel]])
        assert coverage(plate, RIG).sum((1, 2)) == pytest.approx([30.0, 30.0], rel=1e-6)


def test_a_ball_off_the_axis_is_an_ellipse() -> None:
    x, y, z, r = 0.2, -0.15, 1.0, 0.05
    image = coverage(np.array([[1, x, y, z, 0, r, 0, 0]]), StereoRig(baseline=0.0))[0]
    distance = math.sqrt(x * x + y * y + z * z)
    # The image of a ball is a conic; its area follows from the cone's half-angle and the axis' slant.
    half = math.asin(r / distance)
    slant = z / distance
    area = (
        math.pi
        * math.sin(half) ** 2
        * math.cos(half)
        / (slant**2 - math.sin(half) ** 2) ** 1.5
        * RIG.focal**2
    )
    assert image.sum() == pytest.approx(area, rel=5e-3)


def test_coverage_grows_smoothly_with_every_shift() -> None:
    shifts = np.linspace(0, 2 / RIG.focal, 81)
    left_half = [
        coverage(np.array([[2, shift, 0.05, 1.0, 0.02, 0.01, 0.2, 0.0]]), RIG)[0, :, :50].sum()
        for shift in shifts
    ]
    steps = np.diff(left_half)
    assert np.all(steps < 0)
    assert np.ptp(steps) < 0.3 * np.abs(steps).mean() + 0.05


def test_what_lies_behind_the_eyes_covers_nothing() -> None:
    model = np.array([[s, 0.0, 0.0, -1.0, 0.3, 0.1, 0.1, 0.1] for s in (0, 1, 2)])
    assert coverage(model, RIG).sum() == 0.0


def test_no_model_is_refused() -> None:
    with pytest.raises(ValueError, match="model"):
        coverage(np.zeros((2, 7)), RIG)


@pytest.mark.parametrize("shade", [0.82, 1.0])
def test_darkness_recovers_coverage_under_shading_and_noise(shade: float) -> None:
    model = np.array([[0, -0.1, 0.1, 1.0, 0.2, 0.14, 0.11, 0.05], [2, 0.07, 0.08, 1.0, -0.5, 0.01, 0.2, 0.0]])
    truth = coverage(model, RIG)
    box = coverage(model[:1], RIG)
    rng = np.random.default_rng(1)
    full = np.where(box > 0.5, 190 * shade, 190.0)
    images = np.clip(np.rint(255 - full * truth + rng.normal(0, 2, truth.shape)), 0, 255).astype(np.uint8)
    found = darkness(images, SilhouetteParameters())
    assert found.dtype == np.float32
    assert found.min() == 0.0
    assert found.max() == 1.0
    assert np.sqrt(np.mean((found - truth)[truth > 0.02] ** 2)) < 0.06
    assert found[truth == 0].max() < 0.1


def test_an_empty_image_is_not_dark() -> None:
    assert darkness(np.full((3, 2, 10, 12), 255, np.uint8), SilhouetteParameters()).sum() == 0.0
