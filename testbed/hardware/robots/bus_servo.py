"""What one bus servo says about itself, and whether that can be and is well."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass

from testbed.hardware.failures import ServoFault, WrongBoard
from testbed.hardware.line.bus import FeetechLine, Register, faults

MODEL = 777
"""What an STS3215 says in register 3."""
TICKS = 4096
"""Of a whole turn."""
TICKS_PER_RAD = TICKS / (2 * math.pi)
_FROM, _COUNT = Register.TORQUE_ENABLE, Register.MOVING - Register.TORQUE_ENABLE + 1


@dataclass(frozen=True, kw_only=True)
class BusSettings:
    """How the servos are driven, and what is expected of them.

    Attributes:
        speed: Ticks a second; 300 degrees a second, as fast as the standard hobby servo of build A.
        torque: Share of the greatest torque, 0 to 1; an STS3215 has 3 N m at 12 V, the paper's body needs 1.2.
        lowest_volts: The supply sags below this only when it is too weak ...
        highest_volts: ... and is above it only when it is the wrong one.
        hottest: Degrees Celsius; the servo itself switches off at 70.
    """

    speed: int = 3400
    torque: float = 0.5
    lowest_volts: float = 5.0
    highest_volts: float = 14.0
    hottest: int = 65


@dataclass(frozen=True)
class ServoReading:
    """One servo in its own units.

    Attributes:
        torque: Whether it pulls.
        goal: Where it has to go, ticks.
        position: Where it is, ticks.
        volts: Of its supply.
        celsius: How hot it is.
        status: Its fault bits.
        moving: Whether it is under way.
    """

    torque: bool
    goal: int
    position: int
    volts: float
    celsius: int
    status: int
    moving: bool


def check_model(line: FeetechLine, servo: int) -> None:
    """Make sure that a servo is there, and what we take it for.

    Raises:
        NoAnswer: If it does not answer.
        WrongBoard: If it is no STS3215.
    """
    model = int.from_bytes(line.read(servo, Register.MODEL, 2), "little")
    if model != MODEL:
        raise WrongBoard(f"servo {servo} of {line.name} is of model {model}, not {MODEL} (STS3215)")


def read_servo(line: FeetechLine, servo: int, settings: BusSettings) -> ServoReading:
    """Ask a servo how it is.

    Raises:
        ServoFault: If it reports a fault, or its supply or temperature is out of bounds, and does so twice.
        LinkLost: If it does not answer any more.
    """
    reading, wrong = _reading(line, servo, settings)
    if wrong is not None:  # one checksum of 256 is right by chance
        reading, wrong = _reading(line, servo, settings)
    if wrong is not None:
        raise wrong
    return reading


def _reading(line: FeetechLine, servo: int, settings: BusSettings) -> tuple[ServoReading, ServoFault | None]:
    table = line.read(servo, _FROM, _COUNT)

    def word(register: int) -> int:
        return int(struct.unpack_from("<H", table, register - _FROM)[0])

    def byte(register: int) -> int:
        return table[register - _FROM]

    reading = ServoReading(
        torque=bool(byte(Register.TORQUE_ENABLE)),
        goal=word(Register.GOAL),
        position=word(Register.POSITION),
        volts=byte(Register.VOLTAGE) / 10,
        celsius=byte(Register.TEMPERATURE),
        status=byte(Register.STATUS),
        moving=bool(byte(Register.MOVING)),
    )
    return reading, _wrong(f"servo {servo} of {line.name}", reading, settings)


def _wrong(who: str, reading: ServoReading, settings: BusSettings) -> ServoFault | None:
    if reading.status:
        return ServoFault(f"{who} reports: {faults(reading.status)}")
    if not settings.lowest_volts <= reading.volts <= settings.highest_volts:
        return ServoFault(f"{who} has a supply of {reading.volts:.1f} V", "check its supply")
    if reading.celsius > settings.hottest:
        return ServoFault(
            f"{who} is {reading.celsius} degrees Celsius hot", "let it cool, look for what blocks it"
        )
    if reading.goal >= TICKS:
        return ServoFault(
            f"{who} says that it goes for {reading.goal}, beyond a whole turn", "power-cycle it"
        )
    return None
