"""What was measured about one device, kept in a file of its own and believed about no other.

``<unique id>.servos.yaml`` and ``<unique id>.tilt.yaml`` in the bench's folder of calibrations. A file says whose it
is, in which form it is written, and has a checksum: it is not for editing, measuring anew takes a minute.
"""

from __future__ import annotations

import binascii
import json
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np
from pydantic import Field, field_validator

from testbed.bodies.parts import Vector
from testbed.document_writing import document_text
from testbed.documents import read_document, validate
from testbed.errors import UserError, shown_path
from testbed.experiment.atomic import write_text
from testbed.frozen import Frozen
from testbed.hardware.failures import CalibrationForeign, CalibrationStale, NotCalibrated

VERSION = 1
"""Of the form of these files; a file of another one is measured anew, never guessed at."""

OLDEST_SERVOS = 180.0
"""Days; a stereo rig's is believed for :data:`testbed.hardware.calibration.rig.OLDEST`, a screw moves it sooner."""

_COUNTS_PER_G = 16384.0
_Triple = tuple[float, float, float]


class _Calibration(Frozen):
    version: int = VERSION
    unique_id: str = Field(description="whose it is")
    board_id: str = Field(description="what that board was named when this was measured")
    created: str = Field(description="when, UTC")

    @field_validator("created")
    @classmethod
    def _is_a_moment(cls, created: str) -> str:
        if datetime.fromisoformat(created).tzinfo is None:
            raise ValueError("needs its offset from UTC")
        return created

    @property
    def age(self) -> float:
        """Days since it was made."""
        return (datetime.now(UTC) - datetime.fromisoformat(self.created)).total_seconds() / 86400


class JointCalibration(Frozen):
    """One servo: which pulse turns it where."""

    centre_us: float = Field(gt=0, lt=5000, description="the pulse at which the limb lies flat")
    us_per_rad: float = Field(description="negative where longer pulses turn the limb up")
    low_deg: float = Field(ge=-180, le=180, description="how far it may turn up ...")
    high_deg: float = Field(ge=-180, le=180, description="... and down")
    residual_deg: float = Field(0.0, ge=0, description="how well the marks lie on a line, rms")


class ServoCalibration(_Calibration):
    """Pulses and angles of a board's servos, in the order of its joints."""

    kind: Literal["servos"] = "servos"
    unit: Literal["us", "ticks"] = Field("us", description="ticks: a bus servo's, in place of microseconds")
    joints: dict[str, JointCalibration] = Field(min_length=1)

    def ordered(self, joints: Sequence[str]) -> ServoCalibration:
        """The same with the joints in this order.

        Raises:
            CalibrationForeign: If they are not these joints.
        """
        if set(joints) != set(self.joints):
            what = f"the servo calibration of {self.board_id} is for the joints {', '.join(self.joints)}"
            raise CalibrationForeign(f"{what}, the body has {', '.join(joints)}")
        return self.model_copy(update={"joints": {name: self.joints[name] for name in joints}})

    def pulses(self, angles: Vector) -> Vector:
        """(joints,) us that turn the joints to these angles (rad)."""
        centre, slope = self._lines
        return np.asarray(centre + slope * angles)

    def angles(self, pulses: Vector) -> Vector:
        """(joints,) rad that these pulses (us) turn the joints to; NaN for NaN."""
        centre, slope = self._lines
        return np.asarray((pulses - centre) / slope)

    @property
    def limits_us(self) -> Vector:
        """(joints, 2) us: the least and the greatest pulse of each."""
        joints = self.joints.values()
        ends = [
            sorted(
                joint.centre_us + joint.us_per_rad * np.radians(end)
                for end in (joint.low_deg, joint.high_deg)
            )
            for joint in joints
        ]
        return np.array(ends)

    @property
    def _lines(self) -> tuple[Vector, Vector]:
        joints = self.joints.values()
        centre = np.array([joint.centre_us for joint in joints])
        return centre, np.array([joint.us_per_rad for joint in joints])


class TiltCalibration(_Calibration):
    """How a tilt sensor sits on its body, and what is wrong with it."""

    kind: Literal["tilt"] = "tilt"
    rotation: tuple[_Triple, _Triple, _Triple] = Field(description="from the sensor's axes to the body's")
    bias: _Triple = Field(description="g, along the sensor's axes")
    scale: _Triple = Field(description="true over measured, along the sensor's axes")
    residual_deg: float = Field(ge=0, description="how far off the poses are that it was measured in, rms")

    def acceleration(self, counts: Sequence[int]) -> Vector:
        """(3,) g in the body's frame, of the sensor's counts; at rest it points up."""
        felt = (np.array(counts, dtype=float) / _COUNTS_PER_G - self.bias) * self.scale
        return np.asarray(np.array(self.rotation) @ felt)


