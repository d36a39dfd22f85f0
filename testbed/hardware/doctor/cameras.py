"""Looking over the stereo rig: do frames come in pairs, are they sharp, is exposure held, is the calibration true?"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np

from testbed.hardware.calibration.board_check import check_rig
from testbed.hardware.calibration.charuco import grey
from testbed.hardware.calibration.rig import RigCalibration, load_calibration
from testbed.hardware.calibration.rig_procedure import BoardWatcher
from testbed.hardware.clock import Clock
from testbed.hardware.doctor.checks import Check, checked, failed, passed, skipped
from testbed.hardware.failures import CamerasApart, ExposureChanged, HardwareFailure, NotCalibrated
from testbed.hardware.prompt import Prompt, Question
from testbed.hardware.rig.backdrop import load_backdrop
from testbed.hardware.rig.cameras import Camera, Image
from testbed.hardware.rig.pairing import SIDES, FramePair, Pairing
from testbed.hardware.rig.rectification import Rectification
from testbed.vision.camera import StereoRig

WATCHED = 2.0
"""Seconds for which the cameras' timing is watched."""
FEWEST = 8
"""Pairs a second: half as many as the student's images."""
MOST_BLUR = 1.5
"""Pixels of the full image: a quarter of one of the student's. A webcam in focus has 0.7."""
_CAMERAS = "cameras"
_SMOOTHED = 1.0
_SOBEL = 0.65  # pixels: what a 3 x 3 Sobel filter adds, .58 along an axis and .65 across both
_EDGE = 15  # pixels; wider than an edge that is still worth measuring
_LEAST_CONTRAST = 60.0
_FEWEST_EDGES = 50
_STEEPEST = 0.9  # of the steepest slope around: there an edge is measured


def camera_checks(
    cameras: Sequence[Camera],
    clock: Clock,
    calibrations: Path,
    ask: Prompt | None = None,
    eyes: StereoRig | None = None,
) -> Iterator[Check]:
    """One check after the other.

    Args:
        cameras: Left and right.
        clock: Theirs.
        calibrations: The folder of calibrations.
        ask: Shows the printed board; without anybody to ask, that check is left out.
        eyes: The rig that the cameras have to be; without one, what they can be is told.
    """
    left, right = cameras
    for side, camera in zip(SIDES, cameras, strict=True):
        yield checked(f"{side} camera", "settings held", functools.partial(_locked, camera))
    pairs: list[FramePair] = []
    try:
        pairs = _watched(Pairing(left, right, clock), clock)
    except HardwareFailure as failure:
        yield failed(_CAMERAS, "pairs", failure)
    else:
        yield checked(_CAMERAS, "pairs", lambda: _timing(pairs))
        for eye, side in enumerate(SIDES):
            image = grey(pairs[-1][eye].image)
            yield checked(f"{side} camera", "picture", functools.partial(_picture, image))
    try:
        calibration = load_calibration(calibrations)
        calibration.require(left_id=left.id, right_id=right.id)
    except HardwareFailure as failure:
        yield failed(_CAMERAS, "stereo calibration", failure)
        return
    yield passed(_CAMERAS, "stereo calibration", _told(calibration))
    yield checked(_CAMERAS, "backdrop", lambda: _backdrop(calibrations, calibration))
    if eyes is not None:
        wanted = eyes
        yield checked(_CAMERAS, "scenario's rig", lambda: _fitting(calibrations, calibration, wanted))
    if not pairs:
        yield skipped(_CAMERAS, "board re-check", "the cameras give no pairs")
    elif ask is None:
        yield skipped(_CAMERAS, "board re-check", "with --board you are asked to show the printed board")
    else:
        show = ask
        yield checked(_CAMERAS, "board re-check", lambda: _rechecked(cameras, clock, calibration, show))


