"""An ATmega328P that runs the shipped firmware: what a board of build A does, without the board."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Literal, NamedTuple, Self

from testbed.errors import UserError
from testbed.hardware.emulation.building import emulator_library, firmware_file

FREQUENCY = 16_000_000
"""Cycles a second of the emulated processor."""

MOST_SERVOS = 2
MOST_NAME = 16
MOST_UNIQUE = 8

SENSOR_NOISE = 0.0033
"""g, standard deviation of one reading: the data sheet's 400 ug/sqrt(Hz) over 44 Hz and a first-order roll-off."""

_POWER_ON, _RESET_PIN, _BROWN_OUT = 1, 2, 4  # bits of MCUSR
_PULSES = 256  # as many are taken at a time
_BYTES = 4096

ImuState = Literal["fine", "unplugged", "stuck", "bus dead", "bus held"]
"""``bus dead`` is a line that is held down for good, ``bus held`` one that a slave holds until it is clocked free."""

_IMU_STATES: tuple[ImuState, ...] = ("fine", "unplugged", "stuck", "bus dead", "bus held")


class Pulse(NamedTuple):
    """A servo pulse as it came out of a pin: when it began (s), on which channel, and its width (us)."""

    at: float
    channel: int
    width_us: float


class _CPulse(ctypes.Structure):
    _fields_ = (
        ("rise", ctypes.c_uint64),
        ("width", ctypes.c_uint32),
        ("channel", ctypes.c_uint8),
        ("cut", ctypes.c_uint8),
    )


class Microcontroller:
    """The emulated board. Nothing happens but in :meth:`run`; the same calls give the same bytes and pulses.

    Args:
        firmware: The Intel hex file to run; the shipped firmware, built when it is not there yet, by default.
        name: The board id in its EEPROM, up to 16 characters; may be empty.
        unique_id: The unique id in its EEPROM, 8 bytes (or 16 hexadecimal digits); without one it was never set up.
        imu: Whether an MPU-6050 is connected.
        servos: How many servos the EEPROM says it has, 1 or 2; None leaves it blank, which means 2.
        seed: Of the sensor's noise and of what an unpowered memory holds.
        noise: g, the standard deviation of one reading of the sensor.
        powered: Whether the supply is on from the beginning.

    Raises:
        UserError: If the tools to build the firmware or its emulator are missing, or the file is no firmware.
    """

    def __init__(
        self,
        firmware: Path | None = None,
        *,
        name: str = "",
        unique_id: bytes | str = b"",
        imu: bool = True,
        servos: int | None = MOST_SERVOS,
        seed: int = 0,
        noise: float = SENSOR_NOISE,
        powered: bool = True,
    ) -> None:
        unique = bytes.fromhex(unique_id) if isinstance(unique_id, str) else unique_id
        if (
            servos not in (None, *range(1, MOST_SERVOS + 1))
            or len(name) > MOST_NAME
            or len(unique) not in (0, MOST_UNIQUE)
        ):
            raise ValueError(
                "a board has 1 or 2 servos, a name of at most 16 characters and a unique id of 8 bytes"
            )
        path = firmware_file() if firmware is None else firmware
        self._library = _loaded(emulator_library())
        self._board: int | None = self._library.board_new(str(path).encode(), seed)
        if self._board is None:
            raise UserError(
                f"{path} is no firmware in Intel hex format", "build it with make -C hardware/firmware"
            )
        self._cut: list[Pulse] = []
        self._pulses: list[Pulse] = []
        if name:
            self.write_eeprom(0, name.encode("ascii").ljust(MOST_NAME, b"\0"))
        if unique:
            self.write_eeprom(16, unique)
        if servos is not None:
            self.write_eeprom(26, bytes([servos]))
        self.set_imu("fine" if imu else "unplugged")
        self._library.board_noise(self._board, noise)
        if powered:
            self.power_on()

    @property
    def time(self) -> float:
        """Seconds that it has been run for."""
        return int(self._library.board_now(self._handle)) / FREQUENCY

    def run(self, seconds: float) -> None:
        """Let so much time pass."""
        self.run_until(self.time + seconds)

    def run_until(self, time: float) -> None:
        """Let time pass up to this moment (s); small steps do not add up rounding errors.

        Raises:
            RuntimeError: If the firmware has crashed: it jumped to nowhere or sleeps for ever.
        """
        if self._library.board_run(self._handle, round(time * FREQUENCY)):
            raise RuntimeError(f"the firmware has crashed at {self.time:.6f} s")

    def write(self, data: bytes) -> None:
        """Send bytes to it; they queue up on the wire, 40 us each, and are lost on a board without power."""
        self._library.board_write(self._handle, data, len(data))

    def read(self) -> bytes:
        """The bytes that have come out since the last call, at most 1.3 s of them."""
        buffer = ctypes.create_string_buffer(_BYTES)
        parts = []
        while length := self._library.board_read(self._handle, buffer, _BYTES):
            parts.append(buffer.raw[:length])
        return b"".join(parts)

    def pulses(self) -> list[Pulse]:
        """The pulses that have ended since the last call, exact to 1/16 us; see also :meth:`cut_pulses`."""
        self._take_pulses()
        taken, self._pulses = self._pulses, []
        return taken

    def cut_pulses(self) -> list[Pulse]:
        """Pulses since the last call that a reset, the supply or the firmware cut short, at their real width."""
        self._take_pulses()
        taken, self._cut = self._cut, []
        return taken

    def set_acceleration(self, x: float, y: float, z: float) -> None:
        """What the accelerometer feels along its own axes, in g; (0, 0, 1) when level and at rest."""
        self._library.board_feel(self._handle, x, y, z)

    def set_imu(self, state: ImuState) -> None:
        """Plug the accelerometer in (``fine``), or let something be wrong with it."""
        self._library.board_imu(self._handle, _IMU_STATES.index(state))

    def restart_imu(self) -> None:
        """The accelerometer alone loses its supply for a moment; it comes back asleep and repeats zeros until woken."""
        self._library.board_imu_restart(self._handle)

    def press_stop(self, pressed: bool = True) -> None:
        """Press the stop button, whose contact then opens, or let it go."""
        self._library.board_press_stop(self._handle, pressed)

    def power_off(self) -> None:
        """Cut the supply: pulses end, bytes on their way in are lost, nothing comes out."""
        self._library.board_power_off(self._handle)

    def power_on(self) -> None:
        """Switch the supply on: it boots."""
        self._library.board_power_on(self._handle, _POWER_ON, True)

    def power_cycle(self, off: float = 0.5) -> None:
        """Without power for so many seconds, which pass; then it boots."""
        self.power_off()
        self.run(off)
        self.power_on()

    def brown_out(self, low: float = 0.02) -> None:
        """The supply drops too low for so many seconds, which pass; then it boots, its memory still there."""
        self.power_off()
        self.run(low)
        self._library.board_power_on(self._handle, _BROWN_OUT, False)

    def reset(self) -> None:
        """Pull the reset pin for a moment, as opening the port of a real Uno does."""
        self.power_off()
        self.run(0.0001)
        self._library.board_power_on(self._handle, _RESET_PIN, False)

    def hang(self, *, interrupts: bool = True) -> None:
        """The firmware runs in a circle from now on; its interrupts are served still, or not."""
        if self._library.board_hang(self._handle, interrupts):
            raise RuntimeError("the firmware has no place to hang at")

    def write_eeprom(self, offset: int, data: bytes) -> None:
        """Change what the EEPROM holds, as a programmer does."""
        self._library.board_eeprom(self._handle, offset, data, len(data), True)

    def read_eeprom(self, offset: int, length: int) -> bytes:
        """What the EEPROM holds."""
        buffer = ctypes.create_string_buffer(length)
        self._library.board_eeprom(self._handle, offset, buffer, length, False)
        return buffer.raw

    def close(self) -> None:
        """Let go of it; harmless when repeated."""
        if self._board is not None:
            self._library.board_free(self._board)
            self._board = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def _handle(self) -> int:
        if self._board is None:
            raise ValueError("this microcontroller is closed")
        return self._board

    def _take_pulses(self) -> None:
        buffer = (_CPulse * _PULSES)()
        while count := self._library.board_pulses(self._handle, buffer, _PULSES):
            self._sort(buffer[:count])

    def _sort(self, ended: Sequence[_CPulse]) -> None:
        for pulse in ended:
            whole = Pulse(pulse.rise / FREQUENCY, pulse.channel, pulse.width * 1e6 / FREQUENCY)
            (self._cut if pulse.cut else self._pulses).append(whole)


