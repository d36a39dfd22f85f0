"""Emulated benches for tests, and calibrations as a flawless person would find them, which takes no time."""

from __future__ import annotations

import math
from pathlib import Path

from testbed.bodies.morphology import Morphology
from testbed.hardware.bench_file import PAN, RIG
from testbed.hardware.calibration.records import (
    JointCalibration,
    ServoCalibration,
    TiltCalibration,
    save_calibration,
    today,
)
from testbed.hardware.calibration.rig import save_calibration as save_rig
from testbed.hardware.emulation.bench import EmulatedBench
from testbed.hardware.emulation.mounting import Mounting
from testbed.hardware.emulation.servos import Servo
from testbed.hardware.emulation.truth import true_backdrop, true_calibration
from testbed.hardware.rig.backdrop import save_backdrop
from testbed.scenario import Scenario, load_scenario, with_overrides
from testbed.vision.camera import StereoRig


def short_life() -> Scenario:
    """The shipped bench scenario with everything that a life has, cut down to fifteen seconds of it."""
    scenario = with_overrides(load_scenario("bench"), smoke=True)
    parameters = scenario.student.parameters
    looking = parameters.looking.model_copy(update={"dwell_time": 0.2, "first_look": 0.8})
    student = scenario.student.model_copy(
        update={"parameters": parameters.model_copy(update={"looking": looking})}
    )
    rig = scenario.rig.model_copy(update={"pan_limit_deg": 45.0, "camera_rate": 7.5})
    return scenario.model_copy(update={"student": student, "rig": rig})


SEED = 3
"""Of the bench that tests share: what came out of the shop."""


def calibrated(bench: EmulatedBench, folder: Path) -> Path:
    """Write every calibration of a bench as it truly is."""
    for name, board in bench.boards.items():
        about = {"unique_id": board.unique_id, "board_id": name, "created": today()}
        joints = (PAN,) if name == RIG else tuple(bench.bodies[name].joints)
        body = None if name == RIG else bench.bodies[name]
        servos = {
            joint: joint_calibration(servo, body, joint)
            for joint, servo in zip(joints, board.servos.servos, strict=True)
        }
        save_calibration(ServoCalibration(**about, joints=servos), folder)
        if board.mounting is not None:
            save_calibration(tilt_calibration(about, board.mounting), folder)
    spec = bench.scenario.rig
    eyes = StereoRig(field_of_view=math.radians(spec.field_of_view_deg), baseline=spec.baseline)
    left, right = bench.cameras
    rig = true_calibration(bench.rig, left_id=left.id, right_id=right.id)
    save_rig(rig, folder)
    save_backdrop(true_backdrop(rig, eyes, bench.rig.sensor, spec.background), folder)
    return folder


def joint_calibration(servo: Servo, body: Morphology | None, joint: str) -> JointCalibration:
    low, high = (-90.0, 90.0) if body is None else body.joints[joint].limits_deg
    return JointCalibration(centre_us=servo.centre, us_per_rad=servo.us_per_rad, low_deg=low, high_deg=high)


def tilt_calibration(about: dict[str, str], mounting: Mounting) -> TiltCalibration:
    return TiltCalibration(
        **about,
        rotation=tuple(tuple(row) for row in mounting.rotation.T.tolist()),
        bias=tuple(mounting.bias.tolist()),
        scale=tuple((1 / mounting.scale).tolist()),
        residual_deg=0.0,
    )
