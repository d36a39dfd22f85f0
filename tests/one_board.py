"""Boards at real ports in one virtual time: no physics, no cameras, no threads."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import serial

from testbed.hardware.calibration.records import JointCalibration, ServoCalibration, TiltCalibration, today
from testbed.hardware.clock import readable
from testbed.hardware.emulation.wire import Wire
from testbed.hardware.line.protocol import (
    PROTOCOL,
    REPLY,
    Flags,
    Frame,
    Identity,
    Parser,
    State,
    encode,
)
from testbed.hardware.robots.board import Address

TODAY = today()
UNIQUE = "1122334455667788"
JOINTS = ("left", "right")
_SLICE = 0.00025


class Device(Protocol):
    """What hangs on a wire: a microcontroller, or something simpler."""

    def run_until(self, time: float) -> None: ...
    def write(self, data: bytes) -> None: ...
    def read(self) -> bytes: ...


class Table:
    """The :class:`~testbed.hardware.clock.Clock` of some devices, each at its wire."""

    def __init__(self, *pairs: tuple[Device, Wire]) -> None:
        self.pairs = list(pairs)
        self.time = 0.0
        self.happenings: list[tuple[float, Callable[[], None]]] = []

    def now(self) -> float:
        return self.time

    def sleep(self, seconds: float) -> None:
        end = self.time + seconds
        while self.time < end:
            self._advance(min(end, self.time + 8 * _SLICE))

    def wait(self, port: serial.Serial, deadline: float) -> bool:
        while not readable(port):
            if self.time >= deadline:
                return False
            self._advance(min(deadline, self.time + _SLICE))
        return True

    def at(self, time: float, happening: Callable[[], None]) -> None:
        """Something happens by itself."""
        self.happenings.append((time, happening))

    def _advance(self, time: float) -> None:
        for device, wire in self.pairs:
            device.write(wire.from_host(self.time))
            device.run_until(time)
            wire.to_host(device.read(), time)
        self.time = time
        due = [happening for when, happening in self.happenings if when <= time]
        self.happenings = [(when, happening) for when, happening in self.happenings if when > time]
        for happening in due:
            happening()


class Peer:
    """A board of few lines: it answers frames as it is told to, 2 ms later."""

    def __init__(self, answer: Callable[[Frame], list[tuple[float, bytes]]] | None = None) -> None:
        self.frames: list[Frame] = []
        self.identity = Identity(
            PROTOCOL, (1, 0, 0), "peer", UNIQUE, 77, 1, 0x68, ((1000, 5000),) * 2, 40, 300, 2000
        )
        self.state = State(0, Flags(0), 77, 1000, ((0, 0), (0, 0)), (0, 0, 16384), 5, (0, 0, 0, 0))
        self._answer = answer or self.usual
        self._parser = Parser()
        self._time = 0.0
        self._coming: list[tuple[float, bytes]] = []

    def usual(self, frame: Frame) -> list[tuple[float, bytes]]:
        body = self.identity.encode() if frame.type == 1 else self.state.encode()
        return [(0.002, encode(frame.seq, frame.type | REPLY, body))]

    def run_until(self, time: float) -> None:
        self._time = time

    def write(self, data: bytes) -> None:
        for frame in self._parser.feed(data):
            self.frames.append(frame)
            self._coming += [(self._time + delay, coming) for delay, coming in self._answer(frame)]

    def read(self) -> bytes:
        due = [data for when, data in self._coming if when <= self._time]
        self._coming = [(when, data) for when, data in self._coming if when > self._time]
        return b"".join(due)


def address(wire: Wire, unique_id: str | None = None) -> Address:
    return Address(name="student", port=wire.path, unique_id=unique_id)


def servos(
    unique_id: str = UNIQUE, board_id: str = "hob", joints: tuple[str, ...] = JOINTS
) -> ServoCalibration:
    """One servo turns up, the next one down, for longer pulses."""
    lines = {
        joint: JointCalibration(
            centre_us=1480.0 + 30 * number,
            us_per_rad=620.0 * (-1) ** number,
            low_deg=-80.0,
            high_deg=80.0,
        )
        for number, joint in enumerate(joints)
    }
    return ServoCalibration(unique_id=unique_id, board_id=board_id, created=TODAY, joints=lines)


def upright(unique_id: str = UNIQUE, board_id: str = "hob") -> TiltCalibration:
    """Of a sensor whose axes are the body's."""
    return TiltCalibration(
        unique_id=unique_id,
        board_id=board_id,
        created=TODAY,
        rotation=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
        bias=(0.0, 0.0, 0.0),
        scale=(1.0, 1.0, 1.0),
        residual_deg=0.0,
    )


def wire_at(folder: Path, name: str = "port") -> Wire:
    return Wire(folder / name)
