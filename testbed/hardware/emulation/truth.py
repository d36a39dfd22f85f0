"""The calibration that an emulated rig would get from a perfect procedure: for tests that are about something else."""

from __future__ import annotations

import datetime

import cv2
import numpy as np

from testbed.hardware.calibration.board_check import down_of
from testbed.hardware.calibration.charuco import CharucoSpec
from testbed.hardware.calibration.rig import LensCalibration, RigCalibration
from testbed.hardware.calibration.rig_fit import Geometry
from testbed.hardware.emulation.cameras import developed
from testbed.hardware.emulation.lens import SIZE, Lens, RigTruth, Sensor
from testbed.hardware.rig.backdrop import Backdrop
from testbed.hardware.rig.rectification import Rectification
from testbed.vision.camera import StereoRig


def true_geometry(rig: RigTruth) -> Geometry:
    """Two cameras as they are."""
    axes = [mount.axes() for mount in rig.mounts]
    places = [np.array(mount.place) for mount in rig.mounts]
    return Geometry(
        np.stack([_lens(lens).matrix for lens in rig.lenses]),
        np.array([lens.distortion for lens in rig.lenses]),
        axes[1].T @ axes[0],
        axes[1].T @ (places[0] - places[1]),
    )


def true_calibration(rig: RigTruth, *, left_id: str = "left", right_id: str = "right") -> RigCalibration:
    """A calibration without error, made now."""
    geometry = true_geometry(rig)
    level = geometry.rows_aligned()[0] @ rig.mounts[0].axes().T @ np.array([0.0, 1.0, 0.0])
    x, y, z = np.asarray(cv2.Rodrigues(geometry.rotation)[0], dtype=np.float64).ravel().tolist()
    a, b, c = geometry.translation.tolist()
    return RigCalibration(
        created=datetime.datetime.now(datetime.UTC).replace(microsecond=0),
        opencv=cv2.__version__,
        size=SIZE,
        left_id=left_id,
        right_id=right_id,
        board=CharucoSpec(),
        left=_lens(rig.lenses[0]),
        right=_lens(rig.lenses[1]),
        turn=(x, y, z),
        shift=(a, b, c),
        pitch=down_of(level)[0],
        epipolar=0.0,
        pairs=1,
        held_out=1,
    )


def true_backdrop(
    calibration: RigCalibration, eyes: StereoRig, sensor: Sensor, white: float = 255.0
) -> Backdrop:
    """What cameras with this calibration see of a plain backdrop."""
    still = Sensor(sensor.exposure, sensor.vignetting, 0.0, 0.0)
    plain = developed(np.full(SIZE[::-1], white, np.float32), still, np.random.default_rng(0))
    rectification = Rectification(calibration, eyes)
    images = [
        cv2.GaussianBlur(rectification.rectified(eye, plain).astype(np.float32), (0, 0), 4.0)
        for eye in (0, 1)
    ]
    return Backdrop(
        np.stack(images).astype(np.float32),
        calibration.left_id,
        calibration.right_id,
        calibration.created.isoformat(),
        eyes.field_of_view,
    )


def _lens(lens: Lens) -> LensCalibration:
    return LensCalibration(focal=lens.focal, centre=lens.centre, distortion=lens.distortion)
