"""What stands before the plain light backdrop, and how dark it is.

The backdrop is learned once while the rig pans over the bench: robots pass by, so the median of each pixel is the
backdrop as that pixel sees it, with the lens's vignetting and the lamp's gradient in it. Held against it, white is 255
everywhere; what is darker stands before it. Nothing is learned later on: a robot that stands still stays a robot.
"""

from __future__ import annotations

import json
import math
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from testbed.experiment.atomic import write_whole
from testbed.hardware.calibration.charuco import Image
from testbed.hardware.calibration.rig import RigCalibration
from testbed.hardware.failures import CalibrationForeign, ExposureChanged, NotCalibrated
from testbed.hardware.rig.pairing import SIDES
from testbed.vision.camera import StereoRig

FILE = "backdrop.npz"
"""Its name in the folder of calibrations."""
FEWEST_FRAMES = 15
"""For a median: with half a dozen a robot that is seen in three of them would stay."""
DARKER = 0.12
"""What is darker than the backdrop by this share stands before it: nine times the noise of a webcam's corner."""
DIMMEST, BRIGHTEST = 0.6, 1.8
"""Frames so many times as bright as the backdrop was are mended; beyond, noise and clipping take over."""
CLIPPED = 250
"""A backdrop that reads more is as good as clipped, and no longer tells how bright it is."""
_MOST_CLIPPED = 0.02
_UNEVEN = 0.08  # share by which a plain backdrop may deviate from a smooth surface
_UNEVEN_PART = 0.005  # of the picture that may deviate more
_NEAR_WHITE = 0.06
_RIM = 2  # fine pixels around the foreground that are kept: its soft edge
_COARSE = (100, 75)

Fine = NDArray[np.float32]


class Cleaned(NamedTuple):
    """One camera's picture without its backdrop.

    Attributes:
        fine: (450, 600) luminosity from 0 to 255, exactly 255 where nothing stands.
        gain: How bright the frame was over the backdrop when it was learned.
    """

    fine: Fine
    gain: float


@dataclass(frozen=True)
class Backdrop:
    """How each pixel sees the backdrop.

    Attributes:
        images: (2, 450, 600) luminosity, left then right.
        left_id: The cameras that learned it.
        right_id: Likewise.
        calibration: When the stereo calibration was made that straightened them, ISO 8601.
        field_of_view: Of the rectified pictures, rad.
    """

    images: Fine
    left_id: str
    right_id: str
    calibration: str
    field_of_view: float

    def require(self, calibration: RigCalibration) -> None:
        """Make sure that it was learned with this calibration.

        Raises:
            CalibrationForeign: If not.
        """
        given = (calibration.left_id, calibration.right_id, calibration.created.isoformat())
        if (self.left_id, self.right_id, self.calibration) != given:
            raise CalibrationForeign("the backdrop was learned with another stereo calibration", _AGAIN)

    def seen_by(self, rig: StereoRig) -> Backdrop:
        """The same for a rig that sees less of it: the middle of the pictures, enlarged.

        Raises:
            CalibrationForeign: If the rig sees more than was learned.
        """
        share = math.tan(rig.field_of_view / 2) / math.tan(self.field_of_view / 2)
        if abs(share - 1) < 1e-6:
            return self
        if share > 1:
            learned, wanted = (round(math.degrees(each)) for each in (self.field_of_view, rig.field_of_view))
            raise CalibrationForeign(
                f"the backdrop was learned for a field of view of {learned} degrees, the scenario's is {wanted}",
                "name the scenario: 'testbed hardware calibrate stereo --scenario FILE'",
            )
        height, width = self.images.shape[1:]
        shrunk = np.array(
            [[share, 0, (1 - share) * (width - 1) / 2], [0, share, (1 - share) * (height - 1) / 2]]
        )
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        images = [cv2.warpAffine(image, shrunk, (width, height), flags=flags) for image in self.images]
        return replace(self, images=np.stack(images).astype(np.float32), field_of_view=rig.field_of_view)

    def cleaned(self, eye: int, fine: Image) -> Cleaned:
        """What stands before the backdrop in a rectified picture (450, 600) of the left (0) or right (1) camera.

        Raises:
            ExposureChanged: If it is so much brighter or darker than it was that it cannot be mended.
        """
        backdrop = self.images[eye]
        coarse = _coarse(fine)
        gain = _gain(coarse / _coarse(backdrop))
        side = SIDES[eye]
        if not DIMMEST <= gain <= BRIGHTEST:
            raise ExposureChanged(f"the {side} camera's pictures are {gain:.2f} times as bright as they were")
        if np.mean(coarse > CLIPPED) > _MOST_CLIPPED:
            raise ExposureChanged(
                f"the {side} camera's pictures are {gain:.2f} times as bright as they were, and white clips"
            )
        share = cv2.divide(fine, backdrop, scale=1 / gain, dtype=cv2.CV_32F)
        stands = (share < 1 - DARKER).astype(np.uint8)
        around = cv2.dilate(stands, np.ones((2 * _RIM + 1, 2 * _RIM + 1), np.uint8))
        whitened = np.where(
            np.asarray(around) > 0, np.minimum(share * np.float32(255), np.float32(255)), np.float32(255)
        )
        return Cleaned(np.asarray(whitened, dtype=np.float32), gain)


