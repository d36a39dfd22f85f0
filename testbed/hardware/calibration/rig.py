"""The stereo rig's calibration: kept in a file, and refused where it does not belong.

What is stored is what was gated. It belongs to two cameras, an image size and a version of OpenCV, for versions differ
by half a pixel in where they see a corner.
"""

from __future__ import annotations

import contextlib
import datetime
import math
from pathlib import Path
from typing import Annotated, Literal

import cv2
import numpy as np
import yaml
from pydantic import AwareDatetime, BeforeValidator, Field

from testbed.bodies.morphology import Vector
from testbed.documents import read_document, validate
from testbed.errors import UserError
from testbed.experiment.atomic import write_text
from testbed.frames import rotation_about
from testbed.hardware.calibration.board_check import pitch_of
from testbed.hardware.calibration.charuco import CharucoSpec
from testbed.hardware.calibration.rig_fit import (
    BASELINE_TOLERANCE,
    EPIPOLAR_LIMIT,
    BoardPair,
    Geometry,
    RigFit,
    fit_rig,
)
from testbed.hardware.failures import (
    CalibrationForeign,
    CalibrationStale,
    NotCalibrated,
)
from testbed.scenario.base import Spec

FILE = "stereo.yaml"
"""Its name in the folder of calibrations."""
OLDEST = 90.0
"""Days: screws loosen and webcams' plastic lenses drift; a new one takes five minutes."""

Three = tuple[float, float, float]
Five = tuple[float, float, float, float, float]
Positive = Annotated[float, Field(gt=0)]


def _moment(value: object) -> object:
    """Files have no moments, only their text; what is none is left to be refused."""
    with contextlib.suppress(ValueError):
        return datetime.datetime.fromisoformat(value) if isinstance(value, str) else value
    return value


class LensCalibration(Spec):
    """One camera: focal lengths and centre in pixels, and k1, k2, p1, p2, k3."""

    focal: tuple[Positive, Positive]
    centre: tuple[float, float]
    distortion: Five

    @property
    def matrix(self) -> Vector:
        """(3, 3) as OpenCV takes it."""
        return np.array([[self.focal[0], 0, self.centre[0]], [0, self.focal[1], self.centre[1]], [0, 0, 1.0]])


class RigCalibration(Spec):
    """Two cameras, and how well they are known."""

    version: Literal[1] = 1
    created: Annotated[AwareDatetime, BeforeValidator(_moment)] = Field(
        description="ISO 8601, with time zone"
    )
    opencv: str
    size: tuple[int, int] = Field(description="width and height of the images")
    left_id: str
    right_id: str
    board: CharucoSpec
    left: LensCalibration
    right: LensCalibration
    turn: Three = Field(description="rotation vector (rad) from the left camera's frame to the right one's")
    shift: Three = Field(description="m; a point p of the left frame is R p + shift in the right one")
    pitch: float = Field(0.0, description="rad; how far the rig looks down, found with the upright board")
    epipolar: float = Field(ge=0, description="pixels off the row of held-out corners, root mean square")
    pairs: int = Field(ge=1, description="image pairs that were fitted")
    held_out: int = Field(ge=1, description="image pairs that were not")
    measured_baseline: float | None = Field(None, gt=0, description="m, by tape measure")

    @property
    def geometry(self) -> Geometry:
        """The two cameras as arrays."""
        return Geometry(
            np.stack([self.left.matrix, self.right.matrix]),
            np.array([self.left.distortion, self.right.distortion]),
            rotation_about(self.turn)[:3, :3],
            np.array(self.shift),
        )

    @property
    def baseline(self) -> float:
        """Distance between the eyes, m."""
        return math.hypot(*self.shift)

    def age(self, now: datetime.datetime | None = None) -> float:
        """Days since it was made."""
        return ((now or datetime.datetime.now(datetime.UTC)) - self.created).total_seconds() / 86400

    def require(
        self,
        *,
        left_id: str,
        right_id: str,
        size: tuple[int, int] | None = None,
        now: datetime.datetime | None = None,
        oldest: float = OLDEST,
    ) -> None:
        """Make sure that it belongs to these cameras and is still good.

        Raises:
            CalibrationForeign: If it is of other cameras, another image size or another version of OpenCV.
            CalibrationStale: If it is older than ``oldest`` days.
        """
        if (self.left_id, self.right_id) == (right_id, left_id):
            what = f"the stereo calibration has {self.left_id} on the left, the bench has it on the right"
            raise CalibrationForeign(what, "exchange left and right in the bench file")
        for side, own, given in (("left", self.left_id, left_id), ("right", self.right_id, right_id)):
            if own != given:
                what = f"the stereo calibration is of another {side} camera: {own} instead of {given}"
                raise CalibrationForeign(what, _AGAIN)
        if size is not None and self.size != size:
            sizes = f"{self.size[0]} x {self.size[1]} instead of {size[0]} x {size[1]}"
            raise CalibrationForeign(f"the stereo calibration is of images of {sizes}", _AGAIN)
        if self.opencv != cv2.__version__:
            what = f"the stereo calibration was made with OpenCV {self.opencv}, this is {cv2.__version__}"
            raise CalibrationForeign(what, "versions see corners in other places; " + _AGAIN)
        if (age := self.age(now)) > oldest:
            what = f"the stereo calibration is {age:.0f} days old, more than {oldest:.0f}"
            raise CalibrationStale(what, _AGAIN)
        if age < -1:
            what = f"the stereo calibration was made {-age:.0f} days from now"
            raise CalibrationStale(what, "set this machine's clock, or " + _AGAIN)