def sharpness(image: Image) -> float | None:
    """How wide the sharpest edges are: the standard deviation of their blur, pixels; None where there is no edge.

    A blurred edge of contrast c has a slope of c / (sqrt(2 pi) sigma) at its steepest.
    """
    smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), _SMOOTHED)
    slope = np.hypot(
        cv2.Sobel(smooth, cv2.CV_32F, 1, 0, scale=1 / 8), cv2.Sobel(smooth, cv2.CV_32F, 0, 1, scale=1 / 8)
    )
    window = np.ones((_EDGE, _EDGE), np.uint8)
    contrast = np.asarray(cv2.dilate(smooth, window)) - np.asarray(cv2.erode(smooth, window))
    edges = (contrast > _LEAST_CONTRAST) & (slope >= _STEEPEST * np.asarray(cv2.dilate(slope, window)))
    if int(edges.sum()) < _FEWEST_EDGES:
        return None
    width = float(np.median(contrast[edges] / (np.sqrt(2 * np.pi) * slope[edges])))
    # The filter against noise, and Sobel's own, widen what they measure.
    return math.sqrt(max(width**2 - _SMOOTHED**2 - _SOBEL**2, 0.0))


def _locked(camera: Camera) -> str:
    refused = camera.lock()
    if refused:
        mend = "fix it with the camera's own tool (v4l2-ctl), or take a camera that obeys"
        raise ExposureChanged("; ".join(refused), mend)
    held = ", ".join(f"{name} {value:g}" for name, value in camera.settings().items())
    return held or "nothing that could change by itself"


def _watched(pairing: Pairing, clock: Clock) -> list[FramePair]:
    pairs = [pairing.newest()]
    until = clock.now() + WATCHED
    while clock.now() < until:
        clock.sleep(0.005)
        pair = pairing.newest()
        if pair is not pairs[-1]:
            pairs.append(pair)
    return pairs


def _timing(pairs: list[FramePair]) -> str:
    rate = (len(pairs) - 1) / WATCHED
    apart = np.array([abs(pair.left.at - pair.right.at) for pair in pairs])
    found = (
        f"{rate:.0f} a second, apart {1000 * np.median(apart):.1f} ms, at most {1000 * apart.max():.1f} ms"
    )
    if rate < FEWEST:
        raise CamerasApart(f"only {found}")
    return found


def _picture(image: Image) -> str:
    blur = sharpness(image)
    level = int(np.median(image))
    if blur is None:
        return f"brightness {level} of 255; nothing with edges in view, so sharpness cannot be told"
    found = f"brightness {level} of 255, edges blurred by {blur:.1f} pixels"
    if blur > MOST_BLUR:
        raise NotCalibrated(
            f"out of focus: {found}", "turn the lens until edges are sharp; then calibrate stereo"
        )
    return found


def _told(calibration: RigCalibration) -> str:
    baseline = f"baseline {1000 * calibration.baseline:.2f} mm"
    if calibration.measured_baseline is not None:
        baseline += f" (tape {1000 * calibration.measured_baseline:.1f})"
    age = calibration.age()
    made = "made today" if age < 1 else f"{age:.0f} days old"
    return (
        f"{made}, {calibration.pairs} views, {calibration.epipolar:.2f} pixels off the row "
        f"in {calibration.held_out} held-out views, {baseline}"
    )


def _backdrop(calibrations: Path, calibration: RigCalibration) -> str:
    backdrop = load_backdrop(calibrations)
    backdrop.require(calibration)
    levels = [int(np.median(image)) for image in backdrop.images]
    wide = math.degrees(backdrop.field_of_view)
    return f"learned with this calibration, {wide:.0f}° wide; brightness {levels[0]} and {levels[1]} of 255"


def _fitting(calibrations: Path, calibration: RigCalibration, eyes: StereoRig) -> str:
    Rectification(calibration, eyes)
    load_backdrop(calibrations).seen_by(eyes)
    return f"{math.degrees(eyes.field_of_view):.0f}° wide, {1000 * eyes.baseline:.1f} mm apart: these cameras can be it"


def _rechecked(cameras: Sequence[Camera], clock: Clock, calibration: RigCalibration, ask: Prompt) -> str:
    text = "hold the board half a metre before the cameras, still and in both views, then press Enter"
    ask(Question("board", "cameras", text, {"u": 0.0, "v": 0.0, "distance": 0.5}))
    left, right = cameras
    try:
        found = BoardWatcher(left, right, clock, calibration.board).still()
        if found is None or found[2].common() is None:
            raise NotCalibrated("the board is not in both views", "hold it nearer, still, flat and well lit")
        seen = found[2]
        off, size = check_rig(calibration.geometry, seen, calibration.board, calibration.epipolar)
        return f"{off:.2f} pixels off the row, its size measured at {size:.2%}"
    finally:
        ask(Question("board_away", "cameras", "take the board away again, then press Enter"))
