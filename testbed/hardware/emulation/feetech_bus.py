"""Some STS3215 servos on a bus, emulated.

Written from the vendor's data sheet and memory table, not from the vendor's firmware, which is not public: that a
robot of build B works with this shows that the host speaks the documented protocol, and no more.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable

from testbed.hardware.line.bus import BROADCAST, Instruction, Register, packet, split

MODEL = 777
_TABLE = 71
_RETURN_DELAY = 0.0005  # s; register 7 is 250 by default, in units of 2 us
_MAKES_LIMP = 0b101100  # overheated, current, overload: the servo lets go by itself


class EmulatedServo:
    """One servo: its memory table, and a shaft that turns.

    Attributes:
        table: The registers.
        fault: Bits that it reports; see the error byte of the protocol.
    """

    def __init__(self, position: int = 2048) -> None:
        self.table = bytearray(_TABLE)
        self.fault = 0
        self._position = float(position)
        self._put(Register.MODEL, MODEL)
        self._put(Register.LOW_LIMIT, 0)
        self._put(Register.HIGH_LIMIT, 4095)
        self._put(Register.GOAL, position)
        self._put(Register.TORQUE_LIMIT, 1000)
        self.table[Register.VOLTAGE], self.table[Register.TEMPERATURE] = 74, 30
        self.turn(0.0)

    @property
    def torque(self) -> bool:
        """Whether it pulls."""
        return self.table[Register.TORQUE_ENABLE] == 1

    @property
    def position(self) -> float:
        """Where its shaft is, ticks."""
        return self._position

    def move(self, position: float) -> None:
        """Somebody turns its shaft by hand (ticks)."""
        self._position = position

    def write(self, register: int, data: bytes) -> None:
        """What a write instruction does; goals are kept within the limits, what is read-only stays."""
        for offset, value in enumerate(data):
            if register + offset < Register.POSITION:
                self.table[register + offset] = value
        low, high = self._word(Register.LOW_LIMIT), self._word(Register.HIGH_LIMIT)
        self._put(Register.GOAL, min(max(self._word(Register.GOAL), low), high))

    def turn(self, seconds: float) -> None:
        """Let so much time pass."""
        if self.fault & _MAKES_LIMP:
            self.table[Register.TORQUE_ENABLE] = 0
        way = self._word(Register.GOAL) - self._position
        most = (self._word(Register.SPEED) or 4000) * seconds
        moving = self.torque and abs(way) > 0.5
        if moving:
            self._position += max(-most, min(most, way))
        self._put(Register.POSITION, round(self._position))
        self.table[Register.MOVING] = moving
        self.table[Register.STATUS] = self.fault

    def _word(self, register: int) -> int:
        return int(struct.unpack_from("<H", self.table, register)[0])

    def _put(self, register: int, value: int) -> None:
        struct.pack_into("<H", self.table, register, value)


class FeetechBus:
    """A bus with an adapter; has the same ``write``, ``read`` and ``run_until`` as a microcontroller.

    Args:
        ids: The servos' numbers.
        echo: Whether the adapter hears itself, as the simplest ones do.
    """

    def __init__(self, ids: Iterable[int], *, echo: bool = False) -> None:
        self.servos = {servo: EmulatedServo() for servo in ids}
        self._echo = echo
        self._time = 0.0
        self._pending = bytearray()
        self._coming: list[tuple[float, bytes]] = []

    def run_until(self, time: float) -> None:
        """Let time pass up to this moment (s)."""
        for servo in self.servos.values():
            servo.turn(time - self._time)
        self._time = time

    def write(self, data: bytes) -> None:
        """Bytes from the host."""
        if self._echo and data:
            self._coming.append((self._time, data))
        self._pending += data
        for servo, code, parameters in split(self._pending):
            self._obey(servo, code, parameters)

    def read(self) -> bytes:
        """Bytes for the host that have come out by now."""
        due = b"".join(data for when, data in self._coming if when <= self._time)
        self._coming = [(when, data) for when, data in self._coming if when > self._time]
        return due

    def _obey(self, servo: int, code: int, parameters: bytes) -> None:
        if code == Instruction.SYNC_WRITE and len(parameters) >= 2:
            register, size = parameters[0], parameters[1]
            for start in range(2, len(parameters) - size, size + 1):
                if parameters[start] in self.servos:
                    self.servos[parameters[start]].write(register, parameters[start + 1 : start + 1 + size])
            return
        addressed = self.servos if servo == BROADCAST else {servo} & self.servos.keys()
        for each in addressed:
            one = self.servos[each]
            answer = b""
            if code == Instruction.WRITE and parameters:
                one.write(parameters[0], parameters[1:])
            elif code == Instruction.READ and len(parameters) == 2:
                answer = bytes(one.table[parameters[0] : parameters[0] + parameters[1]])
            elif code != Instruction.PING:
                continue
            if servo != BROADCAST:
                self._coming.append((self._time + _RETURN_DELAY, packet(each, one.fault, answer)))