_AGAIN = "run 'testbed hardware calibrate stereo'"


def gated(fit: RigFit, measured_baseline: float | None, tolerance: float = BASELINE_TOLERANCE) -> None:
    """Make sure that a fit is good enough to be used.

    Raises:
        NotCalibrated: If held-out corners lie off their rows, or the baseline is not the measured one (m).
    """
    if not fit.epipolar < EPIPOLAR_LIMIT:
        raise NotCalibrated(
            f"held-out corners lie {fit.epipolar:.2f} pixels off their row, more than {EPIPOLAR_LIMIT}",
            "take the pairs anew: hold the board still, flat and well lit, and fill the images to their corners",
        )
    if measured_baseline is not None and abs(fit.geometry.baseline - measured_baseline) > tolerance:
        raise NotCalibrated(
            f"the lenses come out {fit.geometry.baseline * 1e3:.1f} mm apart, measured were "
            f"{measured_baseline * 1e3:.1f} mm",
            "measure the board's check ruler and the distance of the lenses again; the board must be flat",
        )
    if fit.geometry.translation[0] > 0:
        raise NotCalibrated("left and right are exchanged", "exchange left and right in the bench file")


def calibrate_rig(
    pairs: list[BoardPair],
    board: CharucoSpec,
    size: tuple[int, int],
    *,
    left_id: str,
    right_id: str,
    measured_baseline: float | None,
    upright: BoardPair | None = None,
    created: datetime.datetime | None = None,
) -> RigCalibration:
    """A calibration from images of the board.

    Args:
        pairs: What both cameras saw of it, in many poses.
        board: As it was printed.
        size: Width and height of the images.
        left_id: The cameras' names.
        right_id: Likewise.
        measured_baseline: Between the lenses, m; None leaves that gate out.
        upright: A view of the board standing upright on its longer edge: tells where level is.
        created: When; now by default.

    Raises:
        NotCalibrated: If it is not good enough, with what to do better.
    """
    fit = fit_rig(pairs, board, size)
    gated(fit, measured_baseline)
    geometry = fit.geometry
    lenses = [
        LensCalibration(
            focal=(float(matrix[0, 0]), float(matrix[1, 1])),
            centre=(float(matrix[0, 2]), float(matrix[1, 2])),
            distortion=_five(bent),
        )
        for matrix, bent in zip(geometry.matrices, geometry.distortions, strict=True)
    ]
    turn = cv2.Rodrigues(geometry.rotation)[0].reshape(3)
    return RigCalibration(
        created=created or datetime.datetime.now(datetime.UTC).replace(microsecond=0),
        opencv=cv2.__version__,
        size=size,
        left_id=left_id,
        right_id=right_id,
        board=board,
        left=lenses[0],
        right=lenses[1],
        turn=_three(np.asarray(turn, dtype=np.float64)),
        shift=_three(geometry.translation),
        pitch=0.0 if upright is None else pitch_of(geometry, upright, board),
        epipolar=fit.epipolar,
        pairs=fit.pairs,
        held_out=fit.held_out,
        measured_baseline=measured_baseline,
    )


def save_calibration(calibration: RigCalibration, folder: Path) -> Path:
    """Write it into the folder of calibrations, whole or not at all; returns the file."""
    data = calibration.model_dump(mode="json")
    path = folder / FILE
    write_text(path, yaml.safe_dump(data, sort_keys=False, default_flow_style=None, width=110))
    return path


def load_calibration(folder: Path) -> RigCalibration:
    """Read it from the folder of calibrations.

    Raises:
        NotCalibrated: If there is none.
        CalibrationForeign: If it is damaged or of another version of this program.
    """
    path = folder / FILE
    if not path.exists():
        raise NotCalibrated("the cameras have no stereo calibration", _AGAIN)
    try:
        return validate(RigCalibration, read_document(path))
    except UserError as error:
        raise CalibrationForeign(f"the stereo calibration cannot be used: {error}", _AGAIN) from error


def _three(values: Vector) -> Three:
    x, y, z = values.tolist()
    return x, y, z


def _five(values: Vector) -> Five:
    a, b, c, d, e = values.tolist()
    return a, b, c, d, e
