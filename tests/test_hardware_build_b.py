"""Build B through the commands: calibrate, doctor and stop, on an emulated bus and a board with its sensor."""

from __future__ import annotations

import contextlib
import json
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from one_board import UNIQUE, Table
from simavr_needed import simavr_or_skip

from testbed import cli
from testbed.hardware.bench_file import BenchSpec
from testbed.hardware.calibration.records import load_servos, load_tilt, save_calibration
from testbed.hardware.calibration.tilt import ORIENTATIONS
from testbed.hardware.emulation.feetech_bus import FeetechBus
from testbed.hardware.emulation.microcontroller import Microcontroller
from testbed.hardware.emulation.wire import Wire, WireFaults
from testbed.hardware.line.bus import Register
from testbed.hardware.operating import stopping
from testbed.hardware.operating import workbench as working
from testbed.hardware.operating.workbench import Workbench
from testbed.hardware.prompt import Question, nothing
from testbed.hardware.robots.bus_servo import TICKS_PER_RAD

simavr_or_skip()

ADAPTER = "5A7B123"
FLAT = {"joint_a": 2100.0, "joint_b": 1950.0}  # ticks
WAYS = {"joint_a": 1, "joint_b": -1}


@dataclass
class Bench:
    """A student of bus servos 1 and 2, and somebody who does as they are asked."""

    bus: FeetechBus
    chip: Microcontroller
    bus_wire: Wire
    chip_wire: Wire
    place: Workbench
    asked: list[Question]

    def answer(self, question: Question, meanwhile: Callable[[], None] = nothing) -> str:
        self.asked.append(question)
        if question.kind == "servo_by_hand":
            joint = str(question.details["joint"])
            turned = WAYS[joint] * math.radians(float(question.details["angle_deg"]))
            self.bus.servos[list(FLAT).index(joint) + 1].move(FLAT[joint] + turned * TICKS_PER_RAD)
        else:
            self.chip.set_acceleration(*ORIENTATIONS[str(question.details["orientation"])])
        self.place.clock.sleep(0.2)
        return ""


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    bus, bus_wire = FeetechBus([1, 2]), Wire(tmp_path / "tty-bus", seed=2)
    chip = Microcontroller(name="sensor", unique_id=UNIQUE, noise=0.001, seed=1)
    chip_wire = Wire(tmp_path / "tty-sensor")
    board = {"build": "feetech", "unique_id": ADAPTER, "port": bus_wire.path, "imu": UNIQUE}
    spec = BenchSpec.model_validate(
        {"boards": {"student": board}, "port_globs": (str(chip_wire.path),)}
    ).model_copy(update={"calibrations": str(tmp_path / "calibrations")})
    clock = Table((bus, bus_wire), (chip, chip_wire))
    asked: list[Question] = []
    place = Workbench(
        spec, clock, lambda *question: made.answer(*question), lambda: pytest.fail("no cameras")
    )
    made = Bench(bus, chip, bus_wire, chip_wire, place, asked)
    monkeypatch.setattr(working, "workbench", lambda name: contextlib.nullcontext(place))
    yield made
    bus_wire.close()
    chip_wire.close()
    chip.close()


@pytest.fixture
def say(capsys: pytest.CaptureFixture[str]) -> Any:
    def run(*arguments: str) -> tuple[int, str, str]:
        status = cli._status(cli.app, list(arguments))
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return run


def calibrated(say: Any, bench: Bench) -> None:
    for what in ("servos", "tilt"):
        status, out, err = say("hardware", "calibrate", what)
        assert (status, err) == (0, "")
        assert out.startswith("student: ")


def failures(out: str) -> dict[str, str]:
    return {
        f"{each['about']}: {each['check']}": each["failure"]
        for each in json.loads(out)["checks"]
        if each["outcome"] == "failed" and each["about"] != "this machine"
    }


