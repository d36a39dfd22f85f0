"""The student's eyes on a bench: two cameras in, one pair of 100 x 75 luminosities out.

Pair by time, straighten, hold against the backdrop, shrink; and at each step ask whether what comes can be believed.
Whatever cannot is a named failure, never a picture.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from testbed.hardware.calibration.charuco import grey
from testbed.hardware.calibration.rig import RigCalibration
from testbed.hardware.clock import Clock
from testbed.hardware.failures import CalibrationForeign
from testbed.hardware.rig.alignment import Alignment
from testbed.hardware.rig.backdrop import Backdrop
from testbed.hardware.rig.cameras import Camera
from testbed.hardware.rig.pairing import FramePair, Pairing, PairingSpec
from testbed.hardware.rig.rectification import Rectification
from testbed.vision.camera import StereoRig as StudentRig
from testbed.world.backend import Pair


class StereoRig:
    """Two calibrated cameras.

    Args:
        left: The left camera.
        right: The right camera.
        calibration: Where they are and how their lenses bend.
        backdrop: What they see where nobody stands.
        clock: The bench's.
        eyes: The pair that is wanted, as the scenario's rig says.
        pairing: When frames belong together.

    Raises:
        CalibrationForeign: If calibration or backdrop are not of these cameras and this rig.
        CalibrationStale: If the calibration is too old.
        UserError: If these cameras cannot be that rig.
    """

    def __init__(
        self,
        left: Camera,
        right: Camera,
        calibration: RigCalibration,
        backdrop: Backdrop,
        clock: Clock,
        *,
        eyes: StudentRig | None = None,
        pairing: PairingSpec | None = None,
    ) -> None:
        self.eyes = eyes or StudentRig()
        calibration.require(left_id=left.id, right_id=right.id)
        backdrop.require(calibration)
        self.calibration, self._backdrop = calibration, backdrop.seen_by(self.eyes)
        self._rectification = Rectification(calibration, self.eyes)
        self._pairing = Pairing(left, right, clock, pairing)
        self.alignment = Alignment()
        self._seen: tuple[FramePair, Pair] | None = None

    @property
    def at(self) -> float:
        """When the pair that was last looked at was exposed, s on the clock."""
        return self._seen[0].at if self._seen is not None else 0.0

    def look(self) -> Pair:
        """(2, 75, 100) luminosity: the newest left and right picture, white where nothing stands.

        Raises:
            HardwareFailure: If what the cameras give cannot be believed; see :mod:`testbed.hardware.failures`.
        """
        pair = self._pairing.newest()
        if self._seen is None or self._seen[0] is not pair:
            self._seen = pair, self._cleaned(pair)
        return self._seen[1]

    def picture(self) -> NDArray[np.uint8]:
        """(H, W, 3) both cameras' newest images side by side, for people; red, green, blue."""
        images = [frame.image for frame in self._pairing.newest()]
        shown = [
            np.repeat(image[..., None], 3, axis=-1) if image.ndim == 2 else image[..., ::-1]
            for image in images
        ]
        return np.ascontiguousarray(np.concatenate(shown, axis=1))

    def close(self) -> None:
        """Let go of the cameras; harmless when repeated."""
        for camera in self._pairing.cameras:
            camera.close()

    def _cleaned(self, pair: FramePair) -> Pair:
        fine = []
        for eye, frame in enumerate(pair):
            image = grey(frame.image)
            size = (image.shape[1], image.shape[0])
            if size != self.calibration.size:
                what = (
                    f"the cameras give {size[0]} x {size[1]} pixels, calibrated were {self.calibration.size}"
                )
                raise CalibrationForeign(what)
            fine.append(self._backdrop.cleaned(eye, self._rectification.rectified(eye, image)).fine)
        self.alignment.watch(fine[0], fine[1])
        small = [self._rectification.reduced(image) for image in fine]
        return np.stack([np.rint(image).astype(np.uint8) for image in small])
