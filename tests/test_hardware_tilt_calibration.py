"""Tilt sensors are found by their procedure, and implausible ones refused."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from calibrating_bench import Chip, calibrating_bench
from hypothesis import given, settings
from hypothesis import strategies as st
from one_board import UNIQUE

from testbed.errors import UserError
from testbed.frames import rotation_about, tilt_of
from testbed.hardware.calibration.records import (
    load_tilt,
    save_calibration,
    tilt_from,
)
from testbed.hardware.calibration.tilt import ORIENTATIONS, calibrate_tilt, fit_tilt
from testbed.hardware.failures import ImuMissing, ImuStuck
from testbed.hardware.line.protocol import Request
from testbed.hardware.prompt import Question, nothing


@pytest.fixture
def chip(tmp_path: Path) -> Iterator[Chip]:
    with calibrating_bench(tmp_path) as chip:
        yield chip


small = st.floats(-0.05, 0.05)


@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1))
def test_tilt_from_an_acceleration_is_the_tilt_of_the_pose(parts: list[float]) -> None:
    quaternion = np.array(parts) / np.linalg.norm(parts)
    x, y, z, w = quaternion
    up = np.array([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])
    assert tilt_from(up) == pytest.approx(tilt_of(quaternion), abs=1e-9)


def test_nose_down_and_left_side_down_have_the_signs_that_the_world_uses() -> None:
    assert tilt_from(np.array(ORIENTATIONS["nose_down"]))[1] == pytest.approx(math.pi / 2)
    assert tilt_from(np.array(ORIENTATIONS["left_side"]))[0] == pytest.approx(-math.pi / 2)
    half = math.sqrt(0.5)  # turned about y: the nose goes down for positive angles
    assert tilt_of(np.array([0, half, 0, half]))[1] == pytest.approx(math.pi / 2)
    assert tilt_of(np.array([-half, 0, 0, half]))[0] == pytest.approx(-math.pi / 2)


def sensed(up: np.ndarray, mount: np.ndarray, bias: np.ndarray, gain: np.ndarray) -> list[float]:
    """Counts of a sensor that is turned by ``mount`` against the body."""
    return (16384 * (gain * (mount @ up) + bias)).tolist()


@settings(deadline=None)
@given(
    st.lists(st.floats(-1.7, 1.7), min_size=3, max_size=3),
    st.lists(small, min_size=3, max_size=3),
    st.lists(small, min_size=3, max_size=3),
    st.sampled_from([4, 5, 6]),
)
def test_a_sensor_is_found_however_it_is_mounted(
    turning: list[float], bias: list[float], gains: list[float], count: int
) -> None:
    mount, gain = rotation_about(turning)[:3, :3], 1 + np.array(gains)
    poses = dict(list(ORIENTATIONS.items())[:count])
    fit = fit_tilt({pose: sensed(np.array(up), mount, np.array(bias), gain) for pose, up in poses.items()})
    assert fit.residual_deg < 0.02
    assert fit.rotation == pytest.approx(mount.T, abs=1e-3)
    assert fit.bias == pytest.approx(bias, abs=1e-3)
    assert fit.scale == pytest.approx(1 / gain, abs=2e-3)


def test_poses_that_are_a_degree_off_cost_less_than_a_degree_and_more_poses_less() -> None:
    rng = np.random.default_rng(3)
    errors: dict[int, list[float]] = {4: [], 6: []}
    for _ in range(60):
        mount = rotation_about(rng.normal(0, 0.05, 3).tolist())[:3, :3]
        gain, bias = rng.uniform(0.98, 1.02, 3), rng.uniform(-0.05, 0.05, 3)
        counts = {}
        for pose, up in ORIENTATIONS.items():
            askew = rotation_about(np.radians(rng.normal(0, 1 / math.sqrt(2), 3)).tolist())[:3, :3]
            counts[pose] = sensed(askew @ up, mount, bias, gain)
        for count, found in errors.items():
            fit = fit_tilt(dict(list(counts.items())[:count]))
            felt = np.array(sensed(np.array([0, 0, 1.0]), mount, bias, gain)) / 16384
            level = fit.rotation @ ((felt - fit.bias) * fit.scale)
            found.append(math.degrees(np.abs(tilt_from(level)).max()))
    assert np.median(errors[6]) < np.median(errors[4]) + 0.05
    assert np.percentile(errors[6], 95) < 1.5


def test_implausible_sensors_and_wrong_poses_are_refused() -> None:
    one = np.ones(3)
    counts = {pose: sensed(np.array(up), np.eye(3), np.zeros(3), one) for pose, up in ORIENTATIONS.items()}
    with pytest.raises(UserError, match="3 poses say too little; lay it down in at least 4"):
        fit_tilt(dict(list(counts.items())[:3]))
    with pytest.raises(UserError, match=r"contradict each other .* lay the robot down again"):
        fit_tilt({**counts, "left_side": counts["right_side"]})
    with pytest.raises(UserError, match=r"a scale of -1\.00"):  # a mirrored sensor is none
        fit_tilt({pose: [-x, y, z] for pose, (x, y, z) in counts.items()})
    with pytest.raises(UserError, match=r"cannot be: .* a scale of 0\.50"):  # set to another range
        fit_tilt({pose: [2 * x, 2 * y, 2 * z] for pose, (x, y, z) in counts.items()})
    with pytest.raises(UserError, match=r"a bias of 0\.40 g"):
        fit_tilt({pose: [x + 0.4 * 16384, y, z] for pose, (x, y, z) in counts.items()})


def test_a_tilt_sensor_is_calibrated_with_a_person(chip: Chip, tmp_path: Path) -> None:
    microcontroller, board, table = chip
    mount = rotation_about((0.05, -0.08, 1.6))[:3, :3]  # soldered on a quarter turn round
    bias, gain = np.array([0.03, -0.02, 0.04]), np.array([1.01, 0.99, 1.02])
    asked: list[str] = []

    def feel(up: np.ndarray) -> None:
        microcontroller.set_acceleration(*(gain * (mount @ up) + bias))

    def hands(question: Question, meanwhile: Callable[[], None] = nothing) -> str:
        pose = str(question.details["orientation"])
        asked.append(pose)
        if pose == "nose_up":
            return "skip"
        feel(np.array(ORIENTATIONS[pose]))
        if asked == ["level"]:  # still rocking the first time
            table.at(table.now() + 0.1, lambda: feel(np.array([0, 0.6, 0.8])))
        else:
            table.sleep(0.2)
        return ""

    found = calibrate_tilt(board, table, hands)
    assert asked == ["level", "level", "nose_down", "left_side", "upside_down", "nose_up", "right_side"]
    assert found.residual_deg < 0.3
    assert np.array(found.rotation) == pytest.approx(mount.T, abs=0.01)
    save_calibration(found, tmp_path)
    read = load_tilt(tmp_path, UNIQUE, "hob")
    feel(np.array([math.sin(-0.3), 0, math.cos(-0.3)]))
    table.sleep(0.2)
    state = board.ask(Request.READ)
    assert tilt_from(read.acceleration(state.acceleration)) == pytest.approx([0, 0.3], abs=0.01)


def test_a_sensor_that_fails_while_it_is_calibrated_is_named(
    chip: Chip,
) -> None:
    microcontroller, board, table = chip
    for state, kind in (("unplugged", ImuMissing), ("stuck", ImuStuck)):
        microcontroller.set_imu(state)  # type: ignore[arg-type]
        table.sleep(0.5)
        with pytest.raises(kind):
            calibrate_tilt(board, table, lambda question, meanwhile=nothing: "")
        microcontroller.set_imu("fine")
        table.sleep(0.5)
