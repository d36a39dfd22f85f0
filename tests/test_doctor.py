"""The doctor names what is wrong on a bench and how to mend it; a bench in order passes every check."""

from __future__ import annotations

import contextlib
import dataclasses
import datetime
import math
import stat
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from bench_builder import SEED, calibrated
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.special import erf
from simavr_needed import simavr_or_skip

from testbed.hardware.bench_file import BenchSpec, BoardSpec
from testbed.hardware.calibration.records import load_servos, save_calibration
from testbed.hardware.doctor import boards as board_doctor
from testbed.hardware.doctor.boards import machine_checks
from testbed.hardware.doctor.cameras import sharpness
from testbed.hardware.doctor.checks import Check, Outcome, all_well
from testbed.hardware.doctor.examination import examine
from testbed.hardware.emulation.bench import EmulatedBench
from testbed.hardware.emulation.wire import WireFaults
from testbed.hardware.line.ports import open_port
from testbed.hardware.operating.stage import workbench_of
from testbed.hardware.operating.workbench import Workbench
from testbed.hardware.rig.rectification import student_rig
from testbed.scenario import Scenario, drawn, load_scenario
from testbed.vision.camera import StereoRig

simavr_or_skip()


@pytest.fixture(scope="module")
def one() -> Scenario:
    """A student and a teacher: as many boards as it takes."""
    here = drawn(load_scenario("bench"), 0)
    return here.model_copy(update={"teachers": here.teachers[:1]})


