"""The kernel against ray casting on meshes (trimesh), a rasteriser (TinyRenderer) and closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter

from testbed.vision import CAPPED_CYLINDER, CUBOID, SPHERE, StereoRig, luminosity, render, to_trimesh
from testbed.vision.primitives import D1, SHAPE

RIG = StereoRig()
Image = NDArray[np.bool_]

angle = st.floats(-math.pi, math.pi)
size = st.floats(0.01, 0.3)


@st.composite
def part(draw: st.DrawFn, nearest: float = 0.4) -> list[float]:
    shape = draw(st.sampled_from((CUBOID, SPHERE, CAPPED_CYLINDER)))
    z = draw(st.floats(nearest, 2.0))
    x, y = draw(st.floats(-0.5, 0.5)) * z, draw(st.floats(-0.4, 0.4)) * z
    sizes = [draw(size) for _ in range(3)]
    if shape != CUBOID:
        sizes[0] /= 2.0
    return [shape, x, y, z, draw(angle), *sizes]


scenes = st.lists(part(), min_size=1, max_size=3).map(lambda rows: np.array(rows, dtype=np.float64))


def mesh_images(parts: NDArray[np.float64], rig: StereoRig = RIG) -> Image:
    """(2, height, width) coverage by casting rays at triangles: shares no formula with the kernel."""
    rays = rig.rays().reshape(-1, 2)
    directions = np.column_stack([rays, np.ones(len(rays))])
    mesh = trimesh.util.concatenate([to_trimesh(row) for row in parts])
    images = []
    for eye in rig.eyes:
        hits = mesh.ray.intersects_any(np.tile([eye, 0.0, 0.0], (len(rays), 1)), directions)
        images.append(hits.reshape(rig.height, rig.width))
    return np.array(images)


def inner(image: Image) -> Image:
    """The pixels whose 3 x 3 neighbourhood is all covered or all free."""
    window = (1,) * (image.ndim - 2) + (3, 3)
    return np.asarray(maximum_filter(image, window) == minimum_filter(image, window))


@settings(max_examples=40, deadline=None)
@given(scenes)
def test_agrees_with_rays_cast_at_meshes(parts: NDArray[np.float64]) -> None:
    expected, seen = mesh_images(parts), render(parts, RIG) < 255
    certain = inner(expected)
    assert np.array_equal(seen[certain], expected[certain])
    # Facets shave round shapes by less than a thousandth of the radius: the shape lies between the mesh and one with
    # radii a little larger. Two pixels are left to rays through an edge itself.
    round_shapes = parts[:, SHAPE] != CUBOID
    larger = parts.copy()
    larger[round_shapes, D1] *= 1.002
    assert np.count_nonzero(expected & ~seen) <= 2
    assert np.count_nonzero(seen & ~mesh_images(larger)) <= 2


@settings(max_examples=40, deadline=None)
@given(st.builds(np.array, st.lists(part().filter(lambda row: row[0] == CUBOID), min_size=1, max_size=3)))
def test_cuboids_have_no_facets_to_blame(parts: NDArray[np.float64]) -> None:
    expected, seen = mesh_images(parts), render(parts, RIG) < 255
    assert np.count_nonzero(seen != expected) <= 2  # rays through an edge itself


@settings(max_examples=60, deadline=None)
@given(part(nearest=-0.4), st.floats(0.0, 0.3))
def test_near_and_behind_the_camera(row: list[float], z: float) -> None:
    """Shapes around, beside and behind the cameras, against points sampled along the rays."""
    row[3] = math.copysign(z, row[3])
    parts = np.array([row])
    rays = RIG.rays().reshape(-1, 2)
    t = np.linspace(1e-6, 1.0, 4000)
    for camera, eye in enumerate(RIG.eyes):
        seen = (render(parts, RIG)[camera] < 255).reshape(-1)
        for pixel in (0, 3750, 3799, 7499, 2525):
            points = t[:, None] * [*rays[pixel], 1.0] + [eye, 0.0, 0.0]
            distance = signed_distance(row, points).min()
            if abs(distance) > 1e-3:
                assert seen[pixel] == (distance < 0.0)


@pytest.mark.parametrize("row", [(CUBOID, 0.06, 0.4, 0.1), (CAPPED_CYLINDER, 0.03, 0.1, 0.0)])
def test_what_stands_beside_the_camera_is_seen_on_its_own_side_only(row: tuple[float, ...]) -> None:
    """The line through a pixel on the other side meets the shape too, but behind the camera."""
    shape, *sizes = row
    rig = StereoRig(baseline=0.0, field_of_view=math.radians(150.0))
    covered = render(np.array([[shape, 0.15, 0.0, 0.02, 0.0, *sizes]]), rig)[0] < 255
    assert covered[:, 50:].any()
    assert not covered[:, :50].any()


def signed_distance(row: list[float], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far (N, 3) points are outside the shape, negative inside (exact enough for its sign)."""
    shape, centre, omega, sizes = row[0], np.array(row[1:4]), row[4], row[5:]
    axis = np.array([math.cos(omega), math.sin(omega), 0.0])
    across = np.array([-math.sin(omega), math.cos(omega), 0.0])
    offset = points - centre
    if shape == CUBOID:
        along = (
            np.abs(np.stack([offset @ axis, offset[:, 2], offset @ across])) - np.array(sizes)[:, None] / 2.0
        )
        return np.asarray(along.max(axis=0))
    half = sizes[1] / 2.0 if shape == CAPPED_CYLINDER else 0.0
    nearest = np.clip(offset @ axis, -half, half)[:, None] * axis
    return np.asarray(np.linalg.norm(offset - nearest, axis=1) - sizes[0])


