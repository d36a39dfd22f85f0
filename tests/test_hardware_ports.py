"""Opening ports: each refusal has its name and its mend."""

from __future__ import annotations

import itertools
import os
import pickle
from collections.abc import Iterator
from pathlib import Path

import pytest
import serial
from one_board import UNIQUE, Peer, Table

from testbed.errors import UserError
from testbed.hardware import failures
from testbed.hardware.emulation.wire import Wire
from testbed.hardware.failures import HardwareFailure, LinkLost, PortBusy, PortDenied, PortMissing
from testbed.hardware.line import ports as opening
from testbed.hardware.line.handshake import ask, find_board
from testbed.hardware.line.ports import PortInfo, found_ports, open_port, write_all

NAMED = [
    kind for kind in vars(failures).values() if isinstance(kind, type) and issubclass(kind, HardwareFailure)
]


@pytest.fixture
def wire(tmp_path: Path) -> Iterator[Wire]:
    wire = Wire(tmp_path / "ttyA")
    yield wire
    wire.close()


@pytest.mark.parametrize("kind", NAMED[1:])
def test_every_failure_says_in_one_line_how_to_mend_it_also_out_of_another_process(
    kind: type[HardwareFailure],
) -> None:
    failure = kind("this is wrong")
    assert isinstance(failure, UserError)
    assert failure.outcome == kind.__name__
    assert len(kind.usual_mend) > 8
    assert str(failure) == f"this is wrong; {kind.usual_mend}"
    copy = pickle.loads(pickle.dumps(kind("this is wrong", "do that")))
    assert type(copy) is kind
    assert str(copy) == "this is wrong; do that"


def test_a_port_that_is_not_there_is_missing(tmp_path: Path) -> None:
    with pytest.raises(PortMissing, match=r"there is no port .*ttyNone; check cable"):
        open_port(str(tmp_path / "ttyNone"))


def test_a_file_is_no_port(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(PortMissing, match="is no serial port"):
        open_port(str(tmp_path / "file"))
    with pytest.raises(HardwareFailure):
        open_port(str(tmp_path))


def test_a_port_of_another_user_is_denied(wire: Wire) -> None:
    Path(os.path.realpath(wire.path)).chmod(0o600 if os.geteuid() == 0 else 0)
    user = os.geteuid()
    if user == 0:
        for folder in Path(wire.path).parents:  # so that it is the port itself that is denied
            if str(folder) != "/" and folder.stat().st_uid == 0:
                folder.chmod(folder.stat().st_mode | 0o011)
        os.seteuid(65534)
    try:
        with pytest.raises(
            PortDenied, match=r"may not be opened by this user; join the port's group .*dialout"
        ):
            open_port(wire.path)
    finally:
        os.seteuid(user)


def test_a_port_that_is_in_use_is_busy_and_free_again_afterwards(wire: Wire) -> None:
    first = open_port(wire.path)
    with pytest.raises(PortBusy, match="another program has the port"):
        open_port(wire.path)
    first.close()
    open_port(wire.path).close()


def test_a_pulled_out_port_is_missing_and_there_again_under_the_same_name(wire: Wire) -> None:
    wire.unplug()
    assert not wire.plugged
    with pytest.raises(PortMissing):
        open_port(wire.path)
    wire.replug()
    open_port(wire.path).close()


def test_the_name_that_a_killed_bench_left_is_taken_over_but_no_file_is(tmp_path: Path) -> None:
    (tmp_path / "ttyA").symlink_to("/nowhere")
    wire = Wire(tmp_path / "ttyA")
    open_port(wire.path).close()
    wire.close()
    (tmp_path / "ttyB").write_text("somebody's")
    with pytest.raises(FileExistsError):
        Wire(tmp_path / "ttyB")
    assert (tmp_path / "ttyB").read_text() == "somebody's"


def test_ports_are_found_by_pattern_each_once(wire: Wire, tmp_path: Path) -> None:
    pattern = str(tmp_path / "tty*")
    assert [port.path for port in found_ports([pattern, pattern])][-1:] == [wire.path]


def test_a_board_is_found_by_its_id_wherever_it_is_and_busy_ports_are_left_alone(tmp_path: Path) -> None:
    peers = [Peer(), Peer(lambda frame: []), Peer()]
    wires = [Wire(tmp_path / f"tty{letter}") for letter in "ABC"]
    table = Table(*zip(peers, wires, strict=True))
    peers[0].identity = peers[0].identity.__class__(**{**vars(peers[0].identity), "unique_id": "ff" * 8})
    pattern = str(tmp_path / "tty*")
    busy = open_port(wires[0].path)
    assert find_board(UNIQUE, table, [pattern]).path == wires[2].path
    assert not peers[0].frames
    missing = r"the board f+ of student is not there \(3 ports were looked at\)"
    with pytest.raises(PortBusy, match=rf"{missing}, but another program has the port .*ttyA"):
        find_board("ff" * 8, table, [pattern], name="student")
    busy.close()
    with pytest.raises(PortMissing, match=missing.replace("f+", "e+")):
        find_board("ee" * 8, table, [pattern], name="student")
    assert find_board("FF" * 8, table, [pattern]).path == wires[0].path
    assert ask(wires[0].path, table).unique_id == "ff" * 8
    for wire in wires:
        wire.close()


def test_a_usb_serial_number_tells_without_opening_anything(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    ports = [PortInfo("/dev/a", serial_number="X1"), PortInfo("/dev/b", serial_number="x2")]
    monkeypatch.setattr("testbed.hardware.line.handshake.found_ports", lambda globs: ports)
    monkeypatch.setattr("testbed.hardware.line.handshake.ask", lambda *_: pytest.fail("was opened"))
    assert find_board("X2", Table()).path == "/dev/b"


def test_a_process_that_was_stopped_while_it_wrote_has_lost_nothing(
    wire: Wire, monkeypatch: pytest.MonkeyPatch
) -> None:
    port = open_port(wire.path)
    hours = itertools.count()
    monkeypatch.setattr("serial.serialutil.Timeout.TIME", lambda: 3600.0 * next(hours))
    write_all(port, "student", b"all of it")
    assert wire.from_host(0.0) == b"all of it"
    port.close()


def test_a_port_that_takes_nothing_any_more_is_a_lost_link(
    wire: Wire, monkeypatch: pytest.MonkeyPatch
) -> None:
    port = open_port(wire.path)
    monkeypatch.setattr(opening, "_FULL", 0.05)
    with pytest.raises(LinkLost, match="resource temporarily unavailable"):
        write_all(port, "student", bytes(1_000_000))
    port.close()


def test_an_open_port_never_waits(wire: Wire) -> None:
    port = open_port(wire.path)
    assert isinstance(port, serial.Serial)
    assert port.read(10) == b""
    port.close()
