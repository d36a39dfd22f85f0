"""Finding a board and making sure that it is the right one."""

from __future__ import annotations

from collections.abc import Iterable

import serial

from testbed.hardware.clock import Clock
from testbed.hardware.failures import (
    HardwareFailure,
    LinkLost,
    NoAnswer,
    PortBusy,
    PortDenied,
    PortMissing,
    WrongBoard,
    WrongFirmware,
    WrongProtocol,
)
from testbed.hardware.line.link import Link, Listener, deaf
from testbed.hardware.line.ports import PortInfo, found_ports, open_port
from testbed.hardware.line.protocol import PROTOCOL, Frame, Identity, Request

PATIENCE = 3.0
"""s; a board that is reset by the opening of its port waits up to two in its boot loader."""
FIRMWARE = 1
"""The major version of the firmware that this speaks with."""

_RESET_CAUSES = ((3, "a watchdog reset"), (2, "a brown-out"), (1, "its reset pin"), (0, "power-on"))


def shake_hands(link: Link, clock: Clock, *, patience: float = PATIENCE) -> Identity:
    """Ask a board for its identity until it answers.

    Raises:
        NoAnswer: If it does not within ``patience`` seconds.
        LinkLost: If the port is gone.
        WrongProtocol: If it speaks another version.
        WrongFirmware: If its firmware is another one.
    """
    deadline = clock.now() + patience
    while True:
        try:
            body = link.request(Request.HELLO, bytes((PROTOCOL,)), judge=_is_identity, retries=0).body
            break
        except NoAnswer:
            if clock.now() >= deadline:
                raise NoAnswer(f"{link.name} does not answer on {link.path} for {patience:g} s") from None
    if not _is_ours(body):
        raise WrongProtocol(f"{link.name} speaks protocol {body[0]}, this version speaks {PROTOCOL}")
    identity = Identity.decode(body)
    if identity.firmware[0] != FIRMWARE:
        version = ".".join(map(str, identity.firmware))
        raise WrongFirmware(f"{link.name} has firmware {version}, this version needs {FIRMWARE}.x")
    return identity


def _is_identity(frame: Frame) -> bool:
    """Whether a reply is a whole identity, or the beginning of one of another version."""
    if not _is_ours(frame.body):
        return len(frame.body) > 0
    try:
        Identity.decode(frame.body)
    except ValueError:
        return False
    return True


def _is_ours(body: bytes) -> bool:
    return body[:1] == bytes((PROTOCOL,))


def ask(path: str, clock: Clock, *, patience: float = PATIENCE, listener: Listener = deaf) -> Identity:
    """The identity of the board at a port, which is opened for as long as it takes.

    Raises:
        HardwareFailure: As :func:`~testbed.hardware.line.ports.open_port` and :func:`shake_hands` do.
    """
    link = Link(open_port(path), clock, name=path, listener=listener)
    try:
        return shake_hands(link, clock, patience=patience)
    finally:
        link.close()


def find_board(unique_id: str, clock: Clock, globs: Iterable[str] = (), *, name: str = "") -> PortInfo:
    """The port where a board is now, by its unique id or its USB serial number.

    Ports are opened one after the other where USB does not tell; those that are in use are left alone.

    Raises:
        PortMissing: If it is nowhere.
        PortBusy: If it is nowhere, and another program has a port; PortDenied likewise.
    """
    ports = found_ports(globs)
    for port in ports:
        if is_usb_serial(port, unique_id):
            return port
    closed: HardwareFailure | None = None
    for port in ports:
        try:
            if ask(port.path, clock).unique_id == unique_id.casefold():
                return port
        except (PortBusy, PortDenied) as failure:
            closed = failure  # the board may be behind it
        except HardwareFailure:
            continue
    looked = f"{len(ports)} ports were looked at" if ports else "there are no serial ports"
    missing = f"the board {unique_id} {f'of {name} ' if name else ''}is not there ({looked})"
    if closed is not None:
        raise type(closed)(f"{missing}, but {closed.what}")
    raise PortMissing(missing)


def is_usb_serial(port: PortInfo, unique_id: str) -> bool:
    """Whether it is by its USB serial number that this port is known."""
    return bool(port.serial_number) and str(port.serial_number).casefold() == unique_id.casefold()


def check_board(identity: Identity, name: str, unique_id: str | None, servos: int) -> None:
    """Make sure that it is the right board and has enough servos.

    Raises:
        WrongBoard: If it is another one.
    """
    if unique_id is not None and unique_id.casefold() != identity.unique_id:
        shown = f"{identity.unique_id} ('{identity.board_id}')"
        raise WrongBoard(f"{shown} answers where {name} should be, which is {unique_id}")
    if len(identity.limits) < servos:
        raise WrongBoard(f"the board of {name} drives {len(identity.limits)} servos, the body has {servos}")


def reset_cause(identity: Identity) -> str:
    """Why a board booted last, in words."""
    for bit, words in _RESET_CAUSES:
        if identity.reset_cause >> bit & 1:
            return words
    return "an unknown cause"


def identity_now(port: serial.Serial, clock: Clock, name: str, listener: Listener) -> Identity | None:
    """Who answers at an open port, if anybody does and the port still is one."""
    try:
        return shake_hands(Link(port, clock, name=name, listener=listener), clock)
    except (NoAnswer, LinkLost, WrongProtocol, WrongFirmware):
        return None