_AGAIN = "run 'testbed hardware calibrate stereo' again, which looks around at its end"


def learned(pairs: Sequence[tuple[Image, Image]], calibration: RigCalibration, rig: StereoRig) -> Backdrop:
    """The backdrop from rectified pairs (450, 600) taken while the rig looked around.

    Raises:
        NotCalibrated: If there are too few, the backdrop is too dark, too bright or not plain, or something stands in
            the same place of the picture in most of them.
    """
    if len(pairs) < FEWEST_FRAMES:
        raise NotCalibrated(f"{len(pairs)} frames are too few to learn the backdrop", f"take {FEWEST_FRAMES}")
    images = [_median([pair[eye] for pair in pairs]) for eye in (0, 1)]
    for side, image in zip(SIDES, images, strict=True):
        _require_plain(side, image)
    return Backdrop(
        np.stack(images),
        calibration.left_id,
        calibration.right_id,
        calibration.created.isoformat(),
        rig.field_of_view,
    )


def _median(frames: Sequence[Image]) -> Fine:
    """The median of frames that differ in exposure, smoothed: a plain backdrop has no detail, only noise."""
    rough = np.median([_coarse(frame) for frame in frames], axis=0)
    gains = [_gain(_coarse(frame) / rough) for frame in frames]
    even = [cv2.convertScaleAbs(frame, alpha=1 / gain) for frame, gain in zip(frames, gains, strict=True)]
    middle = np.median(np.stack(even), axis=0).astype(np.float32)
    return np.asarray(cv2.GaussianBlur(middle, (0, 0), 4.0, borderType=cv2.BORDER_REFLECT), dtype=np.float32)


def _require_plain(side: str, image: Fine) -> None:
    coarse = _coarse(image).astype(np.float64)
    level = float(np.median(coarse))
    if level < 90 or np.mean(coarse > CLIPPED) > _MOST_CLIPPED:
        how = "dark" if level < 90 else "bright"
        mend = "change the camera's exposure so that the backdrop reads about 200 of 255, then lock it"
        raise NotCalibrated(f"the {side} camera sees the backdrop too {how} ({level:.0f} of 255)", mend)
    x, y = np.meshgrid(np.linspace(-1, 1, _COARSE[0]), np.linspace(-1, 1, _COARSE[1]))
    terms = np.stack([x**i * y**j for i in range(5) for j in range(5 - i)], axis=-1).reshape(-1, 15)
    smooth = terms @ np.linalg.lstsq(terms, coarse.ravel(), rcond=None)[0]
    uneven = np.abs(coarse.ravel() / smooth - 1) > _UNEVEN
    if uneven.mean() > _UNEVEN_PART:
        place = int(np.median(np.flatnonzero(uneven) % _COARSE[0])) / _COARSE[0]
        where = "left" if place < 1 / 3 else "right" if place > 2 / 3 else "middle"
        raise NotCalibrated(
            f"the backdrop is not plain in the {where} of the {side} camera's picture",
            "hang plain white paper or cloth, and see that nothing turns along with the rig",
        )


def _coarse(image: NDArray[np.uint8] | Fine) -> Fine:
    small = cv2.resize(image, _COARSE, interpolation=cv2.INTER_AREA)
    return np.asarray(small, dtype=np.float32)


def _gain(ratio: Fine) -> float:
    """By what the backdrop is brighter, from shares of which fewer than half are something before it."""
    rough = float(np.median(ratio))
    near = ratio[np.abs(ratio / max(rough, 1e-6) - 1) < _NEAR_WHITE]
    return float(np.median(near)) if near.size else rough


def save_backdrop(backdrop: Backdrop, folder: Path) -> Path:
    """Write it into the folder of calibrations, whole or not at all; returns the file."""
    about = {key: value for key, value in vars(backdrop).items() if key != "images"}
    path = folder / FILE

    def write(file: IO[bytes]) -> None:
        np.savez_compressed(
            file, images=backdrop.images.astype(np.float16), about=np.array(json.dumps(about))
        )

    write_whole(path, write)
    return path


def load_backdrop(folder: Path) -> Backdrop:
    """Read it from the folder of calibrations.

    Raises:
        NotCalibrated: If there is none.
        CalibrationForeign: If it is damaged.
    """
    path = folder / FILE
    if not path.exists():
        raise NotCalibrated("the backdrop has not been learned", _AGAIN)
    try:
        with np.load(path, allow_pickle=False) as data:
            images = data["images"].astype(np.float32)
            return Backdrop(images=images, **json.loads(str(data["about"])))
    except (OSError, EOFError, ValueError, KeyError, TypeError, zipfile.BadZipFile, zlib.error) as error:
        raise CalibrationForeign(f"the backdrop's file is damaged ({error})", _AGAIN) from error