@pytest.fixture(scope="module")
def kept(one: Scenario, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The calibrations of the bench, which always is the same."""
    folder = tmp_path_factory.mktemp("calibrations")
    with EmulatedBench(one, seed=SEED, ports=tmp_path_factory.mktemp("ports")) as bench:
        calibrated(bench, folder)
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@contextlib.contextmanager
def bench_at(
    tmp_path: Path, one: Scenario, kept: dict[str, bytes]
) -> Iterator[tuple[EmulatedBench, Workbench]]:
    folder = tmp_path / "calibrations"
    folder.mkdir()
    for name, contents in kept.items():
        (folder / name).write_bytes(contents)
    with EmulatedBench(one, seed=SEED, ports=tmp_path / "ports") as bench:
        bench.advance(0.3)
        yield bench, workbench_of(bench, tmp_path / "ports", folder)


def only(place: Workbench, about: set[str]) -> Workbench:
    """The bench without what is beside the point, for time."""
    boards = {name: board for name, board in place.spec.boards.items() if name in about}
    changes: dict[str, object] = {"boards": boards}
    if "cameras" not in about:
        changes["cameras"] = None
    return dataclasses.replace(place, spec=place.spec.model_copy(update=changes))


def named(checks: list[Check]) -> dict[tuple[str, str], str | None]:
    """What failed, by what it is about, and its name."""
    return {(each.about, each.name): each.failure for each in checks if each.outcome is Outcome.FAILED}


def test_a_bench_in_order_passes_and_nothing_moves(
    tmp_path: Path, one: Scenario, kept: dict[str, bytes]
) -> None:
    with bench_at(tmp_path, one, kept) as (bench, place):
        told: list[tuple[int, int]] = []
        eyes = student_rig(one.rig)
        checks = examine(
            place, reads=50, show_board=True, eyes=eyes, progress=lambda *done: told.append(done)
        )
        assert named(checks) == {}
        assert all_well(checks)
        assert not any(board.pulses for board in bench.boards.values())
        assert told[-1][0] == told[-1][1]
        for other in (StereoRig(baseline=0.12), StereoRig(field_of_view=math.radians(52))):
            again = examine(only(place, {"cameras"}), eyes=other)
            assert named(again).keys() == {("cameras", "scenario's rig")}
    names = {(each.about, each.name) for each in checks if each.outcome is Outcome.PASSED}
    for agent in ("student", "teacher_0"):
        for what in ("port", "firmware", "line", "tilt sensor", "tilt calibration", "servo calibration"):
            assert (agent, what) in names
    assert ("rig", "tilt sensor") not in names
    assert {("cameras", "board re-check"), ("cameras", "scenario's rig")} <= names
    assert ("this machine", "permissions") in names


def _unplugged(bench: EmulatedBench, place: Workbench) -> None:
    bench.boards["student"].wire.unplug()


def _sensor_off(bench: EmulatedBench, place: Workbench) -> None:
    bench.boards["student"].chip.set_imu("unplugged")
    bench.advance(0.5)


def _sensor_stuck(bench: EmulatedBench, place: Workbench) -> None:
    bench.boards["student"].chip.set_imu("stuck")
    bench.advance(0.5)


def _wild(bench: EmulatedBench, place: Workbench) -> None:
    board = bench.boards["student"]
    board.mounting = None  # what it feels is no longer told anew
    board.chip.set_acceleration(0.1, 0.2, 1.7)
    bench.advance(0.2)


def _stop_pressed(bench: EmulatedBench, place: Workbench) -> None:
    bench.boards["student"].chip.press_stop()
    bench.advance(0.1)


def _bad_cable(bench: EmulatedBench, place: Workbench) -> None:
    bench.boards["student"].wire.faults = WireFaults(drop=0.004)


def _old_calibration(bench: EmulatedBench, place: Workbench) -> None:
    folder, own = place.spec.calibration_folder, bench.boards["student"].unique_id
    old = datetime.datetime.now(datetime.UTC) - datetime.timedelta(days=300)
    save_calibration(load_servos(folder, own).model_copy(update={"created": old.isoformat()}), folder)


def _no_tilt_calibration(bench: EmulatedBench, place: Workbench) -> None:
    for path in place.spec.calibration_folder.glob("*.tilt.yaml"):
        path.unlink()


def _foreign_calibration(bench: EmulatedBench, place: Workbench) -> None:
    folder = place.spec.calibration_folder
    ours, theirs = (bench.boards[name].unique_id for name in ("student", "teacher_0"))
    (folder / f"{ours}.servos.yaml").write_bytes((folder / f"{theirs}.servos.yaml").read_bytes())


def _covered(bench: EmulatedBench, place: Workbench) -> None:
    bench.cameras[0].faults.black = True


def _stalled(bench: EmulatedBench, place: Workbench) -> None:
    bench.cameras[1].faults.stalled = True


def _frozen(bench: EmulatedBench, place: Workbench) -> None:
    bench.advance(0.2)
    bench.cameras[1].faults.frozen = True


def _camera_gone(bench: EmulatedBench, place: Workbench) -> None:
    bench.cameras[0].faults.gone = True


def _knocked(bench: EmulatedBench, place: Workbench) -> None:
    bench.cameras[1].faults.turned = (math.radians(0.4), 0.0, 0.0)


def _no_stereo(bench: EmulatedBench, place: Workbench) -> None:
    (place.spec.calibration_folder / "stereo.yaml").unlink()


FAULTS: list[tuple[Callable[[EmulatedBench, Workbench], None], dict[tuple[str, str], str]]] = [
    (_unplugged, {("student", "port"): "PortMissing"}),
    (_sensor_off, {("student", "tilt sensor"): "ImuMissing"}),
    (_sensor_stuck, {("student", "tilt sensor"): "ImuStuck"}),
    (_wild, {("student", "tilt calibration"): "TiltImplausible"}),
    (_stop_pressed, {("student", "emergency stop"): "Stopped"}),
    (_bad_cable, {("student", "line"): "LinkLost"}),
    (_old_calibration, {("student", "servo calibration"): "CalibrationStale"}),
    (
        _no_tilt_calibration,
        {
            ("student", "tilt calibration"): "NotCalibrated",
            ("teacher_0", "tilt calibration"): "NotCalibrated",
        },
    ),
    (_foreign_calibration, {("student", "servo calibration"): "CalibrationForeign"}),
    (_covered, {("cameras", "pairs"): "CameraBlack"}),
    (_stalled, {("cameras", "pairs"): "CameraStalled"}),
    (_frozen, {("cameras", "pairs"): "CameraFrozen"}),
    (_camera_gone, {("cameras", "pairs"): "CameraMissing"}),
    (_knocked, {("cameras", "board re-check"): "RigMoved"}),
    (_no_stereo, {("cameras", "stereo calibration"): "NotCalibrated"}),
]


@pytest.mark.parametrize(
    ("break_it", "expected"), FAULTS, ids=[each[0].__name__.strip("_") for each in FAULTS]
)
def test_each_fault_is_named_with_its_mend_and_nothing_else_is(
    tmp_path: Path,
    one: Scenario,
    kept: dict[str, bytes],
    break_it: Callable[[EmulatedBench, Workbench], None],
    expected: dict[tuple[str, str], str],
) -> None:
    with bench_at(tmp_path, one, kept) as (bench, place):
        break_it(bench, place)
        about = {agent for agent, _ in expected}
        checks = examine(only(place, about), reads=100, show_board=True)
        assert named(checks) == expected
        assert all(each.mend for each in checks if each.outcome is Outcome.FAILED)
        assert not any(board.pulses for board in bench.boards.values())


def test_a_port_in_use_and_another_board_are_told_apart(
    tmp_path: Path, one: Scenario, kept: dict[str, bytes]
) -> None:
    with bench_at(tmp_path, one, kept) as (bench, place):
        wires = {name: board.wire.path for name, board in bench.boards.items()}
        own = {name: board.unique_id for name, board in bench.boards.items()}
        boards = {
            "student": BoardSpec(port=wires["student"]),
            "teacher_0": BoardSpec(port=wires["teacher_0"], unique_id=own["rig"]),
            "rig": BoardSpec(port=str(tmp_path / "nowhere")),
        }
        spec = BenchSpec(boards=boards, calibrations=place.spec.calibrations)
        there = Workbench(spec, place.clock, place.prompt, place.cameras)
        with open_port(wires["student"]):
            found = named(examine(there, reads=5))
        assert found == {
            ("student", "port"): "PortBusy",
            ("teacher_0", "firmware"): "WrongBoard",
            ("rig", "port"): "PortMissing",
        }


def test_a_port_that_may_not_be_opened_tells_the_group(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    port = tmp_path / "ttyUSB0"
    port.write_text("")
    port.chmod(stat.S_IRUSR | stat.S_IRGRP | stat.S_IWGRP)
    monkeypatch.setattr(board_doctor.os, "access", lambda path, mode: False)  # root may open everything
    checks = list(machine_checks((str(tmp_path / "tty*"),)))
    (denied,) = [each for each in checks if each.outcome is Outcome.FAILED]
    assert denied.failure == "PortDenied"
    assert "adduser" in denied.mend
    assert port.group() in denied.mend


def test_the_sheet_is_plain_data_too(tmp_path: Path, one: Scenario, kept: dict[str, bytes]) -> None:
    with bench_at(tmp_path, one, kept) as (_, place):
        rows = [each.as_row() for each in examine(place, reads=5)]
    assert yaml.safe_load(yaml.safe_dump(rows)) == rows
    assert {row["outcome"] for row in rows} == {"passed", "left out"}


@settings(max_examples=25, deadline=None)
@given(
    blur=st.floats(0.6, 3.0),
    angle=st.floats(0, 2 * math.pi),
    contrast=st.floats(90, 200),
    seed=st.integers(0, 99),
)
@example(blur=0.6, angle=0.0, contrast=144.0, seed=0)  # as sharp as can be, along the pixels
def test_sharpness_is_the_blur_of_the_edges(blur: float, angle: float, contrast: float, seed: int) -> None:
    y, x = np.mgrid[0:240, 0:320].astype(float)
    across = (x - 160) * math.cos(angle) + (y - 120) * math.sin(angle)
    image = 225 - contrast / 2 * (1 + erf(across / (math.sqrt(2) * blur)))
    noise = np.random.default_rng(seed).normal(0, 2, image.shape)
    found = sharpness(np.clip(image + noise, 0, 255).astype(np.uint8))
    assert found is not None
    assert found == pytest.approx(blur, abs=0.2 + 0.05 * blur)


def test_nothing_is_said_of_the_sharpness_of_a_wall() -> None:
    wall = np.random.default_rng(0).normal(200, 3, (240, 320)).clip(0, 255).astype(np.uint8)
    assert sharpness(wall) is None
    assert sharpness(np.asarray(cv2.GaussianBlur(wall, (0, 0), 3), dtype=np.uint8)) is None
