"""Calibrations are kept in files, and believed about their own device only."""

from __future__ import annotations

import contextlib
import datetime
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from one_board import JOINTS, UNIQUE, servos, upright

from testbed.errors import UserError
from testbed.hardware.calibration.records import (
    calibration_file,
    load_servos,
    load_tilt,
    save_calibration,
)
from testbed.hardware.failures import CalibrationForeign, CalibrationStale, NotCalibrated

angle = st.floats(-1, 1)


def test_a_calibration_is_read_as_it_was_kept_and_kept_beside_others(tmp_path: Path) -> None:
    path = save_calibration(servos(), tmp_path / "calibrations")
    save_calibration(upright(), tmp_path / "calibrations")
    save_calibration(servos("12e4567890123456"), tmp_path / "calibrations")  # no number
    assert path == calibration_file(tmp_path / "calibrations", UNIQUE, "servos")
    assert load_servos(path.parent, UNIQUE) == servos()
    assert load_servos(path.parent, UNIQUE, "hob") == servos()
    assert load_tilt(path.parent, UNIQUE) == upright()
    assert load_servos(path.parent, "12e4567890123456").unique_id == "12e4567890123456"
    assert len(list(path.parent.iterdir())) == 3


def test_one_that_is_missing_foreign_or_of_another_version_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        NotCalibrated, match=f"there is no servos calibration of board {UNIQUE}; run .*calibrate servos"
    ):
        load_servos(tmp_path, UNIQUE)
    path = save_calibration(servos(), tmp_path)
    with pytest.raises(CalibrationForeign, match="was calibrated as 'hob' and is named 'arm' now"):
        load_servos(tmp_path, UNIQUE, "arm")
    other = calibration_file(tmp_path, "ff" * 8, "servos")
    other.write_bytes(path.read_bytes())  # copied by hand
    with pytest.raises(CalibrationForeign, match=f"is of board {UNIQUE}, this is ffff"):
        load_servos(tmp_path, "ff" * 8)
    path.write_text(path.read_text().replace("version: 1", "version: 2"))
    with pytest.raises(CalibrationForeign, match="is of version 2, not 1"):
        load_servos(tmp_path, UNIQUE)


def test_one_of_servos_is_not_believed_for_ever(tmp_path: Path) -> None:
    for days, good in ((179, True), (181, False)):
        made = datetime.datetime.now(datetime.UTC) - datetime.timedelta(days=days)
        old = servos().model_copy(update={"created": made.isoformat()})
        save_calibration(old, tmp_path)
        refused = pytest.raises(
            CalibrationStale, match=r"181 days old, more than 180; run .*calibrate servos"
        )
        with contextlib.nullcontext() if good else refused:
            assert load_servos(tmp_path, UNIQUE) == old


def test_a_damaged_file_is_refused_wherever_it_is_damaged(tmp_path: Path) -> None:
    path = save_calibration(upright(), tmp_path)
    whole = path.read_bytes()
    for end in range(0, len(whole) - 1, 5):  # without its last line end it still is whole
        path.write_bytes(whole[:end])
        with pytest.raises((NotCalibrated, CalibrationForeign)):
            load_tilt(tmp_path, UNIQUE)
    for at in range(0, len(whole), 3):
        spoilt = bytearray(whole)
        spoilt[at] ^= 1
        path.write_bytes(spoilt)
        with contextlib.suppress(NotCalibrated, CalibrationForeign):
            assert load_tilt(tmp_path, UNIQUE) == upright()  # a blank more or less says the same
    path.write_bytes(whole.replace(b"scale:\n- 1.0", b"scale:\n- 1.5"))
    with pytest.raises(NotCalibrated, match="was changed; run 'testbed hardware calibrate tilt'"):
        load_tilt(tmp_path, UNIQUE)


def test_one_that_cannot_be_kept_leaves_the_old_one(tmp_path: Path) -> None:
    save_calibration(servos(), tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError):
        save_calibration(servos(), tmp_path / "file")
    assert load_servos(tmp_path, UNIQUE) == servos()


@given(st.lists(angle, min_size=2, max_size=2))
def test_angles_become_pulses_and_angles_again(angles: list[float]) -> None:
    wanted = np.array(angles)
    assert servos().angles(servos().pulses(wanted)) == pytest.approx(wanted, abs=1e-12)
    low, high = servos().limits_us.T
    assert (low < high).all()
    assert ((low <= servos().pulses(wanted)) & (servos().pulses(wanted) <= high)).all()


def test_the_order_of_joints_is_the_bodys() -> None:
    turned = servos().ordered(JOINTS[::-1])
    assert list(turned.joints) == list(JOINTS[::-1])
    assert turned.pulses(np.zeros(2)).tolist() == servos().pulses(np.zeros(2)).tolist()[::-1]
