"""The commands of the bench, on an emulated one that runs in real time: the very ports and streams of the tutorial."""

from __future__ import annotations

import json
import math
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from simavr_needed import simavr_or_skip

from testbed import cli
from testbed.errors import UserError
from testbed.hardware import bench_time
from testbed.hardware.backend import HardwareBackend
from testbed.hardware.bench_file import BenchSpec, BoardSpec, load_bench, save_bench
from testbed.hardware.bench_time import BenchTime, Shown
from testbed.hardware.calibration import servos as fitting
from testbed.hardware.calibration.records import load_servos
from testbed.hardware.calibration.servos import ServoFitSpec
from testbed.hardware.clock import WallClock
from testbed.hardware.doctor import cameras as looking_over
from testbed.hardware.emulation.live import LiveBench, started
from testbed.hardware.emulation.turns import Turns
from testbed.hardware.line.ports import open_port
from testbed.hardware.operating.hands import DistantHands
from testbed.hardware.operating.setup_sheet import misfits
from testbed.hardware.prompt import Question
from testbed.scenario import load_scenario

simavr_or_skip()

SCENARIO = """
name: two
seed: 1
student: like_me
world: {control_step: 0.0333333333333333}
rig: {renderer: analytic}
teachers:
  - {robot: splayed, gait: splayed_crawl, distance: 0.9, bearing_deg: 30}
"""
COMMANDS = [
    ("find",), ("name",), ("doctor",), ("calibrate", "servos"), ("calibrate", "tilt"), ("calibrate", "stereo"),
    ("calibrate", "all"), ("emulate",), ("run",), ("stop",),
]  # fmt: skip


@pytest.fixture
def say(capsys: pytest.CaptureFixture[str]) -> Any:
    def run(*arguments: str) -> tuple[int, str, str]:
        status = cli._status(cli.app, list(arguments))
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return run