def test_the_outline_of_a_sphere_is_the_cone_that_touches_it() -> None:
    centre, radius = np.array([0.12, -0.05, 0.8]), 0.07
    parts = np.array([[SPHERE, *centre, 0.3, radius, 0.4, 0.4]])
    rays = RIG.rays()
    directions = np.concatenate([rays, np.ones((75, 100, 1))], axis=2)
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    for image, eye in zip(render(parts, RIG), RIG.eyes, strict=True):
        towards = centre - [eye, 0.0, 0.0]
        far = float(np.linalg.norm(towards))
        off_axis = np.arccos(directions @ (towards / far))
        assert np.array_equal(image < 255, off_axis <= math.asin(radius / far))


def test_disparity_is_focal_length_times_baseline_over_depth() -> None:
    rig = StereoRig(width=1000, height=750, baseline=0.10)
    for z in (0.5, 0.9, 1.4):
        left, right = render(np.array([[CUBOID, 0.0, 0.0, z, 0.0, 0.1, 1e-6, 0.1]]), rig) < 255
        columns = [np.nonzero(image.any(axis=0))[0].mean() for image in (left, right)]
        # What stands in the middle is seen to the right of the middle by the left eye.
        assert columns[0] - columns[1] == pytest.approx(rig.focal * 0.10 / z, abs=1.01)


def test_caps_are_round_and_lie_beyond_the_length() -> None:
    radius, length, z = 0.05, 0.2, 1.0
    parts = np.array([[CAPPED_CYLINDER, 0.0, 0.0, z, 0.0, radius, length, 0.0]])
    rig = StereoRig(width=1000, height=750, baseline=0.0)
    covered = render(parts, rig)[0] < 255
    tip = math.tan(math.asin(radius / math.hypot(z, length / 2.0)))  # a little loose: the cap is a sphere
    extent = np.count_nonzero(covered.any(axis=0)) / rig.focal
    assert extent == pytest.approx(length / z + 2.0 * tip, rel=0.02)
    # A flat end would darken the corner of the bounding box; without caps the tip would stay white.
    corner = rig.project(np.array([[length / 2 + 0.9 * radius, 0.9 * radius, z]]))[0, 0].round().astype(int)
    end = rig.project(np.array([[length / 2 + 0.9 * radius, 0.0, z]]))[0, 0].round().astype(int)
    assert not covered[corner[1], corner[0]]
    assert covered[end[1], end[0]]


@pytest.mark.parametrize("shape", [CUBOID, CAPPED_CYLINDER])
def test_positive_roll_turns_clockwise_in_the_image(shape: int) -> None:
    sizes = (0.4, 0.02, 0.02) if shape == CUBOID else (0.01, 0.4, 0.0)
    image = render(np.array([[shape, 0.0, 0.0, 1.0, math.radians(30.0), *sizes]]), RIG)[0] < 255
    rows, columns = np.nonzero(image)
    assert np.corrcoef(rows, columns)[0, 1] > 0.9  # the right-hand end is lower, and rows count downwards


def test_a_roll_by_half_a_turn_changes_nothing() -> None:
    parts = np.array(
        [[CUBOID, 0.1, 0.0, 1.0, 0.4, 0.2, 0.1, 0.05], [CAPPED_CYLINDER, -0.1, 0.0, 1.0, -0.9, 0.02, 0.2, 0]]
    )
    turned = parts.copy()
    turned[:, 4] += math.pi
    assert np.count_nonzero(render(parts, RIG) != render(turned, RIG)) <= 2


def test_few_pixels_are_the_same_as_the_whole_image() -> None:
    rng = np.random.default_rng(3)
    parts = np.array([[SPHERE, 0.0, 0.0, 0.9, 0.0, 0.1, 0, 0], [CUBOID, 0.2, 0.1, 1.1, 0.4, 0.2, 0.1, 0.05]])
    pixels = np.column_stack([rng.integers(0, 100, 777), rng.integers(0, 75, 777)])
    images = render(parts, RIG, part_luminosity=17)
    assert set(np.unique(images)) == {17, 255}
    assert np.array_equal(luminosity(parts, RIG, pixels, 17), images[:, pixels[:, 1], pixels[:, 0]])
    one = np.stack([luminosity(parts, RIG, p[None], 17)[:, 0] for p in pixels[:50]], axis=1)
    assert np.array_equal(one, luminosity(parts, RIG, pixels[:50], 17))


def test_no_parts_is_a_white_image() -> None:
    assert np.all(render(np.empty((0, 8)), RIG) == 255)


@pytest.mark.parametrize(
    ("pixels", "said"),
    [
        (np.array([[100, 0]]), "outside"),
        (np.array([[0, -1]]), "outside"),
        (np.array([[0.5, 1.0]]), "integer"),
    ],
)
def test_a_wrong_pixel_is_refused(pixels: NDArray[np.int64], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        luminosity(np.array([[SPHERE, 0, 0, 1.0, 0, 0.1, 0, 0]]), RIG, pixels)


@pytest.mark.parametrize(
    "parts", [np.zeros(8), np.zeros((1, 7)), np.full((1, 8), np.nan), np.full((1, 8), 3.0)]
)
def test_a_wrong_model_is_refused(parts: NDArray[np.float64]) -> None:
    with pytest.raises(ValueError, match=r"model|shape"):
        render(parts, RIG)
