"""Serial ports: which there are, what each says of itself, and opening one with every refusal named."""

from __future__ import annotations

import errno
import glob
import os
import select
import termios
from collections.abc import Iterable
from dataclasses import dataclass

import serial
from serial.tools import list_ports

from testbed.hardware.failures import HardwareFailure, LinkLost, PortBusy, PortDenied, PortMissing
from testbed.hardware.line.protocol import BAUD

_FULL = 1.0  # s; a port whose buffer stays full for so long takes nothing any more
_BUSY = {errno.EAGAIN, errno.EWOULDBLOCK, errno.EBUSY}
_MISSING = {errno.ENOENT, errno.ENODEV, errno.ENXIO, errno.EIO, errno.ENOTDIR}
_DENIED = {errno.EACCES, errno.EPERM}


@dataclass(frozen=True)
class PortInfo:
    """A serial port.

    Attributes:
        path: Where it is now; another one after the next plug.
        vendor: USB vendor id, if it is a USB port.
        product: USB product id.
        serial_number: What the USB device says; cheap adapters say nothing.
        description: In words.
    """

    path: str
    vendor: int | None = None
    product: int | None = None
    serial_number: str | None = None
    description: str = ""


def found_ports(extra_globs: Iterable[str] = ()) -> list[PortInfo]:
    """The machine's USB serial ports, and those that match further patterns, each once, sorted by path."""
    # A PC's own COM ports (ttyS*) are listed whether or not anything is there, and have no vendor.
    found = {
        port.device: PortInfo(port.device, port.vid, port.pid, port.serial_number, port.description or "")
        for port in list_ports.comports()
        if port.vid is not None
    }
    for pattern in extra_globs:
        for path in glob.glob(pattern):  # noqa: PTH207 - patterns are absolute as a rule, which Path refuses
            found.setdefault(path, PortInfo(path, description="named by a pattern"))
    return [found[path] for path in sorted(found)]


def open_port(path: str, *, baud: int = BAUD) -> serial.Serial:
    """Open a port for nobody else, without waiting in reads.

    Raises:
        PortMissing: If there is no such port.
        PortDenied: If this user may not.
        PortBusy: If another program has it.
        HardwareFailure: If the system refuses for another reason.
    """
    try:
        return serial.Serial(path, baud, timeout=0, exclusive=True)
    except (OSError, ValueError, termios.error) as error:
        raise _refused(path, error) from None


def read_all(port: serial.Serial, name: str) -> bytes:
    """What has come in, without waiting; the port is read until it is dry.

    Raises:
        LinkLost: If the port is gone.
    """
    try:
        return bytes(port.read(4096))
    except (OSError, TypeError, termios.error) as error:  # TypeError: closed by somebody else
        raise lost(port, name, error) from None


def write_all(port: serial.Serial, name: str, data: bytes) -> None:
    """Send bytes.

    Raises:
        LinkLost: If the port is gone or takes nothing.
    """
    # pyserial's own writing fails when its time is over, even if all was written: after a stopped process, say.
    left = memoryview(data)
    try:
        while left:
            try:
                left = left[os.write(port.fileno(), left) :]
            except BlockingIOError:
                if not select.select([], [port.fileno()], [], _FULL)[1]:
                    raise
    except (OSError, TypeError, termios.error) as error:
        raise lost(port, name, error) from None


def lost(port: serial.Serial, name: str, error: Exception) -> LinkLost:
    """What to say when an open port fails."""
    number = getattr(error, "errno", None)
    reason = os.strerror(number).lower() if number else "unplugged?"
    return LinkLost(f"the port of {name} ({port.port}) is gone ({reason})")


def _refused(path: str, error: Exception) -> HardwareFailure:
    number = getattr(error, "errno", None)
    if number is None and isinstance(error, termios.error) and error.args:
        number = error.args[0]
    if number in _MISSING:
        return PortMissing(f"there is no port {path}")
    if number in _DENIED:
        return PortDenied(f"the port {path} may not be opened by this user")
    if number in _BUSY:
        return PortBusy(f"another program has the port {path}")
    if number == errno.ENOTTY or "Could not configure port" in str(error):
        return PortMissing(f"{path} is no serial port", "name one that 'testbed hardware find' lists")
    return HardwareFailure(f"the port {path} cannot be opened ({error})", "check cable and adapter")
