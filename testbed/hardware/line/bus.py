"""The half-duplex bus of Feetech's STS servos, as the host speaks it.

A packet is ``FF FF id length instruction parameters checksum``; the answer has an error byte in the instruction's
place. The checksum is one byte: of 256 garbled packets one gets through, so what is read is also asked for
plausibility by whoever uses it. There are no numbers on packets: before each request, what is left of the last one
is thrown away.
"""

from __future__ import annotations

import enum
from collections import deque
from collections.abc import Mapping

import serial

from testbed.hardware.clock import Clock
from testbed.hardware.failures import LinkLost, NoAnswer, ServoFault
from testbed.hardware.line.link import LinkSpec, LinkStatistics, Listener, deaf
from testbed.hardware.line.ports import read_all, write_all

BUS_BAUD = 1_000_000
BROADCAST = 0xFE
_HEADER = b"\xff\xff"
_ERRORS = {0: "voltage", 1: "angle sensor", 2: "overheated", 3: "current", 5: "overload"}


class Instruction(enum.IntEnum):
    """What a servo can be told."""

    PING = 1
    READ = 2
    WRITE = 3
    SYNC_WRITE = 0x83


class Register(enum.IntEnum):
    """Addresses in a servo's table; two bytes are little-endian."""

    MODEL = 3
    LOW_LIMIT = 9
    HIGH_LIMIT = 11
    TORQUE_ENABLE = 40
    GOAL = 42
    SPEED = 46
    TORQUE_LIMIT = 48
    POSITION = 56
    VOLTAGE = 62
    TEMPERATURE = 63
    STATUS = 65
    MOVING = 66


def packet(servo: int, code: int, parameters: bytes = b"") -> bytes:
    """A packet as it goes over the wire; ``code`` is the instruction, or in an answer the error byte."""
    content = bytes((servo, len(parameters) + 2, code)) + parameters
    return _HEADER + content + bytes((~sum(content) & 0xFF,))


def split(pending: bytearray) -> list[tuple[int, int, bytes]]:
    """Take the whole packets (id, code, parameters) out of what has come in; what is none is thrown away."""
    packets = []
    while (start := pending.find(_HEADER)) >= 0:
        del pending[:start]
        if len(pending) < 4:
            break
        length = pending[3]
        if pending[2] == 0xFF or length < 2:  # one FF more, or no packet
            del pending[:1]
            continue
        if len(pending) < length + 4:
            break
        content, checksum = pending[2 : length + 3], pending[length + 3]
        if ~sum(content) & 0xFF != checksum:
            del pending[:1]
            continue
        packets.append((content[0], content[2], bytes(content[3:])))
        del pending[: length + 4]
    return packets


class FeetechLine:
    """The bus, at an adapter's port.

    Args:
        port: An open port.
        clock: The bench's.
        name: Whose bus.
        listener: Hears all that is sent and received.
        spec: How patient it is.
    """

    def __init__(
        self,
        port: serial.Serial,
        clock: Clock,
        *,
        name: str = "bus",
        listener: Listener = deaf,
        spec: LinkSpec | None = None,
    ) -> None:
        self.name = name
        self.port = port
        self.spec = spec or LinkSpec()
        self.statistics = LinkStatistics(times=deque(maxlen=self.spec.kept_times))
        self._clock = clock
        self._listener = listener

    def read(self, servo: int, register: int, count: int) -> bytes:
        """So many bytes of a servo's table.

        Raises:
            LinkLost: If the port is gone, or the servo does not answer any more.
            NoAnswer: If it never did.
            ServoFault: If it reports a fault.
        """
        return self._ask(servo, Instruction.READ, bytes((register, count)), count)

    def write(self, servo: int, register: int, data: bytes) -> None:
        """Write into a servo's table and wait for its word; raises like :meth:`read`."""
        self._ask(servo, Instruction.WRITE, bytes((register,)) + data, 0)

    def ping(self, servo: int) -> None:
        """Make sure that a servo is there; raises like :meth:`read`."""
        self._ask(servo, Instruction.PING, b"", 0)

    def write_all(self, register: int, data: Mapping[int, bytes]) -> None:
        """Write into several servos' tables at the same moment; nobody answers.

        Raises:
            LinkLost: If the port is gone.
        """
        (size,) = {len(content) for content in data.values()}
        content = b"".join(bytes((servo,)) + written for servo, written in data.items())
        self._send(packet(BROADCAST, Instruction.SYNC_WRITE, bytes((register, size)) + content))

    def close(self) -> None:
        """Let go of the port; harmless when repeated."""
        self.port.close()

    def _ask(self, servo: int, instruction: Instruction, parameters: bytes, count: int) -> bytes:
        request = packet(servo, instruction, parameters)
        began, suspected = self._clock.now(), 0
        for attempt in range(1 + self.spec.retries):
            self.statistics.retries += attempt > 0
            self.statistics.late += bool(read_all(self.port, self.name))
            self._send(request)
            answer = self._answer(servo, request, count)
            if answer is None:
                continue
            self.statistics.received += 1
            error, content = answer
            if not error:
                self.statistics.times.append(self._clock.now() - began)
                return content
            if error & suspected:  # twice: so it was not the line that garbled it
                raise ServoFault(f"servo {servo} of {self.name} reports: {faults(error)}")
            suspected = error
        self.statistics.lost += 1
        where = f"servo {servo} of {self.name}"
        if self.statistics.received:
            raise LinkLost(f"{where} does not answer any more ({self.port.port})")
        raise NoAnswer(
            f"{where} does not answer on {self.port.port}", "check its supply, its cable and its id"
        )

    def _answer(self, servo: int, request: bytes, count: int) -> tuple[int, bytes] | None:
        deadline = self._clock.now() + self.spec.timeout
        pending = bytearray()
        echo = bytearray(request)  # some adapters hear themselves
        while self._clock.wait(self.port, deadline):
            came = read_all(self.port, self.name)
            self._listener(self._clock.now(), self.name, "received", came)
            pending += came
            if pending[: len(echo)] == echo:
                del pending[: len(echo)]
                echo.clear()
            elif echo.startswith(pending):
                continue
            for who, error, parameters in split(pending):
                if who == servo and (len(parameters) == count or (error and not parameters)):
                    return error, parameters
                self.statistics.framing += 1
        return None

    def _send(self, data: bytes) -> None:
        write_all(self.port, self.name, data)
        self.statistics.sent += 1
        self._listener(self._clock.now(), self.name, "sent", data)


def faults(error: int) -> str:
    """An error byte in words."""
    known = [words for bit, words in _ERRORS.items() if error >> bit & 1]
    return ", ".join(known) or f"unknown fault {error}"
