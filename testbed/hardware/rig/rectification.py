"""Out of two pictures through bent lenses, the two that the student's rig is said to take.

That rig (:class:`testbed.vision.camera.StereoRig`) has two parallel pinholes, one field of view, the principal point in
the middle. What cannot be computed is the baseline: it is what it is, and has to be the scenario's.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from testbed.bodies.morphology import Vector
from testbed.errors import UserError
from testbed.frames import rotation_about
from testbed.hardware.calibration.charuco import Image
from testbed.hardware.calibration.rig import RigCalibration
from testbed.scenario.specs import RigSpec
from testbed.vision.camera import StereoRig

FINENESS = 6
"""Rectified pixels to one of the student's, along each side: 600 x 450, about what the cameras resolve."""
BASELINE_SHARE = 0.02
"""How far the cameras' distance may be from the scenario's, as a share of it: so far are depths off."""


class Rectification:
    """Straightens, turns and scales a pair of full images.

    Args:
        calibration: The cameras.
        rig: The pair that is wanted: the student's eyes.

    Raises:
        UserError: If these cameras cannot be that rig: another baseline, or they do not see as wide.
    """

    def __init__(self, calibration: RigCalibration, rig: StereoRig) -> None:
        if abs(calibration.baseline / rig.baseline - 1) > BASELINE_SHARE:
            raise UserError(
                f"the cameras are {calibration.baseline * 1e3:.1f} mm apart, the scenario's rig "
                f"{rig.baseline * 1e3:.1f} mm",
                f"write 'rig: {{baseline: {calibration.baseline:.4f}}}' in the scenario, or move the cameras",
            )
        self.rig = rig
        self.shape = (rig.height * FINENESS, rig.width * FINENESS)
        geometry = calibration.geometry
        level = rotation_about((-calibration.pitch, 0.0, 0.0))[:3, :3]
        self._turns = [level @ turn for turn in geometry.rows_aligned()]
        focal = rig.focal * FINENESS
        middle = ((self.shape[1] - 1) / 2, (self.shape[0] - 1) / 2)
        self._matrix = np.array([[focal, 0, middle[0]], [0, focal, middle[1]], [0, 0, 1]])
        self._maps = []
        for eye in (0, 1):
            u, v = cv2.initUndistortRectifyMap(
                geometry.matrices[eye],
                geometry.distortions[eye],
                self._turns[eye],
                self._matrix,
                self.shape[::-1],
                cv2.CV_32FC1,
            )
            self._require_seen(np.asarray(u), np.asarray(v), calibration.size, ("left", "right")[eye])
            # In fixed point remapping takes a third of the time, and is a 32nd of a pixel off at most.
            self._maps.append(cv2.convertMaps(u, v, cv2.CV_16SC2))

    def rectified(self, eye: int, image: Image) -> Image:
        """(450, 600) the picture of the left (0) or right (1) camera as the rig's, at full fineness."""
        u, v = self._maps[eye]
        straight = cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(straight, dtype=np.uint8)

    def sources(self, eye: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """(450, 600) column and row of the full image that each rectified pixel is taken from."""
        fixed, parts = self._maps[eye]
        u, v = cv2.convertMaps(fixed, parts, cv2.CV_32FC1)
        return np.asarray(u, dtype=np.float32), np.asarray(v, dtype=np.float32)

    def reduced(self, fine: NDArray[np.float32]) -> NDArray[np.float32]:
        """(75, 100) a rectified picture in the student's pixels: each gathers the light of its whole area."""
        small = cv2.resize(fine, (self.rig.width, self.rig.height), interpolation=cv2.INTER_AREA)
        return np.asarray(small, dtype=np.float32)

    def _require_seen(
        self, u: NDArray[np.float32], v: NDArray[np.float32], size: tuple[int, int], side: str
    ) -> None:
        """What the rig sees must be in the camera's image, but for a pixel at its rim."""
        seen = (u >= -1) & (u <= size[0]) & (v >= -1) & (v <= size[1])
        if seen.all():
            return
        rows, columns = (
            np.abs(where - (count - 1) / 2)
            for where, count in zip(np.nonzero(~seen), self.shape, strict=True)
        )
        # The widest frame of the same shape in which all is seen: a missing pixel is outside if either side is.
        half = np.maximum(columns, rows * self.rig.width / self.rig.height).min() / FINENESS
        widest = 2 * math.degrees(math.atan(max(half - 0.5, 1) / self.rig.focal))
        raise UserError(
            f"the {side} camera does not see the {math.degrees(self.rig.field_of_view):.0f} degrees of the "
            "scenario's rig",
            f"write 'rig: {{field_of_view_deg: {widest:.0f}}}' in the scenario, or use wider lenses",
        )


def student_rig(spec: RigSpec) -> StereoRig:
    """The student's eyes, as a scenario's ``rig`` says."""
    return StereoRig(field_of_view=math.radians(spec.field_of_view_deg), baseline=spec.baseline)


def frame_of(calibration: RigCalibration) -> tuple[Vector, Vector]:
    """Where the rectified rig is in the left camera's frame: axes (3, 3; one a row), origin (3,) between the eyes."""
    geometry = calibration.geometry
    axes = rotation_about((-calibration.pitch, 0.0, 0.0))[:3, :3] @ geometry.rows_aligned()[0]
    return axes, -geometry.rotation.T @ geometry.translation / 2