@pytest.fixture(scope="module")
def scenario(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scenario") / "two.yaml"
    path.write_text(SCENARIO)
    return path


@pytest.fixture(scope="module")
def live(scenario: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveBench]:
    with started(str(scenario), tmp_path_factory.mktemp("live")) as bench:
        passing = threading.Thread(target=bench.run)
        passing.start()
        yield bench
        bench.stop()
        passing.join()


@pytest.fixture(scope="module")
def file(live: LiveBench) -> str:
    assert live.spec.file is not None
    return str(live.spec.file)


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_every_command_explains_itself_with_an_example(say: Any, command: tuple[str, ...]) -> None:
    status, out, _ = say("hardware", *command, "--help")
    assert status == 0
    assert f"Example: testbed hardware {' '.join(command)}" in " ".join(out.split())


def test_find_lists_boards_by_name_and_cameras_with_what_they_see(
    say: Any, live: LiveBench, file: str, tmp_path: Path
) -> None:
    out = tmp_path / "bench.yaml"
    arguments = ("--bench", file, "--pictures", str(tmp_path / "seen"), "--out", str(out))
    status, said, _ = say("hardware", "find", *arguments, "--json")
    found = json.loads(said)
    assert status == 0
    names = {port["name"]: port for port in found["ports"]}
    assert names.keys() == {"student", "teacher_0", "rig"}
    assert names["student"]["unique_id"] == live.spec.boards["student"].unique_id
    assert (names["student"]["imu"], names["rig"]["imu"], names["student"]["servos"]) == (True, False, 2)
    assert [camera["size"] for camera in found["cameras"]] == [[640, 480]] * 2
    assert all(Path(camera["thumbnail"]).stat().st_size > 1000 for camera in found["cameras"])
    begun = load_bench(out)
    assert list(begun.boards) == ["student", "teacher_0", "rig"]
    assert begun.cameras is not None
    assert live.spec.cameras is not None
    assert begun.cameras.left == live.spec.cameras.left
    status, said, err = say("hardware", "find", *arguments)
    assert (status, err.count("\n")) == (2, 1)
    assert "is there already" in err


def test_hands_of_another_process_calibrate_a_servo(
    say: Any, live: LiveBench, file: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    hasty = ServoFitSpec(pulses_us=(1500.0, 1200.0, 1800.0), slew_us=60.0, settle=0.3)
    monkeypatch.setattr(fitting, "ServoFitSpec", lambda: hasty)
    status, out, _ = say("hardware", "calibrate", "servos", "rig", "--bench", file)
    assert status == 0
    assert "us flat" in out
    own = live.spec.boards["rig"].unique_id
    assert own is not None
    found = load_servos(live.spec.calibration_folder, own).joints["pan"]
    true = live._bench.boards["rig"].servos.servos[0]
    assert found.centre_us == pytest.approx(true.centre, abs=8)
    assert found.us_per_rad == pytest.approx(true.us_per_rad, rel=0.02)


def test_the_doctor_says_what_is_not_calibrated_yet(
    say: Any, file: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(looking_over, "WATCHED", 0.5)
    status, out, _ = say("hardware", "doctor", "--bench", file, "--reads", "20", "--json")
    told = json.loads(out)
    failed = {
        (each["about"], each["check"], each["failure"])
        for each in told["checks"]
        if each["outcome"] == "failed"
    }
    assert status == 1
    assert not told["well"]
    assert ("student", "tilt calibration", "NotCalibrated") in failed
    assert ("cameras", "stereo calibration", "NotCalibrated") in failed
    # A machine with much else to do may be slow; what it must not do is take that for something else.
    assert {each[2] for each in failed} <= {"NotCalibrated", "CamerasApart", "CameraStalled", "LinkLost"}


def test_a_dry_run_says_who_stands_where_and_moves_nothing(
    say: Any, live: LiveBench, file: str, scenario: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(looking_over, "WATCHED", 0.5)
    before = [len(board.pulses) for board in live._bench.boards.values()]
    status, out, _ = say("hardware", "run", str(scenario), "--bench", file, "--dry-run", "--json")
    told = json.loads(out)
    assert status == 1  # it is not calibrated
    assert not told["ready"]
    assert told["misfits"] == []
    places = {row["who"]: row for row in told["places"]}
    assert list(places) == ["student", "teacher_0", "rig"]
    assert places["teacher_0"]["robot"] == "splayed"
    assert places["teacher_0"]["board"] == live.spec.boards["teacher_0"].unique_id
    x, y = (float(places["teacher_0"][key].removesuffix(" cm")) for key in ("to the right", "ahead"))
    # The middle of the flat body, not of its main part, is at the scenario's distance and bearing.
    assert math.hypot(x - 90 * math.sin(math.pi / 6), y - 90 * math.cos(math.pi / 6)) < 25
    assert [len(board.pulses) for board in live._bench.boards.values()] == before
    assert "there is no board for teacher_1" in misfits(load_scenario("bench"), live.spec)


def test_a_run_that_cannot_begin_is_one_line_with_its_mend(
    say: Any, file: str, scenario: Path, tmp_path: Path
) -> None:
    run = ("run", str(scenario), "--backend", "hardware", "--bench", file, "--out", str(tmp_path / "run"))
    status, _, err = say(*run)
    assert status == 2
    assert err.count("\n") == 1
    assert "testbed hardware calibrate" in err


@pytest.mark.parametrize(
    ("arguments", "fragments"),
    [
        (("run", "bench", "--backend", "hardwar"), ("no backend 'hardwar'", "hardware")),
        (("run", "bench", "--bench", "x.yaml"), ("--backend hardware",)),
        (("run", "bench", "--backend", "hardware", "--bench", "x.yaml"), ("x.yaml", "hardware emulate")),
        (("run", "bench", "--backend", "hardware", "--bench", "FILE", "--workers", "2"), ("one trial at a time",)),
        (("hardware", "doctor", "--bench", "x.yaml"), ("no such bench file", "hardware find")),
        (("hardware", "calibrate", "servos", "teacher_7", "--bench", "FILE"), ("no board for teacher_7",)),
        (("hardware", "calibrate", "tilt", "rig", "--bench", "FILE"), ("no tilt sensor",)),
        (("hardware", "name", "/dev/ttyNOWHERE", "student"), ("/dev/ttyNOWHERE",)),
        (("hardware", "name", "/dev/ttyNOWHERE", "pupil"), ("nobody is called 'pupil'",)),
        (("hardware", "emulate", "crowd"), ("joints",)),
    ],
)  # fmt: skip
def test_a_mistake_is_one_line_and_status_2(
    say: Any, file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...],
    fragments: tuple[str, ...],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    status, _, err = say(*(file if each == "FILE" else each for each in arguments))
    assert (status, err.count("\n")) == (2, 1)
    assert all(fragment in err for fragment in fragments)


def test_another_bench_does_not_take_the_same_folder(
    say: Any, live: LiveBench, file: str, scenario: Path
) -> None:
    status, _, err = say("hardware", "emulate", str(scenario), "--folder", str(Path(file).parent))
    assert status == 2
    assert "another emulated bench is in" in err


def test_hands_say_what_they_cannot_do(live: LiveBench) -> None:
    assert live.spec.hands is not None
    with pytest.raises(UserError, match="cannot do 'dance'"):
        DistantHands(Path(live.spec.hands))(Question("dance", "student", "dance"))
    with pytest.raises(UserError, match="emulate"):
        DistantHands(Path("/nowhere"))(Question("place", "student", "put it back"))


def test_a_board_takes_another_name(say: Any, live: LiveBench, file: str) -> None:
    port = live.port_of("teacher_0")
    assert say("hardware", "name", port, "teacher_5")[0] == 0
    status, out, _ = say("hardware", "name", port, "teacher_0")
    assert status == 0
    assert "was 'teacher_5' and is 'teacher_0' now" in out


def test_stop_reaches_every_board_but_one_that_is_in_use(say: Any, live: LiveBench, file: str) -> None:
    with open_port(live.port_of("student")):
        status, out, _ = say("hardware", "stop", "--bench", file)
    assert status == 1
    lines = {Path(line.split(":")[0]).name: line for line in out.splitlines()}
    assert "NOT stopped" in lines["tty-student"]
    assert "by the switch" in lines["tty-student"]
    assert lines["tty-rig"].endswith(": stopped")
    status, out, _ = say("hardware", "stop", "--bench", file, "--json")
    assert status == 0
    assert all(each["stopped"] for each in json.loads(out)["stopped"])
    status, out, _ = say("hardware", "doctor", "--bench", file, "--reads", "5", "--json")
    stopped = [each for each in json.loads(out)["checks"] if each["failure"] == "Stopped"]
    assert {each["about"] for each in stopped} == {"student", "teacher_0", "rig"}


@pytest.mark.parametrize(
    ("text", "line", "fragment"),
    [
        ("boards:\n  studen: {port: a}", 2, "no agent 'studen'"),
        ("boards:\n  student: {}", 2, "neither unique_id nor port"),
        ("boards:\n  student: {port: a}\n  rig: {port: a}", 3, "the same board"),
        ("boards:\n  student: {port: a}\ncameras:\n  left: a\n  right: a", 5, "same camera"),
        ("boards:\n  student: {port: a, imu: b}", 2, "its own tilt sensor"),
        ("boards:\n  student: {unique_id: 12e4}", 2, "in quotes"),
        ("bords: {}", 1, "boards"),
        ("boards:\n  student: {port: a, biuld: feetech}", 2, "did you mean 'build'"),
        ("boards:\n  student: {port: a, colour: red}", 2, "unique_id, port, build, robot, imu"),
        ("boards: {student: {port: a}}\nboard_square: 2", 2, "board_square"),
    ],
)  # fmt: skip
def test_a_mistake_in_a_bench_file_has_its_line(tmp_path: Path, text: str, line: int, fragment: str) -> None:
    path = tmp_path / "bench.yaml"
    path.write_text(text)
    with pytest.raises(UserError) as mistake:
        load_bench(path)
    assert mistake.value.line == line
    assert fragment in str(mistake.value)


def test_a_bench_file_is_read_as_it_was_written(tmp_path: Path) -> None:
    boards = {
        "student": BoardSpec(unique_id="12e4"),
        "rig": BoardSpec(port="/dev/ttyUSB0", build="feetech", imu="77"),
    }
    spec = BenchSpec(boards=boards, port_globs=("ports/x*",), board_square=0.0281)
    assert save_bench(spec, tmp_path / "below" / "bench.yaml") == spec
    assert (
        load_bench(tmp_path / "below" / "bench.yaml").calibration_folder
        == tmp_path / "below" / "calibrations"
    )


def test_turns_are_taken_in_the_order_in_which_they_were_asked_for() -> None:
    turns, order = Turns(), []

    def take(number: int) -> None:
        with turns:
            order.append(number)

    turns.acquire()
    threads = [threading.Thread(target=take, args=(number,)) for number in range(5)]
    for number, thread in enumerate(threads):
        thread.start()
        while len(turns._waiting) <= number:
            time.sleep(0.001)
    turns.release()
    turns.acquire()  # behind those who wait
    assert order == list(range(5))
    turns.release()
    for thread in threads:
        thread.join()


def test_a_slow_bench_has_a_slow_clock(tmp_path: Path) -> None:
    shown = Shown(tmp_path / "clock")
    clock = BenchTime(tmp_path / "clock")
    passing = threading.Event()

    def pass_slowly() -> None:
        for step in range(201):  # half a second of the bench's in five of ours, were it not told to end
            shown.tell(step / 400)
            if passing.wait(0.005):
                return

    thread = threading.Thread(target=pass_slowly)
    thread.start()
    began = time.monotonic()
    clock.sleep(0.05)
    assert clock.now() >= 0.05
    assert time.monotonic() - began > 0.09
    passing.set()
    thread.join()
    with pytest.raises(UserError, match="not running; start it: testbed hardware emulate"):
        BenchTime(tmp_path / "another")


def test_time_that_stands_still_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench_time, "_PATIENCE", 0.05)
    Shown(tmp_path / "clock").tell(7.0)
    with pytest.raises(UserError, match="is not running"):
        BenchTime(tmp_path / "clock").sleep(1.0)


def test_a_bench_that_nobody_has_reset_yet_is_left_alone(scenario: Path) -> None:
    """A trial that goes on thinks again what it had thought, for seconds, before any robot is armed."""
    nobody: Any = object()
    robots = {"student": nobody, "teacher_0": nobody}
    HardwareBackend(load_scenario(scenario), robots, nobody, nobody, WallClock(), nobody).keep()