def tilt_from(up: Vector) -> Vector:
    """(2,) tilt (rad) where (3,) ``up`` points up, see :func:`testbed.frames.tilt_of`."""
    return np.array([np.arctan2(up[1], up[2]), np.arctan2(-up[0], np.hypot(up[1], up[2]))])


AnyCalibration = TypeVar("AnyCalibration", bound=_Calibration)


def today() -> str:
    """For the field ``created``."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def calibration_file(folder: Path, unique_id: str, kind: str) -> Path:
    """Where a device's calibration of a kind, ``servos`` or ``tilt``, is kept."""
    return folder / f"{unique_id}.{kind}.yaml"


def save_calibration(calibration: ServoCalibration | TiltCalibration, folder: Path) -> Path:
    """Keep it, in place of an older one; the file is written whole or not at all.

    Raises:
        UserError: If the place cannot be written.
    """
    path = calibration_file(folder, calibration.unique_id, calibration.kind)
    data = calibration.model_dump(mode="json")
    write_text(path, document_text({**data, "checksum": _checksum(data)}))
    return path


def load_servos(folder: Path, unique_id: str, board_id: str | None = None) -> ServoCalibration:
    """The servo calibration of a device.

    Args:
        folder: The bench's folder of calibrations.
        unique_id: Which device.
        board_id: What it is named now, where it has a name.

    Raises:
        NotCalibrated: If there is none or the file is damaged.
        CalibrationForeign: If it is of another device or another version.
        CalibrationStale: If it is older than :data:`OLDEST_SERVOS` days: horns slip and gears wear.
    """
    calibration = _load(ServoCalibration, "servos", folder, unique_id, board_id)
    if calibration.age > OLDEST_SERVOS:
        what = f"the servo calibration of {calibration.board_id} is {calibration.age:.0f} days old"
        mend = "run 'testbed hardware calibrate servos'"
        raise CalibrationStale(f"{what}, more than {OLDEST_SERVOS:.0f}", mend)
    return calibration


def load_tilt(folder: Path, unique_id: str, board_id: str | None = None) -> TiltCalibration:
    """The tilt calibration of a device; see :func:`load_servos`."""
    return _load(TiltCalibration, "tilt", folder, unique_id, board_id)


def check_owner(calibration: _Calibration, unique_id: str, board_id: str | None = None) -> None:
    """Refuse a calibration that is not this device's.

    Raises:
        CalibrationForeign: If it is another's.
    """
    if calibration.unique_id != unique_id:
        raise CalibrationForeign(f"the calibration is of board {calibration.unique_id}, this is {unique_id}")
    if board_id is not None and calibration.board_id != board_id:
        was = f"'{calibration.board_id}'"
        raise CalibrationForeign(f"board {unique_id} was calibrated as {was} and is named '{board_id}' now")


def _load(
    model: type[AnyCalibration], kind: str, folder: Path, unique_id: str, board_id: str | None
) -> AnyCalibration:
    path = calibration_file(folder, unique_id, kind)
    mend = f"run 'testbed hardware calibrate {kind}'"
    if not path.exists():
        raise NotCalibrated(f"there is no {kind} calibration of board {unique_id}", mend)
    try:
        document = read_document(path)
        version = document.data.get("version")
        if version != VERSION:
            what = f"{shown_path(path)} is of version {version}, not {VERSION}"
            raise CalibrationForeign(what, mend)
        checksum = document.data.pop("checksum", None)
        calibration = validate(model, document)
    except CalibrationForeign:
        raise
    except UserError as error:
        raise NotCalibrated(f"a calibration is damaged: {error}", mend) from None
    if checksum != _checksum(calibration.model_dump(mode="json")):
        raise NotCalibrated(f"a calibration is damaged: {shown_path(path)} was changed", mend)
    check_owner(calibration, unique_id, board_id)
    return calibration


def _checksum(data: dict[str, object]) -> str:
    return f"crc32-{binascii.crc32(json.dumps(data, sort_keys=True).encode()):08x}"