def _loaded(path: Path) -> ctypes.CDLL:
    try:
        library = ctypes.CDLL(str(path))
    except OSError as error:
        raise UserError(
            f"the emulated board cannot be loaded ({error})",
            "apt-get install libsimavr-dev; then remove " + str(path),
        ) from error
    handle, number, text = ctypes.c_void_p, ctypes.c_double, ctypes.c_char_p
    size, cycles = ctypes.c_size_t, ctypes.c_uint64
    signatures: dict[str, tuple[object, list[object]]] = {
        "board_new": (handle, [text, cycles]),
        "board_free": (None, [handle]),
        "board_run": (ctypes.c_int, [handle, cycles]),
        "board_now": (cycles, [handle]),
        "board_power_off": (None, [handle]),
        "board_power_on": (None, [handle, ctypes.c_uint8, ctypes.c_bool]),
        "board_write": (None, [handle, text, size]),
        "board_read": (size, [handle, text, size]),
        "board_pulses": (size, [handle, ctypes.c_void_p, size]),
        "board_eeprom": (None, [handle, ctypes.c_uint16, text, ctypes.c_uint16, ctypes.c_bool]),
        "board_press_stop": (None, [handle, ctypes.c_bool]),
        "board_hang": (ctypes.c_int, [handle, ctypes.c_bool]),
        "board_feel": (None, [handle, number, number, number]),
        "board_noise": (None, [handle, number]),
        "board_imu": (None, [handle, ctypes.c_int]),
        "board_imu_restart": (None, [handle]),
    }
    for name, (result, arguments) in signatures.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library
