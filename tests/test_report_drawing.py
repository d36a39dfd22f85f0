"""Pictures tell the truth: shapes, poses and perspectives held against independent computations."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.path import Path as Path2D
from scipy.spatial.transform import Rotation

from testbed.bodies.morphology import load_robot
from testbed.physics import tilt_of
from testbed.report.drawing import OBLIQUE, SIDE, TOP, View, extent, flat_on_ground, tilted
from testbed.report.figures import threshold
from testbed.report.film import Camera, floor, paint
from testbed.report.motion import sticks
from testbed.report.outlines import outline
from testbed.report.pictures import robot_picture
from testbed.student.body.self_model import BodyPrior, self_model
from testbed.vision import StereoRig, render
from testbed.world.optics import projection_matrix, view_matrix

angles = st.floats(-1.2, 1.2)


@given(side=angles, nose=angles, joints=st.tuples(angles, angles))
@settings(max_examples=40, deadline=None)
def test_a_tilted_body_has_the_tilt_that_its_sensor_read(
    side: float, nose: float, joints: tuple[float, float]
) -> None:
    body = load_robot("crawler")
    poses = tilted(body, np.array(joints), np.array([side, nose]))
    quaternion = Rotation.from_matrix(poses[body.root][:3, :3]).as_quat()
    assert tilt_of(quaternion) == pytest.approx([side, nose], abs=1e-9)
    assert extent(body, poses, SIDE)[0, 1] == pytest.approx(
        0.0, abs=2e-3
    )  # nothing below the ground, nor above it


@pytest.mark.parametrize(
    ("view", "right", "up"),
    [(SIDE, [1, 0, 0], [0, 0, 1]), (TOP, [1, 0, 0], [0, 1, 0]), (View(0, 0), [0, 1, 0], [0, 0, 1])],
)
def test_views_look_the_right_way(view: View, right: list[float], up: list[float]) -> None:
    assert view.basis[0] == pytest.approx(right, abs=1e-12)
    assert view.basis[1] == pytest.approx(up, abs=1e-12)
    assert np.linalg.det(OBLIQUE.basis) == pytest.approx(1.0)


def test_a_flat_crawler_is_as_long_as_its_parts() -> None:
    body = load_robot("crawler")
    low, high = extent(body, flat_on_ground(body), TOP)
    assert high[0] - low[0] == pytest.approx(0.14 + 0.20 + 0.20 + 0.01, abs=1e-3)
    assert high[1] - low[1] == pytest.approx(0.11)


@given(st.integers(0, 2**31))
@settings(max_examples=25, deadline=None)
def test_outlines_enclose_what_the_kernel_darkens(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shape = float(rng.integers(0, 3))
    # A cuboid without depth: seen from aside, a deep one shows more than its near face.
    sizes = {0.0: (0.2, 1e-6, 0.1), 1.0: (0.08, 0.0, 0.0), 2.0: (0.04, 0.2, 0.0)}[shape]
    x, y, roll = rng.uniform(-0.1, 0.1), rng.uniform(-0.08, 0.08), rng.uniform(-math.pi, math.pi)
    part = np.array([shape, x, y, 1.0, roll, *sizes])
    rig = StereoRig()
    pixels = np.stack(np.meshgrid(np.arange(100), np.arange(75)), axis=-1).reshape(-1, 2)
    drawn = Path2D(rig.project(outline(part))[0]).contains_points(pixels).reshape(75, 100)
    seen = render(part[None], rig)[0] < 255
    assert (drawn & seen).sum() > 0.94 * (drawn | seen).sum()


@given(st.tuples(angles, angles, angles), st.booleans())
@settings(max_examples=30, deadline=None)
def test_stick_poses_have_the_rolls_and_hang_together(
    rolls: tuple[float, float, float], branch: bool
) -> None:
    genome = np.array([0.0, float(branch), math.pi if branch else 0.0])
    parts = sticks(self_model(BodyPrior.of(load_robot("crawler")), genome), np.array(rolls))
    assert parts[:, 4] == pytest.approx(rolls)
    along = np.stack([np.cos(parts[:, 4]), np.sin(parts[:, 4])], axis=1)
    left, right = parts[0, 1:3] - 0.07 * along[0], parts[0, 1:3] + 0.07 * along[0]
    if branch:  # limb b is looked at from where it hangs to the right
        assert parts[1, 1:3] + 0.10 * along[1] == pytest.approx(left)
        assert parts[2, 1:3] - 0.10 * along[2] == pytest.approx(right)
    else:
        assert parts[1, 1:3] - 0.10 * along[1] == pytest.approx(right)
        assert parts[2, 1:3] - 0.10 * along[2] == pytest.approx(parts[1, 1:3] + 0.10 * along[1])


def test_the_films_camera_is_a_pinhole_camera() -> None:
    eye, target, size = np.array([0.3, -0.9, 0.4]), np.array([0.1, 0.2, 0.05]), (640, 480)
    camera = Camera.towards(eye, target, size)
    points = np.random.default_rng(0).uniform(-0.2, 0.2, (50, 3))
    field = 2 * math.atan(size[0] / 2 / camera.focal)
    view = np.array(view_matrix(eye, target)).reshape(4, 4).T
    projection = np.array(projection_matrix(field, *size)).reshape(4, 4).T
    clip = np.c_[points, np.ones(50)] @ (projection @ view).T
    expected = (clip[:, :2] / clip[:, 3:] * [0.5, -0.5] + 0.5) * size
    assert camera.project(points)[0] == pytest.approx(expected)


@pytest.mark.parametrize("heading", [0.0, 0.5, -2.0])
def test_the_films_camera_sees_the_body_whole_and_facing_right(heading: float) -> None:
    body = load_robot("crawler")
    base = np.tile([0.4, -0.3, 0.025, 0, 0, math.sin(heading / 2), math.cos(heading / 2)], (2, 1))
    base[1, :2] += 0.2 * np.array([math.cos(heading), math.sin(heading)])
    camera = Camera.watching(body, base, (400, 300))
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_quat(base[0, 3:]).as_matrix()
    for place in base[:, :3]:
        turn[:3, 3] = place
        poses = {name: turn @ pose for name, pose in body.poses([0.0, 0.0]).items()}
        empty = floor(camera)
        image = empty.copy()
        paint(image, camera, body, poses, (200, 80, 10))
        painted = np.abs(image.astype(int) - empty.astype(int)).sum(axis=2) > 120
        assert painted.any()
        edges = [*painted[0], *painted[-1], *painted[:, 0], *painted[:, -1]]
        assert not any(edges)
        centres = camera.project(np.array([poses[part][:3, 3] for part in ("body", "limb_a", "limb_b")]))[0]
        assert np.all(np.diff(centres[:, 0]) > 10)


def test_robot_pictures_are_written_and_repeat(tmp_path: Path) -> None:
    for robot in ("crawler", "splayed"):
        body = load_robot(robot)
        picture = cv2.imread(str(robot_picture(body, tmp_path / f"{robot}.png")))
        assert picture is not None
        assert picture.shape[1] > 1000
        assert (picture < 200).mean() > 0.02
        first = robot_picture(body, tmp_path / f"{robot}.svg").read_text()
        assert robot_picture(body, tmp_path / "again.svg").read_text() == first
        for name in (*body.parts, *body.joints):
            assert name in first


def test_the_threshold_lies_between_the_verdicts() -> None:
    def row(score: float, verdict: str) -> dict[str, object]:
        return {"score": score, "verdict": verdict}

    assert threshold([row(0.1, "inappropriate"), row(0.6, "appropriate"), row(0.3, "inappropriate")]) == (
        0.3,
        0.6,
    )
    assert threshold([row(0.7, "inappropriate"), row(0.6, "appropriate")]) is None
    assert threshold([row(0.7, "appropriate")]) is None
    assert threshold([{**row(0.7, "appropriate"), "probability": 0.7}]) == (0.0, 0.0)
