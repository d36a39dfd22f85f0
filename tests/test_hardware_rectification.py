"""A point in the world lands in the pixel that the student's rig says, through whatever lenses."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rig_bench import EYES

from testbed.errors import UserError
from testbed.hardware.emulation.lens import Lens, Mount, RigTruth, built_rig
from testbed.hardware.emulation.truth import true_calibration
from testbed.hardware.rig.rectification import Rectification, frame_of
from testbed.vision.camera import StereoRig as StudentRig


@settings(max_examples=40, deadline=None)
@given(
    u=st.floats(0.05, 0.95),
    v=st.floats(0.05, 0.95),
    depth=st.floats(0.3, 3.0),
    seed=st.integers(0, 7),
)
def test_a_point_lands_in_the_pixel_that_the_students_rig_says(
    u: float, v: float, depth: float, seed: int
) -> None:
    """Through a bent lens, onto the sensor, and back by the rectification's maps; each step from the other side."""
    rig, rectification = _rectified(seed)
    column, row = u * EYES.width - 0.5, v * EYES.height - 0.5
    # Where the student's left eye believes a thing to be that it sees there.
    slope = np.array(
        [(column + 0.5 - EYES.width / 2) / EYES.focal, (row + 0.5 - EYES.height / 2) / EYES.focal]
    )
    point = np.array([slope[0] * depth + EYES.eyes[0], slope[1] * depth, depth])
    axes, origin = frame_of(true_calibration(rig))
    own = axes.T @ point + origin  # in the left camera's frame
    world = rig.mounts[0].axes() @ own + rig.mounts[0].place
    wanted = EYES.project(point)[:, 0]
    for eye, (lens, mount) in enumerate(zip(rig.lenses, rig.mounts, strict=True)):
        pixel = lens.project(mount.axes().T @ (world - mount.place))
        u_map, v_map = rectification.sources(eye)
        off = np.hypot(u_map - pixel[0], v_map - pixel[1])
        best_row, best_column = np.unravel_index(int(np.argmin(off)), off.shape)
        if not (0 < best_row < off.shape[0] - 1 and 0 < best_column < off.shape[1] - 1):
            continue  # outside this eye's picture
        # How the sources change from one fine pixel to the next, across and down.
        around = np.array(
            [
                [
                    (m[best_row, best_column + 1] - m[best_row, best_column - 1]) / 2,
                    (m[best_row + 1, best_column] - m[best_row - 1, best_column]) / 2,
                ]
                for m in (u_map, v_map)
            ]
        )
        rest = pixel - (u_map[best_row, best_column], v_map[best_row, best_column])
        fine = np.array([best_column, best_row]) + np.linalg.solve(around, rest)
        found = (fine + 0.5) / 6 - 0.5
        slack = (
            abs(rig.baseline / EYES.baseline - 1) * EYES.focal * EYES.baseline / depth
        )  # cannot be computed away
        assert np.all(np.abs(found - wanted[eye]) < 0.03 + slack), (found, wanted[eye])


_RECTIFIED: dict[int, tuple[RigTruth, Rectification]] = {}


def _rectified(seed: int) -> tuple[RigTruth, Rectification]:
    if seed not in _RECTIFIED:
        rig = built_rig(np.random.default_rng(seed))
        _RECTIFIED[seed] = rig, Rectification(true_calibration(rig), EYES)
    return _RECTIFIED[seed]


def test_a_rig_that_is_built_as_it_should_be_looks_where_the_scenario_says() -> None:
    rig = RigTruth(lenses=(Lens(distortion=(-0.1, 0.03, 0.0, 0.0, 0.0)), Lens()))
    axes, origin = frame_of(true_calibration(rig))
    assert np.allclose(axes, np.eye(3), atol=1e-12)
    assert np.allclose(origin, [0.05, 0, 0])


def test_a_rig_that_looks_down_is_computed_level() -> None:
    down = math.radians(2)  # a positive turn about x, to the right, tips the axis ahead up
    mounts = (Mount((-0.05, 0, 0), (-down, 0, 0)), Mount((0.05, 0, 0), (-down, 0, 0)))
    calibration = true_calibration(RigTruth(mounts=mounts))
    assert calibration.pitch == pytest.approx(down)
    axes, _ = frame_of(calibration)
    assert np.allclose(axes @ mounts[0].axes().T, np.eye(3), atol=1e-9)


def test_cameras_that_cannot_be_the_rig_are_refused_with_what_to_write() -> None:
    calibration = true_calibration(RigTruth())
    with pytest.raises(UserError, match=r"rig: \{baseline: 0\.1000\}"):
        Rectification(calibration, StudentRig(baseline=0.12))
    with pytest.raises(UserError, match=r"rig: \{field_of_view_deg: 5\d\}") as refused:
        Rectification(calibration, StudentRig(field_of_view=math.radians(70)))
    widest = int(str(refused.value).split("field_of_view_deg: ")[1][:2])
    Rectification(calibration, StudentRig(field_of_view=math.radians(widest)))
