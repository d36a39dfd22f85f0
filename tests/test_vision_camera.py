"""The stereo rig's geometry, and primitives as meshes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from testbed.vision import CAPPED_CYLINDER, CUBOID, SPHERE, StereoRig, to_trimesh

RIG = StereoRig()


def test_the_paper_s_rig() -> None:
    assert (RIG.width, RIG.height, RIG.baseline) == (100, 75, 0.10)
    assert RIG.rays().shape == (75, 100, 2)
    assert RIG.eyes == (-0.05, 0.05)  # left, right


@given(st.floats(0.2, 3.0), st.integers(0, 99), st.integers(0, 74))
def test_a_point_on_a_pixel_s_ray_is_seen_in_that_pixel(depth: float, u: int, v: int) -> None:
    dx, dy = RIG.rays()[v, u]
    for camera, eye in enumerate(RIG.eyes):
        point = np.array([[eye + dx * depth, dy * depth, depth]])
        assert RIG.project(point)[camera, 0] == pytest.approx((u, v), abs=1e-9)


def test_the_image_spans_the_field_of_view() -> None:
    rig = StereoRig(field_of_view=math.radians(60.0))
    edge = np.array([[math.tan(math.radians(30.0)) - 0.05, 0.0, 1.0]])
    assert rig.project(edge)[0, 0] == pytest.approx((99.5, 37.0))  # the right border, half-way down
    below = rig.project(np.array([[0.0, 0.1, 1.0]]))
    assert np.all(below[:, :, 1] > 37.0)


def test_the_disparity_is_focal_length_times_baseline_over_depth() -> None:
    left, right = RIG.project(np.array([[0.1, 0.2, 0.8], [0.0, 0.0, 2.0]]))
    assert (left - right)[:, 0] == pytest.approx([RIG.focal * 0.1 / 0.8, RIG.focal * 0.1 / 2.0])
    assert (left - right)[:, 1] == pytest.approx([0.0, 0.0])


def test_what_is_behind_is_nowhere() -> None:
    assert np.all(np.isnan(RIG.project(np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 0.0]]))))


@pytest.mark.parametrize(
    "wrong", [{"width": 0}, {"field_of_view": 0.0}, {"field_of_view": math.pi}, {"baseline": -0.1}]
)
def test_a_rig_that_cannot_see_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"pixel|field_of_view|baseline"):
        StereoRig(**wrong)  # type: ignore[arg-type]


def test_meshes_have_the_size_place_and_roll_of_their_primitives() -> None:
    roll = math.radians(30.0)
    place = (0.1, -0.2, 0.9, roll)
    cuboid = to_trimesh(np.array([CUBOID, *place, 0.3, 0.2, 0.1]))
    sphere = to_trimesh(np.array([SPHERE, *place, 0.3, 0.2, 0.1]))
    capsule = to_trimesh(np.array([CAPPED_CYLINDER, *place, 0.05, 0.2, 0.1]))
    assert to_trimesh(np.array([CAPPED_CYLINDER, *place, 0.005, 0.2, 0.1])).is_watertight
    for mesh in (cuboid, sphere, capsule):
        assert mesh.is_watertight
        assert mesh.center_mass == pytest.approx(place[:3], abs=1e-6)
    assert cuboid.volume == pytest.approx(0.3 * 0.2 * 0.1)
    assert sphere.volume == pytest.approx(4.0 / 3.0 * math.pi * 0.3**3, rel=0.005)
    assert capsule.volume == pytest.approx(math.pi * 0.05**2 * (0.2 + 4.0 / 3.0 * 0.05), rel=0.005)
    # The far end along the own x axis: to the right and, y being down, below the centre.
    offset = np.asarray(capsule.vertices) - place[:3]
    tip = max(offset[offset[:, 0] > 0.0], key=np.linalg.norm)
    assert tip == pytest.approx((0.15 * math.cos(roll), 0.15 * math.sin(roll), 0.0), abs=0.006)
    assert np.ptp(cuboid.vertices[:, 2]) == pytest.approx(0.2)