def test_it_is_calibrated_looked_over_and_drives(say: Any, bench: Bench) -> None:
    calibrated(say, bench)
    assert [question.about for question in bench.asked] == ["student"] * 12
    assert not any(servo.torque for servo in bench.bus.servos.values())
    folder = bench.place.spec.calibration_folder
    servos = load_servos(folder, ADAPTER)
    assert servos.unit == "ticks"
    for joint, found in servos.joints.items():
        assert found.centre_us == pytest.approx(FLAT[joint], abs=1)
        assert found.us_per_rad == pytest.approx(WAYS[joint] * TICKS_PER_RAD, rel=1e-3)
    tilt = load_tilt(folder, UNIQUE, "sensor")
    assert np.array(tilt.rotation) == pytest.approx(np.eye(3), abs=0.01)

    _, out, _ = say("hardware", "doctor", "--reads", "20", "--json")
    assert failures(out) == {}, out
    names = {
        (each["about"], each["check"]) for each in json.loads(out)["checks"] if each["outcome"] == "passed"
    }
    wanted = {"bus adapter", "servo 1", "servo 2", "bus", "servo calibration"}
    assert {("student", name) for name in wanted} <= names
    sensor = {"firmware", "line", "tilt sensor", "tilt calibration"}
    assert {("student's sensor", name) for name in sensor} <= names

    bench.chip.set_acceleration(0, 0, 1)
    bench.place.clock.sleep(0.2)
    with bench.place.robot("student") as robot:
        robot.connect()
        robot.configure()
        robot.arm()
        state = robot.act(np.array([0.3, -0.2]))
        bench.place.clock.sleep(0.3)
        assert state.tilt == pytest.approx([0, 0], abs=0.02)
    assert bench.bus.servos[1].position == pytest.approx(FLAT["joint_a"] + 0.3 * TICKS_PER_RAD, abs=1)
    assert bench.bus.servos[2].position == pytest.approx(FLAT["joint_b"] + 0.2 * TICKS_PER_RAD, abs=1)


FAULTS: dict[str, tuple[Callable[[Bench], object], dict[str, str]]] = {
    "adapter pulled": (lambda bench: bench.bus_wire.unplug(), {"student: bus adapter": "PortMissing"}),
    "a servo missing": (lambda bench: bench.bus.servos.pop(2), {"student: servo 2": "LinkLost"}),
    "another model": (
        lambda bench: bench.bus.servos[1].write(Register.MODEL, b"\1"),
        {"student: servo 1": "WrongBoard"},
    ),
    "overload": (lambda bench: setattr(bench.bus.servos[2], "fault", 32), {"student: servo 2": "ServoFault"}),
    "supply": (
        lambda bench: bench.bus.servos[1].table.__setitem__(Register.VOLTAGE, 42),
        {"student: servo 1": "ServoFault"},
    ),
    "a bad line": (
        lambda bench: setattr(bench.bus_wire, "faults", WireFaults(drop=0.004)),
        {"student: bus": "LinkLost"},
    ),
    "sensor's board gone": (
        lambda bench: bench.chip_wire.unplug(), {"student's sensor: port": "PortMissing"}
    ),
    "sensor unplugged": (
        lambda bench: bench.chip.set_imu("unplugged"),
        {"student's sensor: tilt sensor": "ImuMissing"},
    ),
    "nobody's calibration": (
        lambda bench: bench.place.spec.calibration_folder.joinpath(f"{ADAPTER}.servos.yaml").unlink(),
        {"student: servo calibration": "NotCalibrated"},
    ),
}  # fmt: skip


@pytest.fixture
def kept(bench: Bench, say: Any) -> Bench:
    calibrated(say, bench)
    return bench


def test_the_doctor_names_what_is_wrong_and_pulls_at_nobody(say: Any, kept: Bench) -> None:
    folder = kept.place.spec.calibration_folder
    servos = load_servos(folder, ADAPTER)
    gone = dict(kept.bus.servos)
    for name, (breaks, expected) in FAULTS.items():
        breaks(kept)
        kept.place.clock.sleep(0.6)
        status, out, _ = say("hardware", "doctor", "--reads", "60", "--json")
        assert status == 1, name
        found = failures(out)
        assert expected.items() <= found.items(), (name, found)
        # A servo that fails spoils the reading of the whole bus, and nothing else.
        assert set(found) - set(expected) <= {"student: bus"}, (name, found)
        assert not any(servo.torque for servo in kept.bus.servos.values())
        for wire in (kept.bus_wire, kept.chip_wire):
            wire.faults = WireFaults()
            if not wire.plugged:
                wire.replug()
        kept.bus.servos.update(gone)
        for servo in gone.values():
            servo.fault, servo.table[Register.VOLTAGE] = 0, 74
        gone[1].write(Register.MODEL, (777).to_bytes(2, "little"))
        kept.chip.set_imu("fine")
        save_calibration(servos, folder)
    assert failures(say("hardware", "doctor", "--reads", "20", "--json")[1]) == {}


def test_stop_lets_bus_servos_go(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stopping, "clock_of", lambda spec: bench.place.clock)
    monkeypatch.setattr(stopping, "found_ports", lambda globs: [])
    for servo in bench.bus.servos.values():
        servo.write(Register.TORQUE_ENABLE, b"\1")
    (done,) = stopping.stop_everything(bench.place.spec)
    assert (done.board, done.stopped) == ("student", True)
    assert not any(servo.torque for servo in bench.bus.servos.values())
    del bench.bus.servos[2]
    bench.bus.servos[1].write(Register.TORQUE_ENABLE, b"\1")
    (done,) = stopping.stop_everything(bench.place.spec)
    assert not done.stopped
    assert "servo 2 of student does not answer" in done.why
    assert not bench.bus.servos[1].torque
